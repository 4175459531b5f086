"""Videos: none is decoded that has more pixels than a picture can, or that names other files."""

from pathlib import Path

from dmae.files.contents import check_file
from dmae.files.pictures import MOST_PIXELS


def open_video(path: Path):
    """Return the PyAV container of a video file; nothing that it names is opened.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it holds no video that can be read, or one of too many pixels.
    """
    import av

    check_file(path)
    try:
        container = av.open(str(path), options={"protocol_whitelist": "file"})
    except (av.FFmpegError, ValueError) as error:
        raise ValueError(f"{path}: expected a video, {error}") from None
    try:
        context = container.streams.video[0].codec_context
        if context.width * context.height > MOST_PIXELS:
            raise ValueError(f"{path}: expected at most {MOST_PIXELS} pixels, found {context.width} x {context.height}")
        # A stream may grow later on.
        context.options = {"max_pixels": str(MOST_PIXELS)}
    except (IndexError, AttributeError, av.FFmpegError):
        container.close()
        raise ValueError(f"{path}: expected a video, found no stream that can be decoded") from None
    except ValueError:
        container.close()
        raise
    return container
