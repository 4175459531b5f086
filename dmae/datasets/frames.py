"""A data set of images with the persons in them."""

from pathlib import Path
from typing import TypedDict

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.datasets.clip_files import ClipFile, clip_files
from dmae.formats.labelled_images.joints import joint_labels
from dmae.formats.labelled_images.pictures import PersonLabel, label_persons


class Target(TypedDict, total=False):
    """The N persons that an image shows, in the format of torchvision's detectors."""

    boxes: Tensor
    """(N, 4) float32 left, top, right, bottom, px."""
    labels: Tensor
    """(N,) int64, all 1: a person."""
    keypoints: Tensor
    """(N, J, 3) float32 x, y px and COCO's v; zeros where a joint is not in the image."""
    visibility: Tensor
    """(N, J) uint8 `Visibility`; without labels of it there is none."""
    masks: Tensor
    """(N, H, W) bool visible pixels; with `masks=True`."""
    area: Tensor
    """(N,) float32 px."""
    persons: Tensor
    """(N,) int64 indices in the clip."""
    image_id: int
    """Index in the data set."""


class FrameDataset(Dataset):
    """Single images of the cameras of a data set, with boxes, joints and masks of the persons in them.

        frames = FrameDataset("runs/data", skeleton="coco17")
        loader = DataLoader(frames, batch_size=8, shuffle=True, num_workers=2, collate_fn=frames.collate)
        for images, targets in loader: model(images, targets)

    For an item, only one image and the labels of one frame are read. A video is decoded from the keyframe before.

    Args:
        path: The data set, or a clip; its clips have images of colour and truth.
        skeleton: Skeleton of the joints.
        every: 2 for every other frame.
        masks: Whether targets have masks, which need images of ids.

    Raises:
        FileNotFoundError: there is neither a clip nor a data set.
        ValueError: a clip lacks truth or images; the message names it.
        KeyError: there is no such skeleton.
    """

    def __init__(self, path: str | Path, skeleton: str = "coco17", every: int = 1, masks: bool = False):
        if every < 1:
            raise ValueError(f"expected every 1 or more, got {every}")
        self.every, self.masks = every, masks
        self.skeleton: Skeleton = get_skeleton(skeleton)
        self.files: list[ClipFile] = list(clip_files(Path(path)))
        for file in self.files:
            for kind in ("rgb", "ids") if masks else ("rgb",):
                if kind not in file.kinds:
                    raise ValueError(
                        f"{file.folder}: expected images of kind {kind}, found {', '.join(file.kinds) or 'none'}; "
                        f"synth generate images={'all' if masks else 'rgb'} makes them"
                    )
            if "truth" not in file.persons:
                raise ValueError(f"{file.folder}: the clip has no truth, of which pictures are labelled")
        self._ends = np.cumsum([-(-file.frames // every) * len(file.cameras) for file in self.files])

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def place(self, index: int) -> tuple[int, int, int]:
        """Return number of the clip, index of the camera and index of the frame of a picture.

        Raises:
            IndexError: there is no such picture.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"picture {index}: there are {len(self)}")
        index %= len(self)
        clip = int(np.searchsorted(self._ends, index, side="right"))
        within = index - (int(self._ends[clip - 1]) if clip else 0)
        view, frame = divmod(within, -(-self.files[clip].frames // self.every))
        return clip, view, frame * self.every

    def __getitem__(self, index: int) -> tuple[Tensor, Target]:
        """Return an image (3, H, W) uint8, and its annotations."""
        number, view, frame = self.place(index)
        clip = self.files[number].read(frame, frame + 1, view)
        (camera,) = clip.rig.names
        picture = clip.images.at("rgb", camera, 0)
        ids = clip.images.at("ids", camera, 0) if "ids" in clip.images.kinds else None
        found = label_persons(clip, joint_labels(clip, clip.truth, self.skeleton), 0, 0, ids, masks=False)
        persons = [person for person in found if person.shown and person.box]
        target = self._target(persons)
        target["image_id"] = index % len(self)
        if self.masks:
            shown = np.array([1 + person.person for person in persons], ids.dtype)
            target["masks"] = torch.from_numpy(ids == shown[:, None, None])
        return torch.from_numpy(picture).permute(2, 0, 1), target

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
        """Return a batch as lists: images differ in size and number of persons."""
        images, targets = zip(*items, strict=True)
        return list(images), list(targets)
