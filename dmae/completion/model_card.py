"""The card of a trained model: its network, its training data, and its scores."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from dmae.completion.weights import find_shipped, load_model
from dmae.files.structured import read_json, read_yaml
from dmae.metrics.tables import score_tables
from dmae.reporting.tables import Table, counted

_USE = """\
Completes joints of people captured by calibrated cameras where no camera measured them (`dmae complete`). Completed
joints are estimates, marked `COMPLETED`. Their covariances hold for motion and rigs like those of the calibration, and
are unknown (NaN) farther than 0.2 s from any measurement of the person. The model does not identify people.
"""

_VALIDATION = ("validation ", "unseen ")
"""Prefixes of the names of clips from `validation_data`; the second is that of version 0.1."""

_USUAL = {"input": "captured_poses", "reference": "truth", "skeleton": None, "smooth": 0.1}
"""Options of `dmae evaluate` that are named where they differ from these."""


def model_card(folder: Path, scores: Sequence[Path], command: str) -> str:
    """Return the card as Markdown; every fact is read from files that `dmae train` and `dmae evaluate` wrote.

    Raises:
        FileNotFoundError: one of these files is missing.
        ValueError: scores are of other weights, or a file is malformed.
    """
    try:
        return _card(folder, scores, command)
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        files = ", ".join(map(str, (folder, *scores)))
        raise ValueError(f"{files}: expected files that dmae train and dmae evaluate wrote, {error!r:.200}") from None


def _card(folder: Path, scores: Sequence[Path], command: str) -> str:
    model, skeleton, record = load_model(folder)
    # Weights that Python trained have no command's configuration, only the settings that training depends on.
    trained = read_json(folder / "training.json")
    config = _config(folder) if (folder / "config.yaml").is_file() else trained
    held_back = record["validation_clips"]
    learned = [name for name in trained["clips"] if name not in held_back]
    learning = config["learning"]
    settings = {"max_minutes": config["max_minutes"]} | {name: learning[name] for name in ("batch", "lr", "loss")}
    settings = {name: value for name, value in settings.items() if value is not None} | {"seed": config["seed"]}
    start = record.get("init")
    size, network = sum(part.numel() for part in model.parameters()), model.config
    lines = [
        f"# D-MAE for {skeleton.name}",
        "",
        _USE,
        f"- **Network**: {size:,} parameters; windows of {network.frames} frames at {network.fps:g}/s, "
        f"{len(skeleton)} joints; its sizes are in `model.json`.",
        f"- **Learned from**: {_sets(learned, config)}; {record['steps']} steps, {_listed(settings)}.",
        *([f"- **Started from**: weights with the sha256 {start['sha256']}."] if start else []),
        f"- **Validated and calibrated on**: {_sets(held_back, config) or 'nothing'}.",
        f"- **Made by**: `{command}`",
        f"- **Made with**: {_listed(record['versions'])}; sha256 of the weights {record['sha256']}.",
        "",
    ]
    for path in scores:
        found = read_json(path / "scores.json")
        config = _config(path)
        used = Path(config["weights"]) if config["weights"] else find_shipped(skeleton)
        if read_json(used / "model.json")["sha256"] != record["sha256"]:
            raise ValueError(f"{path}: the scores are of other weights, {used}; score {folder} with dmae evaluate")
        asked = " ".join(f"{name}={config[name]}" for name, usual in _USUAL.items() if config[name] != usual)
        lines += [f"## {found['recording']}" + (f", `{asked}`" if asked else ""), ""]
        for table in score_tables(found):
            lines += [*_markdown(table), ""]
    return "\n".join(lines)


def _config(folder: Path) -> dict:
    """Return the resolved configuration with which a command made a folder."""
    return read_yaml(folder / "config.yaml")


def _sets(clips: Sequence[str], config: dict) -> str:
    """Return the number of clips by data set; clips of the first set are named by their number alone."""
    counts = Counter()
    for clip in clips:
        prefix = next((prefix for prefix in _VALIDATION if clip.startswith(prefix)), "")
        if "data" in config:
            first = Path(config["validation_data"][0] if prefix else config["data"]["path"]).name
        else:
            first = "a Python program"
        counts[clip.removeprefix(prefix).rpartition("/")[0] or first] += 1
    return ", ".join(f"{counted(count, 'clip')} of {name}" for name, count in sorted(counts.items()))


def _listed(facts: dict) -> str:
    return ", ".join(f"{name} {value}" for name, value in facts.items())


def _markdown(table: Table) -> list[str]:
    rule = ["---", *["---:"] * (len(table.header) - 1)]
    return [table.caption, "", *(f"| {' | '.join(row)} |" for row in (table.header, rule, *table.rows))]
