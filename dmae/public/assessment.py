"""Assessment: evaluate poses, draw and report them, check a solver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import get_skeleton
from dmae.public.arguments import checked

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dmae.evaluation.gates import Gate
    from dmae.regression.verdicts import Verdict
    from dmae.viewing.config import LayersConfig


@checked
def evaluate(clip: Clip, poses: Poses3D | None = None, *, skeleton: str | None = None) -> dict:
    """Score poses against the truth of their clip.

    Args:
        clip: Has truth.
        poses: Captured or completed poses; by default `clip.poses`.
        skeleton: Compare on this skeleton; by default that of the truth, or the second one of two fused.

    Returns:
        The scores of `dmae evaluate` for one clip: `pcp` %, `mpjpe` mm by source, `hidden` {recall %, mpjpe mm},
        `pck`, `gaps`, `identity_switches`, `idf1` and more (`dmae.evaluation.scores.score`).

    Raises:
        ValueError: the clip has no truth, there are no poses, or they differ from the truth in length or unit, or
            have none of its joints.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> scores = dmae.evaluate(clip, dmae.capture(clip))
        >>> bool(scores["pcp"] > 50)
        True
    """
    from dmae.evaluation.predictions import fitting
    from dmae.evaluation.scores import score, scored_actors

    poses = clip.poses if poses is None else poses
    if clip.truth is None or poses is None:
        raise ValueError(f"clip {clip.id!r} has no {'truth to score against' if poses else 'poses; run dmae.capture'}")
    truth = convert(clip.truth, get_skeleton(skeleton) if skeleton else clip.truth.skeleton.parts[-1])
    poses = fitting(poses, truth, f"clip {clip.id!r}")
    captured = poses.without(poses.source == Source.COMPLETED)
    return score(poses, captured, truth, scored_actors(clip), fps=clip.fps)


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
        ValueError: the scores belong to other clips, options or skeletons, or to a version that stored no sums by time.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.save(clip, "walk")
        >>> from dmae.evaluation.config import EvaluateConfig
        >>> from dmae.evaluation.evaluate import evaluate
        >>> from dmae.formats.reading import DataConfig
        >>> scores = evaluate(EvaluateConfig(DataConfig(path="walk"), methods=["linear"]))
        >>> dmae.compare_scores(scores, scores).passed
        True
    """
    from dmae.evaluation import gates
    from dmae.evaluation.scores import read_scores

    found = (each if isinstance(each, dict) else read_scores(Path(each)) for each in (baseline, scores))
    return gates.compare_scores(*found, changed)


@checked
def draw(clip: Clip, poses: Poses3D | None = None, frame: int | None = None) -> Figure:
    """Draw one frame: the poses in every view, and the world from the side and from above. Completed joints are red.

    Args:
        clip: V views.
        poses: By default `clip.poses`.
        frame: Index of the frame; by default the one with most completed joints.

    Returns:
        A matplotlib figure; `figure.savefig("frame.png")` writes it.

    Raises:
        ValueError: there are no poses to draw.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.draw(clip, dmae.capture(clip), frame=10).savefig("frame.png")
        >>> Path("frame.png").stat().st_size > 10_000
        True
    """
    from dmae.reporting.figures import frames_to_draw, views_figure

    clip = clip if poses is None else replace(clip, poses=poses)
    if clip.poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses to draw; run dmae.capture(clip)")
    return views_figure(clip, frames_to_draw(clip, 1)[0] if frame is None else frame)


@checked
def report(
    clip: Clip | Sequence[Clip],
    out: str | Path,
    *,
    scores: Sequence[dict] = (),
    title: str = "Multi-view motion: measured and completed",
) -> None:
    """Write the report of a clip: a player, the worst moments, errors by group, as one HTML file without network.

    Args:
        clip: Any clip, captured and completed or not; or several, as `load_dataset` returns.
        out: The file.
        scores: Contents of `scores.json` of `dmae evaluate`, shown at the end of the page.
        title: Heading of the page.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.report(replace(clip, poses=dmae.capture(clip)), "report.html")
        >>> "Worst moments" in Path("report.html").read_text()
        True
    """
    from dmae.evaluation.report.page import write_clips_report

    write_clips_report(Path(out), [clip] if isinstance(clip, Clip) else clip, scores, title=title)


