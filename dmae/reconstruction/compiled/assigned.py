"""Assignment of detections to the joints of people, compiled."""

import numpy as np

from dmae.numerics.compiled import compiled


@compiled()
def gather(xy, confidence, frames, assigned, found_xy, found_confidence):
    """Write the assigned detections of each joint into the last two arrays; NaN where none is assigned.

    Args:
        xy: (F, V, D, J, 2) px.
        confidence: (F, V, D, J).
        frames: (n,) frame of each person.
        assigned: (n, V, J) index of the detection that shows the joint in each view; negative for none.
        found_xy: (n, J, V, 2) px.
        found_confidence: (n, J, V).
    """
    for i in range(len(assigned)):
        frame = frames[i]
        for v in range(assigned.shape[1]):
            for j in range(assigned.shape[2]):
                detection = assigned[i, v, j]
                if detection < 0:
                    found_xy[i, j, v, 0] = found_xy[i, j, v, 1] = found_confidence[i, j, v] = np.nan
                    continue
                found_xy[i, j, v, 0] = xy[frame, v, detection, j, 0]
                found_xy[i, j, v, 1] = xy[frame, v, detection, j, 1]
                found_confidence[i, j, v] = confidence[frame, v, detection, j]


@compiled()
def assign_joints(primary, owner, present, closeness, assigned):
    """Write the detection that shows each joint of each track in each view; -1 where none does.

    This is the primary detection of the track. A fragment or a duplicate supplies the joints that the primary detection
    lacks, if they are near.

    Args:
        primary: (V, T) primary detection of each track; negative for none.
        owner: (V, D) track of each detection; negative for none.
        present: (V, D, J) True for detected joints.
        closeness: (V, T, D, J), positive for joints near the track; NaN where either is absent.
        assigned: (V, T, J), written.
    """
    views, tracks, joints = assigned.shape
    for v in range(views):
        for t in range(tracks):
            d = primary[v, t]
            for j in range(joints):
                assigned[v, t, j] = d if d >= 0 and present[v, d, j] else -1
        for d in range(owner.shape[1]):
            t = owner[v, d]
            if t < 0 or primary[v, t] == d:
                continue
            for j in range(joints):
                if present[v, d, j] and assigned[v, t, j] < 0 and not closeness[v, t, d, j] <= 0:
                    assigned[v, t, j] = d
