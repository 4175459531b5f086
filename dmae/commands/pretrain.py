"""`dmae pretrain`: a model for your own cameras, detector and motion."""

import shlex
from pathlib import Path

from dmae.command_line.steps import run_steps
from dmae.commands.config import PretrainCommand


def run(config: PretrainCommand, out: Path) -> None:
    run_steps(_steps(config, out))
    print(f"The model is {out / 'model'}; tune it with dmae train init={out / 'model'} data=<recordings with truth>")


def _steps(config: PretrainCommand, out: Path) -> list[list[str]]:
    """Return the command lines, in order.

    Raises:
        ValueError: a path has characters that options give a meaning.
        FileNotFoundError: there is no such motion, calibration or file of a preset.
    """
    for path in (str(out), config.motion or "", config.rig, config.detector):
        if set(path) & set("'\"[]{}(),=$"):
            raise ValueError(f"{path}: expected a path without quotes, brackets, commas, = and $")
    steps, sets = [], {name: _procedural() for name in ("train", "validation", "test")}
    if config.motion:
        motion = Path(config.motion)
        if not motion.exists():
            raise FileNotFoundError(f"motion={motion}: no such folder or list of takes")
        takes = motion
        if motion.is_dir():
            takes = out / "takes.tsv"
            shares = ["train=0.7", "validation=0.15", "test=0.15", f"seed={config.seed}"]
            steps.append(["synth", "split", f"data={motion}", *shares, f"out={takes}"])
        sets = {name: ["motion=recorded", f"motion.path={takes}", f"motion.sets=[{name}]"] for name in sets}
    rig = [f"rig={config.rig}"]
    if Path(config.rig).exists():
        rig = ["rig=random", f"rig.path={config.rig}"]
    elif Path(config.rig).suffix:
        raise FileNotFoundError(f"rig={config.rig}: no such calibration, and no preset of rigs")
    detector = _detector(config.detector)
    counts = {"train": config.clips, "validation": max(1, config.clips // 4), "test": max(1, config.clips // 4)}
    for number, (name, count) in enumerate(counts.items()):
        steps.append(
            ["synth", "generate", f"out={out}/{name}", f"clips={count}", f"seed={3 * config.seed + number}", *rig,
             *detector, f"scene.seconds={config.seconds}", f"workers={config.workers}", *sets[name]]
        )  # fmt: skip
    drawn = f"draw=[{','.join(map(str, config.views))}]"
    steps += [
        ["dmae", "capture", f"data={out}/{name}", drawn, f"seed={config.seed}", f"out={out}/{name}_captured"]
        for name in ("train", "validation")
    ]
    learning = [f"learning.steps={config.steps}", f"learning.epoch={min(500, config.steps)}", f"seed={config.seed}"]
    steps.append(
        ["dmae", "train", f"data={out}/train_captured", f"validation_data=[{out}/validation_captured]", *learning,
         "learning.observed_weight=0.2", f"out={out}/model"]
    )  # fmt: skip
    methods = "methods=[linear,pchip_body,gaussian_process,dmae]"
    scoring = ["dmae", "evaluate", f"data={out}/test", methods, f"weights={out}/model"]
    captured = ["skeleton=body25", f"views=[{3 if 3 in config.views else min(config.views)}]"]
    steps.append([*scoring, *captured, f"out={out}/scores"])
    # Gaps made in true poses are scored on the skeleton of the detections.
    steps.append([*scoring, "input=true_poses", "smooth=0", f"out={out}/scores_true"])
    # The command on the card contains no folders, so that it can be repeated with other paths.
    made = [f"clips={config.clips}", f"seconds={config.seconds}", f"steps={config.steps}", f"seed={config.seed}"]
    made += [f"detector={Path(config.detector).name}", f"rig={Path(config.rig).name}"]
    command = shlex.join(["dmae", "pretrain", *(["motion=..."] if config.motion else []), *made])
    scores = f"scores=[{out}/scores,{out}/scores_true]"
    return [*steps, ["dmae", "card", f"weights={out}/model", f"command={_quoted(command)}", scores]]


def _detector(detector: str) -> list[str]:
    """Return the options of `synth generate` for a preset of the detector, by its name or its file."""
    path = Path(detector)
    if path.suffix not in (".yaml", ".yml"):
        return [f"detector={detector}"]
    if not path.is_file():
        raise FileNotFoundError(f"detector={detector}: no such file")
    if path.parent.name != "detector":
        raise ValueError(f"detector={detector}: expected a file in a folder `detector`, as synth fit-detector writes")
    return [f"--config-dir={path.parent.parent}", f"detector={path.stem}"]


def _quoted(text: str) -> str:
    """Return a text as the value of an option."""
    return f'"{text}"'


def _procedural() -> list[str]:
    return ["motion=procedural"]


def interrupted(config: PretrainCommand, out: Path) -> str:
    return f"{out} holds what is finished; the same command continues"