def benchmark(
    *,
    methods: Sequence[str | Callable] = ("linear", "dmae"),
    captures: Sequence[str | Callable] = ("capture",),
    name: str = "occlusion-v2",
    size: str = "small",
    against: str | Path | None = None,
    workers: int = 1,
    out: str | Path = "runs/benchmark",
) -> dict:
    """Compare completion and capture on a benchmark of occlusion, which is generated from its definition.

    Args:
        methods: Methods that fill the holes of captured poses: functions of poses and frames per second that return
            poses, names of completion methods, or folders of poses.
        captures: Methods that compute poses from detections: functions of a clip, `capture` (of this package), or
            folders of poses.
        name: The benchmark, or a YAML file of your own.
        size: `small` or `full`.
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
    from dmae.evaluation.config import BenchmarkConfig, BenchmarkSize

    if size not in [*BenchmarkSize]:
        raise ValueError(f"size={size}: expected one of {', '.join(BenchmarkSize)}")
    named, own = ([[each for each in group if isinstance(each, str) == by_name] for group in (methods, captures)]
                  for by_name in (True, False))  # fmt: skip
    config = BenchmarkConfig(
        name,
        BenchmarkSize(size),
        *named,
        against=None if against is None else str(against),
        workers=workers,
        out=str(out),
    )
    scores = run(config, *own)
    write_scores(scores, Path(out))
    return scores


def regress(solver: Callable, *, skip: tuple[str, ...] = ()) -> list[Verdict]:
    """Check a triangulation against a frozen pack of cases with documented bounds.

    Args:
        solver: Takes keywords `K` (V, 3, 3), `dist` (V, 5) or (V, 8), `cam_from_world` (V, 4, 4) m, `size` (V, 2) px,
            `xy` (n, V, 2) px, distorted, NaN where absent, `confidence` (n, V); returns (n, 3) m, NaN where it refuses.
        skip: Names of cases.

    Returns:
        A verdict for each case: `passed`, `measured`, `bounds`. `str(verdict)` lists the bounds that are exceeded.

    Raises:
        ValueError: a name in `skip` is not the name of a case.

    Examples:
        >>> from dmae.regression.solvers import ours
        >>> all(verdict.passed for verdict in dmae.regress(ours))
        True
    """
    from dmae.regression.verdicts import check

    return check(solver, skip)


@checked
def show(
    clip: Clip,
    out: str | Path,
    *,
    frames: int = 4,
    views: Sequence[str] = (),
    width: int = 480,
    layers: LayersConfig | None = None,
    video: bool = True,
    rerun: bool = False,
) -> list[Path]:
    """Draw a clip, captured, completed, simulated or as recorded: a contact sheet, a video, a recording for Rerun.

    Args:
        clip: Any clip. Its images, detections, poses and truth are drawn, as far as it has them.
        out: Folder of the files.
        frames: Number of frames on the sheet, one row each.
        views: Names of the cameras; by default all.
        width: Width of a view, px.
        layers: What is drawn; by default the poses, or the truth if there are none, and the detections of real clips.
        video: Whether to write the video, all views of all frames.
        rerun: Whether to write the recording for Rerun.

    Returns:
        The files: `sheet.png`, `clip.mp4`, `clip.rrd`.

    Raises:
        ValueError: there is no such camera, or Rerun is not installed.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> completed = dmae.complete(dmae.capture(clip), clip.fps)
        >>> files = dmae.show(replace(clip, poses=completed), "pictures", frames=1, width=240)
        >>> [file.name for file in files]
        ['sheet.png', 'clip.mp4']
    """
    from dmae.viewing.show import show_clip

    options = {"frames": frames, "views": views, "width": width, "layers": layers, "video": video, "rerun": rerun}
    return show_clip(clip, Path(out), **options)
