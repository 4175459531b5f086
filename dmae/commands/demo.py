"""`dmae demo`: the whole loop on simulated people, from an empty folder to a page."""

import time
from pathlib import Path
from types import ModuleType

from dmae.command_line.outputs import record_options
from dmae.commands import capture, complete, evaluate, report, train
from dmae.commands.config import CaptureCommand, CompleteCommand, DemoCommand, DemoSize, ReportCommand
from dmae.completion.config import LearningConfig, TrainConfig
from dmae.evaluation.config import EvaluateConfig
from dmae.formats.config import DataConfig

_METHODS = ["measured", "linear", "dmae"]


def run(config: DemoCommand, out: Path) -> None:
    """Simulate, capture, train, complete, score and report."""
    import synth  # the only commands of dmae that simulate are this one and `dmae pretrain`

    small, model, scores = config.size == DemoSize.small, str(out / "model"), [str(out / "scores")]
    steps = 8 if config.shelf is None else 9
    say("simulate people to learn from", 1, steps)
    length = {"seconds": 2} if small else {}
    synth.generate(clips=3 if small else 40, seed=1, **length, workers=config.workers, out=out / "train")
    say("simulate others, and render them", 2, steps)
    three = {"rig": synth.preset("rig", "ring", ring=synth.RingConfig(views=3)), "persons": [3, 3]} if small else {}
    pictures = {"images": ["rgb"], "quality": "draft"}
    clips, seconds = (1, 2) if small else (2, 4)
    synth.generate(clips=clips, seed=2, seconds=seconds, **three, **pictures, workers=config.workers, out=out / "test")
    for number, name in ((3, "train"), (4, "test")):
        say(f"capture the people of {out / name}", number, steps)
        captured = out / ("train_captured" if name == "train" else "captured")
        run_step(capture, CaptureCommand(data=DataConfig(path=str(out / name))), captured)
    say("train, from the shipped model" if small else "train", 5, steps)
    learning = LearningConfig(steps=20, epoch=20, batch=16) if small else LearningConfig()
    learn = TrainConfig(
        data=DataConfig(path=str(out / "train_captured")), learning=learning, init="shipped" if small else None,
        max_minutes=None if small else 2.0,
    )  # fmt: skip
    train.run(learn, out / "model", time.monotonic())
    record_options(learn, out / "model")
    say("complete what no camera measured", 6, steps)
    run_step(complete, CompleteCommand(clip=str(out / "captured"), weights=model), out / "completed")
    say("score", 7, steps)
    run_step(
        evaluate, EvaluateConfig(DataConfig(path=str(out / "test")), methods=_METHODS, weights=model), out / "scores"
    )
    if config.shelf is not None:
        say("score on the recording Shelf", 8, steps)
        scores.append(str(out / "scores_shelf"))
        shelf = DataConfig(name="shelf", path=config.shelf)
        run_step(evaluate, EvaluateConfig(shelf, methods=_METHODS, views=[5, 3], weights=model), out / "scores_shelf")
    say("report", steps, steps)
    run_step(report, ReportCommand(clip=str(out / "completed"), scores=scores), out / "report.html")
    print(f"Look at {out / 'report.html'}")


def run_step(command: ModuleType, config, out: Path) -> None:
    """Run another command, and record its configuration with its output."""
    command.run(config, out)
    record_options(config, out)


def say(step: str, number: int, steps: int) -> None:
    print(f"[{number}/{steps}] {step}", flush=True)
