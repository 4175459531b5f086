"""Interpolation in the body: offsets between joints, in a frame that turns with the body, change least over time."""

from copy import copy

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.numerics.bones import median_bone_lengths
from dmae.numerics.compiled import compiled
from dmae.numerics.heading import body_rotations
from dmae.numerics.interpolation import Interpolation, connect
from dmae.numerics.robust import mean_known

HEADING_SMOOTHING = 0.2
"""s over which the heading is smoothed: hips are a narrow base to measure it from."""

FARTHEST = 0.5
"""m from where a joint is expected to its ray; a ray farther away is taken to be of another person."""
_ALONG_RAY, _BONE_ERROR = 0.1, 0.08
"""m; standard deviations of a joint's place along its ray, and of a measured bone length."""
_RELATIVE_TOLERANCE, _TOLERANCE = 0.25, 0.05
"""A joint is not moved to its ray where its bone would be off by more than this share and this many metres, as in
`dmae.reconstruction.pruning`."""
_STEPS = 8
"""Of Gauss-Newton."""


def interpolate(
    xyz: np.ndarray,
    skeleton: Skeleton,
    fps: float,
    through: Interpolation,
    rays: np.ndarray | None = None,
) -> "Bodies":
    """Fill the gaps of (F, P, J, 3) wherever anything is known; `Bodies.filled` is the result.

    The frame is rotated about the vertical by the heading of hips and shoulders, smoothed; where a skeleton of your own
    has none, in space by its torso. A hidden joint of the torso
    is placed by its interpolated offsets from the torso joints that are measured, a hidden joint of a limb by its
    offset from its parent. Both are then moved to meet what was measured before and after. Where the whole torso is
    hidden its root is interpolated in the world.

    Args:
        xyz: (F, P, J, 3) m, world; NaN where hidden.
        through: How offsets are interpolated over time.
        rays: (F, P, J, 2, 3) on which hidden joints are known to be, see `Poses3D.rays`. Joints are moved there, and
            the joints below them in the skeleton move along.
    """
    bodies = Bodies(xyz, skeleton, rays, body_rotations(xyz, skeleton, HEADING_SMOOTHING * fps))
    torso, parents = bodies.torso, bodies.parents
    for joint in torso:
        anchors = [anchor for anchor in torso if anchor != joint]
        bodies.place(
            joint, mean_known(xyz[:, :, anchors] + bodies.offsets([joint] * len(anchors), anchors, through), 2)
        )
    attached = bodies.attached
    offsets = np.moveaxis(bodies.offsets(attached, [parents[j] for j in attached], through), 2, 0)
    for joint in _parents_first(skeleton):
        if joint in attached:
            parent = parents[joint]
            offset = offsets[attached.index(joint)]
            bodies.place(joint, bodies.filled[:, :, parent] + offset, None if joint in torso else parent)
        if np.isnan(bodies.filled[:, :, joint]).any():
            # The root, or a joint never measured together with its parent.
            bodies.place(joint, through(bodies.filled[:, :, joint]))
    return bodies


