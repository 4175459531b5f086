"""The second pass: each joint takes the detections nearest to its own path, or the ray of its surest camera."""

from math import prod

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.files.mapped import column_blocks, frame_blocks
from dmae.numerics.compiled import compiled
from dmae.numerics.paths import linear, neighbours
from dmae.reconstruction.association import NONE
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.pruning import prune
from dmae.reconstruction.triangulation import project

LONGEST_GAP = 0.4
"""s; longest gap of a joint over which its path is interpolated."""


def expected_paths(xyz: np.ndarray, skeleton: Skeleton, fps: float, deviation: float = 0.0) -> np.ndarray:
    """Return the expected places of joints, (F, P, J, 3) m: pruned, with straight lines through short gaps.

    Args:
        xyz: (F, P, J, 3) m, NaN where absent.
        deviation: Standard deviation of a joint along one axis, m.
    """
    pruned = prune(xyz, skeleton, fps, deviation)
    # The paths are changed in place, as they are independent of each other.
    paths = pruned.reshape(len(pruned), prod(pruned.shape[1:-1]), 3)
    for columns, known in column_blocks(paths):
        before, after = neighbours(~np.isnan(known[..., 0]))
        bridged = (before >= 0) & (after < len(known)) & (after - before <= int(LONGEST_GAP * fps))
        expected = np.where(bridged[..., None], linear(known), np.nan)
        for part in frame_blocks(paths):
            paths[part, columns] = expected[part]
    return pruned


def reassign(evidence: Evidence, assigned: np.ndarray, paths: np.ndarray, max_distance: float) -> np.ndarray:
    """Return, for joints with a path, the nearest detections that are not nearer to another person.

    This corrects detections that were assembled or matched wrongly: the wrist of a neighbour, a forearm that belongs
    to no detected person.

    Args:
        assigned: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        paths: (F, P, J, 3) m; NaN where a joint has no path and keeps its assignment.
        max_distance: Largest distance of a detection from the path, m; at 0 all joints keep their assignment.

    Returns:
        (F, P, V, J) indices of detections, or `NONE`.
    """
    if not assigned.size or max_distance == 0:
        return assigned
    rig, paths = evidence.rig, np.asarray(paths, np.float64)
    return nearest_detections(
        rig.projections, rig.focal, evidence.xy[: len(paths)], paths, max_distance, assigned.copy()
    )


_MAX_DISTANCE = 0.3
"""m; the ray of a single camera is not used if it is farther than this from the expected place of the joint."""


def most_confident_rays(
    evidence: Evidence, absent: np.ndarray, expected: np.ndarray, assigned: np.ndarray, first_pass: np.ndarray
) -> np.ndarray:
    """Return the ray of the most confident view of each joint, (F, P, J, 2, 3); see `Poses3D.rays`.

    A measured joint takes the ray of a view that measured it. An absent joint takes the ray of the most confident
    detection near the place where it is expected; if there is none, of a detection that tracking assigned to its
    person. Detections from which the joint of another person was measured show that person, so they are left out.

    Args:
        evidence: Detections that the joints were measured from.
        absent: (F, P, J) True for joints that were not measured.
        expected: (F, P, J, 3) m, measured or interpolated places of the joints.
        assigned: (F, P, V, J) detections that the joints were measured from, or `NONE`.
        first_pass: (F, P, V, J) detections that tracking assigned, or `NONE`.
    """
    near = reassign(evidence, assigned, expected.astype(np.float64), _MAX_DISTANCE)
    first_pass = first_pass.copy()
    for other in range(assigned.shape[1]):
        shown = np.where(absent[:, other, None], NONE, assigned[:, other])[:, None]  # (F, 1, V, J)
        for found in (near, first_pass):
            found[(found == shown) & (np.arange(found.shape[1]) != other)[:, None, None]] = NONE
    near = np.where((near == NONE).all(2, keepdims=True), first_pass, near)
    near = np.where(absent[:, :, None], near, assigned).swapaxes(2, 3)
    frame, person, joint, views = np.ogrid[tuple(slice(n) for n in near.shape)]
    confidence = np.where(near == NONE, np.nan, evidence.confidence[frame, views, near, joint])
    view = np.nan_to_num(confidence, nan=-1).argmax(-1)
    frame, person, joint = frame[..., 0], person[..., 0], joint[..., 0]
    pixels = evidence.xy[frame, view, near[frame, person, joint, view], joint]
    directions = (
        evidence.rig.world_from_pixel[view] @ np.append(pixels, np.ones_like(pixels[..., :1]), -1)[..., None]
    )[..., 0]
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    unknown = np.all(np.isnan(confidence), -1)[..., None, None]
    return np.where(unknown, np.nan, np.stack([evidence.rig.centers[view], directions], -2))


@compiled()
def nearest_detections(projections, focal, xy, paths, most, assigned):
    """Write into `assigned`, at joints with a path, the nearest detection that is not nearer to another person, or -1.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        xy: (F, V, D, J, 2) px; NaN where absent.
        paths: (F, P, J, 3) m; NaN where a joint has no path.
        most: m, upper limit of the distance of a detection from the path.
        assigned: (F, P, V, J) detections.
    """
    frames, persons, views, joints = assigned.shape
    detections = xy.shape[2]
    nearest, least = np.empty(persons, np.int64), np.empty(persons)
    owner, closest = np.empty(detections, np.int64), np.empty(detections)
    for f in range(frames):
        for v in range(views):
            for j in range(joints):
                nearest[:], least[:], owner[:], closest[:] = -1, most, -1, most
                for p in range(persons):
                    x, y, depth = project(projections[v], paths[f, p, j])
                    if np.isnan(x):
                        continue
                    for d in range(detections):
                        dx, dy = x - xy[f, v, d, j, 0], y - xy[f, v, d, j, 1]
                        distance = np.sqrt(dx * dx + dy * dy) * depth / focal[v]
                        if distance < least[p]:
                            least[p], nearest[p] = distance, d
                        if distance < closest[d]:
                            closest[d], owner[d] = distance, p
                for p in range(persons):
                    if not np.isnan(paths[f, p, j, 0]):
                        d = nearest[p]
                        assigned[f, p, v, j] = d if d >= 0 and owner[d] == p else -1
    return assigned
