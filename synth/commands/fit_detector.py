"""`synth fit-detector`: fit a preset for `configs/detector/` to a recording of the user."""

from dataclasses import replace
from pathlib import Path

from dmae.data.clip import Clip
from dmae.data.json_values import json_text, rounded
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip
from dmae.files.checks import child
from dmae.files.contents import write_atomic
from dmae.reporting.tables import counted, print_tables
from synth.commands.config import FitDetectorCommand
from synth.datasets.config import GenerateConfig
from synth.datasets.generate import generate
from synth.detector.comparison import compare, table, write_page
from synth.detector.config import ErrorReference, Limits
from synth.detector.fitting import Fit, fit, preset_yaml
from synth.detector.statistics import measure, on_skeleton, read_recording
from synth.recognition import truth_fit
from synth.rigs.config import listed_rig


def run(config: FitDetectorCommand, out: Path) -> None:
    """Fit the detector, write `detector/<name>.yaml` and `compare.html`, and print the undetermined options."""
    known = config.truth == ErrorReference.annotated
    if (config.extra_data or config.held_back) and not known:
        raise ValueError("extra_data and held_back need truth=annotated: clips with truth")
    recorded = (Path(config.detections) / "detection").is_dir()
    if known and not recorded and config.clips is None and config.frames is None:
        clips = _read(config.detections, *config.extra_data)
        if clips and all(clip.truth is not None and clip.occlusion is not None for clip in clips):
            _fit_to_truth(config, clips, out)
            return
    recording = read_recording(Path(config.detections), config.frames)
    real = measure(_converted(recording), config.truth)
    clips = _clips(config, recording, out)
    how: dict = {"rounds": config.rounds, "seed": config.seed, "workers": config.workers}
    fitted = fit(real, clips, config.detector, **how, reference=config.truth)
    rows = compare(real, fitted.statistics, Limits())
    print_tables([table(rows)])
    what = f"{len(recording)} frames of {recording.id} in {len(recording.rig)} views"
    _write(config, fitted, what, out)
    write_page(out / "compare.html", real, replace(fitted.statistics, name="simulated"), rows)
    print(f"{out / 'compare.html'}")


def _converted(recording: Clip) -> Clip:
    """Return the recording on the skeleton of the simulated detector, and say what its detector lacks."""
    own = recording.detections.skeleton
    if own != BODY25:
        print(f"{recording.id}: detections of {own.name} are converted to body25, the simulated detector's skeleton")
    return on_skeleton(recording, BODY25)


def _fit_to_truth(config: FitDetectorCommand, clips: list[Clip], out: Path) -> None:
    options = {"seed": config.seed, "workers": config.workers}
    fitted = truth_fit.fit_to_truth(clips, config.detector, rounds=config.rounds, **options)
    distances = {"fitted": truth_fit.distances(clips, fitted.config, **options)}
    if config.held_back:
        others = _read(*config.held_back)
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

    written = {
        name: [
            {"what": row.what, "real": rounded(row.real, 5), "simulated": rounded(row.sim, 5),
             "distance": rounded(row.distance, 5), "allowed": rounded(row.allowed, 5), "exceeded": row.exceeded}
            for row in rows
        ]
        for name, rows in distances.items()
    }  # fmt: skip
    write_atomic(out / "distances.json", json_text(written) + "\n")
    print(f"{out / 'distances.json'}")


def _write(config: FitDetectorCommand, fitted: Fit, what: str, out: Path) -> None:
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
    folder = config.clips or str(out / "clips")
    if config.clips is None:
        scene = replace(config.scene, fps=recording.fps)
        rig = replace(listed_rig(recording.rig), name=recording.id, origin=config.origin)
        same = {name: getattr(config, name) for name in
                ("seed", "workers", "backend", "motion", "interaction", "detector")}  # fmt: skip
        generate(GenerateConfig(out=folder, clips=config.count, scene=scene, rig=rig, **same))
    return _read(folder)


def _read(*data: str) -> list[Clip]:
    """Return the clips of data sets."""
    return [load_clip(folder) for path in data for folder in clip_folders(Path(path))]