class Bodies:
    """Bodies being filled joint by joint.

    Attributes:
        xyz: (F, P, J, 3) m, world, as given; `filled` with the joints placed so far.
        rays: As for `interpolate`.
        world_from_body: (F, P, 3, 3)
        torso: Joints of the torso, parents first.
        parents: (J,) parent of each joint, -1 for none. A root outside the torso, such as COCO's nose, has the root of
            the torso for parent.
        stretching: Joints with a bone that changes its length.
        attached: Joints that have a parent, parents first.
    """

    def __init__(self, xyz: np.ndarray, skeleton: Skeleton, rays: np.ndarray | None, world_from_body: np.ndarray):
        self.xyz, self.filled, self.rays, self.world_from_body = xyz, xyz.copy(), rays, world_from_body
        order = _parents_first(skeleton)
        self.stretching = skeleton.stretching
        self.torso = torso = [joint for joint in order if joint in skeleton.trunk]
        self.parents = [torso[0] if parent < 0 and torso else parent for parent in skeleton.parents]
        self.attached = [joint for joint in order if self.parents[joint] not in (-1, joint)]

    def copy(self) -> "Bodies":
        """Return bodies that can be filled in another way."""
        other = copy(self)
        other.filled = self.filled.copy()
        return other

    def offsets(self, joints: list[int], anchors: list[int], through: Interpolation) -> np.ndarray:
        """Return (F, P, n, 3) from anchors to joints, world, interpolated in the body over frames that have both."""
        offsets = self.in_body(self.xyz[:, :, joints] - self.xyz[:, :, anchors])
        return self.in_world(through(offsets))

    def place(self, joint: int, estimate: np.ndarray, parent: int | None = None) -> None:
        """Fill what is missing of a joint by an estimate (F, P, 3), moved to meet what was measured, and onto rays.

        With a parent the bone between them keeps its length.
        """
        if not np.isnan(self.filled[:, :, joint]).any():
            return
        xyz = self.xyz[:, :, joint]
        # An estimate that misses the samples on both sides of a gap misses the path within it by about as much.
        estimate = estimate + connect(xyz - estimate)
        if self.rays is not None:
            hidden = np.isnan(xyz[..., 0])
            frame, person = np.nonzero(hidden & ~np.isnan(self.rays[:, :, joint, 0, 0]))
            start, ray = estimate[frame, person], self.rays[frame, person, joint]
            bone = (np.nan, np.nan)
            if parent is not None and joint not in self.stretching:
                lengths = median_bone_lengths(self.xyz, [(parent, joint)])[:, 0]
                bone = self.filled[frame, person, parent], lengths[person]
            moved = np.where(hidden[..., None], np.nan, np.zeros(3))
            moved[frame, person] = _onto_rays(start, ray, *bone) - start
            # A joint does not jump back in the frame where its ray ends.
            estimate = estimate + connect(moved)
        self.filled[:, :, joint] = np.where(np.isnan(self.filled[:, :, joint]), estimate, self.filled[:, :, joint])

    def in_body(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors (F, P, n, 3) of the world in the frame of the body."""
        return vectors @ self.world_from_body

    def in_world(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors (F, P, n, 3) of the body's frame in the world."""
        return vectors @ self.world_from_body.swapaxes(-1, -2)


def _onto_rays(estimate: np.ndarray, rays: np.ndarray, parent: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Return points (n, 3) moved onto their rays (n, 2, 3), to where their bones have about their usual length.

    Along the ray the sum of two squared distances is minimised, in units of `_ALONG_RAY` and `_BONE_ERROR`: from the
    point of the ray nearest to the estimate, and from the sphere about the parent (n, 3) of radius `length` (n,), m;
    NaN where either is unknown. Points too far from their rays, or with bones too long or too short, are NaN.
    """
    placed = np.full(estimate.shape, np.nan)
    parent = np.broadcast_to(np.asarray(parent, np.float64), estimate.shape)
    length = np.broadcast_to(np.asarray(length, np.float64), len(estimate))
    _place_on_rays(np.asarray(estimate, np.float64), rays.astype(np.float64), parent, length, placed)
    return placed


@compiled()
def _place_on_rays(estimate, rays, parent, length, placed):
    """Write the points of `_onto_rays` that are near enough; `placed` (n, 3) is filled with NaN by the caller."""
    for i in range(len(estimate)):
        depth = 0.0
        for k in range(3):
            depth += (estimate[i, k] - rays[i, 0, k]) * rays[i, 1, k]
        away, before, towards = 0.0, 0.0, 0.0
        for k in range(3):
            point = rays[i, 0, k] + depth * rays[i, 1, k]
            away += (point - estimate[i, k]) ** 2
            before += (point - parent[i, k]) ** 2
            towards += (point - parent[i, k]) * rays[i, 1, k]
        if not (depth > 0 and np.sqrt(away) < FARTHEST):
            continue
        # Along the ray the bone's length is sqrt(before + 2 along towards + along^2).
        along = 0.0
        for _ in range(_STEPS):
            current = max(np.sqrt(max(before + 2 * along * towards + along * along, 0.0)), 1e-6)
            slope = (towards + along) / current
            gradient = along / _ALONG_RAY**2 + (current - length[i]) * slope / _BONE_ERROR**2
            step = gradient / (1 / _ALONG_RAY**2 + slope**2 / _BONE_ERROR**2)
            if np.isnan(step):
                break
            along -= min(max(step, -_ALONG_RAY), _ALONG_RAY)
        bone = np.sqrt(max(before + 2 * along * towards + along * along, 0.0))
        if abs(bone - length[i]) > _RELATIVE_TOLERANCE * length[i] + _TOLERANCE:
            continue
        for k in range(3):
            placed[i, k] = rays[i, 0, k] + (depth + along) * rays[i, 1, k]


def _parents_first(skeleton: Skeleton) -> list[int]:
    """Return all joints, parents before their children."""
    depth = []
    for joint in range(len(skeleton)):
        depth.append(0)
        while (joint := skeleton.parents[joint]) >= 0:
            depth[-1] += 1
    return [int(joint) for joint in np.argsort(depth, kind="stable")]
