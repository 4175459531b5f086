"""Bodies: lengths of bones, heading, and interpolation in a frame that turns with the body."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.skeleton import Skeleton
from dmae.files.mapped import by_frames, column_blocks
from dmae.numerics.compiled import compiled
from dmae.numerics.paths import Interpolation, connect, linear, local_parabola
from dmae.numerics.statistics import mean_known, median_over_frames

Bones = Sequence[tuple[int, int]]
"""Pairs of indices (parent, child), as in `Skeleton.bones`."""


def bone_lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the length of each of B bones (parent, child) in each frame, (F, P, B) m; NaN where an end is unknown."""
    ends = np.array(bones, int).reshape(-1, 2)
    xyz = xyz.astype(np.float64)
    return np.linalg.norm(xyz[..., ends[:, 1], :] - xyz[..., ends[:, 0], :], axis=-1)


def median_bone_lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the median length of each of B bones (parent, child) of each person, (P, B) m; NaN if not measured."""
    return median_over_frames(bone_lengths(xyz, bones))


def symmetric_bone_lengths(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the median length of each rigid bone of each person on both sides, (P, B) m; NaN if not measured."""
    bones = skeleton.rigid_bones
    lengths = by_frames(lambda xyz: bone_lengths(xyz, bones), xyz)
    order = {bone: i for i, bone in enumerate(bones)}
    mirror = skeleton.mirror
    partner = [order.get((mirror[a], mirror[b]), i) for i, (a, b) in enumerate(bones)]
    persons, count = lengths.shape[1:]
    partners = (count * np.arange(persons)[:, None] + partner).ravel()
    paths, medians = lengths.reshape(len(lengths), persons * count), np.empty(persons * count)
    # In blocks: copies of all are most of the memory that capture of a long recording takes.
    for columns, lengths_here in column_blocks(paths[..., None]):
        medians[columns] = median_over_frames(np.concatenate([lengths_here[..., 0], paths[:, partners[columns]]]))
    return medians.reshape(persons, count)


