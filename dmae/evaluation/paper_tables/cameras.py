"""Table 6, which is not in the paper: error in mm and recall by the number of cameras, on simulated people.

Published figures by number of cameras are on CMU Panoptic, whose recordings are not here; simulated people have truth.
"""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from dmae.evaluation.config import TableConfig
from dmae.evaluation.evaluate import load_methods
from dmae.evaluation.paper_tables.clips import check_truth, load_sets
from dmae.evaluation.paper_tables.recording import AGAINST, METHODS, angle_columns, scored_run, tally_trials
from dmae.evaluation.paper_tables.table import NOISE_NOTE, MeasuredRow, TableColumn, paper_table
from dmae.evaluation.scores import figure_score, run_table, summary
from dmae.progress import progress

_MOST_SUBSETS = 5  # Subsets of a size for each clip, evenly spread over all of them
_NOTES = (
    "Published rows are on CMU Panoptic, with real detections of people who stand and play music in a dome; rows "
    "measured here are on simulated people, so that they are beside each other and not compared.",
    f"Up to {_MOST_SUBSETS} subsets of cameras of each size and clip. MPJPE is over joints of people who are found; "
    "recall is the share of all true joints within 0.2 m, so that a person who is not found lowers it.",
)


def counts_table(config: TableConfig, out: Path) -> dict:
    """Return table 6.

    Args:
        config: `data` and `extra_data` are data sets of simulated clips, all with the same number of cameras.
        out: Not used; this table trains nothing.

    Raises:
        ValueError: a clip has no truth on Shelf's joints, or clips have different numbers of cameras.
    """
    clips = load_sets([config.data.path, *config.extra_data])
    methods = load_methods(METHODS[config.size], config.weights)
    runs: dict[tuple[str, int], list[dict]] = {}
    cameras = len(clips[0].rig)
    for clip in progress(clips, "scoring"):
        check_truth(clip, config.number)
        if len(clip.rig) != cameras:
            raise ValueError(f"clip {clip.id!r} has {len(clip.rig)} cameras, {clips[0].id!r} has {cameras}")
        for count in range(2, cameras + 1):
            subsets = list(combinations(range(cameras), count))
            chosen = np.unique(np.linspace(0, len(subsets) - 1, _MOST_SUBSETS).astype(int))
            for subset in (subsets[index] for index in chosen):
                ((trial, filled, _),) = tally_trials([clip.select(views=list(subset))], config, methods, [])
                for name, poses in filled.items():
                    run = scored_run(trial, poses, config) | {"cameras": subset}
                    runs.setdefault((name, count), []).append(run)
    columns, rows = [], {name: MeasuredRow(name, {}) for name in methods}
    for count in range(2, cameras + 1):
        columns.append(TableColumn(f"mpjpe_{count}", f"MPJPE, {count} cameras", "mm", lead=count == cameras))
        columns.append(TableColumn(f"recall_{count}", f"recall, {count}"))
        columns += [replace(each, key=f"angles_{count}", heading=f"angles, {count}") for each in angle_columns(config)]
        for name, row in rows.items():
            found = runs[name, count]
            table = run_table(found)
            row.cells.update({f"{figure}_{count}": figure_score(table, figure) for figure in ("mpjpe", "angles")})
            row.cells[f"recall_{count}"] = summary(found)["mean"]["pck"]["recall"]
    return paper_table(
        config, columns, list(rows.values()), against=AGAINST, comparable=None,
        recording=f"{len(clips)} simulated clips", frames={}, footnotes=[*_NOTES, NOISE_NOTE],
        rules="joints within 0.2 m",
    )  # fmt: skip
