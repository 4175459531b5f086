"""Run a benchmark: generate its clips, score the hand-ins, and compare them with earlier scores."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dmae.completion.methods.registry import find_method
from dmae.evaluation.benchmark.cells import AXES, capture_cells, completion_cells
from dmae.evaluation.benchmark.clips import clip_of, given_clip, make_clips
from dmae.evaluation.benchmark.definition import BenchmarkSize, find_definition
from dmae.evaluation.benchmark.differences import check_same, differences
from dmae.evaluation.benchmark.hand_in import OURS, HandIn, Task, find_hand_in
from dmae.evaluation.benchmark.holes import holes_of_capture, holes_of_sight
from dmae.evaluation.benchmark.summary import capture_summary, completion_summary
from dmae.files.structured import read_json
from dmae.parallel import Backend, in_parallel, running_on
from dmae.progress import progress


@dataclass(frozen=True)
class BenchmarkConfig:
    """Score completion and capture on a benchmark of occlusion, which is generated, not downloaded.

    Clips are simulated from a definition and its seed, and their checksums are compared with the published ones.
    Methods fill the holes of the same captured poses; captures make poses from the detections. A method or a capture is
    a name, package.module:function, or a folder of poses with a file LEVEL/SET/CLIP.npz for each clip.
    """

    name: str = "occlusion-v2"
    """The benchmark: one of the package, or your own YAML file."""
    size: BenchmarkSize = BenchmarkSize.small
    """Number of clips: small takes minutes; published tables use full."""
    methods: list[str] = field(default_factory=lambda: ["linear", "pchip_body", "gaussian_process", "dmae"])
    """Methods that fill holes: completion methods, module:function of poses and their frame rate, or folders of
    poses."""
    captures: list[str] = field(default_factory=lambda: [OURS])
    """Methods that make poses from detections: `capture` (this package), module:function of a clip, or folders of
    poses."""
    weights: str | None = None
    """Folder that `dmae train` wrote, for learned methods; by default the weights that come with the package."""
    against: str | None = None
    """Earlier scores, a `scores.json` or its folder, to compare with: paired differences with intervals."""
    data_folder: str | None = None
    """Folder of the clips, which runs can share; by default `data` in `out`."""
    workers: int = 1
    """Processes; -1 for one per core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    out: str = "runs/benchmark"
    """Folder for `scores.json`, `benchmark.html` and the clips."""


def benchmark(config: BenchmarkConfig, methods: Sequence[Callable] = (), captures: Sequence[Callable] = ()) -> dict:
    """Generate the clips of a benchmark unless they exist, and score methods and captures on them.

    Args:
        config: Configuration of the run.
        methods, captures: Functions that are scored in addition to the methods and captures of the configuration.

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
    hand_ins = [find_hand_in(each, Task.completion, config.weights) for each in (*config.methods, *methods)]
    hand_ins += [find_hand_in(each, Task.capture) for each in (*config.captures, *captures)]
    names = [(each.task, each.name) for each in hand_ins]
    if len(set(names)) < len(names):
        raise ValueError(f"expected methods of different names, found {[name for _, name in names]}")
    if not hand_ins:
        raise ValueError("methods=[] captures=[]: nothing to score")
    sets = definition.sets(config.size)
    ids = [name for each in sets for name in each.ids]
    for hand_in in hand_ins:
        hand_in.check(ids)
    earlier = _earlier(config.against)
    if earlier:
        check_same(earlier, definition.name, config.size)
    data = Path(config.data_folder) if config.data_folder else Path(config.out) / "data"
    with running_on(config.backend):
        agreement = make_clips(definition, config.size, data, config.workers)
    level_of = {name: each.level for each in sets for name in each.ids}
    tasks = [(data, name, hand_ins) for name in ids]
    with running_on(config.backend):
        scored = list(progress(in_parallel(score_clip, tasks, config.workers), "scoring clips", len(ids)))
    scores = {
        "benchmark": definition.name,
        "size": BenchmarkSize(config.size).value,
        "checksums": agreement.value,
        "axes": AXES,
        "levels": [
            {
                "name": level.name,
                "about": level.about,
                **_difficulty([s for s in scored if level_of[s["id"]] == number]),
            }
            for number, level in enumerate(definition.levels)
        ],
        "holes": np.sum([each["holes"] for each in scored], 0).tolist(),
        "clips": [
            {"level": level_of[each["id"]]} | {key: value for key, value in each.items() if key not in [*Task, "holes"]}
            for each in scored
        ],
    }
    for task, summary in ((Task.completion, completion_summary), (Task.capture, capture_summary)):
        names = list(scored[0][task])
        cells = {name: {each["id"]: each[task][name] for each in scored} for name in names}
        scores[task.value] = {name: {"summary": summary(level_of, cells[name]), "clips": cells[name]} for name in names}
    if earlier:
        scores["differences"] = differences(scores, earlier)
    return scores


def score_clip(data: Path, name: str, hand_ins: list[HandIn]) -> dict:
    """Return the scores of all hand-ins on one clip.

    Args:
        data: Folder of the benchmark's clips.
        name: Id of the clip.
        hand_ins: The hand-ins to score.

    Returns:
        JSON-able. `id`, `frames`, `persons`, `cameras`; `joints`, the number of true joints; `uncaptured`, the number
        of joints of persons that capture missed; `hidden`, the number of joints of other persons that capture did not
        measure; `causes`, the number of hidden joints by cause; `holes`, the number of holes in each cell; `linear_mm`,
        the sum of errors of linear filling in each cell; `completion` and `capture`, the cells of each hand-in by name.
        Completed poses are also scored as a capture: `capture + <method>`.
    """
    clip, given = clip_of(data, name), given_clip(data, name)
    holes, sight = holes_of_capture(clip, given.poses), holes_of_sight(clip, given.poses.skeleton)
    linear = find_method("linear").function(given.poses, given.fps)
    found: dict[str, dict] = {task.value: {} for task in Task}
    for hand_in in hand_ins:
        # Read the clip again for each method, so that no method gets data that another has changed.
        poses = hand_in.poses(name, given_clip(data, name))
        if hand_in.task == Task.completion:
            found[Task.completion][hand_in.name] = completion_cells(holes, given.poses, linear, poses)
            found[Task.capture][f"{OURS} + {hand_in.name}"] = capture_cells(sight, poses)
        else:
            found[Task.capture][hand_in.name] = capture_cells(sight, poses)
    known = ~np.isnan(holes.truth.xyz).any(-1)
    by_linear = completion_cells(holes, given.poses, linear, linear)
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
    """Return the difficulty of a level: hidden joints, %, error of linear filling, mm, and causes, %."""

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


def _earlier(against: str | None) -> dict | None:
    if against is None:
        return None
    path = Path(against)
    return read_json(path / "scores.json" if path.is_dir() else path)
