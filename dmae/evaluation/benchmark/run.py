"""A benchmark from hand-ins to scores: make the clips, score every hand-in, compare with earlier scores.

A hand-in is a method by name, a function of your own, or a folder of poses made elsewhere. Its scores on a clip are
sums by cause, length and body part of the gaps; `completion_summary` and `capture_summary` divide them over all clips.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from dmae.completion.methods import completion_method, find_method
from dmae.data.clip import Clip, Poses3D
from dmae.data.json_values import rounded
from dmae.evaluation.benchmark.clips import clip_of, find_definition, given_clip, make_clips
from dmae.evaluation.benchmark.holes import (
    ANGLE_AXES,
    AXES,
    angle_cells,
    capture_cells,
    completion_cells,
    holes_of_capture,
    holes_of_sight,
)
from dmae.evaluation.config import OURS, BenchmarkConfig, BenchmarkSize
from dmae.evaluation.predictions import fitting
from dmae.evaluation.scores import read_scores
from dmae.formats.poses import pose_paths, read_poses
from dmae.metrics.angles import leg_angles
from dmae.metrics.table import Score, ratios, score_of
from dmae.parallel import in_parallel, running_on
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig, capture_method
from dmae.reconstruction.pipeline import capture, of_clip_and_config
from dmae.registry import OutsideError, from_outside, load_function, raised_in
from dmae.reporting.tables import listed


class Task(StrEnum):
    """The kind of result that a method hands in."""

    completion = "completion"
    """Poses with the gaps of our capture filled: all methods on the same gaps."""
    capture = "capture"
    """Poses made from detections, by any capture."""


@dataclass(frozen=True)
class HandIn:
    """A method or capture that is scored."""

    name: str  # The user's name for it: a completion method, `capture`, `package.module:function`, or a folder
    task: Task  # The task that it solves
    weights: str | None = None  # Folder of trained weights, for learned completion methods
    own: Callable | None = None  # A Python function; `name` is then the name of the function

    @property
    def folder(self) -> Path | None:
        """The folder of poses; None if the name is not a folder. Write `./NAME` if a method has the same name."""
        known = self.own or self.name in completion_method or self.name in capture_method or self.name == OURS
        return Path(self.name) if not known and Path(self.name).is_dir() else None

    def check(self, clips: list[str]) -> None:
        """Raise ValueError if the method, function or folder does not exist, and FileNotFoundError if the folder lacks
        clips of the benchmark."""
        if self.folder is None:
            self.function()
            return
        lacking = [name for name in clips if _file(self.folder, name) is None]
        if lacking:
            raise FileNotFoundError(
                f"{self.name}: lacks {len(lacking)} of {len(clips)} clips: {listed(lacking, 3)}; expected "
                f"{lacking[0]}.npz, as dmae export format=npz writes, or another format that dmae.read_poses reads"
            )

    def function(self) -> Callable:
        """Return the function that makes poses. Its arguments are poses and frames per second, or a clip."""
        if self.own:
            return self.own
        if self.task == Task.completion:
            return find_method(self.name).load(Path(self.weights) if self.weights else None)
        if self.name == OURS:
            return lambda clip: clip.poses
        if self.name in capture_method:
            return partial(capture, config=CaptureConfig(method=self.name))
        if ":" not in self.name:
            known = ", ".join([OURS, *capture_method])
            raise ValueError(f"captures={self.name}: expected {known}, package.module:function, or a folder of poses")
        function = of_clip_and_config(from_outside(load_function("captures", self.name)), f"captures={self.name}")
        return lambda clip: function(clip, CaptureConfig())

    def poses(self, name: str, given: Clip) -> Poses3D:
        """Return the poses of a clip on the skeleton of our captured poses, made from `given`, the data methods get.

        Raises ValueError, which names clip and hand-in, if they are no poses, or do not fit the clip (`fitting`).
        """
        where = f"{self.name}, clip {name}"
        if self.folder is not None:
            file = _file(self.folder, name)
            assert file is not None, "`check` refuses folders that lack clips"
            found = read_poses(file)
            if found.fps is not None and not np.isclose(found.fps, given.fps, rtol=1e-3):
                raise ValueError(f"{where}: expected {given.fps:g} frames per second, found {found.fps:g}")
            poses = found.poses
        else:
            function = self.function()
            try:
                poses = function(given.poses, given.fps) if self.task == Task.completion else function(given)
            except OutsideError as error:
                raise ValueError(f"{where}: {str(error).removeprefix(f'{self.name}: ')}") from error
            # A function of another project may raise any error. The message names the clip and the function.
            except Exception as error:
                raise ValueError(f"{where}: {raised_in(error, self.own or function)}") from error
        assert given.poses is not None
        if not isinstance(poses, Poses3D):
            raise ValueError(f"{where}: expected dmae.Poses3D, found {type(poses).__name__}")
        return fitting(poses, given.poses, where, tracks=self.task == Task.completion)


def hand_ins_of(
    config: BenchmarkConfig, clips: list[str], methods: Sequence[Callable], captures: Sequence[Callable]
) -> list[HandIn]:
    """Return the methods and captures of a configuration, and of the functions given, checked; errors as `benchmark`.

    Raises also ValueError if there are none, or two of a task have one name.
    """
    completing: list[str | Callable] = [*config.methods, *methods]
    capturing: list[str | Callable] = [*config.captures, *captures]
    given: list[tuple[str | Callable, Task, str | None]]
    given = [(each, Task.completion, config.weights) for each in completing]
    given += [(each, Task.capture, None) for each in capturing]
    found = [
        HandIn(getattr(each, "__name__", repr(each)), task, weights, each)
        if callable(each)
        else HandIn(each, task, weights)
        for each, task, weights in given
    ]
    names = [(each.task, each.name) for each in found]
    if len(set(names)) < len(names):
        raise ValueError(f"expected methods of different names, found {[name for _, name in names]}")
    if not found:
        raise ValueError("methods=[] captures=[]: nothing to score")
    for hand_in in found:
        hand_in.check(clips)
    return found


def _file(folder: Path, name: str) -> Path | None:
    """Return the file or folder of a clip's poses; None if it does not exist."""
    place = folder / name
    return (pose_paths(place.parent) or {}).get(place.name) if place.parent.is_dir() else None


