"""Simulated people who hide each other from calibrated cameras: configuration and seed in, `dmae.Clip` out.

    import synth

    for clip in synth.generate(clips=8, scene="office", seed=7):
        print(clip.truth.xyz.shape, clip.detections.xy.shape)

Every name here is loaded when it is first used: `import synth` loads neither mujoco nor hydra.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dmae.public.recordings import load_dataset as load_dataset
    from synth.public import body_state as body_state
    from synth.public import contact_sheet as contact_sheet
    from synth.public import forecast as forecast
    from synth.public import generate as generate
    from synth.public import render as render
    from synth.public import verify as verify

_HOME_OF = {
    "body_state": "synth.public",
    "contact_sheet": "synth.public",
    "forecast": "synth.public",
    "generate": "synth.public",
    "load_dataset": "dmae.public.recordings",
    "render": "synth.public",
    "verify": "synth.public",
}

__all__ = sorted(_HOME_OF)


def __getattr__(name: str):
    if name not in _HOME_OF:
        raise AttributeError(f"module 'synth' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = globals()[name] = getattr(import_module(_HOME_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
