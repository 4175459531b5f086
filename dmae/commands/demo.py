"""`dmae demo`: the whole loop on simulated people, from an empty folder to a page."""

import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from types import ModuleType

from dmae.command_line.outputs import record_options
from dmae.commands import capture, complete, evaluate, train
from dmae.commands.config import CaptureCommand, CompleteCommand, DemoCommand, DemoSize
from dmae.completion.config import LearningConfig, TrainConfig
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.report.page import write_clips_report
from dmae.evaluation.scores import read_scores
from dmae.files.contents import check_vacant
from dmae.files.structured import read_json
from dmae.formats.config import DataConfig
from dmae.formats.reading import Clips
from dmae.metrics.score_tables import compared_error, overview
from dmae.reporting.tables import counted, print_tables

_FEW_STEPS = 20  # A network of fewer steps fills little better than the interpolation that it starts from
_SKELETON = "body25"  # On which people are captured, completed and scored
LOG = "log.txt"
"""In the folder of a command of several steps: what each step printed."""


def run(config: DemoCommand, out: Path) -> None:
    """Simulate, capture, train, complete, score and report."""
    import synth  # the only commands of dmae that simulate are this one and `dmae pretrain`

    if not (out / "train").is_dir():  # the first that an earlier demo has written
        check_vacant(out, "the demo")
    small, model = config.size == DemoSize.small, str(out / "model")
    steps = 8 if config.shelf is None else 9
    methods = ["measured", "linear", "dmae", model]
    say("simulate people to learn from", 1, steps)
    synth.generate(
        clips=3 if small else 24, seed=1, seconds=2 if small else None, workers=config.workers, out=out / "train"
    )
    say("simulate others, and render them", 2, steps)
    three = synth.preset("rig", "ring", ring=synth.RingConfig(views=3))
    synth.generate(
        clips=1 if small else 2, seed=2, seconds=2 if small else 3, rig=three if small else None,
        persons=[3, 3] if small else None, images=["rgb"], quality="draft", workers=config.workers, out=out / "test",
    )  # fmt: skip
    for number, name in ((3, "train"), (4, "test")):
        say(f"capture the people of {out / name}", number, steps)
        captured = out / ("train_captured" if name == "train" else "captured")
        with logged(out):
            run_step(capture, CaptureCommand(DataConfig(path=str(out / name)), workers=config.workers), captured)
    say("train, from the shipped model" if small else "train", 5, steps)
    learning = LearningConfig(steps=20, epoch=20, batch=16) if small else LearningConfig()
    learn = TrainConfig(
        data=DataConfig(path=str(out / "train_captured")), learning=learning, init="shipped" if small else None,
        max_minutes=None if small else 1.0,
    )  # fmt: skip
    run_step(train, learn, out / "model", since=time.monotonic())
    say("complete joints on which fewer than two cameras agree, with the weights of the package", 6, steps)
    with logged(out):
        run_step(complete, CompleteCommand(clip=str(out / "captured")), out / "completed")
    say("score these weights (dmae) beside those trained now (model)", 7, steps)
    # The page states its errors on this skeleton, so its tables use it too.
    scoring = EvaluateConfig(
        DataConfig(path=str(out / "test")), methods=methods, skeleton=_SKELETON, workers=config.workers
    )
    scored = [(out / "scores", scoring)]
    if config.shelf is not None:
        shelf = DataConfig(name="shelf", path=config.shelf)
        scored.append((out / "scores_shelf", EvaluateConfig(shelf, methods=methods, views=[5, 3])))
    for number, (folder, each) in enumerate(scored):
        if number:
            say("score on the recording Shelf", 8, steps)
        with logged(out):
            run_step(evaluate, each, folder)
        print_tables([overview(read_scores(folder))])
    say("report", steps, steps)
    page, scores = out / "report.html", [read_scores(folder) for folder, _ in scored]
    shown = Clips(DataConfig(name="clip", path=str(out / "completed")))
    duration = training(read_json(out / "model/model.json")["steps"], small)
    about = what_to_look_at(scores[0], Path(model).name, duration)
    write_clips_report(page, shown, scores, title="The demo: simulated people, captured and completed", about=about)
    print(f"Look at {page}; what the steps printed is in {out / LOG}")


def interrupted(config: DemoCommand, out: Path) -> str:
    return f"{out} holds what is finished; the same command continues"


def training(steps: int, small: bool) -> str:
    """Return how long the demo's network was trained. One minute of a busy machine can be a single step."""
    trained = counted(steps, "step")
    if small:
        return trained
    return f"a minute ({trained}{', too few to learn much: the machine was busy' if steps < _FEW_STEPS else ''})"


def what_to_look_at(scores: dict, trained: str, duration: str) -> list[str]:
    """Return the first paragraphs of the page: what to do in the player, and what the models of the demo are worth."""
    means = {result["method"]: compared_error(result["mean"]) for result in scores["results"]}
    errors = {name: "unknown" if mm is None else f"{mm:.0f}\N{NO-BREAK SPACE}mm" for name, mm in means.items()}
    clips = "this clip" if len(scores["clips"]) == 1 else f"these {len(scores['clips'])} clips"
    gaps = [result["mean"]["gaps"] for result in scores["results"]]
    hidden, filled = (max(sum(gap[count] for gap in each) for each in gaps) for count in ("hidden", "filled"))
    return [
        "What to look at: press Play. Discs are joints that cameras measured; diamonds with a red outline are joints "
        "on which fewer than two cameras agree, completed by the weights that come with the package; thin lines are "
        "the truth. Next gap leads to the next diamond, Worst frame to the largest error.",
        f"Errors are of joints of {scores['skeleton']}, in {clips}. The next paragraphs are about the poses in the "
        "player: all joints, smoothed and completed by dmae complete. The tables under Scores on "
        f"{scores['recording']} compare three ways to fill the {counted(hidden, 'joint')} that cameras did not "
        f"measure. All three fill {filled:,} of them; there the mean error is {errors['dmae']} with these weights, "
        f"{errors[trained]} with the network that this demo trained for {duration}, {errors['linear']} with straight "
        "lines.",
    ]


def run_step(command: ModuleType, config, out: Path, **options) -> None:
    """Run another command, and record its configuration with its output."""
    command.run(config, out, **options)
    record_options(config, out)


@contextmanager
def logged(out: Path) -> Iterator[None]:
    """Write what is printed in the block to the log in a folder."""
    out.mkdir(parents=True, exist_ok=True)
    with (out / LOG).open("a", encoding="utf-8") as log, redirect_stdout(log):
        yield


def say(step: str, number: int, steps: int) -> None:
    print(f"[{number}/{steps}] {step}", flush=True)