def completion_summary(levels: dict[str, int], cells: dict[str, dict]) -> dict:
    """Return the scores of completed poses, from the level of each clip and its `completion_cells`, by id.

    Returns:
        JSON-able; None stands for "not measured". `mm`, the mean error in gaps, is the mean over levels with its 95 %
        interval over clips; `levels`, `cause`, `frames`, `part` and `cells` (flat, in the order of `AXES`) split it.
        `filled`, % of the holes that were filled. `held`, % of the filled holes with a covariance that are within their
        90 % region, and `held_cause`, `held_frames`. `seen`, mm, the error of measured joints. `angles`, if they are
        scored, see `angle_summary`.
    """
    turned = {name: each["angles"] for name, each in cells.items() if "angles" in each}
    angles = {"angles": angle_summary(levels, turned)} if turned else {}
    if not _total(cells, "filled"):
        none = dict.fromkeys(("mm", "levels", "cause", "frames", "part", "cells", "held", "held_cause", "held_frames"))
        return none | {"filled": 0.0, "seen": _ratio(cells, "seen_mm", "seen")} | angles
    table = cell_table(levels, cells)
    return {
        "mm": _mean_error(table).json(2),
        "levels": [*_ratios(table, "level", value="mm").values()],
        **{axis: _ratios(table, axis, value="mm") for axis in AXES},
        "cells": [*_ratios(table, *AXES, value="mm", digits=1).values()],
        "filled": _ratio(cells, "filled", "holes", 100),
        "held": _ratio(cells, "held", "stated", 100),
        "held_cause": _ratios(table, "cause", value="held", count="stated", scale=100),
        "held_frames": _ratios(table, "frames", value="held", count="stated", scale=100),
        "seen": _ratio(cells, "seen_mm", "seen"),
        **angles,
    }


def angle_summary(levels: dict[str, int], cells: dict[str, dict]) -> dict:
    """Return the scores of joint angles, from the level of each clip and its `angle_cells`, by id.

    Returns:
        JSON-able. `degrees`, the mean absolute error, as `mm` of `completion_summary`; `levels` and each of
        `ANGLE_AXES` split it. `determined`, % of the true angles; `held`, % of these that are in the 90 % interval.
    """
    table = cell_table(levels, cells, ANGLE_AXES)
    return {
        "degrees": _mean_error(table, "degrees", "determined").json(2),
        "levels": [*_ratios(table, "level", value="degrees", count="determined").values()],
        **{axis: _ratios(table, axis, value="degrees", count="determined") for axis in ANGLE_AXES},
        "determined": _ratio(cells, "determined", "angles", 100),
        "held": _ratio(cells, "held", "determined", 100),
    }


