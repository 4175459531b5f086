"""`dmae demo`: the whole loop on simulated people, from an empty folder to a page."""

from pathlib import Path

from dmae.command_line.steps import run_steps
from dmae.commands.config import DemoCommand, DemoSize

_TRAINING_SET = {DemoSize.small: ("clips=3", "scene.seconds=2"), DemoSize.full: ("clips=40",)}
_THREE_CAMERAS = ("rig=ring", "rig.ring.views=3", "scene.persons=[3,3]")
_TEST_SET = {
    DemoSize.small: ("clips=1", "scene.seconds=2", *_THREE_CAMERAS),
    DemoSize.full: ("clips=2", "scene.seconds=4"),
}
_LEARNING = {
    DemoSize.small: ("init=shipped", "learning.steps=20", "learning.epoch=20", "learning.batch=16"),
    DemoSize.full: ("max_minutes=2",),
}


def run(config: DemoCommand, out: Path) -> None:
    run_steps(_steps(config, out))
    print(f"Look at {out / 'report.html'}")


def _steps(config: DemoCommand, out: Path) -> list[list[str]]:
    """Return the command lines of the demo, in order.

    Raises:
        ValueError: a path has characters that options give a meaning.
    """
    for path in (str(out), config.shelf or ""):
        if set(path) & set("'\"[]{}(),=$"):
            raise ValueError(f"{path}: expected a path without quotes, brackets, commas, = and $")
    size = config.size
    generate = ["synth", "generate", f"workers={config.workers}"]
    methods = "methods=[measured,linear,dmae]"
    steps = [
        [*generate, f"out={out}/train", "seed=1", *_TRAINING_SET[size]],
        ["dmae", "capture", f"data={out}/train", f"out={out}/train_captured"],
        [*generate, f"out={out}/test", "seed=2", *_TEST_SET[size], "images=rgb", "quality=draft"],
        ["dmae", "train", f"data={out}/train_captured", f"out={out}/model", *_LEARNING[size]],
        ["dmae", "capture", f"data={out}/test", f"out={out}/captured"],
        ["dmae", "complete", f"clip={out}/captured", f"weights={out}/model", f"out={out}/completed"],
        ["dmae", "evaluate", f"data={out}/test", methods, f"weights={out}/model", f"out={out}/scores"],
    ]
    scores = [f"{out}/scores"]
    if config.shelf:
        scores.append(f"{out}/scores_shelf")
        steps.append(
            ["dmae", "evaluate", "data=shelf", f"data.path={config.shelf}", "views=[5,3]", methods,
             f"weights={out}/model", f"out={scores[1]}"]
        )  # fmt: skip
    report = ["dmae", "report", f"clip={out}/completed", f"scores=[{','.join(scores)}]", f"out={out}/report.html"]
    return [*steps, report]
