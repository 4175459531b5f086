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
    from dmae.data.cameras import CameraRig as CameraRig
    from dmae.data.clip import Clip as Clip
    from dmae.data.clip import Detections2D as Detections2D
    from dmae.data.clip import Poses3D as Poses3D
    from dmae.data.clip import Source as Source
    from dmae.data.skeleton import Skeleton as Skeleton
    from dmae.data.skeleton import get_skeleton as get_skeleton
    from dmae.online.capture import OnlineCapture as OnlineCapture
    from dmae.public.assessment import benchmark as benchmark
    from dmae.public.assessment import compare_scores as compare_scores
    from dmae.public.assessment import draw as draw
    from dmae.public.assessment import evaluate as evaluate
    from dmae.public.assessment import regress as regress
    from dmae.public.assessment import report as report
    from dmae.public.assessment import show as show
    from dmae.public.cameras import calibrate as calibrate
    from dmae.public.cameras import doctor as doctor
    from dmae.public.motion import capture as capture
    from dmae.public.motion import card as card
    from dmae.public.motion import complete as complete
    from dmae.public.motion import completer as completer
    from dmae.public.motion import train as train
    from dmae.public.motion import triangulate as triangulate
    from dmae.public.recordings import convert as convert
    from dmae.public.recordings import detect as detect
    from dmae.public.recordings import export as export
    from dmae.public.recordings import load as load
    from dmae.public.recordings import load_dataset as load_dataset
    from dmae.public.recordings import read as read
    from dmae.public.recordings import read_poses as read_poses
    from dmae.public.recordings import save as save
    from dmae.public.reviewing import decide as decide
    from dmae.public.reviewing import review as review
    from dmae.public.stress import corrupt as corrupt
    from dmae.public.stress import stress as stress
    from dmae.public.tables import table as table
    from dmae.public.videos import run as run
    from dmae.reconstruction.config import CaptureConfig as CaptureConfig

_HOMES = {
    "dmae.data.cameras": ["CameraRig"],
    "dmae.data.clip": ["Clip", "Detections2D", "Poses3D", "Source"],
    "dmae.data.skeleton": ["Skeleton", "get_skeleton"],
    "dmae.online.capture": ["OnlineCapture"],
    "dmae.public.assessment": [
        "benchmark",
        "compare_scores",
        "draw",
        "evaluate",
        "regress",
        "report",
        "show",
    ],
    "dmae.public.cameras": ["calibrate", "doctor"],
    "dmae.public.motion": ["capture", "card", "complete", "completer", "train", "triangulate"],
    "dmae.public.recordings": ["convert", "detect", "export", "load", "load_dataset", "read", "read_poses", "save"],
    "dmae.public.reviewing": ["decide", "review"],
    "dmae.public.stress": ["corrupt", "stress"],
    "dmae.public.tables": ["table"],
    "dmae.public.videos": ["run"],
    "dmae.reconstruction.config": ["CaptureConfig"],
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = sorted(_HOME_OF)


def __getattr__(name: str):
    if name not in _HOME_OF:
        raise AttributeError(f"module 'dmae' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = globals()[name] = getattr(import_module(_HOME_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
