"""Differences between the hand-ins of two runs of a benchmark, with intervals over clips."""

from dmae.evaluation.benchmark.summary import clip_sums, interval_json
from dmae.metrics.intervals import bootstrap_difference


def check_same(earlier: dict, benchmark: str, size: str) -> None:
    """Check that earlier scores are scores of this benchmark and size.

    Raises:
        ValueError: they are of another benchmark or size; the message names both.
    """
    found = (earlier.get("benchmark"), earlier.get("size")) if isinstance(earlier, dict) else (None, None)
    if found != (benchmark, size):
        raise ValueError(
            f"against: expected scores of {benchmark} size={size}, found those of {found[0] or 'no benchmark'}"
            f"{f' size={found[1]}' if found[1] else ''}"
        )


def differences(scores: dict, earlier: dict) -> list[dict]:
    """Return the differences of errors between methods and earlier methods. Positive differences are worse.

    A method is compared with the earlier method of the same name. If there is none, it is compared with each earlier
    method. The bootstrap draws the same clips for both.

    Args:
        scores: Result of `benchmark`.
        earlier: Scores of the same benchmark and size.

    Returns:
        An entry for each pair: `method`; `against`; `mm`, the difference of the mean over levels with its 95 %
        interval; and `shown`, whether the interval excludes zero.

    Raises:
        ValueError: the scores are of other clips or other holes; the message names the first one.
    """
    levels = {clip["id"]: clip["level"] for clip in scores["clips"]}
    new, old = (
        {name: entry["clips"] for name, entry in each["completion"].items() if entry["summary"]["mm"]}
        for each in (scores, earlier)
    )
    found = []
    for method, cells in new.items():
        for counterpart in [method] if method in old else old:
            _check_holes(cells, old[counterpart])
            difference = bootstrap_difference(clip_sums(levels, cells), clip_sums(levels, old[counterpart]))
            found.append({
                "method": method,
                "against": counterpart,
                "mm": interval_json(difference),
                "shown": bool(difference.excludes_zero),
            })  # fmt: skip
    return found


def _check_holes(cells: dict[str, dict], earlier: dict[str, dict]) -> None:
    if list(cells) != list(earlier):
        raise ValueError(f"against: expected scores of {len(cells)} clips from {next(iter(cells))} on, found others")
    for name in cells:
        now, then = sum(cells[name]["holes"]), sum(earlier[name]["holes"])
        if cells[name]["holes"] != earlier[name]["holes"]:
            raise ValueError(
                f"against: clip {name} has {now} holes, then it had {then}, or others as many. The captured poses "
                "differ, as of another version of capture or another processor; score the earlier method again"
            )
