"""D-MAE: the network that `dmae train` trains, by default with the weights that come with the package."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dmae.completion.methods.registry import completion_method

if TYPE_CHECKING:
    from dmae.data.conversion import Fill


@completion_method("dmae", learned=True)
def dmae(weights: Path | None) -> Fill:
    """The trained network; measured joints stay as they are."""
    return _fill(weights)


@completion_method("dmae_reject", learned=True)
def dmae_reject(weights: Path | None) -> Fill:
    """As dmae, after dropping joints of two views that are contradicted."""
    return _fill(weights, reject=True)


@completion_method("dmae_denoise", learned=True)
def dmae_denoise(weights: Path | None) -> Fill:
    """As dmae_reject, and moves measured joints of two views too."""
    return _fill(weights, reject=True, denoise=True)


def _fill(weights: Path | None, **options: bool) -> Fill:
    # Torch is loaded when a network is used, not when methods are listed.
    from dmae.completion.pipeline import completers

    completer_for = completers(weights, **options)
    return lambda poses, fps: completer_for(poses.skeleton)(poses, fps)
