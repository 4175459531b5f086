"""A data set of images with labels of the persons in them."""

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
    area: Tensor
    """(N,) float32 px."""
    persons: Tensor
    """(N,) int64 indices of the persons in the clip."""
    image_id: int
    """Index of the image in the data set."""


class FrameDataset(Dataset):
    """Single camera images of a data set, with boxes, joints and masks of the persons in them.

        frames = FrameDataset("runs/data", skeleton="coco17")
        loader = DataLoader(frames, batch_size=8, shuffle=True, num_workers=2, collate_fn=frames.collate)
        for images, targets in loader: model(images, targets)

    An item reads only one image and the labels of one frame. A video is decoded from the previous keyframe on.

    Args:
        path: Path of a data set or of a clip. The clips must have colour images and truth.
        skeleton: Name of the skeleton of the joints.
        every: Step between frames: 2 takes every second frame.
        masks: Whether targets have masks. Masks need id images.

    Raises:
        FileNotFoundError: the path is neither a clip nor a data set.
        ValueError: a clip has no truth or no images; the message names the clip.
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
                raise ValueError(f"{file.folder}: the clip has no truth, which the labels of images are made from")
        self._ends = np.cumsum([-(-file.frames // every) * len(file.cameras) for file in self.files])

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def place(self, index: int) -> tuple[int, int, int]:
        """Return the number of the clip, the index of the camera and the index of the frame of an image.

        Raises:
            IndexError: there is no image with this index.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"picture {index}: there are {len(self)}")
        index %= len(self)
        clip = int(np.searchsorted(self._ends, index, side="right"))
        within = index - (int(self._ends[clip - 1]) if clip else 0)
        view, frame = divmod(within, -(-self.files[clip].frames // self.every))
        return clip, view, frame * self.every

    def __getitem__(self, index: int) -> tuple[Tensor, Target]:
        """Return an image (3, H, W) uint8 and its labels."""
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
        """Return a batch as lists, because images differ in size and in the number of persons."""
        images, targets = zip(*items, strict=True)
        return list(images), list(targets)