def parent_bone_lengths(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the length of the bone from each joint to its parent, (F, P, J) m; NaN where unknown, and for roots."""
    lengths = np.full(xyz.shape[:-1], np.nan)
    lengths[..., [joint for _, joint in bones]] = bone_lengths(xyz, bones)
    return lengths


def distance_to_bones(points: np.ndarray, xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return the distance (N,) from points (N, C) to the nearest known bone of a body (J, C); infinite if none."""
    parents, joints = (xyz[list(ends)] for ends in zip(*bones, strict=True))
    known = np.isfinite(parents).all(-1) & np.isfinite(joints).all(-1)
    start, along = parents[known], (joints - parents)[known]
    from_start = points[:, None] - start
    share = (from_start * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-9)
    distance = np.linalg.norm(from_start - np.clip(share, 0, 1)[..., None] * along, axis=-1)
    return distance.min(-1, initial=np.inf)


_MIN_POINTS, _MIN_EXTENT = 3, 0.02
"""Smallest number of points that determine a rotation, and smallest squared extent of the points across their longest
direction, as a share of the squared extent along it."""


def body_heading(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the heading of bodies (..., J, 3) from hips and shoulders, (...) rad; NaN where neither pair is known.

    The line between the hips and the line between the shoulders have equal weights, independent of their lengths.
    """
    left = np.zeros((*xyz.shape[:-2], 2))
    for part in ("hip", "shoulder"):
        if {f"l_{part}", f"r_{part}"} <= set(skeleton.joints):
            left_joint, right_joint = skeleton.index(f"l_{part}", f"r_{part}")
            across = xyz[..., left_joint, :2] - xyz[..., right_joint, :2]
            length = np.linalg.norm(across, axis=-1, keepdims=True)
            left += np.where(length > 1e-6, across / np.maximum(length, 1e-6), 0)
    return np.where((left != 0).any(-1), np.arctan2(-left[..., 0], left[..., 1]), np.nan)


def smooth_heading(xyz: np.ndarray, skeleton: Skeleton, frames: float) -> np.ndarray:
    """Return the heading of bodies (F, P, J, 3), interpolated over time and smoothed, (F, P) rad, unwrapped; never NaN.

    The heading is midway between the heading of the hips and the heading of the shoulders. Where one of the two is
    unknown, it is computed from the other and from the interpolated twist between them. If neither is known in any
    frame, the heading is 0. The standard deviation of the smoothing weights is in frames.
    """
    hips, shoulders = (_heading_of_pair(xyz, skeleton, joint) for joint in ("l_hip", "l_shoulder"))
    twist = connect(np.angle(np.exp(1j * (hips - shoulders)))[..., None])[..., 0]
    heading = np.where(np.isnan(shoulders), hips - twist / 2, shoulders + twist / 2)
    # Interpolate unit vectors instead of angles, because angles can be interpolated in two directions.
    direction = linear(np.stack([np.cos(heading), np.sin(heading)], -1))
    heading = np.unwrap(np.nan_to_num(np.arctan2(direction[..., 1], direction[..., 0])), axis=0)
    return local_parabola(heading[..., None], frames)[..., 0]


def body_rotations(xyz: np.ndarray, skeleton: Skeleton, frames: float) -> np.ndarray:
    """Return the rotations of bodies (F, P, J, 3) in the world, (F, P, 3, 3), from their heading or from their torso.

    The torso is used for your own skeletons, if they define a torso or have neither hips nor shoulders. The rotation is
    then the one that brings the usual shape of the torso nearest to its joints (Kabsch 1976), in frames with at least
    three known joints of the torso, and is interpolated in the others. Without any such frame it is the identity.
    `frames` is as in `smooth_heading`; rotations of the torso are smoothed with a quarter of it.
    """
    pairs = [{f"l_{part}", f"r_{part}"} for part in ("hip", "shoulder")]
    if not skeleton.defined or (skeleton.torso is None and any(pair <= set(skeleton.joints) for pair in pairs)):
        return rotation_z(smooth_heading(xyz, skeleton, frames))
    turned = np.broadcast_to(np.eye(3), (*xyz.shape[:2], 3, 3)).copy()
    for person in range(xyz.shape[1]):
        found = _torso_rotations(xyz[:, person][:, list(skeleton.trunk)])
        known = np.flatnonzero(~np.isnan(found).any((1, 2)))
        if len(known):
            quaternion = np.full((len(xyz), 4), np.nan)
            quaternion[known] = continuous(Rotation.from_matrix(found[known]).as_quat())
            turned[:, person] = Rotation.from_quat(local_parabola(linear(quaternion), frames / 4)).as_matrix()
    return turned


def _torso_rotations(points: np.ndarray) -> np.ndarray:
    """Return the rotations (F, 3, 3) from the usual shape of n points to the points (F, n, 3); NaN where unknown."""
    known = ~np.isnan(points).any(-1)
    if not len(points) or known.sum(1).max() < _MIN_POINTS:
        return np.full((len(points), 3, 3), np.nan)
    reference = points[known.sum(1).argmax()]
    found = _fitted(points, reference)
    # Fit again, with the median shape over all frames.
    middle = np.where(known[..., None], points, 0).sum(1) / np.maximum(known.sum(1), 1)[:, None]
    shapes = np.einsum("fji,fnj->fni", found, points - middle[:, None])
    complete = known.sum(1) == known.any(0).sum()
    usual = median_over_frames(shapes[complete]) if complete.any() else reference
    return _fitted(points, usual)


def _fitted(points: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the rotations (F, 3, 3) that bring `reference` (n, 3) nearest to `points` (F, n, 3); NaN where unknown."""
    both = (~np.isnan(points).any(-1) & ~np.isnan(reference).any(-1))[..., None]
    count = np.maximum(both.sum(1), 1)
    there, here = np.where(both, points, 0), np.where(both, reference, 0)
    there = np.where(both, there - (there.sum(1) / count)[:, None], 0)
    here = np.where(both, here - (here.sum(1) / count)[:, None], 0)
    left, sizes, right = np.linalg.svd(np.einsum("fni,fnj->fij", there, here))
    sign = np.sign(np.linalg.det(left @ right))
    left[..., 2] *= sign[:, None]
    determined = (both.sum((1, 2)) >= _MIN_POINTS) & (sizes[:, 1] > _MIN_EXTENT * sizes[:, 0])
    return np.where(determined[:, None, None], left @ right, np.nan)


def continuous(quaternions: np.ndarray) -> np.ndarray:
    """Return the same rotations as quaternions (F, ..., 4) with signs such that neighbours are near each other."""
    flips = np.sign((quaternions[1:] * quaternions[:-1]).sum(-1))
    signs = np.concatenate([np.ones_like(quaternions[:1, ..., 0]), np.where(flips == 0, 1, flips)])
    return quaternions * np.cumprod(signs, 0)[..., None]


def rotation_z(angle: np.ndarray) -> np.ndarray:
    """Return the rotations (..., 3, 3) about z by angles (...), rad."""
    cos, sin, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], -1).reshape(*angle.shape, 3, 3)


