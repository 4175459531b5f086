"""A trial of a Pose2Sim session, with what its Config.toml files say."""

from dataclasses import replace
from pathlib import Path

from dmae.formats.openpose import read_openpose
from dmae.formats.recording import Recording
from dmae.formats.toml import read_toml
from dmae.formats.trc import trc_rate
from dmae.skeleton import BODY25, BODY25B, COCO17, COCO18, HALPE26, Skeleton

_LEVELS = 3
"""A trial, the participant above, the session above that."""
_POSES = ("pose-sync", "pose")
"""Detections of a trial, synchronised ones first."""
_MODELS = {
    "body25": BODY25, "body25b": BODY25B, "coco": COCO18, "coco17": COCO17, "body": COCO17,
    "halpe26": HALPE26, "bodywithfeet": HALPE26,
}  # fmt: skip


def read_pose2sim(path: Path, detections: Path | None = None, skeleton: Skeleton | None = None) -> Recording:
    """The detections of a trial: `pose-sync/` or `pose/`, not the associated ones, persons are found anew.

    Settings come from the Config.toml nearest to the trial that has them: `pose.pose_model` says the skeleton
    and `project.frame_rate` the frame rate. Where it is not there, the rate is that of `videos/*`, or else of
    the trial's own `pose-3d/*.trc`.

    Raises:
        FileNotFoundError: the folder is no trial; the message names those below it.
        ValueError: a file is malformed.
    """
    path = Path(path).resolve()
    folder = detections or next((path / name for name in _POSES if (path / name).is_dir()), None)
    if folder is None:
        trials = sorted(
            str(found.parent.relative_to(path)) for depth in ("*", "*/*") for found in path.glob(f"{depth}/pose")
        )
        hint = f"; there are trials {', '.join(trials)}" if trials else "; name its folder by data.detections=..."
        raise FileNotFoundError(f"{path}: expected a trial, a folder that holds pose/{hint}")
    model = _setting(path, "pose", "pose_model")
    named = _MODELS.get(str(model).lower().replace("_", "").replace("-", ""))
    try:
        recording = read_openpose(folder, skeleton or named)
    except ValueError:
        # A model that the files were not made with: let them speak for themselves.
        if skeleton or not named:
            raise
        recording = read_openpose(folder)
        recording = replace(recording, notes=(*recording.notes, f"{path}: not the {model} that Config.toml says"))
    return replace(recording, fps=_rate(path))


def _rate(path: Path) -> float | None:
    rate = _setting(path, "project", "frame_rate")
    if isinstance(rate, int | float) and rate > 0:
        return float(rate)
    for video in sorted((path / "videos").glob("*")):
        rate = _video_rate(video)
        if rate:
            return rate
    rates = {trc_rate(file) for file in sorted((path / "pose-3d").glob("*.trc"))}
    return rates.pop() if len(rates) == 1 else None


def _video_rate(path: Path) -> float | None:
    import av

    try:
        with av.open(str(path)) as video:
            rate = video.streams.video[0].average_rate
    except (av.FFmpegError, IndexError):
        return None
    return float(rate) if rate else None


def _setting(path: Path, table: str, key: str):
    """A setting of the nearest Config.toml that has it, None if none has."""
    for level in [path, *path.parents][:_LEVELS]:
        file = level / "Config.toml"
        if not file.is_file():
            continue
        found = read_toml(file).get(table, {})
        if isinstance(found, dict) and key in found:
            return found[key]
    return None
