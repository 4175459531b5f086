"""When a view sees what: cameras out of step, rows exposed one after the other, frames lost."""

import numpy as np

from dmae.clip import Visibility
from synth.chance import in_bursts, wander
from synth.mistakes.config import DetectorConfig
from synth.mistakes.parts import Effect, Luck


def exposed(
    xy: np.ndarray,
    visibility: np.ndarray,
    hidden_by: np.ndarray,
    size: np.ndarray,
    fps: float,
    config: DetectorConfig,
    luck: Luck,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a view sees of joints in its frames, which are not taken at the frames' times.

    Positions are interpolated in the image, and extrapolated up to a frame beyond the ends of the clip, what hides
    them is that of the nearest frame. What is farther beyond the ends is not known: there the view sees nobody.

    Args:
        xy: (F, P, 25, 2) where joints truly are at the times of the frames, px.
        visibility: (F, P, 25) `Visibility` then, `hidden_by` (F, P, 25) what hides them.
        size: Image width and height, px.

    Returns:
        The same three, as exposed.
    """
    if not (config.out_of_step or config.rolling) or len(xy) < 2:
        return xy, visibility, hidden_by
    frames = len(xy)
    time = np.arange(frames)[:, None, None] + config.out_of_step * luck(Effect.TIMING).uniform(-1, 1)
    # Rows are those of the frame's own time: people move few rows while an image is read out.
    row = np.clip(np.nan_to_num(xy[..., 1]), 0, size[1])
    time = time + row / size[1] * config.rolling * fps
    before = np.clip(np.floor(time).astype(int), 0, frames - 2)
    after = (time - before)[..., None]
    person, joint = np.ogrid[: xy.shape[1], : xy.shape[2]]
    moved = xy[before, person, joint] * (1 - after) + xy[before + 1, person, joint] * after
    nearest = np.clip(np.rint(time).astype(int), 0, frames - 1)
    known = (time >= -1) & (time <= frames)
    code, by = visibility[nearest, person, joint], hidden_by[nearest, person, joint]
    with np.errstate(invalid="ignore"):
        inside = ((moved >= -0.5) & (moved <= size - 0.5)).all(-1)
    # Whoever leaves the image between two frames is not seen outside it; NaN is left to the codes.
    code = np.where(~inside & (code <= Visibility.HIDDEN_BY_OBJECT), Visibility.OUTSIDE_IMAGE, code)
    return np.where(known[..., None], moved, np.nan), np.where(known, code, Visibility.ABSENT), by


def shown(frames: int, fps: float, config: DetectorConfig, luck: Luck) -> np.ndarray:
    """(F,) index of the frame whose detections each frame has; -1 for those that have none."""
    index = np.arange(frames)
    if not config.drop:
        return index
    lost = in_bursts(config.drop, wander((frames,), fps, config.bursts[1], rng=luck(Effect.DROP)))
    kept = np.where(lost, -1, index)
    return np.maximum.accumulate(kept) if config.drop_repeats else kept
