"""Simulate people that hide each other from calibrated cameras: configuration and seed in, `dmae.Clip` out.

    import synth

    for clip in synth.generate(clips=8, scene="office", seed=7):
        print(clip.truth.xyz.shape, clip.detections.xy.shape)

Each name is loaded when it is first used: `import synth` loads neither mujoco nor hydra.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dmae.verbs.recordings import load_dataset as load_dataset
    from synth.datasets.config import AboutConfig as AboutConfig
    from synth.datasets.config import GenerateConfig as GenerateConfig
    from synth.datasets.config import OcclusionConfig as OcclusionConfig
    from synth.datasets.config import RenderConfig as RenderConfig
    from synth.datasets.exporters.export import export as export
    from synth.datasets.physical_labels import label as label
    from synth.datasets.splits import split as split
    from synth.datasets.splits import takes as takes
    from synth.datasets.statistics import stats as stats
    from synth.detector.config import DetectorConfig as DetectorConfig
    from synth.detector.config import Limits as Limits
    from synth.interactions.registry import InteractionConfig as InteractionConfig
    from synth.labels.physical_labels import physical_labels as physical_labels
    from synth.motion.config import MotionConfig as MotionConfig
    from synth.planning.config import LensConfig as LensConfig
    from synth.planning.config import MountConfig as MountConfig
    from synth.planning.config import PlanConfig as PlanConfig
    from synth.planning.config import SearchConfig as SearchConfig
    from synth.rendering.config import ImagingConfig as ImagingConfig
    from synth.rigs.config import RigConfig as RigConfig
    from synth.rigs.config import RingConfig as RingConfig
    from synth.rooms.config import PropsConfig as PropsConfig
    from synth.scene.config import SceneConfig as SceneConfig
    from synth.verbs import body_state as body_state
    from synth.verbs import compare as compare
    from synth.verbs import compare_motion as compare_motion
    from synth.verbs import contact_sheet as contact_sheet
    from synth.verbs import detector_errors as detector_errors
    from synth.verbs import fit_detector as fit_detector
    from synth.verbs import forecast as forecast
    from synth.verbs import generate as generate
    from synth.verbs import plan as plan
    from synth.verbs import preset as preset
    from synth.verbs import realism as realism
    from synth.verbs import render as render
    from synth.verbs import show as show
    from synth.verbs import verify as verify

_HOMES = {
    "dmae.verbs.recordings": "load_dataset",
    "synth.datasets.config": "AboutConfig GenerateConfig OcclusionConfig RenderConfig",
    "synth.datasets.exporters.export": "export",
    "synth.datasets.physical_labels": "label",
    "synth.datasets.splits": "split takes",
    "synth.datasets.statistics": "stats",
    "synth.detector.config": "DetectorConfig Limits",
    "synth.interactions.registry": "InteractionConfig",
    "synth.labels.physical_labels": "physical_labels",
    "synth.motion.config": "MotionConfig",
    "synth.planning.config": "LensConfig MountConfig PlanConfig SearchConfig",
    "synth.rendering.config": "ImagingConfig",
    "synth.rigs.config": "RigConfig RingConfig",
    "synth.rooms.config": "PropsConfig",
    "synth.scene.config": "SceneConfig",
    "synth.verbs": (
        "body_state compare compare_motion contact_sheet detector_errors fit_detector forecast generate plan preset "
        "realism render show verify"
    ),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = sorted(_HOME_OF)


def __getattr__(name: str):
    if name not in _HOME_OF:
        from dmae.nearest import choices

        raise AttributeError(f"module 'synth' has no attribute {name!r}; {choices(name, __all__)}; dmae has others")
    value = globals()[name] = getattr(import_module(_HOME_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__} - {"TYPE_CHECKING", "import_module"})
