"""Assessment: score, compare, draw, report, review, and find what breaks a method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.skeleton import Skeleton
from dmae.data.typed import check_arguments
from dmae.evaluation.config import BenchmarkConfig, BenchmarkSize, EvaluateConfig, StressConfig, TableConfig
from dmae.evaluation.corruption import corrupt as corruption
from dmae.evaluation.review import Decision, save_decisions, without_decided
from dmae.viewing.config import ShowConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dmae.evaluation.gates import Gate
    from dmae.evaluation.report.findings import Doubt
    from dmae.regression.verdicts import Verdict


@check_arguments
def evaluate(
    clip: Clip | Sequence[Clip],
    poses: Poses3D | None = None,
    config: EvaluateConfig | None = None,
    *,
    skeleton: str | Path | Skeleton | None = None,
) -> dict:
    """Score poses against the truth of their clip; or, with `config`, methods over clips and subsets of cameras.

    Args:
        clip: Has truth. With `config` one or several, as `dmae.load_dataset(path)`.
        poses: Captured or completed poses; by default `clip.poses`.
        config: Methods and numbers of cameras, as `dmae.EvaluateConfig(methods=["linear", "dmae"], views=[5, 3])`. The
            fields `data`, `poses`, `first`, `clips`, `baseline`, `changed`, `dry_run` and `out` are not used.
        skeleton: Skeleton to compare on, or its name or file. By default the truth's; if that is two fused, the second.
            With `config` it is a field.

    Returns:
        The scores of `dmae evaluate` for one clip: `pcp` %, `mpjpe` mm by source, `hidden` {recall %, mpjpe mm},
        `pck`, `gaps`, `identity_switches`, `idf1` and more (`dmae.evaluation.scores.score`). With `config` the content
        of `scores.json`.

    Raises:
        ValueError: the clip has no truth, there are no poses, or they differ from the truth in length or unit, or
            have none of its joints. With `config`: there is no such method or number of cameras, or no clip, or two
            have the same id.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> scores = dmae.evaluate(clip, dmae.capture(clip))
        >>> bool(scores["pcp"] > 50)
        True
        >>> scores = dmae.evaluate([clip], config=dmae.EvaluateConfig(methods=["measured", "linear"], views=[3]))
        >>> [(result["method"], result["views"], len(result["runs"])) for result in scores["results"]]
        [('measured', 3, 10), ('linear', 3, 10)]
    """
    from dmae.evaluation.evaluate import evaluate as score_methods
    from dmae.evaluation.predictions import fitting
    from dmae.evaluation.scores import compared_truth, score, scored_actors

    if config is not None:
        if poses is not None or skeleton is not None:
            raise ValueError("config: methods make the poses, and config.skeleton is compared on; leave out the others")
        return score_methods(replace(config, poses=None), [clip] if isinstance(clip, Clip) else clip)
    if not isinstance(clip, Clip):
        raise ValueError("several clips are scored by methods: give config=dmae.EvaluateConfig(methods=[...])")
    poses = clip.poses if poses is None else poses
    if poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses; run dmae.capture")
    truth = compared_truth(clip, skeleton)
    poses = fitting(poses, truth, f"clip {clip.id!r}")
    captured = poses.without(poses.source == Source.COMPLETED)
    return score(poses, captured, truth, scored_actors(clip), fps=clip.fps)


@check_arguments
def compare_scores(baseline: dict | str | Path, scores: dict | str | Path, *, changed: tuple[str, ...] = ()) -> Gate:
    """Compare scores with those of a baseline: is any figure worse by more than its interval?

    Args:
        baseline: The `scores.json` that `dmae evaluate` wrote before, its folder, or its content.
        scores: The new scores, in the same form, of the same clips, options and skeleton.
        changed: Options, or groups of options, that differ on purpose.

    Returns:
        `passed`; `changes`, each figure with both values, the interval of the difference and whether it is `worse` or
        `better`; `refused`, what could not be compared. `str(gate)` is the verdict that the command prints.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the scores belong to other clips, options or skeletons, or are not what `dmae evaluate` writes.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> scores = dmae.evaluate(clip, config=dmae.EvaluateConfig(methods=["linear"]))
        >>> dmae.compare_scores(scores, scores).passed
        True
    """
    from dmae.evaluation import gates
    from dmae.evaluation.scores import read_scores

    before, now = (each if isinstance(each, dict) else read_scores(Path(each)) for each in (baseline, scores))
    return gates.compare_scores(before, now, changed)


@check_arguments
def draw(clip: Clip, poses: Poses3D | None = None, frame: int | None = None) -> Figure:
    """Draw one frame: the poses in every view, and the world from the side and from above. Completed joints are red.

    Args:
        clip: V views.
        poses: By default `clip.poses`.
        frame: Index of the frame; by default the one with most completed joints.

    Returns:
        A matplotlib figure; `figure.savefig("frame.png")` writes it.

    Raises:
        ValueError: there are no poses to draw, or no such frame.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.draw(clip, dmae.capture(clip), frame=10).savefig("frame.png")
        >>> Path("frame.png").stat().st_size > 10_000
        True
    """
    from dmae.reporting.figures import views_figure

    return views_figure(_with(clip, poses).without_lost_images(), frame)


@check_arguments
def report(
    clip: Clip | Sequence[Clip],
    out: str | Path,
    *,
    poses: Poses3D | None = None,
    scores: Sequence[dict] = (),
    title: str = "Multi-view motion: measured and completed",
) -> Path:
    """Write the report of a clip: a player, the worst moments, errors by group, as one HTML file without network.

    Args:
        clip: Any clip, captured and completed or not; or several, as `load_dataset` returns.
        out: The file.
        poses: Captured or completed poses of the one clip; by default `clip.poses`.
        scores: Contents of `scores.json`, which `dmae evaluate` writes; shown at the end of the page.
        title: Heading of the page.

    Returns:
        The file.

    Raises:
        ValueError: `poses` are given for several clips.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> page = dmae.report(clip, "report.html", poses=dmae.capture(clip))
        >>> "Worst moments" in page.read_text()
        True
    """
    from dmae.evaluation.report.page import write_clips_report

    if isinstance(clip, Clip):
        clip = [_with(clip, poses)]
    elif poses is not None:
        raise ValueError("poses=...: expected one clip, found several, each with its own poses")
    if Path(out).is_dir():
        raise ValueError(f"out={out}: expected a file, as {Path(out) / 'report.html'}, found a folder")
    write_clips_report(Path(out), clip, scores, title=title)
    return Path(out)


def _with(clip: Clip, poses: Poses3D | None) -> Clip:
    """Return the clip with these poses, or with its own for None."""
    return clip if poses is None else replace(clip, poses=poses)


@check_arguments
def benchmark(
    *,
    methods: Sequence[str | Callable] = ("linear", "pchip_body", "gaussian_process", "dmae"),
    captures: Sequence[str | Callable] = ("capture",),
    name: str = "occlusion-v2",
    size: BenchmarkSize | str = BenchmarkSize.small,
    angles: bool = False,
    against: str | Path | None = None,
    workers: int = 1,
    out: str | Path = "runs/benchmark",
) -> dict:
    """Compare completion and capture on a benchmark of occlusion, which is generated from its definition.

    Args:
        methods: Methods that fill the gaps of captured poses: functions of poses and frames per second that return
            poses, names of completion methods, or folders of poses.
        captures: Methods that compute poses from detections: functions of a clip, `capture` (of this package), or
            folders of poses.
        name: The benchmark, or a YAML file of your own.
        size: `small` or `full`.
        angles: Also score joint angles of hips, knees and ankles.
        against: Earlier scores to compare with.
        workers: Processes; -1 for one per core.
        out: Folder of the clips, `scores.json` and `benchmark.html`.

    Returns:
        `completion` and `capture`: the scores of each hand-in by name, with a `summary` and its `clips`; `levels`,
        `clips`, `checksums` and `differences` (`dmae.evaluation.benchmark.run.benchmark`).

    Raises:
        ValueError: poses do not fit a clip, or a clip differs from the published checksum; the message names the clip.

    Examples:
        >>> tiny = "{about: One clip, seed: 5, small: 1, full: 1, levels: "
        >>> tiny += "[{name: self, about: Apart, sets: {apart: scene.seconds=1}}]}"
        >>> _ = Path("tiny.yaml").write_text(tiny)
        >>> scores = dmae.benchmark(name="tiny.yaml", methods=["linear"], out="benchmark")
        >>> scores["completion"]["linear"]["summary"]["filled"]
        100.0
    """
    from dmae.evaluation.benchmark.page import write_scores
    from dmae.evaluation.benchmark.run import benchmark as run

    config = BenchmarkConfig(
        name,
        BenchmarkSize(size),
        [each for each in methods if isinstance(each, str)],
        [each for each in captures if isinstance(each, str)],
        angles=angles,
        against=None if against is None else str(against),
        workers=workers,
        out=str(out),
    )
    own = ([each for each in group if not isinstance(each, str)] for group in (methods, captures))
    scores = run(config, *own)
    write_scores(scores, Path(out))
    return scores


@check_arguments
def regress(solver: Callable | str, *, skip: tuple[str, ...] = ()) -> list[Verdict]:
    """Check a triangulation against a frozen pack of cases with documented bounds.

    Args:
        solver: Takes keywords `K` (V, 3, 3), `dist` (V, 5) or (V, 8), `cam_from_world` (V, 4, 4) m, `size` (V, 2) px,
            `xy` (n, V, 2) px, distorted, NaN where absent, `confidence` (n, V); returns (n, 3) m, NaN where it refuses.
            Or its name, `package.module:function`.
        skip: Names of cases.

    Returns:
        A verdict for each case: `passed`, `measured`, `bounds`. `str(verdict)` lists the bounds that are exceeded.

    Raises:
        ValueError: the solver does not take these keywords, or a name in `skip` is not the name of a case.

    Examples:
        >>> from dmae.regression.solvers import ours
        >>> all(verdict.passed for verdict in dmae.regress(ours))
        True
    """
    from dmae.regression.verdicts import check

    return check(solver, skip)


@check_arguments
def show(clip: Clip, out: str | Path, config: ShowConfig | None = None, *, poses: Poses3D | None = None) -> list[Path]:
    """Draw a clip, captured, completed, simulated or as recorded: a contact sheet, a video, a recording for Rerun.

    Args:
        clip: Any clip. Its images, detections, poses and truth are drawn, as far as it has them.
        out: Folder of the files.
        config: Frames, cameras, layers and files, as `dmae.ShowConfig(frames=2, video=True)`; by default a sheet with
            the poses, or the truth if there are none, and the detections of real clips. The fields `data` and `out` are
            not used.
        poses: Captured or completed poses; by default `clip.poses`.

    Returns:
        The files: `sheet.png`, `clip.mp4`, `clip.rrd`.

    Raises:
        ValueError: there is no such camera, or Rerun is not installed.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> full = dmae.complete(dmae.capture(clip), clip.fps)
        >>> files = dmae.show(clip, "drawings", dmae.ShowConfig(frames=1, width=240), poses=full)
        >>> [file.name for file in files]
        ['sheet.png']
    """
    from dmae.viewing.show import show_clip

    return show_clip(_with(clip, poses), Path(out), config or ShowConfig())


@check_arguments
def review(clip: Clip, decisions: Sequence[Decision] = ()) -> list[Doubt]:
    """Rank the joints of a clip by how far off they may be, the most doubtful first.

    Args:
        clip: A captured clip, completed or not. The truth is not used.
        decisions: Joints with a decision are left out of the ranking.

    Returns:
        Entries, each for one joint of one person in 0.2 s. `entry.decision("blank")` returns a decision on it.

    Raises:
        ValueError: the clip has no poses.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> clip = replace(clip, poses=dmae.capture(clip))
        >>> first, *others = dmae.review(clip)
        >>> first.doubt >= others[0].doubt
        True
        >>> len(dmae.review(clip, [first.decision("accept")])) == len(others)
        True
    """
    from dmae.evaluation.report.findings import rank_doubts

    return rank_doubts(clip, decisions)


@check_arguments
def decide(clip: Clip, decisions: Sequence[Decision], folder: str | Path | None = None) -> Clip:
    """Return a clip without the joints that decisions blank or hand back.

    Args:
        clip: A captured clip, completed or not.
        decisions: If there are several on one joint, the last one counts.
        folder: Folder of the clip, where the decisions are saved for `dmae export` and `dmae complete`.

    Raises:
        ValueError: a decision names a person, joint or frame that the poses do not have, or there are no poses.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> clip = replace(clip, poses=dmae.capture(clip))
        >>> first = dmae.review(clip)[0]
        >>> kept = dmae.decide(clip, [first.decision("blank")])
        >>> joint = kept.poses.skeleton.joints.index(first.joint)
        >>> np.isnan(kept.poses.xyz[first.worst, first.person, joint]).all()
        np.True_
    """
    if clip.poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses to decide on; run dmae.capture on it first")
    kept = without_decided(clip, decisions)
    if folder is not None:
        save_decisions(Path(folder), clip.poses, decisions)
    return kept


@check_arguments
def corrupt(clip: Clip, levels: Mapping[str, float], *, seed: int = 0) -> Clip:
    """Return a clip, simulated or real, with corrupted detections, cameras or frame rate.

    Args:
        clip: V cameras. Its truth does not change, except that frames may be left out.
        levels: Levels of corruptions of `dmae stress` by name, for example `{"objects": 40, "cameras": 2}`, or by
            `module:function`; at level 0 nothing changes.
        seed: Seed of random numbers.

    Returns:
        A clip without images, poses and labels of detections, because these do not fit the new detections.

    Raises:
        ValueError: there is no such corruption or level, or the clip has too few cameras or people for it.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> fewer = dmae.corrupt(clip, {"objects": 40, "cameras": 2})
        >>> len(fewer.rig) == len(clip.rig) - 2
        True
    """
    return corruption.corrupt(clip, levels, seed=seed)


@check_arguments
def stress(clips: Clip | Sequence[Clip], out: str | Path | None = None, config: StressConfig | None = None) -> dict:
    """Corrupt clips step by step, and score every method at each step.

    Args:
        clips: One or several, all with truth, or all without. Without truth, the reference is what all cameras measured
            in the original clips.
        out: Folder of `stress.json`, the page `stress.html` and cached results; None to write nothing.
        config: Corruptions and methods, as `dmae.StressConfig(axes=["objects", "jitter"], methods=["linear", "dmae"])`.
            The fields `data` and `out` are not used.

    Returns:
        The content of `stress.json`: scores of each method along each axis, and where it breaks
        (`dmae.evaluation.stress.matrix.curves`).

    Raises:
        ValueError: clips do not allow a requested axis.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> result = dmae.stress([clip], None, dmae.StressConfig(axes=["cameras"], pairs=[], methods=["linear"]))
        >>> [point["level"] for point in result["axes"][0]["methods"]["linear"]["points"]]
        [0.0, 1.0, 2.0, 3.0]
    """
    from dmae.evaluation.stress.matrix import CACHE, compute, prepare
    from dmae.evaluation.stress.page import write_result

    clips = [clips] if isinstance(clips, Clip) else clips
    matrix = prepare(clips, config or StressConfig(), Path(out) / CACHE if out else None)
    result = compute(matrix)
    if out:
        write_result(result, Path(out))
    return result


@check_arguments
def table(number: int, data: str | Path, out: str | Path, config: TableConfig | None = None) -> dict:
    """Reproduce a table of the paper: published rows and rows measured here, with intervals.

    Args:
        number: Number of the table, 1 to 5 of the paper, or 6 (mm and recall by number of cameras).
        data: A recording with truth for tables 1, 2 and 4; a data set that `synth.generate` made for 3 and 5.
        out: Folder for trained models. A training that is already finished in it is not repeated.
        config: Size, protocol and more, as `dmae.TableConfig(size=TableSize.small)`; `number`, `data` and `out` are
            replaced by the other arguments.

    Returns:
        The table, as in `table_N.json`.

    Raises:
        ValueError: the data does not fit the table, or `out` contains models of other data.

    Examples:
        >>> for clip in synth.generate(seconds=1, clips=1, seed=7, out="walks"): pass
        >>> made = dmae.table(1, "walks/000000", "table", dmae.TableConfig(size="small"))
        >>> sorted({row["origin"] for row in made["rows"]})
        ['measured here', 'not measured', 'published']
    """
    from dmae.evaluation.paper_tables.tables import make_table
    from dmae.formats.reading import recognise

    config = replace(config or TableConfig(), number=number)
    source = replace(config.data, path=str(data), name=recognise(Path(data)))
    return make_table(replace(config, data=source), Path(out))