def rotate_z(xyz: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return points (..., 3) rotated about z by angles (...), rad."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = xyz[..., 0], xyz[..., 1], xyz[..., 2]
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], -1)


def _heading_of_pair(xyz: np.ndarray, skeleton: Skeleton, left_joint: str) -> np.ndarray:
    """Return the heading (F, P) rad of a line from left joint to right one, in the first part with it, or NaN."""
    for left, right in enumerate(skeleton.mirror):
        if skeleton.joints[left].rpartition(".")[2] == left_joint:
            across = xyz[:, :, left] - xyz[:, :, right]
            return np.arctan2(-across[..., 0], across[..., 1])
    return np.full(xyz.shape[:2], np.nan)


HEADING_SMOOTHING = 0.2
"""s; standard deviation of the weights that smooth the heading. Hips are close together, so their heading is noisy."""

FARTHEST = 0.5
"""m; largest distance from the expected position of a joint to its ray. A ray farther away probably shows another
person."""
_ALONG_RAY, _BONE_ERROR = 0.1, 0.08
"""m; standard deviations of the position of a joint along its ray, and of a measured bone length."""
BONE_STRETCH, BONE_SLACK = 0.25, 0.05
"""A bone is broken if its length differs by more than this share plus this number of metres from its usual length."""
_STEPS = 8  # Number of Gauss-Newton steps


