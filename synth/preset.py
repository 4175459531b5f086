"""`synth fit-detector`: a preset for `configs/detector/` from a recording of the user's own."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

from dmae.cameras import CameraRig
from dmae.clip import Clip
from dmae.data import DataConfig, Format, load
from dmae.store import write_atomic
from dmae.tables import print_tables
from synth.compare import CompareConfig, compare, read_recording, table, write_page
from synth.dataset import generate
from synth.failures import Truth, measure
from synth.fit import Fit, fit
from synth.generate import GenerateConfig
from synth.interactions import InteractionConfig
from synth.mistakes import DetectorConfig, PartConfig
from synth.motion.source import MotionConfig
from synth.rigs import CameraConfig, RigConfig
from synth.spec import SceneConfig


@dataclass(frozen=True)
class FitDetectorConfig:
    """`synth fit-detector`.

    Attributes:
        detections: Folder of the recording: a clip, which `dmae convert` makes of any, or Shelf's text files.
        truth: What its detections are judged against.
        frames: First frame that is used, and the one after the last; by default all.
        clips: Folder of simulated clips of a scene like the recording's; by default some are made, seen by its cameras.
        count: How many are made.
        scene, motion, interaction: What is made.
        origin: Where in the recording's world the middle of that scene is, on the floor, m.
        detector: Where the fit starts, and what is kept of what the recording says nothing of.
        rounds: Simulations.
        workers: Processes; -1 for one a core.
        seed: Of the clips and of the detector.
        name: Of the preset.
        out: Folder of the preset, of the page that compares, and of the clips that are made.
    """

    detections: str = "???"
    truth: Truth = Truth.others
    frames: list[int] | None = None
    clips: str | None = None
    count: int = 4
    scene: SceneConfig = field(default_factory=SceneConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    interaction: InteractionConfig = field(default_factory=InteractionConfig)
    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    rounds: int = 8
    workers: int = 1
    seed: int = 0
    name: str = "fitted"
    out: str = "runs/detector"


def run_fit_detector(config: FitDetectorConfig, out: Path) -> None:
    """Fit, write `detector/<name>.yaml` and `compare.html`, and say what could not be determined."""
    recording = read_recording(Path(config.detections), config.frames)
    real = measure(recording, config.truth)
    clips = _clips(config, recording, out)
    fitted = fit(real, clips, config.detector, rounds=config.rounds, seed=config.seed, workers=config.workers)
    rows = compare(real, fitted.failures, CompareConfig())
    print_tables([table(rows)])
    for name, why in fitted.undetermined.items():
        print(f"undetermined, kept as it was: {name}: {why}")
    # As Hydra wants it: with --config-dir=<out> the preset is one of the group.
    path = out / "detector" / f"{config.name}.yaml"
    write_atomic(path, preset_yaml(fitted, config.name, recording))
    write_page(out / "compare.html", real, replace(fitted.failures, name="simulated"), rows)
    print(f"{path}, {out / 'compare.html'}")
    print(f"use it by: synth generate --config-dir={out} detector={config.name} ...")


def _clips(config: FitDetectorConfig, recording: Clip, out: Path) -> list[Clip]:
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
                scene=scene,
                motion=config.motion,
                interaction=config.interaction,
                rig=rig,
                detector=config.detector,
            )
        )
    return list(load(DataConfig(Format.clip, folder)))


def _cameras(rig: CameraRig) -> list[CameraConfig]:
    return [
        CameraConfig(
            name, size.tolist(), K.ravel().tolist(), pose[:3].ravel().tolist(), dist.tolist(), fisheye=bool(fisheye)
        )
        for name, size, K, pose, dist, fisheye in zip(
            rig.names, rig.size, rig.K, rig.cam_from_world, rig.dist, rig.fisheye, strict=True
        )
    ]


def preset_yaml(fitted: Fit, name: str, recording: Clip) -> str:
    """The preset as a file of `configs/detector/`: what differs from the defaults."""
    lines = [
        f"# Fitted by `synth fit-detector` to {len(recording)} frames of {recording.id} in {len(recording.rig)} views.",
        *(f"# Undetermined, kept as it was: {key}: {why}." for key, why in fitted.undetermined.items()),
        f"name: {name}",
        "parts:",
    ]
    settings = _changed(fitted.config, DetectorConfig())
    for kind, part in vars(settings.pop("parts")).items():
        values = ", ".join(f"{key}: {value}" for key, value in _changed(part, PartConfig()).items())
        lines.append(f"  {kind}: {{{values}}}")
    return "\n".join(lines + [f"{key}: {json.dumps(value)}" for key, value in settings.items() if key != "name"]) + "\n"


def _changed(config, default) -> dict:
    return {key: value for key, value in vars(config).items() if value != vars(default)[key]}
