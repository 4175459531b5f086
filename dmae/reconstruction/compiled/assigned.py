"""The detections that are assigned to joints, compiled."""

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
