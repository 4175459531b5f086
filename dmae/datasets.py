"""What do I train on? Torch data sets of clips, windows of motion, and images. Items are read on demand."""

import operator
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypedDict

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor
from torch.utils.data import Dataset

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.labels import Visibility
from dmae.data.skeleton import Skeleton, decode_skeleton, get_skeleton
from dmae.data.store import FORMAT, assemble_clip, clip_folders, is_of_frames, load_clip
from dmae.data.typed import check_arguments
from dmae.files.contents import cached_until_changed, check_file
from dmae.files.structured import read_json
from dmae.formats.labelled_images import PersonLabel, joint_labels, label_persons

ARRAYS, META = "arrays.safetensors", "clip.json"
_DAMAGED = (SafetensorError, ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError)
"""Errors that reading a clip raises if its JSON or its arrays are damaged."""
_OPEN = 32  # Number of files that a process keeps open. They are memory-mapped: only the requested frames are read.


@dataclass(frozen=True)
class ClipFile:
    """A clip on disk. Only its sizes and names have been read."""

    folder: Path  # Folder of the clip
    frames: int  # Number of frames, F
    cameras: tuple[str, ...]  # Names of the V cameras
    persons: dict[str, int]  # Number of persons P of `truth` and of `poses`, by that name, if the clip has them
    # Skeletons of `truth` and of `poses`, by that name, as `dmae.data.skeleton.encode` returns them
    skeletons: dict[str, str | dict]
    kinds: tuple[str, ...]  # Kinds of images of the clip

    def read(self, start: int = 0, stop: int | None = None, view: int | None = None) -> Clip:
        """Return frames `start` to `stop` (excluded) of all views, or of one view.

        `provenance["first_frame"]` is increased accordingly. The checksum of the arrays is not checked, because it
        covers all frames. `synth verify` checks it. Raises ValueError if a file is damaged, which the message names, or
        the clip has no such frames.
        """
        stop = self.frames if stop is None else stop
        if not 0 <= start <= stop <= self.frames:
            raise ValueError(f"frames {start} to {stop}: expected an order, and frames 0 to {self.frames}")
        path = self.folder / ARRAYS
        meta = _meta(self.folder / META)
        try:
            file = _arrays(path)
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

        For the truth, `views` are the cameras that see a joint, if the clip has visibility labels. Raises ValueError if
        a file is damaged; the message names it.
        """
        path = self.folder / ARRAYS
        try:
            file = _arrays(path)
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


def clip_files(path: Path, clips: Collection[str] | None = None) -> Iterator[ClipFile]:
    """Yield the clips of the data set at a path, or the single clip there. Only the file headers are read.

    `clips` names the clips to take, by default all. Raises FileNotFoundError if there is neither, or a clip of
    its manifest is missing, and ValueError for malformed files and unknown names.
    """
    for folder in _folders(path, clips):
        meta = read_json(folder / META)
        if not isinstance(meta, dict) or meta.get("format") != FORMAT:
            raise ValueError(f"{folder / META}: expected a clip of format {FORMAT}")
        yield _head(folder, meta)


def _folders(path: str | Path, clips: Collection[str] | None) -> list[Path]:
    folders = clip_folders(Path(path))
    if clips is None:
        return folders
    if isinstance(clips, str):
        raise TypeError(f"clips={clips!r}: expected a list of names of clips, as a split of synth.split is")
    wanted = set(clips)
    unknown = sorted(wanted - {folder.name for folder in folders})
    if unknown:
        raise ValueError(f"{path}: clips={unknown}: there are no such clips in the data set")
    return [folder for folder in folders if folder.name in wanted]


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


_meta = cached_until_changed(_OPEN)(read_json)


@cached_until_changed(_OPEN)
def _arrays(path: Path):
    return safe_open(path, framework="numpy").__enter__()


def _place(index: int, ends: np.ndarray, what: str) -> tuple[int, int]:
    """Return the clip that an item is in, and its number there, from the items up to the end of each clip."""
    count, index = int(ends[-1]) if len(ends) else 0, operator.index(index)
    if not -count <= index < count:
        raise IndexError(f"{what} {index}: there are {count}")
    clip = int(np.searchsorted(ends, index % count, side="right"))
    return clip, index % count - (int(ends[clip - 1]) if clip else 0)


# A data set of whole clips.


class ClipDataset(Dataset):
    """The clips of a data set. A clip is read, and its checksum is checked, when the item is requested.

        loader = DataLoader(ClipDataset("runs/data"), batch_size=None, num_workers=2)

    Args:
        path: Path of a data set or of a clip.
        transform: Function that is applied to each clip. Without one the items are clips: use `batch_size=None`.
        clips: Names of the clips to take, as `synth.split` returns them for each split; by default all.

    Raises:
        FileNotFoundError: the path is neither a clip nor a data set.
        ValueError: there is no clip of one of the names.
    """

    @check_arguments
    def __init__(
        self,
        path: str | Path,
        transform: Callable[[Clip], Any] | None = None,
        *,
        clips: Collection[str] | None = None,
    ):
        self.folders = _folders(path, clips)
        self.transform = transform

    def __repr__(self) -> str:
        return f"ClipDataset(clips={len(self)})"

    def __len__(self) -> int:
        return len(self.folders)

    def __getitem__(self, index: int) -> Any:
        clip = load_clip(self.folders[index])
        return clip if self.transform is None else self.transform(clip)


# A data set of windows of motion: one person for a fixed number of frames.


class Window(TypedDict):
    """One person with J joints over T frames. It contains no NaN."""

    xyz: Tensor
    """(T, J, 3) float32, m, world; zeros where a joint is absent."""
    observed: Tensor
    """(T, J) bool, True where the joint is known, completed joints included."""
    source: Tensor
    """(T, J) uint8 `Source`."""
    views: Tensor
    """(T, J) uint8 number of cameras that see the joint (labelled truth) or that measured it (poses)."""
    clip: int
    """Number of the clip in `WindowDataset.files`."""
    person: int
    """Index of the person in the clip."""
    start: int
    """First frame in the clip."""


class WindowDataset(Dataset):
    """Windows of each person in each clip. Only the frames of the requested window are read.

        windows = WindowDataset("runs/data", frames=30, every=15, skeleton="body25")
        loader = DataLoader(windows, batch_size=64, shuffle=True, num_workers=2)

    Args:
        path: Path of a data set or of a clip.
        frames: Number of frames T of a window. Shorter clips have no window.
        every: A window begins this many frames after the one before.
        of: `truth` for the true poses, `poses` for the captured or completed poses.
        skeleton: Name of the skeleton of the joints; by default the first skeleton of the clip.
        clips: As for `ClipDataset`.

    Raises:
        FileNotFoundError: the path is neither a clip nor a data set.
        ValueError: no clip has these poses in enough frames, a number is below 1, or a name is of no clip.
        KeyError: there is no skeleton of this name.
    """

    @check_arguments
    def __init__(
        self,
        path: str | Path,
        frames: int = 30,
        every: int = 15,
        of: Literal["truth", "poses"] = "truth",
        skeleton: str | Path | Skeleton | None = None,
        *,
        clips: Collection[str] | None = None,
    ):
        if frames < 1 or every < 1:
            raise ValueError(f"expected 1 frame or more, found frames={frames}, every={every}")
        if of not in ("truth", "poses"):
            raise ValueError(f"of={of!r}: expected truth or poses")
        self.frames, self.every, self.of = frames, every, of
        self.skeleton: Skeleton | None = None if skeleton is None else get_skeleton(skeleton)
        self.files: list[ClipFile] = list(clip_files(Path(path), clips))
        starts = [max(0, (file.frames - frames) // every + 1) for file in self.files]
        counts = [count * file.persons.get(of, 0) for count, file in zip(starts, self.files, strict=True)]
        self._starts, self._ends = starts, np.cumsum(counts)
        if not sum(counts):
            longest = max((file.frames for file in self.files), default=0)
            raise ValueError(
                f"{path}: no {of} of {frames} frames in {len(self.files)} clips; the longest has {longest} frames"
            )

    def __repr__(self) -> str:
        return f"WindowDataset(windows={len(self)}, clips={len(self.files)}, frames={self.frames}, of={self.of!r})"

    def __len__(self) -> int:
        return int(self._ends[-1])

    def place(self, index: int) -> tuple[int, int, int]:
        """Return a window's clip (by number), person (by index) and first frame; IndexError if there is none."""
        clip, within = _place(index, self._ends, "window")
        person, start = divmod(within, self._starts[clip])
        return clip, person, start * self.every

    def clip(self, index: int) -> Clip:
        """Return the frames of a window as a clip, with cameras, detections, labels and all persons."""
        clip, _, start = self.place(index)
        return self.files[clip].read(start, start + self.frames)

    def __getitem__(self, index: int) -> Window:
        number, person, start = self.place(index)
        poses = self.files[number].person(self.of, person, start, start + self.frames)
        poses = convert(poses, self.skeleton or poses.skeleton.parts[0])
        observed = poses.source[:, 0] != Source.ABSENT
        return Window(
            xyz=torch.from_numpy(np.where(observed[..., None], poses.xyz[:, 0], np.float32(0))),
            observed=torch.from_numpy(observed),
            source=torch.from_numpy(poses.source[:, 0].copy()),
            views=torch.from_numpy(np.where(observed, poses.views[:, 0], 0).astype(np.uint8)),
            clip=number,
            person=person,
            start=start,
        )