def capture_summary(levels: dict[str, int], cells: dict[str, dict]) -> dict:
    """Return the scores of poses of any capture, from the level of each clip and its `capture_cells`, by id.

    Returns:
        JSON-able; None stands for "not measured". `pcp`, strict, %. Of joints that fewer than two cameras saw `near`, %
        within 0.1 m, `found`, %, and `mm`, the error of those found; `cause` and `levels` split `near`. `seen_near`,
        `seen_found` and `seen_mm` are the same of the other joints. `extra`, % of persons in a frame that match no true
        person.
    """
    names = ("pcp", "near", "found", "mm", "cause", "levels", "seen_near", "seen_found", "seen_mm", "extra")
    if not _total(cells, "persons"):
        return dict.fromkeys(names)
    table = cell_table(levels, cells)
    return {
        "pcp": _ratio(cells, "correct", "limbs", 100),
        "near": _ratio(cells, "near", "holes", 100),
        "found": _ratio(cells, "filled", "holes", 100),
        "mm": _ratio(cells, "mm", "filled"),
        "cause": _ratios(table, "cause", value="near", scale=100),
        "levels": [*_ratios(table, "level", value="near", scale=100).values()],
        "seen_near": _ratio(cells, "seen_near", "seen", 100),
        "seen_found": _ratio(cells, "seen_found", "seen", 100),
        "seen_mm": _ratio(cells, "seen_mm", "seen_found"),
        "extra": _ratio(cells, "extra", "persons", 100),
    }


def cell_table(levels: dict[str, int], cells: dict[str, dict], axes: dict[str, list[str]] = AXES) -> pd.DataFrame:
    """Return the score table of clips: the columns `level`, `clip`, the axes, and a column for each sum over a cell."""
    classes = pd.MultiIndex.from_product(list(axes.values()), names=list(axes)).to_frame(index=False)
    names = sorted(cells, key=lambda name: levels[name])
    parts = [
        classes.assign(level=levels[name], clip=name, **{k: v for k, v in cells[name].items() if isinstance(v, list)})
        for name in names
    ]
    return pd.concat(parts)


def _mean_error(table: pd.DataFrame, value: str = "mm", count: str = "holes") -> Score:
    """Return the error in gaps, mm: the mean over levels. Clips of a level are drawn for its interval."""
    return score_of(table, "level", within="level", draw="clip", value=value, count=count)


def _ratios(table: pd.DataFrame, *by: str, value: str, count: str = "holes", scale=1, digits: int = 2) -> dict:
    found = ratios(table, *by, value=value, count=count, scale=scale)
    return {key: rounded(each, digits) for key, each in found.items()}


def _total(cells: dict[str, dict], key: str) -> float:
    return np.sum([each[key] for each in cells.values()])


def _ratio(cells: dict[str, dict], value: str, count: str, scale: float = 1) -> float | None:
    total = _total(cells, count)
    return rounded(scale * _total(cells, value) / total, 2) if total else None


def check_same(earlier: dict, benchmark: str, size: str) -> None:
    """Raise ValueError if earlier scores are not of this benchmark and size."""
    found = (earlier.get("benchmark"), earlier.get("size")) if isinstance(earlier, dict) else (None, None)
    if found != (benchmark, size):
        raise ValueError(
            f"against: expected scores of {benchmark} size={size}, found scores of {found[0] or 'no benchmark'}"
            f"{f' size={found[1]}' if found[1] else ''}"
        )


