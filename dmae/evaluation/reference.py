"""Reference poses of an evaluation: the truth of a clip, or the joints that all its cameras together measured."""

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

PUBLISHED_ACTORS = (0, 1, 2)
"""The three of Shelf's four actors that published averages include."""

_VIEWS = 3
"""Without truth, a joint counts as true if capture with all cameras measured it in at least this number of views."""


def truth_of(clip: Clip) -> Poses3D:
    """Return the truth of a clip.

    Raises:
        ValueError: the clip has no truth, or the truth has infinite coordinates.
    """
    if clip.truth is None:
        raise ValueError(f"clip {clip.id!r} has no truth to score against")
    if np.isinf(clip.truth.xyz).any():
        raise ValueError(f"clip {clip.id!r}: its truth has infinite coordinates; joints that are not known must be NaN")
    return clip.truth


def measured_by_all(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Return the captured poses of a clip with only the joints that three views or more measured."""
    whole = capture(clip, config)
    known = whole.views >= _VIEWS
    return Poses3D(whole.skeleton, np.where(known[..., None], whole.xyz, np.nan), cov=whole.cov)


def scored_actors(clip: Clip) -> tuple[int, ...] | None:
    """Return the persons of the truth that averages include; None for all."""
    return PUBLISHED_ACTORS if clip.provenance.get("format") == "shelf" else None
