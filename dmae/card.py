"""The card of a trained model: what it is, what it learned from, and what was measured of it."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import yaml

from dmae.store import read_json
from dmae.tables import Table, tables
from dmae.weights import find_shipped, load_model

_USE = """\
Completes joints of people captured by calibrated cameras where no camera measured them (`dmae complete`); what it
completes is a guess, marked `COMPLETED`. Its covariances hold for motion and rigs like those it was calibrated on, and
are unknown (NaN) farther than 0.2 s from any sighting of the person. It tells nothing of who somebody is.
"""

_UNSEEN = "unseen "
"""What the names of clips that a model was validated on begin with, where they are of sets of their own."""

_USUAL = {"hide": "none", "reference": "truth", "skeleton": None, "smooth": 0.1}
"""What of how scores were made is told where it is not as usual."""


def model_card(folder: Path, scores: Sequence[Path], command: str) -> str:
    """Markdown, every fact of it read from what `dmae train` and `dmae evaluate` left.

    Raises:
        FileNotFoundError: a file of theirs is missing.
        ValueError: scores are of other weights.
    """
    model, skeleton, record = load_model(folder)
    config = _config(folder)
    held_back = record["validation_clips"]
    learned = [name for name in read_json(folder / "training.json")["clips"] if name not in held_back]
    settings = {
        name: config[name] for name in ("max_minutes", "batch", "lr", "loss", "seed") if config[name] is not None
    }
    size, network = sum(part.numel() for part in model.parameters()), model.config
    lines = [
        f"# D-MAE for {skeleton.name}",
        "",
        _USE,
        f"- **Network**: {size:,} parameters; windows of {network.frames} frames at {network.fps:g}/s, "
        f"{len(skeleton)} joints; its sizes are in `model.json`.",
        f"- **Learned from**: {_sets(learned, config)}; {record['steps']} steps, {_listed(settings)}.",
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
        for table in tables(found):
            lines += [*_markdown(table), ""]
    return "\n".join(lines)


def _config(folder: Path) -> dict:
    """The resolved configuration under which a command made a folder."""
    return yaml.safe_load((folder / "config.yaml").read_text())


def _sets(clips: Sequence[str], config: dict) -> str:
    """Clips by the set that they are of; those of the first set are called by their number alone."""
    counts = Counter()
    for clip in clips:
        first = config["unseen"][0] if clip.startswith(_UNSEEN) else config["data"]["path"]
        counts[clip.removeprefix(_UNSEEN).rpartition("/")[0] or Path(first).name] += 1
    return ", ".join(f"{count} clips of {name}" for name, count in sorted(counts.items()))


def _listed(facts: dict) -> str:
    return ", ".join(f"{name} {value}" for name, value in facts.items())


def _markdown(table: Table) -> list[str]:
    rule = ["---", *["---:"] * (len(table.header) - 1)]
    return [table.caption, "", *(f"| {' | '.join(row)} |" for row in (table.header, rule, *table.rows))]
