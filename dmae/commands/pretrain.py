"""`dmae pretrain`: a model for your own cameras, detector and motion."""

import shlex
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from dmae.command_line.presets import is_preset
from dmae.commands import capture, evaluate, train
from dmae.commands.config import CaptureCommand, PretrainCommand
from dmae.commands.demo import LOG, logged, run_step, say
from dmae.completion.config import LearningConfig, TrainConfig
from dmae.completion.weights import model_card
from dmae.data.resources import read_preset
from dmae.evaluation.config import EvaluateConfig, Input
from dmae.evaluation.gates import compare_scores
from dmae.evaluation.scores import read_scores
from dmae.files.contents import write_atomic
from dmae.formats.calibrations import read_calibration
from dmae.formats.config import DataConfig
from dmae.metrics.score_tables import overview
from dmae.reporting.tables import counted, print_tables

_STEPS = 7


def run(config: PretrainCommand, out: Path) -> None:
    """Simulate, capture, train, score, and write the card. What is finished is kept.

    Raises ValueError if the preset of the detector is not as `synth fit-detector` writes it, and FileNotFoundError if a
    motion, calibration or file of a preset does not exist.
    """
    import synth

    generated, command = configurations(config, out), command_line(config)
    config = replace(config, views=camera_numbers(config))
    for number, (name, each) in enumerate(generated.items()):
        say(f"simulate {counted(each['clips'], 'clip')}: {name}", number + 1, _STEPS)
        synth.generate(**each, out=out / name)
    say("capture them with few cameras", 4, _STEPS)
    for name in ("train", "validation"):
        data = DataConfig(path=str(out / name))
        with logged(out):
            run_step(capture, CaptureCommand(data=data, draw=config.views, seed=config.seed), out / f"{name}_captured")
    say("train", 5, _STEPS)
    learn = TrainConfig(
        data=DataConfig(path=str(out / "train_captured")), validation_data=[str(out / "validation_captured")],
        learning=LearningConfig(steps=config.steps, epoch=min(500, config.steps), observed_weight=0.2),
        seed=config.seed,
    )  # fmt: skip
    run_step(train, learn, out / "model", since=time.monotonic())
    say("score on people who were not learned from", 6, _STEPS)
    methods = ["linear", "pchip_body", "gaussian_process", "dmae"]
    score = EvaluateConfig(DataConfig(path=str(out / "test")), methods=methods, weights=str(out / "model"))
    views = [3 if 3 in config.views else min(config.views)]
    captured = replace(score, skeleton="body25", views=views)
    # Gaps made in true poses are scored on the skeleton of the detections.
    true_poses = replace(score, input=Input.true_poses, smooth=0.0)
    with logged(out):
        run_step(evaluate, captured, out / "scores")
        run_step(evaluate, true_poses, out / "scores_true")
    print_tables([overview(read_scores(out / "scores"))])
    say("compare with the weights that come with the package", 7, _STEPS)
    print("your weights, compared with the weights of the package:")
    for name, plan in (("scores", captured), ("scores_true", true_poses)):
        with logged(out):
            run_step(evaluate, replace(plan, methods=["dmae"], weights=None), out / f"{name}_shipped")
        shipped, yours = (read_scores(out / f"{name}{each}") for each in ("_shipped", ""))
        gate = compare_scores(shipped, yours, ["methods"])
        own = [line for line in (*map(str, gate.changes), *gate.refused) if line.startswith("dmae,")]
        print(*own, sep="\n")
    card = model_card(out / "model", [out / "scores", out / "scores_true"], command)
    write_atomic(out / "model/MODEL_CARD.md", card)
    print(f"The model is {out / 'model'}; tune it with dmae train init={out / 'model'} data=<recordings with truth>")
    print(f"What the steps printed is in {out / LOG}")


def configurations(config: PretrainCommand, out: Path) -> dict[str, dict[str, Any]]:
    """Return arguments of `synth.generate` by data set: for learning, uncertainty and scores; errors as in `run`."""
    import synth
    from synth.detector.config import DetectorConfig

    detector: Any = config.detector
    rig: Any = config.rig
    if is_preset("detector", detector):
        detector = synth.preset("detector", detector)
    elif Path(detector).suffix:
        detector = read_preset(DetectorConfig, "detector", detector)
    if is_preset("rig", rig):
        rig = synth.preset("rig", rig)
    elif Path(rig).exists():
        rig = synth.preset("rig", "random", path=rig)
    elif Path(rig).suffix:
        raise FileNotFoundError(f"rig={rig}: no such calibration, and no preset of rigs")
    motions: dict[str, Any] = dict.fromkeys(("train", "validation", "test"), "procedural")
    if config.motion is not None:
        takes = Path(config.motion)
        if not takes.exists():
            raise FileNotFoundError(f"motion={takes}: no such folder or list of takes")
        if takes.is_file() and takes.suffix != ".tsv":
            raise ValueError(f"motion={takes}: expected a folder of motion files, or the list of takes (.tsv) of one")
        if takes.is_dir():
            takes = _divided(takes, out / "takes.tsv", config.seed)
        motions = {name: synth.preset("motion", "recorded", path=str(takes), sets=[name]) for name in motions}
    counts = {"train": config.clips, "validation": max(1, config.clips // 4), "test": max(1, config.clips // 4)}
    common = {"rig": rig, "detector": detector, "seconds": config.seconds, "workers": config.workers}
    return {
        name: {"clips": counts[name], "seed": 3 * config.seed + number, "motion": motions[name], **common}
        for number, name in enumerate(counts)
    }


def camera_numbers(config: PretrainCommand) -> list[int]:
    """Return the numbers of cameras that capture people. Raises ValueError if the rig has fewer."""
    import synth

    if Path(config.rig).exists() and not is_preset("rig", config.rig):
        views = len(read_calibration(Path(config.rig)))
    else:
        rig = synth.preset("rig", config.rig)
        views = len(rig.cameras) or getattr(rig, rig.placement.name).views
    if max(config.views, default=2) > views:
        raise ValueError(f"views={config.views}: expected numbers from 2 to {views}, the cameras of rig={config.rig}")
    return config.views or list(range(2, min(views, 5) + 1))


def _divided(motion: Path, takes: Path, seed: int) -> Path:
    import synth
    from synth.datasets.splits import as_table

    found = synth.takes(motion, train=0.7, validation=0.15, test=0.15, seed=seed)
    write_atomic(takes, as_table(found, takes.parent))
    return takes


def command_line(config: PretrainCommand) -> str:
    """Return the command on the card. It contains no folders, so that it can be repeated with other paths."""
    made = [f"clips={config.clips}", f"seconds={config.seconds}", f"steps={config.steps}", f"seed={config.seed}"]
    made += [f"detector={Path(config.detector).name}", f"rig={Path(config.rig).name}"]
    made += [f"views={config.views}".replace(" ", "")] if config.views else []
    return shlex.join(["dmae", "pretrain", *(["motion=..."] if config.motion else []), *made])


def interrupted(config: PretrainCommand, out: Path) -> str:
    return f"{out} holds what is finished; the same command continues"
