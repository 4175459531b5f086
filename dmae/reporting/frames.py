"""Choose the frames of a clip to draw."""

import numpy as np

from dmae.data.clip import Clip, Source


def frames_to_draw(clip: Clip, number: int) -> list[int]:
    """Return the frames with the most completed joints.

    Without completed joints, return those with the most missing joints of present persons. Without missing joints,
    return those with the most known joints.
    """
    source = clip.poses.source
    present = (source != Source.ABSENT).any(-1, keepdims=True)
    kinds = (source == Source.COMPLETED, (source == Source.ABSENT) & present, source != Source.ABSENT)
    return frames_with_most(next((kind for kind in kinds if kind.any()), kinds[0]).sum((1, 2)), number)


def frames_with_most(counts: np.ndarray, number: int, apart: int = 10) -> list[int]:
    """Return the frames with the largest counts (F,), more than `apart` frames from each other, in order of time."""
    left, chosen = counts.copy(), []
    while len(chosen) < number and (left >= 0).any():
        frame = int(left.argmax())
        chosen.append(frame)
        left[max(0, frame - apart) : frame + apart + 1] = -1
    return sorted(chosen)
