"""Interpolation of what moves least: offsets between joints, in a frame that turns with the body."""

import numpy as np

from dmae.metrics import gap_lengths, mean_known
from dmae.recall import recall
from dmae.series import Interpolation, linear, local_parabola
from dmae.skeleton import Skeleton

HEADING = 0.2
"""s over which the direction that a body faces is smoothed: hips are a narrow base to tell it from."""

SHORT = 0.2
"""s; over holes shorter than this joints go on as they went rather than as they usually do."""

FARTHEST = 0.5
"""m from where a joint is expected to its ray; beyond, the ray is somebody else's."""
_ALONG, _BONE = 0.1, 0.08
"""m; how far from where it is expected a joint is along its ray, and by how much bones change as they are measured."""
_STRETCH, _SLACK = 0.25, 0.05
"""Bones that would be off by more than this share and this many metres do not lead to a ray, as in `dmae.prune`."""
_STEPS = 8
"""Of Gauss-Newton."""

_TORSO = {"mid_hip", "neck", "l_hip", "r_hip", "l_shoulder", "r_shoulder", "bottom_head"}


def interpolate(
    xyz: np.ndarray,
    skeleton: Skeleton,
    fps: float,
    through: Interpolation,
    rays: np.ndarray | None = None,
    recalling: bool = False,
) -> np.ndarray:
    """(F, P, J, 3) with holes filled wherever there is something to go by.

    The frame is turned about the vertical as hips and shoulders are, smoothed. A hidden joint of the torso is
    placed by its interpolated offsets from those torso joints that are measured, a hidden joint of a limb
    by that from its parent; either is moved so that it meets what was measured before and after. Where the whole
    torso is hidden its root is interpolated in the world.

    Args:
        xyz: (F, P, J, 3) m, world; NaN where hidden.
        through: How offsets are interpolated over time.
        rays: (F, P, J, 2, 3) on which hidden joints are known to be, see `Poses3D.rays`; they are moved there, and
            what hangs from them with them.
        recalling: Then place limbs again, as the person held them when the rest of the body was alike
            (`dmae.recall`), the more so the longer they are hidden.
    """
    bodies = _Bodies(xyz, rays, _heading(xyz, skeleton, HEADING * fps))
    order = _from_root(skeleton)
    torso = [joint for joint in order if _part(skeleton, joint) in _TORSO]
    for joint in torso:
        anchors = [anchor for anchor in torso if anchor != joint]
        bodies.put(joint, mean_known(xyz[:, :, anchors] + bodies.offsets([joint] * len(anchors), anchors, through), 2))
    # A root outside the torso, as COCO's nose, hangs on the torso all the same.
    parents = [torso[0] if parent < 0 and torso else parent for parent in skeleton.parents]
    hanging = [joint for joint in order if parents[joint] not in (-1, joint)]
    placed = np.moveaxis(bodies.offsets(hanging, [parents[j] for j in hanging], through), 2, 0)
    for joint in order:
        if joint in hanging:
            parent = parents[joint]
            offset = placed[hanging.index(joint)]
            bodies.put(joint, bodies.filled[:, :, parent] + offset, None if joint in torso else parent)
        # The root, or a joint never measured together with its parent.
        bodies.put(joint, through(bodies.filled[:, :, joint]))
    if recalling:
        for joint in (joint for joint in hanging if joint not in torso):
            others = [other for other in hanging if not _hangs(other, joint, parents, torso)]
            bodies.put_as_recalled(joint, others, parents, fps)
    return bodies.filled


