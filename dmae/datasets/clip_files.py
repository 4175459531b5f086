"""Clips on disk: read some frames without reading the others."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from safetensors import SafetensorError, safe_open

from dmae.data.clip import Clip, Poses3D
from dmae.data.labels import Visibility
from dmae.data.skeleton import decode_skeleton
from dmae.data.store import FORMAT, assemble_clip, clip_folders, is_of_frames
from dmae.files.contents import check_file
from dmae.files.structured import read_json

ARRAYS, META = "arrays.safetensors", "clip.json"
_DAMAGED = (SafetensorError, ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError)
"""Errors that reading a clip raises if its JSON or its arrays are damaged."""
_OPEN = 32
"""Number of files that a process keeps open. They are memory-mapped: only the requested frames are read."""


@dataclass(frozen=True)
class ClipFile:
    """A clip on disk. Only its sizes and names have been read.

    Attributes:
        folder: Folder of the clip.
        frames: Number of frames, F.
        cameras: Names of the V cameras.
        persons: Number of persons P of `truth` and of `poses`, by that name, if the clip has them.
        skeletons: Skeletons of `truth` and of `poses`, by that name, as `dmae.data.skeleton.encode`
            returns them.
        kinds: Kinds of images of the clip.
    """

    folder: Path
    frames: int
    cameras: tuple[str, ...]
    persons: dict[str, int]
    skeletons: dict[str, str | dict]
    kinds: tuple[str, ...]

    def read(self, start: int = 0, stop: int | None = None, view: int | None = None) -> Clip:
        """Return frames `start` to `stop` (excluded) of all views, or of one view.

        `provenance["first_frame"]` is increased accordingly. The checksum of the arrays is not checked, because it
        covers all frames. `synth verify` checks it.

        Raises:
            ValueError: a file is damaged; the message names it.
        """
        path = self.folder / ARRAYS
        meta = _meta(self.folder / META, _modified(self.folder / META))
        try:
            file = _arrays(path, _modified(path))
            stop = self.frames if stop is None else stop
            stored = file.keys()
            arrays = {name: file.get_slice(name)[start:stop] for name in stored if is_of_frames(name)}
            arrays |= {name: file.get_tensor(name) for name in stored if name.startswith(("rig.", "true_rig."))}
            clip = assemble_clip(self.folder, meta, arrays)
            clip.check_numbers()
        except _DAMAGED as error:
            raise ValueError(f"{path}: {error}; the clip is damaged, make it again") from None
        images = clip.images and clip.images.select(slice(start, stop), clip.rig.names)
        provenance = clip.provenance | {"first_frame": clip.provenance.get("first_frame", 0) + start}
        clip = replace(clip, images=images, provenance=provenance)
        return clip if view is None else clip.select(views=[view])

    def person(self, of: str, person: int, start: int, stop: int) -> Poses3D:
        """Return frames `start` to `stop` (excluded) of one person of `truth` or `poses`, without covariance and rays.

        For the truth, `views` are the cameras that see a joint, if the clip has visibility labels.

        Raises:
            ValueError: a file is damaged; the message names it.
        """
        path = self.folder / ARRAYS
        try:
            file = _arrays(path, _modified(path))
            xyz, source, views = (
                file.get_slice(f"{of}.{name}")[start:stop, person : person + 1] for name in ("xyz", "source", "views")
            )
            if of == "truth" and "visibility" in file.keys():  # noqa: SIM118
                seen = file.get_slice("visibility")[start:stop, :, person : person + 1] == Visibility.VISIBLE
                views = seen.sum(1)
            poses = Poses3D(decode_skeleton(self.skeletons[of], str(self.folder)), xyz, source, views=views)
            poses.check_numbers(of)
        except _DAMAGED as error:
            raise ValueError(f"{path}: {error}; the clip is damaged, make it again") from None
        return poses


def clip_files(path: Path) -> Iterator[ClipFile]:
    """Yield the clips of the data set at a path, or the single clip there. Only the file headers are read.

    Raises:
        FileNotFoundError: the path is neither a clip nor a data set, or a clip of its manifest is missing.
        ValueError: a file is malformed; the message names it.
    """
    for folder in clip_folders(Path(path)):
        meta = read_json(folder / META)
        if not isinstance(meta, dict) or meta.get("format") != FORMAT:
            raise ValueError(f"{folder / META}: expected a clip of format {FORMAT}")
        yield _head(folder, meta)


def _head(folder: Path, meta: dict) -> ClipFile:
    check_file(folder / ARRAYS)
    try:
        with safe_open(folder / ARRAYS, framework="numpy") as file:
            frames = file.get_slice("detections.score").get_shape()[0]
            persons = {
                name: file.get_slice(f"{name}.xyz").get_shape()[1]
                for name in ("truth", "poses")
                if name in meta["skeletons"]
            }
        kinds = tuple(meta["images"]["kinds"]) if meta["images"] else ()
        skeletons = {name: meta["skeletons"][name] for name in persons}
        return ClipFile(folder, frames, tuple(meta["cameras"]), persons, skeletons, kinds)
    except (SafetensorError, OSError) as error:
        raise ValueError(f"{folder / ARRAYS}: {error}; the clip is damaged, make it again") from None
    except _DAMAGED as error:
        raise ValueError(f"{folder / META}: {error}; the clip is damaged, make it again") from None


def _modified(path: Path) -> int:
    return path.stat().st_mtime_ns


@lru_cache(maxsize=_OPEN)
def _arrays(path: Path, modified: int):
    return safe_open(path, framework="numpy").__enter__()


@lru_cache(maxsize=_OPEN)
def _meta(path: Path, modified: int) -> dict:
    return read_json(path)
