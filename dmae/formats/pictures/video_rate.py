"""Frame rates of videos."""

from pathlib import Path

from dmae.files.numbers import check_rate
from dmae.files.videos import open_video


def video_rate(folder: Path) -> float | None:
    """Return the frames per second of the first video in a folder that states its rate; None if no video does."""
    for path in sorted(folder.glob("*")):
        try:
            with open_video(path) as video:
                rate = video.streams.video[0].average_rate
        except (ValueError, FileNotFoundError, IsADirectoryError):
            continue
        if rate:
            return check_rate(f"{path}: frame rate", float(rate))
    return None
