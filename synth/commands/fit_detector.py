"""`synth fit-detector`: a preset for `configs/detector/` from a recording of the user's own."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.store import write_atomic
from dmae.files.names import child
from dmae.formats.reading import DataConfig, load
from dmae.parallel import Backend, running_on
from dmae.reporting.tables import print_tables
from synth.datasets.clip import GenerateConfig
from synth.datasets.generate import generate
from synth.detector.comparison import Limits, compare, table
from synth.detector.comparison_page import write_page
from synth.detector.config import DetectorConfig
from synth.detector.fitting import fit
from synth.detector.presets import preset_yaml
from synth.detector.recording import read_recording
from synth.detector.statistics import ErrorReference, measure
from synth.interactions import InteractionConfig
from synth.motion.source import MotionConfig
from synth.rigs.listed_cameras import CameraConfig
from synth.rigs.rig import RigConfig
from synth.scene.spec import SceneConfig

WRITES = "folder"
EXAMPLES = (
    "synth fit-detector detections=$DMAE_DATA/shelf scene=shelf_twin name=mine out=runs/detector",
    "synth generate --config-dir=runs/detector detector=mine out=runs/data",
)


@dataclass(frozen=True)
class FitDetectorCommand:
    """Fit a detector's preset to a recording: `detector/<name>.yaml` and `compare.html`."""

    detections: str = "???"
    """Folder of the recording: a clip, which `dmae convert` makes of any, or Shelf's text files."""
    truth: ErrorReference = ErrorReference.others
    """What its detections are measured against."""
    frames: list[int] | None = None
    """First frame that is used, and the one after the last; by default all."""
    clips: str | None = None
    """Folder of simulated clips of a scene like the recording's; by default some are made, seen by its cameras."""
    count: int = 4
    """How many clips are made."""
    scene: SceneConfig = field(default_factory=SceneConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    interaction: InteractionConfig = field(default_factory=InteractionConfig)
    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """m; where in the recording's world the middle of the scene is, on the floor."""
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    """Start of the fit. Options that the recording does not determine keep its values."""
    rounds: int = 8
    """Simulations."""
    workers: int = 1
    """Processes; -1 for one a core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    seed: int = 0
    """Seed of the clips and of the detector."""
    name: str = "fitted"
    """Name of the preset."""
    out: str = "runs/detector"
    """Folder of the preset, of the page that compares, and of the clips that are made."""


def run(config: FitDetectorCommand, out: Path) -> None:
    """Fit, write `detector/<name>.yaml` and `compare.html`, and say what could not be determined."""
    recording = read_recording(Path(config.detections), config.frames)
    real = measure(recording, config.truth)
    clips = _clips(config, recording, out)
    with running_on(config.backend):
        fitted = fit(real, clips, config.detector, rounds=config.rounds, seed=config.seed, workers=config.workers)
    rows = compare(real, fitted.statistics, Limits())
    print_tables([table(rows)])
    for name, why in fitted.undetermined.items():
        print(f"undetermined, kept as it was: {name}: {why}")
    # As Hydra wants it: with --config-dir=<out> the preset is one of the group.
    path = child(out / "detector", f"{config.name}.yaml", "detector")
    comments = [
        f"Fitted by `synth fit-detector` to {len(recording)} frames of {recording.id} in {len(recording.rig)} views.",
        *(f"Undetermined, kept as it was: {name}: {why}." for name, why in fitted.undetermined.items()),
    ]
    write_atomic(path, preset_yaml(fitted.config, config.name, comments))
    write_page(out / "compare.html", real, replace(fitted.statistics, name="simulated"), rows)
    print(f"{path}, {out / 'compare.html'}")
    print(f"use it by: synth generate --config-dir={out} detector={config.name} ...")


def _clips(config: FitDetectorCommand, recording: Clip, out: Path) -> list[Clip]:
    folder = config.clips
    if folder is None:
        folder = str(out / "clips")
        scene = replace(config.scene, fps=recording.fps)
        rig = RigConfig(name=recording.id, cameras=_cameras(recording.rig), origin=config.origin)
        generate(
            GenerateConfig(
                out=folder,
                seed=config.seed,
                clips=config.count,
                workers=config.workers,
                backend=config.backend,
                scene=scene,
                motion=config.motion,
                interaction=config.interaction,
                rig=rig,
                detector=config.detector,
            )
        )
    return list(load(DataConfig("clip", folder)))


def _cameras(rig: CameraRig) -> list[CameraConfig]:
    return [
        CameraConfig(
            name, size.tolist(), K.ravel().tolist(), pose[:3].ravel().tolist(), dist.tolist(), fisheye=bool(fisheye)
        )
        for name, size, K, pose, dist, fisheye in zip(
            rig.names, rig.size, rig.K, rig.cam_from_world, rig.dist, rig.fisheye, strict=True
        )
    ]
