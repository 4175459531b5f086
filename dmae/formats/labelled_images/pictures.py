"""The pictures of a clip with the persons that each shows, one at a time."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import repeat
from urllib.parse import quote

import cv2
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.formats.labelled_images.joints import JointLabels
from dmae.formats.labelled_images.masks import Box, RunLengths, encode_mask, joints_box, mask_box

SHOWN = ("rgb", "ids", "amodal")
"""Kinds of images that pictures and the labels of their persons are made of."""


@dataclass(frozen=True)
class PersonLabel:
    """A person in a picture. J joints.

    Attributes:
        person: Index in the poses of the clip.
        xy: (J, 2) px.
        flags: (J,) COCO's v: 2 visible, 1 in the image but hidden or not measured, 0 not in the image.
        box: Around the visible pixels, or where these are not known, or there are none, around the joints in the image;
            None where neither is there.
        mask: Visible pixels; None where there is no image of ids.
        visible_pixels: Number of visible pixels; None where there is no image of ids.
        amodal_pixels: Number of pixels if nothing else were there; None where unknown.
        amodal_mask: Pixels if nothing else were there; None where there is no image of them.
        amodal_box: Around these.
        xyz: (J, 3) m, world, None of detections.
        sources: (J,) `Source`, None of detections.
        cov: (J, 3) px^2, xx, xy and yy of the covariance of `xy`; None where unknown.
        scores: (J,) confidences, of detections alone.
        cause: (J,) `Visibility`, None where unknown.
        occluder: (J,) index of the person or object in front, -1 for none.
    """

    person: int
    xy: np.ndarray
    flags: np.ndarray
    box: Box | None
    mask: RunLengths | None = None
    visible_pixels: int | None = None
    amodal_pixels: int | None = None
    amodal_mask: RunLengths | None = None
    amodal_box: Box | None = None
    xyz: np.ndarray | None = None
    sources: np.ndarray | None = None
    cov: np.ndarray | None = None
    scores: np.ndarray | None = None
    cause: np.ndarray | None = None
    occluder: np.ndarray | None = None

    @property
    def shown(self) -> bool:
        """Whether the picture shows any of the person: a pixel, or where these are not counted, a joint."""
        return bool((self.flags == 2).any()) if self.visible_pixels is None else self.visible_pixels > 0

    @property
    def area(self) -> float:
        """Number of visible pixels, or where these are not counted, the area of the box."""
        if self.visible_pixels is not None:
            return self.visible_pixels
        return 0.0 if self.box is None else round(self.box[2] * self.box[3], 3)


@dataclass(frozen=True)
class Picture:
    """One camera's picture of one frame.

    Attributes:
        camera: Name of the camera.
        view: Its index in the rig.
        frame: Index in the clip.
        number: Number of the frame in the recording.
        size: Width and height, px.
        persons: Persons that are labelled in it.
        rgb: (H, W, 3) uint8; None where there is none, or it was not asked for.
    """

    camera: str
    view: int
    frame: int
    number: int
    size: tuple[int, int]
    persons: list[PersonLabel]
    rgb: np.ndarray | None = None

    @property
    def path(self) -> str:
        """`<camera>/<frame>`, where a file of the picture goes, without suffix."""
        return f"{file_part(self.camera)}/{self.number:06d}"

    def encoded(self, suffix: str) -> bytes:
        """Return `rgb` as a file of a suffix: `jpg` (quality 95) or `png`."""
        quality = {"jpg": [cv2.IMWRITE_JPEG_QUALITY, 95], "png": [cv2.IMWRITE_PNG_COMPRESSION, 1]}[suffix]
        written, data = cv2.imencode(f".{suffix}", cv2.cvtColor(self.rgb, cv2.COLOR_RGB2BGR), quality)
        if not written:
            raise OSError(f"frame {self.number} of camera {self.camera}: could not write {suffix}")
        return data.tobytes()


def file_part(name: str) -> str:
    """Return a name as part of a path, whatever is in it: all but letters, digits, - and _ become %XX."""
    return quote(name, safe="").replace(".", "%2E").replace("~", "%7E") or "%"


def read_pictures(clip: Clip, labels: JointLabels, *, every: int = 1, rgb: bool = True) -> Iterator[Picture]:
    """Yield the pictures of a clip, view by view, one frame in `every`; one is in memory at a time.

    Args:
        clip: With or without images.
        labels: Of all its frames and views.
        every: 2 for every other frame.
        rgb: Whether colour is read, where the clip has it.

    Raises:
        ValueError: an image is of another size than its camera's.
        FileNotFoundError: an image is missing.
    """
    frames = range(0, len(clip), every)
    kinds = _kinds(clip, labels, rgb)
    images = clip.images and clip.images.select(slice(None, None, every), clip.rig.names)
    first = clip.provenance.get("first_frame", 0)
    for view, name in enumerate(clip.rig.names):
        size = tuple(clip.rig.size[view].tolist())
        streams = {kind: images.read(kind, name) if kind in kinds else repeat(None) for kind in SHOWN}
        for frame, *read in zip(frames, *streams.values(), strict=False):
            for kind, image in zip(SHOWN, read, strict=True):
                if image is not None and image.shape[1::-1] != size:
                    raise ValueError(
                        f"clip {clip.id!r}, {kind} of camera {name}, frame {frame}: expected {size[0]} x {size[1]} px, "
                        f"found {image.shape[1]} x {image.shape[0]}"
                    )
            colour, ids, amodal = read
            persons = label_persons(clip, labels, frame, view, ids, amodal)
            yield Picture(name, view, frame, first + frame, size, persons, colour)


def array_pictures(
    rig: CameraRig,
    xy: np.ndarray,
    flags: np.ndarray,
    *,
    scores: np.ndarray | None = None,
    sources: np.ndarray | None = None,
    first: int = 0,
) -> list[Picture]:
    """Return pictures without colour or masks, frame by frame, of people who have a labelled joint.

    Args:
        rig: V cameras.
        xy: (F, V, D, J, 2) px.
        flags: (F, V, D, J) COCO's v.
        scores: (F, V, D, J) confidences.
        sources: (F, D, J) `Source`; D are then persons.
        first: Number of the first frame.
    """

    def label(frame: int, view: int, person: int) -> PersonLabel:
        here, labelled = xy[frame, view, person], flags[frame, view, person]
        box = joints_box(here, labelled > 0)
        score = None if scores is None else scores[frame, view, person]
        source = None if sources is None else sources[frame, person]
        return PersonLabel(person, here, labelled, box, sources=source, scores=score)

    known = (flags > 0).any(-1)
    return [
        Picture(
            name, view, frame, first + frame, tuple(rig.size[view].tolist()),
            [label(frame, view, person) for person in np.flatnonzero(known[frame, view]).tolist()],
        )
        for frame in range(len(xy))
        for view, name in enumerate(rig.names)
    ]  # fmt: skip


def _kinds(clip: Clip, labels: JointLabels, rgb: bool) -> set[str]:
    """Return the kinds of images to read: those of ids are of true persons."""
    wanted = ({"rgb"} if rgb else set()) | ({"ids", "amodal"} if labels.true else set())
    return wanted & set(clip.images.kinds if clip.images else ())


def label_persons(
    clip: Clip,
    labels: JointLabels,
    frame: int,
    view: int,
    ids: np.ndarray | None = None,
    amodal: np.ndarray | None = None,
    *,
    masks: bool = True,
) -> list[PersonLabel]:
    """Return the persons who have a joint or a pixel in one picture.

    Args:
        clip: Its counts of pixels are used.
        labels: Of all frames and views of the clip.
        frame, view: Indices of the picture.
        ids: (H, W) image of ids, if there is one: 1 + p is person p.
        amodal: (H, W) of bits, if there is such an image: bit p is 1 where person p would be if nothing else were
            there.
        masks: Whether run lengths of masks are made; boxes and counts of pixels are in any case.
    """
    persons = range(labels.flags.shape[2])
    shown = None if ids is None else np.bincount(ids.ravel(), minlength=1 + len(persons))
    found = []
    for person in persons:
        xy, flags = labels.xy[frame, view, person], labels.flags[frame, view, person]
        more = _pixels(ids, shown, amodal, person, masks) if ids is not None or amodal is not None else {}
        box = more.pop("box", None) or joints_box(xy, flags > 0)
        if box is None and more.get("amodal_box") is None:
            continue
        if clip.occlusion is not None and labels.true and clip.occlusion.amodal_pixels is not None:
            more["amodal_pixels"] = int(clip.occlusion.amodal_pixels[frame, view, person])
        if labels.cause is not None:
            more |= {name: getattr(labels, name)[frame, view, person] for name in ("cause", "occluder")}
        more |= {"xyz": labels.xyz[frame, person], "sources": labels.sources[frame, person]}
        more["cov"] = None if labels.cov is None else labels.cov[frame, view, person]
        found.append(PersonLabel(person, xy, flags, box, **more))
    return found


def _pixels(
    ids: np.ndarray | None, shown: np.ndarray | None, amodal: np.ndarray | None, person: int, masks: bool
) -> dict:
    """Return what images of ids and of whole persons say of one person."""
    found = {}
    if ids is not None:
        mask = ids == 1 + person
        found = {"visible_pixels": int(shown[1 + person]), "box": mask_box(mask)}
        if masks:
            found["mask"] = encode_mask(mask)
    if amodal is not None:
        whole = (amodal >> person) & 1 > 0
        found["amodal_box"] = mask_box(whole)
        if masks:
            found["amodal_mask"] = encode_mask(whole)
    return found
