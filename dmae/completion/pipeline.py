"""From weights to completed poses: load a completer, or find that of the shipped weights for a skeleton."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from dmae.completion.completer import Completer
from dmae.completion.weights import find_shipped, load_model, pick_device
from dmae.data.skeleton import Skeleton

SMOOTHING = 0.1
"""s; light smoothing that suits people."""


def load_completer(
    weights: Path, device: str = "auto", denoise: bool | None = False, reject: bool = False, smooth: float = 0.0
) -> Completer:
    """Return the completer of a folder that `dmae train` wrote.

    Args:
        device: As torch names it; `auto` is a GPU if there is one.
        denoise: Move measured joints of few views too; None where the model was trained for it.
        reject: Drop measured joints of few views that the frames around contradict.
        smooth: s; length of a light smoothing at the end.

    Raises:
        FileNotFoundError: there is no model in the folder.
        ValueError: its files are malformed, damaged, or of another version; or `denoise` is asked of a model that was
            not trained to denoise, or that turns poses into those of another skeleton; or `smooth` is not 0 or more.
    """
    if not 0 <= smooth < np.inf:
        raise ValueError(f"smooth={smooth:g}: expected seconds, 0 (no smoothing) or more")
    model, skeleton, record = load_model(weights)
    if denoise is None:
        denoise = record["denoises"] and len(skeleton.parts) == 1
    if denoise and len(skeleton.parts) > 1:
        raise ValueError(
            f"{weights}: this model turns {skeleton.parts[0].name!r} into {skeleton.parts[1].name!r}, and moves all "
            "joints; leave out denoise"
        )
    if denoise and not record["denoises"]:
        raise ValueError(
            f"{weights}: this model was not trained to denoise; train with learning.observed_weight above 0"
        )
    where = pick_device(device)
    factors = record["calibration"] and tuple(map(tuple, record["calibration"]))
    return Completer(model.to(where), skeleton, denoise, factors, reject, smooth)


def completers(weights: Path | None, **options) -> Callable[[Skeleton], Completer]:
    """Return a function from the skeleton of poses to their completer.

    It is that of a folder, or without one, that of the weights that come with the package
    (`dmae.completion.weights.find_shipped`). The options and errors are those of `load_completer`.
    """
    if weights is None:
        return cache(lambda skeleton: load_completer(find_shipped(skeleton), **options))
    completer = load_completer(weights, **options)
    return lambda skeleton: completer