# A data set of images with labels of the persons in them.


class Target(TypedDict, total=False):
    """Labels of the N persons in an image, in the format of torchvision's detectors."""

    boxes: Tensor
    """(N, 4) float32: left, top, right, bottom, px."""
    labels: Tensor
    """(N,) int64, all 1: a person."""
    keypoints: Tensor
    """(N, J, 3) float32: x and y, px, and COCO's visibility flag v; zeros where a joint is not in the image."""
    visibility: Tensor
    """(N, J) uint8 `Visibility`; missing if the clip has no visibility labels."""
    masks: Tensor
    """(N, H, W) bool, True for visible pixels of the person; only with `masks=True`."""
    depth: Tensor
    """(H, W) float32 m along the optical axis, zeros where there is no surface; only with `depth=True`."""
    depth_known: Tensor
    """(H, W) bool, True where there is a surface within 65 m; only with `depth=True`."""
    area: Tensor
    """(N,) float32 px."""
    persons: Tensor
    """(N,) int64 indices of the persons in the clip."""
    image_id: int
    """Index of the image in the data set."""


class FrameDataset(Dataset):
    """Single camera images of a data set, with boxes, joints and masks of the persons in them.

    Items are as torchvision's detectors take them: images (3, H, W) float32 from 0 to 1, targets as `Target`.

        frames = FrameDataset("runs/data", skeleton="coco17")
        loader = DataLoader(frames, batch_size=8, shuffle=True, num_workers=2, collate_fn=frames.collate)
        for images, targets in loader: losses = model(images, targets)

    An item reads only one image and the labels of one frame. A video is decoded from the previous keyframe on.

    Args:
        path: Path of a data set or of a clip. The clips must have colour images and truth.
        skeleton: Name of the skeleton of the joints.
        every: Step between frames: 2 takes every second frame.
        masks: Whether targets have masks. Masks need id images.
        depth: Whether targets have depth. Depth needs depth images.
        clips: As for `ClipDataset`.

    Raises:
        FileNotFoundError: the path is neither a clip nor a data set.
        ValueError: a clip has no truth or no images, which the message names, or a name is of no clip.
        KeyError: there is no such skeleton.
    """

    @check_arguments
    def __init__(
        self,
        path: str | Path,
        skeleton: str | Path | Skeleton = "coco17",
        every: int = 1,
        masks: bool = False,
        depth: bool = False,
        *,
        clips: Collection[str] | None = None,
    ):
        if every < 1:
            raise ValueError(f"expected every 1 or more, found {every}")
        self.every, self.masks, self.depth = every, masks, depth
        kinds = ("rgb", *(("ids",) if masks else ()), *(("depth",) if depth else ()))
        self.skeleton: Skeleton = get_skeleton(skeleton)
        self.files: list[ClipFile] = list(clip_files(Path(path), clips))
        for file in self.files:
            for kind in kinds:
                if kind not in file.kinds:
                    raise ValueError(
                        f"{file.folder}: expected images of kind {kind}, found {', '.join(file.kinds) or 'none'}; "
                        f"synth render data=... images={'rgb' if len(kinds) == 1 else 'all'} out=... makes them"
                    )
            if "truth" not in file.persons:
                raise ValueError(f"{file.folder}: the clip has no truth, which the labels of images are made from")
        self._ends = np.cumsum([-(-file.frames // every) * len(file.cameras) for file in self.files])

    def __repr__(self) -> str:
        return f"FrameDataset(images={len(self)}, clips={len(self.files)}, skeleton={self.skeleton.name!r})"

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def place(self, index: int) -> tuple[int, int, int]:
        """Return an image's clip (by number), camera and frame (by index); IndexError."""
        clip, within = _place(index, self._ends, "image")
        view, frame = divmod(within, -(-self.files[clip].frames // self.every))
        return clip, view, frame * self.every

    def __getitem__(self, index: int) -> tuple[Tensor, Target]:
        """Return an image (3, H, W) float32, 0 to 1, and its labels."""
        number, view, frame = self.place(index)
        clip = self.files[number].read(frame, frame + 1, view)
        assert clip.images is not None and clip.truth is not None
        (camera,) = clip.rig.names
        image = clip.images.at("rgb", camera, 0)
        ids = clip.images.at("ids", camera, 0) if "ids" in clip.images.kinds else None
        found = label_persons(clip, joint_labels(clip, clip.truth, self.skeleton), 0, 0, ids, masks=False)
        persons = [person for person in found if person.shown and person.box]
        target = self._target(persons)
        target["image_id"] = index % len(self)
        if self.masks and ids is not None:
            shown = np.array([1 + person.person for person in persons], ids.dtype)
            target["masks"] = torch.from_numpy(ids == shown[:, None, None])
        if self.depth:
            depth = clip.images.at("depth", camera, 0)
            target["depth_known"] = torch.from_numpy(~np.isnan(depth))
            target["depth"] = torch.from_numpy(np.nan_to_num(depth))
        return torch.from_numpy(image).permute(2, 0, 1).float() / 255, target

    def _target(self, persons: list[PersonLabel]) -> Target:
        count, joints = len(persons), len(self.skeleton)
        boxes = np.array([person.box for person in persons], np.float32).reshape(count, 4)
        boxes[:, 2:] += boxes[:, :2]
        points = np.zeros((count, joints, 3), np.float32)
        for number, person in enumerate(persons):
            labelled = person.flags > 0
            points[number, labelled, :2] = person.xy[labelled]
            points[number, :, 2] = person.flags
        target = Target(
            boxes=torch.from_numpy(boxes),
            labels=torch.ones(count, dtype=torch.int64),
            keypoints=torch.from_numpy(points),
            area=torch.tensor([person.area for person in persons], dtype=torch.float32),
            persons=torch.tensor([person.person for person in persons], dtype=torch.int64),
        )
        if all(person.cause is not None for person in persons):
            causes = np.array([person.cause for person in persons], np.uint8).reshape(count, joints)
            target["visibility"] = torch.from_numpy(causes)
        return target

    @staticmethod
    def collate(items: list[tuple[Tensor, Target]]) -> tuple[list[Tensor], list[Target]]:
        """Return a batch as lists, because images differ in size and in the number of persons."""
        images, targets = zip(*items, strict=True)
        return list(images), list(targets)