def differences(scores: dict, earlier: dict) -> list[dict]:
    """Return differences of errors between methods and earlier methods, of one benchmark and size; positive: worse.

    A method is compared with the earlier method of the same name. If there is none, it is compared with each earlier
    method. The bootstrap draws the same clips for both. An entry has `method`; `against`; `mm`, the difference of the
    mean over levels with its 95 % interval; and `shown`, whether the interval excludes zero.

    Raises ValueError if the scores are of other clips or other holes; the message names the first one.
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
            difference = _mean_error(cell_table(levels, cells)) - _mean_error(cell_table(levels, old[counterpart]))
            found.append({
                "method": method,
                "against": counterpart,
                "mm": difference.json(2),
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


def benchmark(config: BenchmarkConfig, methods: Sequence[Callable] = (), captures: Sequence[Callable] = ()) -> dict:
    """Generate the clips of a benchmark unless they exist, and score methods and captures on them.

    Functions given are scored in addition to the methods and captures of the configuration.

    Returns:
        JSON-able. `benchmark`; `size`; `checksums`, the agreement of the clips with the frozen ones (`FrozenMatch`);
        `axes`, the classes of cells; `levels`, each with its name, clips and difficulty; `holes`, their number in each
        cell; `clips`, facts about each clip; `completion` and `capture`, for each hand-in by name its `summary` and its
        `clips`, which are its cells by clip id; `differences` from earlier scores, see `differences`.

    Raises:
        ValueError: the benchmark or a hand-in does not exist, poses do not fit a clip, clips differ from the frozen
            ones, or earlier scores are of other clips or holes.
        FileNotFoundError: a folder of poses lacks clips, or the earlier scores do not exist.
    """
    definition = find_definition(config.name)
    level_of = {name: each.level for each in definition.sets(config.size) for name in each.ids}
    hand_ins = hand_ins_of(config, [*level_of], methods, captures)
    earlier = None if config.against is None else read_scores(Path(config.against))
    if earlier:
        check_same(earlier, definition.name, config.size)
    data = Path(config.data_folder) if config.data_folder else Path(config.out) / "data"
    with running_on(config.backend):
        if users := [each for each in hand_ins if each.own or (each.folder is None and ":" in each.name)]:
            # A mistake in a function of the user is found before minutes of simulation.
            make_clips(definition, config.size, data, config.workers, sets=1)
            score_clip(data, next(iter(level_of)), users)
        agreement = make_clips(definition, config.size, data, config.workers)
        tasks = [(data, name, hand_ins, config.angles) for name in level_of]
        scored = list(progress(in_parallel(score_clip, tasks, config.workers), "scoring clips", len(tasks)))
    scores = {
        "benchmark": definition.name,
        "size": BenchmarkSize(config.size).value,
        "checksums": agreement.value,
        "axes": AXES,
        "levels": [
            {"name": level.name, "about": level.about}
            | _difficulty([each for each in scored if level_of[each["id"]] == number])
            for number, level in enumerate(definition.levels)
        ],
        "holes": np.sum([each["holes"] for each in scored], 0).tolist(),
        "clips": [
            {"level": level_of[each["id"]]} | {key: value for key, value in each.items() if key not in [*Task, "holes"]}
            for each in scored
        ],
    }
    for task, summary in ((Task.completion, completion_summary), (Task.capture, capture_summary)):
        cells = {name: {each["id"]: each[task][name] for each in scored} for name in scored[0][task]}
        scores[task.value] = {name: {"summary": summary(level_of, each), "clips": each} for name, each in cells.items()}
    if earlier:
        scores["differences"] = differences(scores, earlier)
    return scores


def score_clip(data: Path, name: str, hand_ins: list[HandIn], angles: bool = False) -> dict:
    """Return the scores of all hand-ins on one clip, `angles` of completed poses as well if they are asked for.

    JSON-able. `id`, `frames`, `persons`, `cameras`; `joints`, the number of true joints; `uncaptured`, the number of
    joints of persons that capture missed; `hidden`, the number of joints of other persons that capture did not measure;
    `causes`, the number of these by cause; `holes`, the number of holes in each cell; `linear_mm`, the sum of errors of
    linear filling in each cell; `completion` and `capture`, the cells of each hand-in by name. Completed poses are also
    scored as a capture: `capture + <method>`.
    """
    clip, given = clip_of(data, name), given_clip(data, name)
    captured = given.poses
    assert captured is not None and clip.truth is not None
    holes, sight = holes_of_capture(clip, captured), holes_of_sight(clip, captured.skeleton)
    linear = find_method("linear").function(captured, given.fps)
    true = leg_angles(holes.truth)[0] if angles else None
    found: dict[str, dict] = {task.value: {} for task in Task}
    for hand_in in hand_ins:
        # Read the clip again for each method, so that no method gets data that another has changed.
        poses = hand_in.poses(name, given_clip(data, name))
        if hand_in.task == Task.completion:
            cells = completion_cells(holes, captured, linear, poses)
            turned = {} if true is None else {"angles": angle_cells(holes, true, captured, poses)}
            found[Task.completion][hand_in.name] = cells | turned
            found[Task.capture][f"{OURS} + {hand_in.name}"] = capture_cells(sight, poses)
        else:
            found[Task.capture][hand_in.name] = capture_cells(sight, poses)
    known = ~np.isnan(holes.truth.xyz).any(-1)
    by_linear = completion_cells(holes, captured, linear, linear)
    return {
        "id": name,
        "frames": len(clip),
        "persons": clip.truth.xyz.shape[1],
        "cameras": len(clip.rig),
        "joints": int(known.sum()),
        "uncaptured": int((known & (holes.matches < 0)[..., None]).sum()),
        "hidden": int(holes.hidden.sum()),
        "causes": np.bincount(holes.cause[holes.hidden], minlength=len(AXES["cause"])).tolist(),
        "holes": by_linear["holes"],
        "linear_mm": round(sum(by_linear["mm"]), 1),
        **found,
    }


def _difficulty(scored: list[dict]) -> dict:
    """Return the difficulty of a level: unmeasured joints, %, error of linear filling, mm, and causes, %."""

    def total(key: str) -> float:
        return sum(each[key] for each in scored)

    hidden, holes = total("hidden"), sum(sum(each["holes"]) for each in scored)
    by_cause = np.sum([each["causes"] for each in scored], 0)
    return {
        "clips": len(scored),
        "frames": total("frames"),
        "persons": total("persons"),
        "uncaptured": round(100 * total("uncaptured") / total("joints"), 2),
        "hidden": round(100 * hidden / total("joints"), 2),
        "linear": round(total("linear_mm") / holes, 2) if holes else None,
        "causes": {
            name: round(100 * int(count) / hidden, 1) if hidden else None
            for name, count in zip(AXES["cause"], by_cause, strict=True)
        },
    }