def interpolate_bodies(
    xyz: np.ndarray, skeleton: Skeleton, fps: float, through: Interpolation, rays: np.ndarray | None = None
) -> "Bodies":
    """Return bodies with filled gaps; `Bodies.filled` contains the positions.

    The frame of the body is rotated about the vertical axis by the smoothed heading of hips and shoulders. If your own
    skeleton has no hips and shoulders, the frame is rotated in space by the torso, see `body_rotations`. A hidden joint
    of the torso is placed by its interpolated offsets from the measured joints of the torso. A hidden joint of a limb
    is placed by its interpolated offset from its parent. Both are then shifted so that the path is continuous with the
    measurements before and after the gap. Where the whole torso is hidden, its root is interpolated in the world.

    Args:
        xyz: (F, P, J, 3) m, world; NaN where hidden.
        through: Function that interpolates offsets over time.
        rays: (F, P, J, 2, 3) rays of unmeasured joints, see `Poses3D.rays`. A joint with a ray is moved onto the ray,
            and its unmeasured descendants in the skeleton move with it.
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
    for joint in parents_first(skeleton):
        if joint in attached:
            parent = parents[joint]
            offset = offsets[attached.index(joint)]
            bodies.place(joint, bodies.filled[:, :, parent] + offset, None if joint in torso else parent)
        if np.isnan(bodies.filled[:, :, joint]).any():
            # This joint is the root, or was never measured together with its parent.
            bodies.place(joint, through(bodies.filled[:, :, joint]))
    return bodies


class Bodies:
    """Bodies that are filled joint by joint.

    Attributes:
        xyz: (F, P, J, 3) m, world, as given.
        filled: (F, P, J, 3) m, world, with the joints that were placed so far.
        rays: As in `interpolate_bodies`.
        world_from_body: (F, P, 3, 3) rotations.
        torso: Joints of the torso, parents first.
        parents: (J,) parent of each joint; -1 for none. The parent of a root outside the torso, such as COCO's nose, is
            the first joint of the torso.
        stretching: Joints with a bone of variable length.
        attached: Joints with a parent, parents first.
    """

    def __init__(self, xyz: np.ndarray, skeleton: Skeleton, rays: np.ndarray | None, world_from_body: np.ndarray):
        self.xyz, self.filled, self.rays, self.world_from_body = xyz, xyz.copy(), rays, world_from_body
        order = parents_first(skeleton)
        self.stretching = skeleton.stretching
        self.torso = torso = [joint for joint in order if joint in skeleton.trunk]
        self.parents = [torso[0] if parent < 0 and torso else parent for parent in skeleton.parents]
        self.attached = [joint for joint in order if self.parents[joint] not in (-1, joint)]

    def offsets(self, joints: list[int], anchors: list[int], through: Interpolation) -> np.ndarray:
        """Return the vectors (F, P, n, 3) m, world, from anchors to joints, interpolated in the frame of the body."""
        offsets = self.in_body(self.xyz[:, :, joints] - self.xyz[:, :, anchors])
        return self.in_world(through(offsets))

    def place(self, joint: int, estimate: np.ndarray, parent: int | None = None) -> None:
        """Fill missing positions of a joint by an estimate (F, P, 3) m, world, moved to measurements and rays.

        A parent is given if the bone to it has a constant length.
        """
        if not np.isnan(self.filled[:, :, joint]).any():
            return
        xyz = self.xyz[:, :, joint]
        # The error of the estimate inside a gap is about its error at the samples on both sides: subtract it.
        estimate = estimate + connect(xyz - estimate)
        if self.rays is not None:
            hidden = np.isnan(xyz[..., 0])
            frame, person = np.nonzero(hidden & ~np.isnan(self.rays[:, :, joint, 0, 0]))
            start, ray = estimate[frame, person], self.rays[frame, person, joint]
            bone = np.full(3, np.nan), np.full(1, np.nan)
            if parent is not None and joint not in self.stretching:
                lengths = median_bone_lengths(self.xyz, [(parent, joint)])[:, 0]
                bone = self.filled[frame, person, parent], lengths[person]
            moved = np.where(hidden[..., None], np.nan, np.zeros(3))
            moved[frame, person] = _onto_rays(start, ray, *bone) - start
            # Interpolate the displacement, so that a joint does not jump in the frame after its last ray.
            estimate = estimate + connect(moved)
        self.filled[:, :, joint] = np.where(np.isnan(self.filled[:, :, joint]), estimate, self.filled[:, :, joint])

    def in_body(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors (F, P, n, 3), given in the world, in the frame of the body."""
        return vectors @ self.world_from_body

    def in_world(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors (F, P, n, 3), given in the frame of the body, in the world."""
        return vectors @ self.world_from_body.swapaxes(-1, -2)


def _onto_rays(estimate: np.ndarray, rays: np.ndarray, parent: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Return points (n, 3) m, moved onto their rays to positions at which bones have about their usual lengths.

    The position minimises the sum of two squared distances: to the point of the ray nearest to the estimate, in units
    of `_ALONG_RAY`, and to the sphere of radius `length` (n,) m around `parent` (n, 3), in units of `_BONE_ERROR`.
    `rays` (n, 2, 3) are origins and unit directions. NaN for points too far from their rays, and bones too long or too
    short.
    """
    # Copies, as each layout of arrays would be compiled for.
    given = estimate, rays, np.broadcast_to(parent, estimate.shape), np.broadcast_to(length, len(estimate))
    return _place_on_rays(*(np.array(array, np.float64, order="C") for array in given))


@compiled()
def _place_on_rays(estimate, rays, parent, length):
    placed = np.full(estimate.shape, np.nan)
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
        # The length of the bone at distance `along` on the ray is sqrt(before + 2 along towards + along^2).
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
        if abs(bone - length[i]) > BONE_STRETCH * length[i] + BONE_SLACK:
            continue
        for k in range(3):
            placed[i, k] = rays[i, 0, k] + (depth + along) * rays[i, 1, k]
    return placed


def joint_depths(skeleton: Skeleton) -> list[int]:
    """Return how many bones each joint (J,) is from its root."""
    depths = []
    for joint in range(len(skeleton)):
        depths.append(0)
        while (joint := skeleton.parents[joint]) >= 0:
            depths[-1] += 1
    return depths


def parents_first(skeleton: Skeleton) -> list[int]:
    """Return all joints, parents before their children."""
    return np.argsort(joint_depths(skeleton), kind="stable").tolist()
