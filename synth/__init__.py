"""Simulate people that hide each other from calibrated cameras: configuration and seed in, `dmae.Clip` out.

    import synth

    for clip in synth.generate(clips=8, scene="office", seed=7):
        print(clip.truth.xyz.shape, clip.detections.xy.shape)

Each name is loaded when it is first used: `import synth` loads neither mujoco nor hydra.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dmae.public.recordings import load_dataset as load_dataset
    from synth.public.comparison import compare as compare
    from synth.public.comparison import compare_motion as compare_motion
    from synth.public.comparison import fit_detector as fit_detector
    from synth.public.generation import export as export
    from synth.public.generation import generate as generate
    from synth.public.generation import split as split
    from synth.public.generation import stats as stats
    from synth.public.generation import takes as takes
    from synth.public.generation import verify as verify
    from synth.public.labels import body_state as body_state
    from synth.public.labels import label as label
    from synth.public.labels import physical_labels as physical_labels
    from synth.public.pictures import contact_sheet as contact_sheet
    from synth.public.pictures import show as show
    from synth.public.planning import plan as plan
    from synth.public.realism import detector_errors as detector_errors
    from synth.public.realism import realism as realism
    from synth.public.rendering import forecast as forecast
    from synth.public.rendering import render as render

_HOMES = {
    "dmae.public.recordings": ["load_dataset"],
    "synth.public.comparison": ["compare", "compare_motion", "fit_detector"],
    "synth.public.generation": ["export", "generate", "split", "stats", "takes", "verify"],
    "synth.public.labels": ["body_state", "label", "physical_labels"],
    "synth.public.pictures": ["contact_sheet", "show"],
    "synth.public.planning": ["plan"],
    "synth.public.realism": ["detector_errors", "realism"],
    "synth.public.rendering": ["forecast", "render"],
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = sorted(_HOME_OF)


def __getattr__(name: str):
    if name not in _HOME_OF:
        raise AttributeError(f"module 'synth' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = globals()[name] = getattr(import_module(_HOME_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
