"""Occluded multi-view human motion: capture it, complete it, score it.

    import dmae

    clip = dmae.read("recordings/session", fps=60)
    poses = dmae.complete(dmae.capture(clip), fps=clip.fps)
    dmae.export(clip, "poses.npz", poses=poses)

Every name here is loaded when it is first used: `import dmae` loads neither torch nor hydra, and nothing here needs
the generator (`synth`) or its physics engine.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dmae.calibration.config import RefineConfig as RefineConfig
    from dmae.commands.config import PretrainCommand as PretrainCommand
    from dmae.completion.config import LearningConfig as LearningConfig
    from dmae.completion.config import ModelConfig as ModelConfig
    from dmae.completion.config import TrainConfig as TrainConfig
    from dmae.data.cameras import CameraRig as CameraRig
    from dmae.data.clip import Clip as Clip
    from dmae.data.clip import Detections2D as Detections2D
    from dmae.data.clip import Poses3D as Poses3D
    from dmae.data.clip import Source as Source
    from dmae.data.labels import DetectionLabels as DetectionLabels
    from dmae.data.labels import JointError as JointError
    from dmae.data.labels import OcclusionLabels as OcclusionLabels
    from dmae.data.labels import Visibility as Visibility
    from dmae.data.skeleton import Skeleton as Skeleton
    from dmae.data.skeleton import get_skeleton as get_skeleton
    from dmae.evaluation.config import EvaluateConfig as EvaluateConfig
    from dmae.evaluation.config import StressConfig as StressConfig
    from dmae.evaluation.config import TableConfig as TableConfig
    from dmae.online.capture import OnlineCapture as OnlineCapture
    from dmae.reconstruction.config import CaptureConfig as CaptureConfig
    from dmae.verbs.assessment import benchmark as benchmark
    from dmae.verbs.assessment import compare_scores as compare_scores
    from dmae.verbs.assessment import corrupt as corrupt
    from dmae.verbs.assessment import decide as decide
    from dmae.verbs.assessment import draw as draw
    from dmae.verbs.assessment import evaluate as evaluate
    from dmae.verbs.assessment import regress as regress
    from dmae.verbs.assessment import report as report
    from dmae.verbs.assessment import review as review
    from dmae.verbs.assessment import show as show
    from dmae.verbs.assessment import stress as stress
    from dmae.verbs.assessment import table as table
    from dmae.verbs.motion import calibrate as calibrate
    from dmae.verbs.motion import capture as capture
    from dmae.verbs.motion import card as card
    from dmae.verbs.motion import complete as complete
    from dmae.verbs.motion import completer as completer
    from dmae.verbs.motion import doctor as doctor
    from dmae.verbs.motion import pretrain as pretrain
    from dmae.verbs.motion import run as run
    from dmae.verbs.motion import train as train
    from dmae.verbs.motion import triangulate as triangulate
    from dmae.verbs.recordings import convert as convert
    from dmae.verbs.recordings import detect as detect
    from dmae.verbs.recordings import export as export
    from dmae.verbs.recordings import load as load
    from dmae.verbs.recordings import load_dataset as load_dataset
    from dmae.verbs.recordings import preset as preset
    from dmae.verbs.recordings import read as read
    from dmae.verbs.recordings import read_poses as read_poses
    from dmae.verbs.recordings import save as save
    from dmae.verbs.recordings import to_skeleton as to_skeleton
    from dmae.viewing.config import LayersConfig as LayersConfig
    from dmae.viewing.config import ShowConfig as ShowConfig

_HOMES = {
    "dmae.calibration.config": "RefineConfig",
    "dmae.commands.config": "PretrainCommand",
    "dmae.completion.config": "LearningConfig ModelConfig TrainConfig",
    "dmae.data.cameras": "CameraRig",
    "dmae.data.clip": "Clip Detections2D Poses3D Source",
    "dmae.data.labels": "DetectionLabels JointError OcclusionLabels Visibility",
    "dmae.data.skeleton": "Skeleton get_skeleton",
    "dmae.evaluation.config": "EvaluateConfig StressConfig TableConfig",
    "dmae.online.capture": "OnlineCapture",
    "dmae.reconstruction.config": "CaptureConfig",
    "dmae.verbs.assessment": (
        "benchmark compare_scores corrupt decide draw evaluate regress report review show stress table"
    ),
    "dmae.verbs.motion": "calibrate capture card complete completer doctor pretrain run train triangulate",
    "dmae.verbs.recordings": "convert detect export load load_dataset preset read read_poses save to_skeleton",
    "dmae.viewing.config": "LayersConfig ShowConfig",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = sorted(_HOME_OF)


def __getattr__(name: str):
    if name not in _HOME_OF:
        from dmae.nearest import choices

        raise AttributeError(f"module 'dmae' has no attribute {name!r}; {choices(name, __all__)}; synth has others")
    value = globals()[name] = getattr(import_module(_HOME_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__} - {"TYPE_CHECKING", "import_module"})
