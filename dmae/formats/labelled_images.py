"""The images of a clip, one per camera and frame, with the labels of the persons in each."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import repeat
from typing import TypedDict
from urllib.parse import quote

import cv2
import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.images import depth_steps
from dmae.data.labels import Visibility
from dmae.data.skeleton import Skeleton
from dmae.formats.poses import pixel_covariances


@dataclass(frozen=True)
class JointLabels:
    """Labels of J joints of P persons in V views and F frames."""

    skeleton: Skeleton  # J joints
    xyz: np.ndarray  # (F, P, J, 3) m, world
    xy: np.ndarray  # (F, V, P, J, 2) px
    flags: np.ndarray  # (F, V, P, J) COCO's v: 2 visible, 1 in the image but hidden or not measured, 0 not in the image
    sources: np.ndarray  # (F, P, J) `Source` of the poses
    cause: np.ndarray | None = None  # (F, V, P, J) `Visibility`; None if unknown for all joints
    # (F, V, P, J) index of the occluder, as in `OcclusionLabels.occluder`; None if `cause` is None
    occluder: np.ndarray | None = None
    # (F, V, P, J, 3) px^2, xx, xy and yy of the covariance of `xy`; None if unknown for all joints
    cov: np.ndarray | None = None
    # Whether the poses are the truth of the clip. Only then do its images of ids show the same persons.
    true: bool = False


def joint_labels(clip: Clip, poses: Poses3D, skeleton: Skeleton) -> JointLabels:
    """Return the labels of the joints of poses, converted to a skeleton with J joints, in each view of a clip.

    Truth of a simulated clip has its occlusion labels, and is projected with its `true_rig`. For other poses, completed
    joints count as hidden and the others as visible. A joint that is derived from several joints has the visibility and
    the occluder of the least visible of them.
    """
    true = poses is clip.truth
    rig = clip.actual_rig if true else clip.rig
    converted = convert(poses, skeleton)
    xy, _ = rig.project(converted.xyz)
    inside = rig.inside(xy)
    if not true or clip.occlusion is None:
        visible = np.where(converted.source == Source.COMPLETED, 1, 2)[:, None]
        flags, cov = np.where(inside, visible, 0), pixel_covariances(converted, rig)
        return JointLabels(skeleton, converted.xyz, xy, flags, converted.source, cov=cov, true=true)
    occluders = clip.occlusion.occluder
    views = [
        _converted_causes(
            poses, skeleton, clip.occlusion.visibility[:, view], None if occluders is None else occluders[:, view]
        )
        for view in range(len(rig))
    ]
    cause, occluder = (np.stack(each, 1) for each in zip(*views, strict=True))
    flags = np.where(inside, np.where(cause == Visibility.VISIBLE, 2, 1), 0)
    return JointLabels(skeleton, converted.xyz, xy, flags, converted.source, cause, occluder, true=true)


def _converted_causes(
    poses: Poses3D, skeleton: Skeleton, visibility: np.ndarray, occluder: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return cause and occluder of one view, (F, P, J) each, for another skeleton: of the least visible source of a
    joint."""
    order = np.argsort(-visibility.astype(int), -1, kind="stable")
    ranks = np.empty(order.shape, np.uint8)
    np.put_along_axis(ranks, order, np.arange(1, order.shape[-1] + 1, dtype=np.uint8), -1)
    least = convert(replace(poses, views=ranks), skeleton).views.astype(int)
    joint = np.take_along_axis(order, np.maximum(least - 1, 0), -1)
    cause = np.where(least > 0, np.take_along_axis(visibility, joint, -1), Visibility.ABSENT).astype(np.uint8)
    if occluder is None:
        return cause, np.full(cause.shape, -1, np.int16)
    return cause, np.where(least > 0, np.take_along_axis(occluder, joint, -1), -1).astype(np.int16)


Box = tuple[float, float, float, float]
"""x and y of the upper left corner, width, height, px."""


class RunLengths(TypedDict):
    """A mask as COCO's uncompressed run lengths. `pycocotools.mask.frPyObjects` reads it."""

    size: list[int]
    """Height and width, px."""
    counts: list[int]
    """Lengths of the runs of pixels outside, inside, outside, ... the mask, counted down each column."""


