"""Assessment: evaluate poses, draw and report them, examine a calibration, check a solver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.skeleton import get_skeleton
from dmae.data.skeleton_conversion import convert

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dmae.calibration.doctor import Diagnosis
    from dmae.regression import Verdict


def evaluate(clip: Clip, poses: Poses3D | None = None, *, skeleton: str | None = None) -> dict:
    """Score poses against the truth of their clip.

    Args:
        clip: Has truth.
        poses: Captured or completed poses; by default `clip.poses`.
        skeleton: Compare on this skeleton; by default that of the truth, of two fused the second.

    Returns:
        The scores of `dmae evaluate` for one clip: `pcp` %, `mpjpe` mm by source, `hidden` {recall %, mpjpe mm},
        `pck`, `gaps`, `identity_switches`, `idf1` and more (`dmae.evaluation.scores.score`).

    Raises:
        ValueError: the clip has no truth, or there are no poses.

    Examples:
        >>> clip = next(synth.generate("scene.seconds=1", clips=1, seed=7))
        >>> scores = dmae.evaluate(clip, dmae.capture(clip))
        >>> bool(scores["pcp"] > 50)
        True
    """
    from dmae.evaluation.evaluate import PUBLISHED_ACTORS
    from dmae.evaluation.scores import score

    poses = clip.poses if poses is None else poses
    if clip.truth is None or poses is None:
        raise ValueError(f"clip {clip.id!r} has no {'truth to score against' if poses else 'poses; run dmae.capture'}")
    truth = convert(clip.truth, get_skeleton(skeleton or clip.truth.skeleton.parts[-1].name))
    captured = poses.without(poses.source == Source.COMPLETED)
    actors = PUBLISHED_ACTORS if clip.provenance.get("format") == "shelf" else None
    return score(poses, captured, truth, actors, fps=clip.fps)


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
        >>> clip = next(synth.generate("scene.seconds=1", clips=1, seed=7))
        >>> dmae.draw(clip, dmae.capture(clip), frame=10).savefig("frame.png")
        >>> Path("frame.png").stat().st_size > 10_000
        True
    """
    from dmae.reporting.figures import views_figure
    from dmae.reporting.page import frames_to_draw

    clip = clip if poses is None else replace(clip, poses=poses)
    if clip.poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses to draw; run dmae.capture(clip)")
    return views_figure(clip, frames_to_draw(clip, 1)[0] if frame is None else frame)


def report(clip: Clip, out: str | Path, *, title: str = "Occluded multi-view motion, captured and completed") -> None:
    """Write a page of pictures of a clip's poses: an HTML file that loads nothing from elsewhere.

    Args:
        clip: Has captured or completed `poses`.
        out: The file.
        title: Heading of the page.

    Raises:
        ValueError: the clip has no poses.

    Examples:
        >>> clip = next(synth.generate("scene.seconds=1", clips=1, seed=7))
        >>> dmae.report(replace(clip, poses=dmae.capture(clip)), "report.html")
        >>> "<html" in Path("report.html").read_text()
        True
    """
    from dmae.reporting.page import views_section, write_report

    if clip.poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses to report; run dmae.capture(clip)")
    write_report(Path(out), title, [views_section(clip)])


def doctor(clip: Clip, *, max_offset: int = 50) -> Diagnosis:
    """Find what is wrong with a calibration, by comparing what its cameras detect.

    Args:
        clip: F frames of V cameras; only cameras and detections are read.
        max_offset: Largest time offset between two cameras that is tried, in frames, either way.

    Returns:
        `findings`, each with fault, cameras, evidence and remedy, in the order to correct them; none where nothing is
        wrong. `pairs` says how every two cameras fit.

    Raises:
        ValueError: `max_offset` is negative.

    Examples:
        >>> clip = next(synth.generate("scene.seconds=1", clips=1, seed=7))
        >>> dmae.doctor(clip).findings
        ()
    """
    from dmae.calibration.doctor import diagnose

    return diagnose(clip, max_offset=max_offset)


def benchmark(
    *,
    methods: Sequence[str | Callable] = ("linear", "dmae"),
    captures: Sequence[str | Callable] = ("capture",),
    name: str = "occlusion-v1",
    size: str = "small",
    against: str | Path | None = None,
    workers: int = 1,
    out: str | Path = "runs/benchmark",
) -> dict:
    """Compare completion and capture on a benchmark of occlusion, made here from its definition.

    Args:
        methods: What fills the holes of captured poses: functions of poses and frames per second that return poses,
            names of completion methods, or folders of poses.
        captures: What makes poses of detections: functions of a clip, `capture` (ours), or folders of poses.
        name: The benchmark, or a YAML file of your own.
        size: `small` or `full`.
        against: Earlier scores to compare with.
        workers: Processes; -1 for one a core.
        out: Folder of the clips, `scores.json` and `benchmark.html`.

    Returns:
        `completion` and `capture`: the scores of each hand-in by name, with a `summary` and its `clips`; `levels`,
        `clips`, `checksums` and `differences` (`dmae.evaluation.benchmark.run.benchmark`).

    Raises:
        ValueError: poses do not fit a clip, or clips are not those that were frozen; the message names the clip.

    Examples:
        >>> tiny = "{about: One clip, seed: 5, small: 1, full: 1, levels: "
        >>> tiny += "[{name: self, about: Apart, sets: {apart: scene.seconds=1}}]}"
        >>> _ = Path("tiny.yaml").write_text(tiny)
        >>> scores = dmae.benchmark(name="tiny.yaml", methods=["linear"], out="benchmark")
        >>> scores["completion"]["linear"]["summary"]["filled"]
        100.0
    """
    from dmae.evaluation.benchmark.definition import Size
    from dmae.evaluation.benchmark.run import BenchmarkConfig
    from dmae.evaluation.benchmark.run import benchmark as run
    from dmae.evaluation.benchmark.tables import write_scores

    if size not in [*Size]:
        raise ValueError(f"size={size}: expected one of {', '.join(Size)}")
    named, own = ([[each for each in group if isinstance(each, str) == by_name] for group in (methods, captures)]
                  for by_name in (True, False))  # fmt: skip
    config = BenchmarkConfig(
        name, Size(size), *named, against=None if against is None else str(against), workers=workers, out=str(out)
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
        A verdict a case: `passed`, `measured`, `bounds`, and as text what is broken.

    Raises:
        ValueError: there is no case of a name in `skip`.

    Examples:
        >>> from dmae.regression.solvers import ours
        >>> all(verdict.passed for verdict in dmae.regress(ours))
        True
    """
    from dmae.regression import check

    return check(solver, skip)
