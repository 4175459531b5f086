"""Videos: from the pictures of cameras to completed people, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from dmae.data.clip import Clip
from dmae.data.store import load_clip


def run(
    source: str | Path | Clip,
    calibration: str | Path | None = None,
    *,
    detector: str = "blazepose",
    capture: str = "default",
    weights: str | Path | None = None,
    fps: float | None = None,
    offsets: Sequence[int] | None = None,
    export: Sequence[str] = ("trc",),
    workers: int = 1,
    out: str | Path | None = None,
) -> Clip:
    """Turn the videos of calibrated cameras, or the images of a clip, into people in 3D: detect, capture, complete.

        clip = dmae.run("session/videos", "session/calibration.toml", workers=4, out="runs/session")

    Args:
        source: Folder of a video, or a folder of pictures, for each camera, named as in the calibration; or a clip with
            colour images, or its folder.
        calibration: Calibration file, or folder of them; None for a clip, which has its own.
        detector: `blazepose`, or `package.module:function`.
        capture: Name of a preset of `dmae capture`, as "tight".
        weights: Folder that `train`, or `dmae train`, wrote; by default the weights that come with the package.
        fps: Frames per second of the videos, where they do not say.
        offsets: Frames by which each camera started late; by default what the videos say.
        export: Formats of the poses that are written to `out`.
        workers: Processes that detect; -1 for one per core.
        out: Folder of what `dmae run` writes: clips of each step, a report, poses in each format. None: nothing is
            written. The same call continues one that was interrupted.

    Returns:
        A clip with the detections and, as `poses`, the completed people (F, P, J, 3) m, world.

    Raises:
        FileNotFoundError: there are no videos, or no such weights.
        ValueError: a video cannot be read, has no calibration, or is of another size; the clip has no colour images;
            `out` is given for a clip in memory.

    Examples:
        >>> clip = next(synth.generate(seconds=0.2, clips=1, seed=7, out="walks"))
        >>> seen = next(synth.render("walks", quality="draft", images=["rgb"], out="seen"))
        >>> found = dmae.run(seen)
        >>> len(found.poses.xyz) == len(seen)
        True
    """
    from dmae.public import motion, recordings

    if out is None:
        if calibration is None and not isinstance(source, Clip):
            source = load_clip(Path(source))
        clip = recordings.detect(source, calibration, detector=detector, fps=fps, offsets=offsets, workers=workers)
        poses = motion.complete(motion.capture(clip, capture), clip.fps, weights=weights)
        return replace(clip, poses=poses)
    if isinstance(source, Clip):
        raise ValueError("out=...: save the clip first with dmae.save, and give its folder as the source")
    from dmae.cli import DMAE, compose
    from dmae.commands import run as command

    config = replace(
        compose(DMAE.commands["run"], [f"capture={capture}", f"detector={detector}"]),
        **{"clip" if calibration is None else "videos": str(source)},
        calibration=None if calibration is None else str(calibration),
        weights=None if weights is None else str(weights),
        fps=fps,
        offsets=None if offsets is None else list(offsets),
        export=list(export),
        workers=workers,
    )
    command.run(config, Path(out))
    return load_clip(Path(out) / "completed")
