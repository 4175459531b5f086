"""Interpolation in the frame of the body: offsets between joints change least in a frame that turns with the body."""

from copy import copy

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.numerics.bones import median_bone_lengths
from dmae.numerics.compiled import compiled
from dmae.numerics.heading import body_rotations
from dmae.numerics.interpolation import Interpolation, connect
from dmae.numerics.robust import mean_known

HEADING_SMOOTHING = 0.2
"""s; standard deviation of the weights that smooth the heading. Hips are close together, so their heading is noisy."""

FARTHEST = 0.5
"""m; largest distance from the expected position of a joint to its ray. A ray farther away probably shows another
person."""
_ALONG_RAY, _BONE_ERROR = 0.1, 0.08
"""m; standard deviations of the position of a joint along its ray, and of a measured bone length."""
_RELATIVE_TOLERANCE, _TOLERANCE = 0.25, 0.05
"""A joint is not moved to its ray if the length of its bone would then differ by more than this share plus this number
of metres, as in `dmae.reconstruction.pruning`."""
_STEPS = 8
"""Number of Gauss-Newton steps."""


def interpolate(
    xyz: np.ndarray,
    skeleton: Skeleton,
    fps: float,
    through: Interpolation,
    rays: np.ndarray | None = None,
) -> "Bodies":
    """Return bodies with filled gaps; `Bodies.filled` contains the positions.

    The frame of the body is rotated about the vertical axis by the smoothed heading of hips and shoulders. If your own
    skeleton has no hips and shoulders, the frame is rotated in space by the torso, see `body_rotations`. A hidden joint
    of the torso is placed by its interpolated offsets from the measured joints of the torso. A hidden joint of a limb
    is placed by its interpolated offset from its parent. Both are then shifted so that the path is continuous with the
    measurements before and after the gap. Where the whole torso is hidden, its root is interpolated in the world.

    Args:
        xyz: (F, P, J, 3) m, world; NaN where hidden.
        skeleton: Skeleton of the J joints.
        fps: Frames per second.
        through: Function that interpolates offsets over time.
        rays: (F, P, J, 2, 3) rays on which hidden joints are, see `Poses3D.rays`. A joint with a ray is moved onto the
            ray, and its hidden descendants in the skeleton move with it.
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
            # This joint is the root, or was never measured together with its parent.
            bodies.place(joint, through(bodies.filled[:, :, joint]))
    return bodies


class Bodies:
    """Bodies that are filled joint by joint.

    Attributes:
        xyz: (F, P, J, 3) m, world, as given.
        filled: (F, P, J, 3) m, world, with the joints that were placed so far.
        rays: As in `interpolate`.
        world_from_body: (F, P, 3, 3) rotations.
        torso: Joints of the torso, parents first.
        parents: (J,) parent of each joint; -1 for none. The parent of a root outside the torso, such as COCO's nose, is
            the first joint of the torso.
        stretching: Joints with a bone of variable length.
        attached: Joints with a parent, parents first.
    """

    def __init__(self, xyz: np.ndarray, skeleton: Skeleton, rays: np.ndarray | None, world_from_body: np.ndarray):
        self.xyz, self.filled, self.rays, self.world_from_body = xyz, xyz.copy(), rays, world_from_body
        order = _parents_first(skeleton)
        self.stretching = skeleton.stretching
        self.torso = torso = [joint for joint in order if joint in skeleton.trunk]
        self.parents = [torso[0] if parent < 0 and torso else parent for parent in skeleton.parents]
        self.attached = [joint for joint in order if self.parents[joint] not in (-1, joint)]

    def copy(self) -> "Bodies":
        """Return a copy that can be filled independently."""
        other = copy(self)
        other.filled = self.filled.copy()
        return other

    def offsets(self, joints: list[int], anchors: list[int], through: Interpolation) -> np.ndarray:
        """Return the vectors (F, P, n, 3) m, world, from anchors to joints, interpolated in the frame of the body."""
        offsets = self.in_body(self.xyz[:, :, joints] - self.xyz[:, :, anchors])
        return self.in_world(through(offsets))

    def place(self, joint: int, estimate: np.ndarray, parent: int | None = None) -> None:
        """Fill the missing positions of a joint by an estimate, shifted to meet the measurements, and moved onto rays.

        Args:
            joint: Index of the joint.
            estimate: (F, P, 3) m, world.
            parent: Index of the parent, if the bone between them has a constant length.
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
            bone = (np.nan, np.nan)
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

    The position on the ray minimises the sum of two squared distances: the distance from the point of the ray nearest
    to the estimate, in units of `_ALONG_RAY`, and the distance from the sphere of radius `length` around the parent, in
    units of `_BONE_ERROR`.

    Args:
        estimate: (n, 3) m, world.
        rays: (n, 2, 3) origins and unit directions.
        parent: (n, 3) m, world; NaN where unknown.
        length: (n,) m; NaN where unknown.

    Returns:
        (n, 3) m; NaN for points too far from their rays, and for points with too long or too short bones.
    """
    placed = np.full(estimate.shape, np.nan)
    parent = np.broadcast_to(np.asarray(parent, np.float64), estimate.shape)
    length = np.broadcast_to(np.asarray(length, np.float64), len(estimate))
    _place_on_rays(np.asarray(estimate, np.float64), rays.astype(np.float64), parent, length, placed)
    return placed


@compiled()
def _place_on_rays(estimate, rays, parent, length, placed):
    """Write the result of `_onto_rays` to `placed` (n, 3), which the caller has filled with NaN."""
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
