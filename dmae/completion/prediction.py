"""Prediction: a network's corrections of a whole recording, blended over overlapping windows."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch

from dmae.completion.blending import correction_weight
from dmae.completion.gaussian_process.steps import Steps
from dmae.completion.methods.gaussian_process_learned import fill_both
from dmae.completion.network.paper import DMAE
from dmae.completion.windows import Rows, make_rows
from dmae.data.clip import Poses3D
from dmae.data.skeleton import Skeleton
from dmae.numerics.body import rotate_z
from dmae.numerics.filling import resample

_BATCH = 4
_FEW = 1
_ROWS_COST, _WINDOW_COST = 6.0, 5.0
"""Of laying out the rows of two people, and of a window, see `Steps`."""
_SAME_RATE = 0.01
"""Rates within this share of each other are taken as equal."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Have torch compute on one thread of the CPU."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def has_rate(model: DMAE, fps: float) -> bool:
    """Return whether poses at a rate need no resampling for a model."""
    return abs(model.config.fps / fps - 1) < _SAME_RATE


def stride(model: DMAE) -> int:
    """Return the frames from one window to the next."""
    return max(1, model.config.frames // 3)


def predict(
    model: DMAE,
    poses: Poses3D,
    fps: float,
    frames: slice,
    wanted: np.ndarray,
    target: Skeleton | None = None,
    small_steps: bool = False,
) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Predict joints in some frames of a recording, by all of its frames, step by step.

    Args:
        wanted: (F, P, J) of those frames, True for the joints to be predicted while their person is present; of the
            target if there is one.
        target: Skeleton that the model turns poses into, if any; its joints follow those of the poses.
        small_steps: Whether steps are short, rather than fast altogether.

    Returns:
        (F, P, J, 3) m, world, meaningful where wanted; and the scale of the error, (F, P, J) m, NaN where the model was
        not used.
    """
    config = model.config
    rest = model.rest.cpu().numpy()
    count, persons = poses.xyz.shape[:2]
    needed = np.zeros((count, persons, len(rest)), bool)
    needed[frames, :, -wanted.shape[2] :] = wanted
    filled = None
    if not target:
        _, filled = yield from fill_both(poses, fps, frames)
    rows = make_rows(poses, fps, rest, config.frames, target=target, filled=filled)
    base = _by_frame(rows.base, persons)[:count]
    yield _ROWS_COST
    if has_rate(model, fps):
        found = yield from _corrections(model, rows, needed, small_steps)
        correction = _by_frame(found, persons)[:count]
    else:
        rows = make_rows(resample(poses, fps, config.fps), config.fps, rest, config.frames, target=target)
        time, last = np.arange(count) * (config.fps / fps), len(rows.base) // persons - 1
        first = np.minimum(time.astype(int), last)
        second = np.minimum(first + 1, last)
        around = np.zeros((last + 1, *needed.shape[1:]), bool)
        for index in (first, second):
            np.logical_or.at(around, index, needed)
        found = yield from _corrections(model, rows, around, small_steps)
        resampled = _by_frame(found, persons)
        weight = (time - first).clip(0, 1)[:, None, None, None]
        correction = resampled[first] * (1 - weight) + resampled[second] * weight
    # The target's joints lie elsewhere than what they are derived from, however short a gap is.
    weight = 1 if target else correction_weight(poses)
    return (base + np.nan_to_num(correction[..., :3]) * weight)[frames], np.exp(correction[..., 3])[frames]


def _corrections(model: DMAE, rows: Rows, needed: np.ndarray, small_steps: bool) -> Steps[np.ndarray]:
    """Return what the model adds to the interpolation, m, world, and the logarithm of its error scale, (S, J, 4).

    Windows overlap by two thirds and are weighted by a triangle; NaN where there is no window, or a joint is not
    `needed` (F, P, J).
    """
    config = model.config
    frames, device = config.frames, next(model.parameters()).device
    count, persons = needed.shape[:2]
    length = len(rows.base) // persons
    start = rows.starts % length
    needed = np.concatenate([needed, np.zeros((length - count, *needed.shape[1:]), bool)])
    needed = needed.swapaxes(0, 1).reshape(rows.observed.shape) & rows.present[:, None]
    useful = needed.any(1)[rows.starts[:, None] + np.arange(frames)].any(1)
    starts = rows.starts[useful & ((start % stride(model) == 0) | (start == length - frames))]
    triangle = np.minimum(np.arange(1, frames + 1), np.arange(frames, 0, -1)).astype(float)

    total, weights = np.zeros((*rows.observed.shape, 4)), np.zeros(rows.observed.shape)
    size = _FEW if small_steps else _BATCH
    for begin in range(0, len(starts), size):
        batch = starts[begin : begin + size]
        windows, _, frame = rows.cut(batch, frames, config.align_heading)
        wanted = needed[batch[:, None] + np.arange(frames)]
        with torch.inference_mode():
            inputs = (tensor.to(device) for tensor in windows)
            xyz, log_scale = (part.cpu() for part in model(*inputs, wanted=torch.from_numpy(wanted).to(device)))
        added = rotate_z((xyz - windows.base).numpy().astype(np.float64), frame.heading[:, None, None])
        added = np.concatenate([added, log_scale.numpy()[..., None]], -1)
        weight = triangle[:, None] * wanted
        for t in range(frames):
            total[batch + t] += weight[:, t, :, None] * added[:, t]
            weights[batch + t] += weight[:, t]
        yield _WINDOW_COST * len(batch)
    return total / np.where(weights > 0, weights, np.nan)[..., None]


def _by_frame(rows: np.ndarray, persons: int) -> np.ndarray:
    """Return rows (S, ...) as (frames, P, ...)."""
    return rows.reshape(persons, -1, *rows.shape[1:]).swapaxes(0, 1)
