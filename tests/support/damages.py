"""Functions that damage a data set of at least three clips with videos and images. Each returns the affected clips."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from dmae.data.images import write_image, write_video
from dmae.files.checksums import RECORD

OWN = {"data set"}
"""Returned if the damaged file belongs to the whole data set."""


def files_of(path: Path) -> list[Path]:
    """Return all files of a data set."""
    return [file for file in sorted(path.rglob("*")) if file.is_file()]


def contents(path: Path, *but: str) -> dict[str, bytes]:
    """Return the bytes of all files of a folder by their paths, except of files with certain names."""
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in files_of(path) if file.name not in but}


def kinds(path: Path) -> dict[str, list[Path]]:
    """Return the files of a data set by kind: their name, and for images what they show."""
    found: dict[str, list[Path]] = {}
    for file in files_of(path):
        found.setdefault(file.parts[-3] if file.suffix == ".png" else file.name, []).append(file)
    return dict(sorted(found.items()))


def flip_bit(path: Path, number: int, rng: np.random.Generator) -> set[str]:
    """Flip a random bit of a file of a data set; kinds of files take turns."""
    of_kind = list(kinds(path).values())
    files = of_kind[number % len(of_kind)]
    file = files[rng.integers(len(files))]
    data = bytearray(file.read_bytes())
    data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
    file.write_bytes(data)
    parts = file.relative_to(path).parts
    return {parts[0]} if len(parts) > 1 else OWN


def exchange(one: Path, other: Path) -> None:
    """Exchange two files or folders."""
    kept = one.with_name("kept")
    one.rename(kept)
    other.rename(one)
    kept.rename(other)


def structural(path: Path, rng: np.random.Generator) -> Iterator[tuple[str, Callable[[], set[str]]]]:
    """Yield names of damages and functions that do them, one of which is to be called."""
    names = sorted(folder.parent.name for folder in path.glob("*/clip.json"))
    one, other = (names[index] for index in rng.permutation(len(names))[:2])
    images = sorted((path / one / "images").rglob("*.png"))
    videos = sorted((path / one / "images").rglob("*.mp4"))
    image, second = (images[index] for index in rng.permutation(len(images))[:2])
    video = videos[rng.integers(len(videos))]

    def done(action: Callable[[], object], *clips: str) -> Callable[[], set[str]]:
        def damage() -> set[str]:
            action()
            return set(clips) or OWN

        return damage

    def lose_last() -> None:
        shutil.rmtree(path / names[-1])
        manifest = path / "manifest.jsonl"
        manifest.write_text("".join(manifest.read_text().splitlines(keepends=True)[:-1]))

    def in_other(file: Path) -> Path:
        return path / other / file.relative_to(path / one)

    yield "an image is missing", done(image.unlink, one)
    yield "a video is missing", done(video.unlink, one)
    yield "labels are missing", done((path / one / "arrays.safetensors").unlink, one)
    yield "clip.json is missing", done((path / one / "clip.json").unlink, one)
    yield "the configuration is missing", done((path / "config.json").unlink)
    yield "the manifest is missing", done((path / "manifest.jsonl").unlink)
    yield "checksums of the data set are missing", done((path / "checksums.json").unlink)
    yield "checksums of a clip are missing", done((path / one / "checksums.json").unlink, one)
    yield "a clip is missing", done(lambda: shutil.rmtree(path / one), one)
    yield "the last clip is lost", done(lose_last, names[-1])
    yield "a foreign image", done(lambda: shutil.copy(image, image.with_name("000099.png")), one)
    yield "a foreign file in a clip", done(lambda: (path / one / "notes.txt").write_text("?"), one)
    yield "a foreign file in the data set", done(lambda: (path / "notes.txt").write_text("?"))
    yield "a clip twice", done(lambda: shutil.copytree(path / one, path / "000077"))
    yield "an image is renamed", done(lambda: image.rename(image.with_name("000098.png")), one)
    yield "a video is renamed", done(lambda: video.rename(video.with_name("ring9.mp4")), one)
    yield "a clip is renamed", done(lambda: (path / one).rename(path / "000078"), one)
    yield "images exchanged", done(lambda: exchange(image, second), one)
    yield "videos of cameras exchanged", done(lambda: exchange(videos[0], videos[1]), one)
    yield "videos of clips exchanged", done(lambda: exchange(video, in_other(video)), one, other)
    yield "images of clips exchanged", done(lambda: exchange(image, in_other(image)), one, other)
    yield "clips exchanged", done(lambda: exchange(path / one, path / other), one, other)
    yield (
        "labels of clips exchanged",
        done(lambda: exchange(path / one / "arrays.safetensors", path / other / "arrays.safetensors"), one, other),
    )
    yield "a black image", done(lambda: write_image("ids", image, np.zeros((72, 96))), one)
    yield "a black video", done(lambda: write_video(video, np.zeros((3, 72, 96, 3), np.uint8), 25), one)
    yield "a cut image", done(lambda: image.write_bytes(image.read_bytes()[:-9]), one)
    yield "an empty video", done(lambda: video.write_bytes(b""), one)
    if (path / RECORD).is_file():
        yield "the record is changed", done(lambda: (path / RECORD).write_text("seed: 9"))