class _Bodies:
    """Bodies being filled joint by joint.

    Attributes:
        xyz: (F, P, J, 3) m, world, as given; `filled` as far as done.
        rays: As for `interpolate`.
        world_from_body: (F, P, 3, 3)
    """

    def __init__(self, xyz: np.ndarray, rays: np.ndarray | None, world_from_body: np.ndarray):
        self.xyz, self.filled, self.rays, self.world_from_body = xyz, xyz.copy(), rays, world_from_body

    def offsets(self, joints: list[int], anchors: list[int], through: Interpolation) -> np.ndarray:
        """(F, P, n, 3) from anchors to joints, world, interpolated in the body over the frames that have both."""
        apart = self._in_body(self.xyz[:, :, joints] - self.xyz[:, :, anchors])
        return self._in_world(through(apart))

    def put(self, joint: int, estimate: np.ndarray, parent: int | None = None) -> None:
        """Fill what is still open of a joint, (F, P, 3): where `estimate` has it, moved to meet what was measured, and
        onto rays. With a parent its bone keeps its length."""
        if not np.isnan(self.filled[:, :, joint]).any():
            return
        xyz = self.xyz[:, :, joint]
        # What misses the samples on both sides of a hole misses what is in it by about as much.
        estimate = estimate + np.nan_to_num(linear(xyz - estimate))
        if self.rays is not None:
            hidden = np.isnan(xyz[..., 0])
            frame, person = np.nonzero(hidden & ~np.isnan(self.rays[:, :, joint, 0, 0]))
            start, ray = estimate[frame, person], self.rays[frame, person, joint]
            held = (np.nan, np.nan)
            if parent is not None:
                held = self.filled[frame, person, parent], self._lengths(joint, parent)[person]
            moved = np.where(hidden[..., None], np.nan, np.zeros(3))
            moved[frame, person] = _onto(start, ray, *held) - start
            # A joint does not jump back when nobody sees it any more.
            estimate = estimate + np.nan_to_num(linear(moved))
        self.filled[:, :, joint] = np.where(np.isnan(self.filled[:, :, joint]), estimate, self.filled[:, :, joint])

    def put_as_recalled(self, joint: int, others: list[int], parents: list[int], fps: float) -> None:
        """Place a joint anew by `others`, which are placed."""
        parent, first = parents[joint], self.filled[:, :, joint].copy()
        known = ~np.isnan(self.xyz[:, :, [joint, parent], 0]).any(-1)
        hidden = np.isnan(self.xyz[:, :, joint, 0])
        if not (hidden & ~np.isnan(first[..., 0])).any():
            return
        beside = self._in_body(self.filled - self.filled[:, :, parents])
        expected = [recall(beside[:, i], joint, others, known[:, i], hidden[:, i], fps) for i in range(first.shape[1])]
        offset = self._in_world(np.stack(expected, 1)[:, :, None])[:, :, 0]
        self.filled[:, :, joint] = self.xyz[:, :, joint]
        self.put(joint, self.filled[:, :, parent] + offset, parent)
        squared = gap_lengths(~hidden)[..., None] ** 2
        moved = squared / (squared + (SHORT * fps) ** 2) * (self.filled[:, :, joint] - first)
        self.filled[:, :, joint] = np.where(hidden[..., None], first + np.nan_to_num(moved), first)

    def _lengths(self, joint: int, parent: int) -> np.ndarray:
        """(P,) m, median; NaN if never measured."""
        length = np.linalg.norm(self.xyz[:, :, joint] - self.xyz[:, :, parent], axis=-1)
        known = ~np.isnan(length).all(0)
        medians = np.full(length.shape[1], np.nan)
        medians[known] = np.nanmedian(length[:, known], 0)
        return medians

    def _in_body(self, vectors: np.ndarray) -> np.ndarray:
        return np.einsum("fpji,fpnj->fpni", self.world_from_body, vectors)

    def _in_world(self, vectors: np.ndarray) -> np.ndarray:
        return np.einsum("fpij,fpnj->fpni", self.world_from_body, vectors)


def _hangs(joint: int, from_joint: int, parents: list[int], torso: list[int]) -> bool:
    """Whether a joint is another, or hangs from it on the way to the torso, which hangs from nothing."""
    while joint != from_joint and joint not in torso and parents[joint] >= 0:
        joint = parents[joint]
    return from_joint in (joint, parents[joint])