def encode_mask(mask: np.ndarray) -> RunLengths:
    """Return the run lengths of a mask (H, W) of bool."""
    down = np.asarray(mask, bool).ravel(order="F")
    changes = np.flatnonzero(down[1:] != down[:-1]) + 1
    ends = np.concatenate([[0] if down.size and down[0] else [], [0], changes, [down.size]]).astype(int)
    return {"size": list(mask.shape), "counts": np.diff(ends).tolist()}


def mask_box(mask: np.ndarray) -> Box | None:
    """Return the box around the pixels of a mask (H, W), with whole pixels as in COCO; None if the mask is empty."""
    columns, rows = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
    if not len(columns):
        return None
    low, high = (columns[0], rows[0]), (columns[-1], rows[-1])
    return int(low[0]), int(low[1]), int(high[0] - low[0] + 1), int(high[1] - low[1] + 1)


def joints_box(xy: np.ndarray, labelled: np.ndarray) -> Box | None:
    """Return the box around the points xy (J, 2) px where `labelled` (J,) is True; None if no joint is labelled."""
    if not labelled.any():
        return None
    points = np.asarray(xy[labelled], np.float64).round(3)
    low, high = points.min(0), points.max(0)
    return (*low.tolist(), *(high - low).round(3).tolist())


SHOWN = ("rgb", "ids", "amodal", "depth")
"""Kinds of images that labelled images, and the labels of their persons, are made from."""
DEPTH = "depth.png"
"""Suffix of depth images, in place of `jpg` or `png`."""


@dataclass(frozen=True)
class PersonLabel:
    """The labels of a person in an image, with J joints."""

    person: int  # Index in the poses of the clip
    xy: np.ndarray  # (J, 2) px
    flags: np.ndarray  # (J,) COCO's v: 2 visible, 1 in the image but hidden or not measured, 0 not in the image
    # Box around the visible pixels. If there are none or they are unknown, box around the joints in the image; None if
    # there are no joints in the image either.
    box: Box | None
    mask: RunLengths | None = None  # Mask of the visible pixels; None without an image of ids
    visible_pixels: int | None = None  # Number of visible pixels; None without an image of ids
    # Number of pixels that would show the person if nothing else were there; None if unknown
    amodal_pixels: int | None = None
    amodal_mask: RunLengths | None = None  # Mask of these pixels; None without an image of them
    amodal_box: Box | None = None  # Box around these pixels; None without an image of them
    xyz: np.ndarray | None = None  # (J, 3) m, world; None for detections
    sources: np.ndarray | None = None  # (J,) `Source`; None for detections
    cov: np.ndarray | None = None  # (J, 3) px^2, xx, xy and yy of the covariance of `xy`; None if unknown
    scores: np.ndarray | None = None  # (J,) confidences; only for detections
    cause: np.ndarray | None = None  # (J,) `Visibility`; None if unknown
    occluder: np.ndarray | None = None  # (J,) index of the person or object in front; -1 for none, None if unknown

    @property
    def shown(self) -> bool:
        """Whether a pixel of the person is visible or, if pixels are not counted, a joint."""
        return bool((self.flags == 2).any()) if self.visible_pixels is None else self.visible_pixels > 0

    @property
    def area(self) -> float:
        """Number of visible pixels or, if pixels are not counted, the area of the box, px^2."""
        if self.visible_pixels is not None:
            return self.visible_pixels
        return 0.0 if self.box is None else round(self.box[2] * self.box[3], 3)


