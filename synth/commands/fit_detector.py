"""`synth fit-detector`: fit a preset for `configs/detector/` to a recording of the user."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.json_values import json_text
from dmae.files.checks import child
from dmae.files.contents import write_atomic
from dmae.formats.reading import DataConfig, load
from dmae.parallel import Backend, running_on
from dmae.reporting.tables import counted, print_tables
from synth.datasets.clip import GenerateConfig
from synth.datasets.generate import generate
from synth.detector.comparison import Limits, Row, compare, table, write_page
from synth.detector.config import DetectorConfig
from synth.detector.fitting import Fit, fit, preset_yaml
from synth.detector.statistics import ErrorReference, measure, read_recording
from synth.interactions.registry import InteractionConfig
from synth.motion.config import MotionConfig
from synth.recognition import truth_fit
from synth.rigs.config import CameraConfig, RigConfig
from synth.scene.config import SceneConfig

WRITES = "folder"
EXAMPLES = (
    "synth fit-detector detections=$DMAE_DATA/shelf scene=shelf_twin name=mine out=runs/detector",
    "synth generate --config-dir=runs/detector detector=mine out=runs/data",
    "synth fit-detector detections=runs/detected truth=annotated detector=hrnet_like name=mine out=runs/detector",
)


@dataclass(frozen=True)
class FitDetectorCommand:
    """Fit a detector's preset to a recording: `detector/<name>.yaml` and `compare.html`."""

    detections: str = "???"
    """Folder of the recording: a clip, which `dmae convert` makes from any format, or Shelf's text files; with
    `truth=annotated` also a data set."""
    extra_data: list[str] = field(default_factory=list)
    """With `truth=annotated`, more data sets of the same detector."""
    held_back: list[str] = field(default_factory=list)
    """With `truth=annotated`, held-back data sets of the same detector, which are not used in the fit. Distances on
    them are printed and written, and those between the detector's results on them and on the clips of the fit."""
    truth: ErrorReference = ErrorReference.others
    """Reference for the detections. With `annotated`, clips with truth and visibility labels, as `dmae detect clip=...`
    writes them, are themselves simulated again, and visible and hidden joints are fitted separately."""
    frames: list[int] | None = None
    """First frame to use, and the one after the last; by default all."""
    clips: str | None = None
    """Folder of simulated clips of a similar scene; by default clips are made with the cameras of the recording."""
    count: int = 4
    """Number of clips to make."""
    scene: SceneConfig = field(default_factory=SceneConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    interaction: InteractionConfig = field(default_factory=InteractionConfig)
    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """m; position of the middle of the scene on the floor, in the world of the recording."""
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    """Start of the fit. Options that the recording does not determine keep its values."""
    rounds: int = 8
    """Simulations."""
    workers: int = 1
    """Processes; -1 for one per core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    seed: int = 0
    """Seed of the clips and of the detector."""
    name: str = "fitted"
    """Name of the preset."""
    out: str = "runs/detector"
    """Folder of the preset, the comparison page, and the new clips."""


def run(config: FitDetectorCommand, out: Path) -> None:
    """Fit the detector, write `detector/<name>.yaml` and `compare.html`, and print the undetermined options."""
    known = config.truth == ErrorReference.annotated
    if (config.extra_data or config.held_back) and not known:
        raise ValueError("extra_data and held_back need truth=annotated: clips with truth")
    if known and (clips := _labelled(config, (config.detections, *config.extra_data))):
        _fit_to_truth(config, clips, out)
        return
    recording = read_recording(Path(config.detections), config.frames)
    real = measure(recording, config.truth)
    clips = _clips(config, recording, out)
    with running_on(config.backend):
        fitted = fit(real, clips, config.detector, rounds=config.rounds, seed=config.seed, workers=config.workers)
    rows = compare(real, fitted.statistics, Limits())
    print_tables([table(rows)])
    what = f"{len(recording)} frames of {recording.id} in {len(recording.rig)} views"
    _write(config, fitted, what, out)
    write_page(out / "compare.html", real, replace(fitted.statistics, name="simulated"), rows)
    print(f"{out / 'compare.html'}")


def _labelled(config: FitDetectorCommand, folders: Sequence[str]) -> list[Clip]:
    """Return the clips of some folders if all have truth and visibility labels; otherwise an empty list."""
    if config.clips is not None or config.frames is not None or (Path(config.detections) / "detection").is_dir():
        return []
    clips = [clip for folder in folders for clip in load(DataConfig("clip", folder))]
    return clips if all(clip.truth is not None and clip.occlusion is not None for clip in clips) else []


def _fit_to_truth(config: FitDetectorCommand, clips: list[Clip], out: Path) -> None:
    with running_on(config.backend):
        options = {"seed": config.seed, "workers": config.workers}
        fitted = truth_fit.fit_to_truth(clips, config.detector, rounds=config.rounds, **options)
        distances = {"fitted": truth_fit.distances(clips, fitted.config, **options)}
        if config.held_back:
            others = [clip for folder in config.held_back for clip in load(DataConfig("clip", folder))]
            distances["held_back"] = truth_fit.distances(others, fitted.config, **options)
            distances["real"] = truth_fit.real_distances(clips, others, config.workers)
    titles = {
        "fitted": "Clips of the fit",
        "held_back": "Held-back clips",
        "real": "The real detector: clips of the fit (real) and held-back clips (simulated)",
    }
    for name, rows in distances.items():
        print_tables([replace(table(rows), caption=f"{titles[name]}. {table(rows).caption}")])
    what = f"{sum(map(len, clips))} frames of {counted(len(clips), 'clip')} with truth"
    _write(config, fitted, what, out)
    write_atomic(
        out / "distances.json",
        json_text({name: [_json_row(row) for row in rows] for name, rows in distances.items()}) + "\n",
    )
    print(f"{out / 'distances.json'}")


def _json_row(row: Row) -> dict:
    values = {name: None if value is None or not np.isfinite(value) else round(float(value), 5)
              for name, value in (("real", row.real), ("simulated", row.sim), ("distance", row.distance),
                                  ("allowed", row.allowed))}  # fmt: skip
    return {"what": row.what, **values, "exceeded": row.exceeded}


def _write(config: FitDetectorCommand, fitted: Fit, what: str, out: Path) -> None:
    """Write the preset, and print the undetermined options."""
    for name, why in fitted.undetermined.items():
        print(f"undetermined, not changed: {name}: {why}")
    # Hydra needs this folder: with --config-dir=<out> the preset is part of the group.
    path = child(out / "detector", f"{config.name}.yaml", "detector")
    comments = [
        f"Fitted by `synth fit-detector` to {what}.",
        *(f"Undetermined, not changed: {name}: {why}." for name, why in fitted.undetermined.items()),
    ]
    write_atomic(path, preset_yaml(fitted.config, config.name, comments))
    print(path)
    print(f"to use it: synth generate --config-dir={out} detector={config.name} ...")


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
