"""Join the results for parts of a data set into the result for all of it."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from dmae.data.json_values import decode
from dmae.evaluation.config import StressConfig
from dmae.evaluation.scores import summary
from dmae.evaluation.stress.matrix import CACHE, compute, prepare
from dmae.formats.reading import load
from dmae.parts import Part

_SHOWN = 3


def join_scores(parts: Sequence[dict], total: int) -> dict:
    """Return the scores over all clips, as `dmae.evaluation.evaluate.evaluate` returns them.

    Args:
        parts: Scores of parts of the data set, in the order of the clips.
        total: Number of clips of all parts together.

    Raises:
        ValueError: the parts differ in methods, numbers of views or skeleton.
    """
    first = parts[0]
    for part in parts[1:]:
        for name, found in (("skeleton", _skeleton), ("methods and views", _scored)):
            if found(part) != found(first):
                raise ValueError(f"expected parts with the same {name}, found {found(first)} and {found(part)}")
    results = []
    for number, (method, views) in enumerate(_scored(first)):
        runs = [_numbers(run) for part in parts for run in part["results"][number]["runs"]]
        results.append({"method": method, "views": views, **summary(runs)})
    name = first["recording"].partition(" clips of ")[2]
    clips = {name: facts for part in parts for name, facts in part["clips"].items()}
    return first | {"recording": f"{total} clips of {name}", "clips": clips, "results": results}


def _skeleton(scores: dict) -> str:
    return scores["skeleton"]


def _scored(scores: dict) -> list[tuple[str, int]]:
    return [(result["method"], result["views"]) for result in scores["results"]]


def _numbers(scores):
    """Return scores with NaN in place of None, which stands for a score without data in JSON."""
    if isinstance(scores, dict):
        return {key: _numbers(value) for key, value in scores.items()}
    if isinstance(scores, list):
        return [_numbers(value) for value in scores]
    return float("nan") if scores is None else scores


def join_stress(parts: Sequence[tuple[Path, Part]], folder: Path, data: str | None = None) -> dict:
    """Join stress tests. Return the result of `dmae.evaluation.stress.matrix.compute` for all clips.

    Args:
        parts: Folders of the parts, with descriptions of the parts.
        folder: Folder of the joined test. The results of the parts are copied to it.
        data: Path of the clips; by default the path of the first part.

    Raises:
        FileNotFoundError: the clips are not at the path.
        ValueError: results are missing in the parts, because they were made with other clips or other code.
    """
    for path, _ in parts:
        for file in (path / CACHE).glob("*/*.json"):
            to = folder / CACHE / file.parent.name / file.name
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, to)
    options, numbers = parts[0][1].options, range(parts[0][1].first, parts[-1][1].stop)
    options = options | {"data": options["data"] | ({} if data is None else {"path": data})}
    config = decode(StressConfig, options, "part.json options")
    clips = load(config.data)
    there = {number for _, part in parts for number in range(part.first, part.stop)}
    whole = [clips[number] for number in numbers if number in there]
    matrix = prepare(whole, config, folder / CACHE)
    missing = matrix.missing()
    if missing:
        lacking = sorted({matrix.ids[clip] for clip, _ in missing})
        raise ValueError(
            f"the parts lack {len(missing)} results of the clips {', '.join(lacking[:_SHOWN])}: they were made of "
            f"clips other than those of {config.data.path}, or by another version; make them again"
        )
    return compute(matrix)