def turn(xyz: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Points (..., 3) turned about z by angles (...), rad."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = xyz[..., 0], xyz[..., 1], xyz[..., 2]
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], -1)


def _onto(estimate: np.ndarray, rays: np.ndarray, parent: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Points (n, 3) moved onto their rays (n, 2, 3), to where on it their bones are about as long as ever.

    Along the ray the squares of two distances are weighed, in units of `_ALONG` and `_BONE`: from the point on it
    nearest to the estimate, and from the sphere about the parent (n, 3) of radius `length` (n,), m; NaN where either
    is unknown. Points too far from their rays for themselves or for their bones are NaN.
    """
    centre, direction = rays[..., 0, :].astype(np.float64), rays[..., 1, :].astype(np.float64)
    depth = ((estimate - centre) * direction).sum(-1, keepdims=True)
    point = centre + depth * direction
    far = ~((depth[..., 0] > 0) & (np.linalg.norm(point - estimate, axis=-1) < FARTHEST))
    along = np.zeros(estimate.shape[:-1])
    for _ in range(_STEPS):
        bone = point + along[..., None] * direction - parent
        now = np.maximum(np.linalg.norm(bone, axis=-1), 1e-6)
        slope = (bone * direction).sum(-1) / now
        gradient = along / _ALONG**2 + (now - length) * slope / _BONE**2
        along = along - np.nan_to_num(gradient / (1 / _ALONG**2 + slope**2 / _BONE**2)).clip(-_ALONG, _ALONG)
    point = point + along[..., None] * direction
    far |= np.abs(np.linalg.norm(point - parent, axis=-1) - length) > _STRETCH * length + _SLACK
    return np.where(far[..., None], np.nan, point)


def _part(skeleton: Skeleton, joint: int) -> str:
    """A joint's name without the skeleton it has in a fused one."""
    return skeleton.joints[joint].rpartition(".")[2]


def _from_root(skeleton: Skeleton) -> list[int]:
    """All joints, parents first."""
    depth = []
    for joint in range(len(skeleton)):
        depth.append(0)
        while (joint := skeleton.parents[joint]) >= 0:
            depth[-1] += 1
    return [int(joint) for joint in np.argsort(depth, kind="stable")]


def _heading(xyz: np.ndarray, skeleton: Skeleton, reach: float) -> np.ndarray:
    """(F, P, 3, 3) world from body: rotations about the vertical, smoothed over `reach` frames.

    The heading is midway between that of the hips and that of the shoulders; where one of them is hidden,
    the other and the interpolated twist between them stand for it.
    """
    hips, shoulders = (_facing(xyz, skeleton, part) for part in ("l_hip", "l_shoulder"))
    twist = np.angle(np.exp(1j * (hips - shoulders)))
    twist = np.nan_to_num(linear(twist[..., None])[..., 0])
    turn = np.where(np.isnan(shoulders), hips - twist / 2, shoulders + twist / 2)
    # Interpolated as vectors: between two angles there are two ways round.
    facing = linear(np.stack([np.cos(turn), np.sin(turn)], -1))
    turn = np.unwrap(np.nan_to_num(np.arctan2(facing[..., 1], facing[..., 0])), axis=0)
    turn = local_parabola(turn[..., None], reach)[..., 0]
    cos, sin, zero, one = np.cos(turn), np.sin(turn), np.zeros_like(turn), np.ones_like(turn)
    return np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], -1).reshape(*turn.shape, 3, 3)


def _facing(xyz: np.ndarray, skeleton: Skeleton, part: str) -> np.ndarray:
    """(F, P) rad about the vertical of the line from a part's right-hand partner to it, NaN where unknown."""
    for left, right in enumerate(skeleton.mirror):
        if _part(skeleton, left) == part:
            across = xyz[:, :, left] - xyz[:, :, right]
            return np.arctan2(-across[..., 0], across[..., 1])
    return np.full(xyz.shape[:2], np.nan)