@dataclass(frozen=True)
class LabelledImage:
    """The image of one frame by one camera."""

    camera: str  # Name of the camera
    view: int  # Index of the camera in the rig
    frame: int  # Index of the frame in the clip
    number: int  # Number of the frame in the recording
    size: tuple[int, int]  # Width and height, px
    persons: list[PersonLabel]  # Labels of the persons in the image
    rgb: np.ndarray | None = None  # (H, W, 3) uint8; None if there is no colour image, or if it was not requested
    # (H, W) float32 m along the optical axis, NaN where there is no surface; None as `rgb`
    depth: np.ndarray | None = None

    @property
    def path(self) -> str:
        """Relative path of a file of the image, `<camera>/<frame>`, without suffix."""
        return f"{file_part(self.camera)}/{self.number:06d}"

    def encoded(self, suffix: str) -> bytes:
        """Return `rgb` encoded as `jpg` (quality 95) or `png`; or `depth` as `depth.png`, 16 bit, in mm, 0 for NaN."""
        png = [cv2.IMWRITE_PNG_COMPRESSION, 1]
        image = self.depth if suffix == DEPTH else self.rgb
        assert image is not None
        if suffix == DEPTH:
            written, data = cv2.imencode(".png", depth_steps(image), png)
        else:
            quality = {"jpg": [cv2.IMWRITE_JPEG_QUALITY, 95], "png": png}[suffix]
            written, data = cv2.imencode(f".{suffix}", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), quality)
        if not written:
            raise OSError(f"frame {self.number} of camera {self.camera}: could not write {suffix}")
        return data.tobytes()


def file_part(name: str) -> str:
    """Return a name as a safe part of a path: all characters except letters, digits, - and _ become %XX."""
    return quote(name, safe="").replace(".", "%2E").replace("~", "%7E") or "%"


def read_labelled_images(
    clip: Clip, labels: JointLabels, *, every: int = 1, depth: bool = False
) -> Iterator[LabelledImage]:
    """Yield the images of a clip, view by view, one frame in `every`, with `rgb`, and `depth` if asked for.

    One image is in memory at a time. Raises ValueError if an image has another size than its camera, and
    FileNotFoundError if it is missing.
    """
    frames = range(0, len(clip), every)
    # Images of ids and whole persons show the persons of the truth.
    wanted = {"rgb", *(("ids", "amodal") if labels.true else ()), *(("depth",) if depth else ())}
    kinds = wanted & set(clip.images.kinds if clip.images else ())
    images = clip.images and clip.images.select(slice(None, None, every), clip.rig.names)
    first = clip.provenance.get("first_frame", 0)
    for view, name in enumerate(clip.rig.names):
        size = tuple(clip.rig.size[view].tolist())
        streams = {kind: images.read(kind, name) if images and kind in kinds else repeat(None) for kind in SHOWN}
        for frame, *read in zip(frames, *streams.values(), strict=False):
            for kind, image in zip(SHOWN, read, strict=True):
                if image is not None and image.shape[1::-1] != size:
                    raise ValueError(
                        f"clip {clip.id!r}, {kind} of camera {name}, frame {frame}: expected {size[0]} x {size[1]} px, "
                        f"found {image.shape[1]} x {image.shape[0]}"
                    )
            colour, ids, amodal, metres = read
            persons = label_persons(clip, labels, frame, view, ids, amodal)
            yield LabelledImage(name, view, frame, first + frame, size, persons, colour, metres)


def detected_images(clip: Clip) -> Iterator[LabelledImage]:
    """Yield images without colour or masks, frame by frame, with all detections that have a joint."""
    found, first = clip.detections, clip.provenance.get("first_frame", 0)
    flags = np.where(found.observed, 2, 0)
    for frame in range(len(clip)):
        for view, name in enumerate(clip.rig.names):
            persons = []
            for number in np.flatnonzero(flags[frame, view].any(-1)).tolist():
                xy, flag = found.xy[frame, view, number], flags[frame, view, number]
                box, scores = joints_box(xy, flag > 0), found.score[frame, view, number]
                persons.append(PersonLabel(number, xy, flag, box, scores=scores))
            yield LabelledImage(name, view, frame, first + frame, tuple(clip.rig.size[view].tolist()), persons)


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
    """Return the labels of the persons with a joint or a pixel in the image of a frame and a view, given by index.

    Args:
        ids: (H, W) image of ids, if there is one: 1 + p is person p.
        amodal: (H, W) image of whole persons, if there is one: bit p is 1 at pixels that would show person p if
            nothing else were there.
        masks: Whether to make run lengths of masks. Boxes and counts of pixels are always made.
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
    """Return the fields of `PersonLabel` that images of ids and of whole persons give for one person."""
    found: dict = {}
    if ids is not None and shown is not None:
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
