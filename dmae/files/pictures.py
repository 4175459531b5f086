"""Read pictures after checking their size, which is in the first bytes, before a decoder allocates memory."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from dmae.files.contents import check_file

MOST_PIXELS = 1 << 26
"""Largest number of pixels of a picture; phones take pictures of 50 million."""
_UPRIGHT_FORMATS = ("PNG", "JPEG", "BMP", "WEBP", "TIFF")
_ORIENTATION = 0x0112
"""EXIF tag; from 5 on, the picture is rotated by a quarter turn."""
_PNG = b"\x89PNG\r\n\x1a\n"
_FRAMES = {0xC0, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}
"""JPEG's markers of a frame; the size of the picture is in its header."""


def check_picture(path: Path) -> tuple[int, int]:
    """Return width and height of a PNG, JPEG or BMP file, px.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is none of these, or has more than `MOST_PIXELS` pixels; the message names the file.
    """
    check_file(path)
    with Path(path).open("rb") as file:
        start = file.read(32)
        try:
            if start.startswith(_PNG) and start[12:16] == b"IHDR":
                width, height = struct.unpack(">II", start[16:24])
            elif start.startswith(b"BM"):
                width, height = map(abs, struct.unpack("<ii", start[18:26]))
            elif start.startswith(b"\xff\xd8"):
                width, height = _jpeg_size(file)
            else:
                raise ValueError("it does not begin like any of them")
        except (ValueError, struct.error) as error:
            raise ValueError(f"{path}: expected a PNG, JPEG or BMP picture, {error}") from None
    if not 0 < width * height <= MOST_PIXELS:
        raise ValueError(f"{path}: expected a picture of at most {MOST_PIXELS} pixels, found {width} x {height}")
    return width, height


def _jpeg_size(file) -> tuple[int, int]:
    file.seek(2)
    while (head := file.read(4)) and len(head) == 4 and head[0] == 0xFF:
        length = struct.unpack(">H", head[2:])[0]
        if head[1] in _FRAMES:
            _, height, width = struct.unpack(">BHH", file.read(5))
            return width, height
        file.seek(max(length - 2, 0), 1)
    raise ValueError("it has no frame")


def read_picture(path: Path, channels: tuple[int, ...]) -> np.ndarray:
    """Return a picture (H, W) or (H, W, C) with one of the given numbers of channels, in OpenCV's order.

    Errors as in `check_picture`.
    """
    check_picture(path)
    try:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError(f"{path}: this picture is damaged, {error}") from None
    found = None if image is None else 1 if image.ndim == 2 else image.shape[2]
    if found not in channels:
        wanted = " or ".join(map(str, channels))
        raise ValueError(f"{path}: expected a readable picture of {wanted} channels, found {found or 'none'}")
    return image


def upright_size(path: Path) -> tuple[int, int]:
    """Return width and height of a PNG, JPEG, BMP, WebP or TIFF file, px, as viewers show it.

    Errors as in `read_upright`.
    """
    with _opened(path) as image:
        width, height = image.size
        turned = _has_exif(image) and image.getexif().get(_ORIENTATION, 1) >= 5
        return (height, width) if turned else (width, height)


def read_upright(path: Path) -> np.ndarray:
    """Return a picture (H, W, 3) uint8 RGB as viewers show it: phones record their orientation in the EXIF data.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is damaged, none of these formats, or has more than `MOST_PIXELS` pixels; the message names it.
    """
    with _opened(path) as image:
        upright = ImageOps.exif_transpose(image) if _has_exif(image) else image
        if upright.mode.startswith("I"):
            grey = np.clip(np.asarray(upright).astype(np.int64) >> 8, 0, 255).astype(np.uint8)
            return np.repeat(grey[..., None], 3, -1)
        return np.array(upright.convert("RGB"))


def _has_exif(image: Image.Image) -> bool:
    """Return whether EXIF data may be there; Pillow would decode a whole PNG to search for them at its end."""
    return image.format != "PNG" or "exif" in image.info


@contextmanager
def _opened(path: Path) -> Iterator[Image.Image]:
    """Open a picture with Pillow; its errors become ValueErrors that name the file."""
    check_file(path)
    try:
        with Image.open(path, formats=_UPRIGHT_FORMATS) as image:
            if not 0 < image.size[0] * image.size[1] <= MOST_PIXELS:
                raise ValueError(
                    f"expected a picture of at most {MOST_PIXELS} pixels, found {image.size[0]} x {image.size[1]}"
                )
            yield image
    except UnidentifiedImageError:
        raise ValueError(f"{path}: expected a PNG, JPEG, BMP, WebP or TIFF picture") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise ValueError(f"{path}: this picture cannot be used, {error}") from None
