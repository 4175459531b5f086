"""Draw the data of a clip into its views: detections, poses, truth, and what hides joints."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property, lru_cache
from itertools import repeat

import cv2
import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from dmae.data.cameras import CameraRig, camera_label
from dmae.data.clip import Clip, Poses3D, Source, person_name
from dmae.data.labels import Visibility
from dmae.reporting.figures import COMPLETED, PERSONS
from dmae.viewing.config import LayersConfig

RGB = tuple[int, int, int]
PAPER, INK, FAINT = (22, 25, 30), (233, 236, 240), (139, 148, 158)
_EMPTY, _GRID = (58, 63, 71), (84, 91, 101)
_FINE = 4  # Number of fractional bits of pixel positions in OpenCV's drawing functions
_FAR = 20  # Multiple of the image width; points farther outside the image are not drawn


def _rgb(text: str) -> RGB:
    red, green, blue = (int(text[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue


RED = _rgb(COMPLETED)
"""Colour of completed joints, on which fewer than two cameras agree."""


def person_colour(person: int) -> RGB:
    """Return the colour of a person, the same in every view and frame."""
    return _rgb(PERSONS[person % len(PERSONS)])


class Mark(Enum):
    """Shapes of joints."""

    DISC = "disc"
    SQUARE = "square"
    CROSS = "cross"
    RING = "ring"


@lru_cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return Matplotlib's default font at a size in px."""
    weight = "bold" if bold else "normal"
    return ImageFont.truetype(
        font_manager.findfont(font_manager.FontProperties(family="DejaVu Sans", weight=weight)), size
    )


def drawable(pixels: np.ndarray, width: int) -> np.ndarray:
    """Return (...) True for the pixels (..., 2) that are known and not too far outside the image to be drawn."""
    return np.isfinite(pixels).all(-1) & (np.abs(np.nan_to_num(pixels)) < _FAR * width).all(-1)


def draw_line(canvas: np.ndarray, points: np.ndarray, colour: RGB, thick: int, *, outlined: bool = False) -> None:
    """Draw a line through points (n, 2), px, with a dark outline if `outlined`."""
    if outlined:
        cv2.polylines(canvas, [_fixed(points)], False, PAPER, thick + 2, cv2.LINE_AA, _FINE)
    cv2.polylines(canvas, [_fixed(points)], False, colour, thick, cv2.LINE_AA, _FINE)


def draw_mark(canvas: np.ndarray, point: np.ndarray, mark: Mark, colour: RGB, thick: int) -> None:
    """Draw a mark at a point (2,), px. Discs and squares have a dark outline."""
    x, y = _fixed(point[None])[0].tolist()
    size = (2 * thick) << _FINE
    edge = thick << _FINE
    if mark is Mark.DISC:
        cv2.circle(canvas, (x, y), size + edge, PAPER, -1, cv2.LINE_AA, _FINE)
        cv2.circle(canvas, (x, y), size, colour, -1, cv2.LINE_AA, _FINE)
    elif mark is Mark.SQUARE:
        for half, filling in ((size + edge, PAPER), (size, colour)):
            cv2.rectangle(canvas, (x - half, y - half), (x + half, y + half), filling, -1, cv2.LINE_AA, _FINE)
    elif mark is Mark.RING:
        cv2.circle(canvas, (x, y), size + edge, colour, thick, cv2.LINE_AA, _FINE)
    else:
        for sign in (1, -1):
            ends = np.array([[x - size, y - sign * size], [x + size, y + sign * size]], np.int32)
            cv2.polylines(canvas, [ends], False, colour, thick, cv2.LINE_AA, _FINE)


_FLOOR = np.array([[-5.0, -5], [5, 5]])
"""m; corners of the floor that is drawn, unless people are elsewhere."""


def floor_of(clip: Clip) -> np.ndarray:
    """Return the corners (2, 2) of the floor to draw, m: ten metres around the origin, or where people are."""
    known = [poses.xyz[..., :2].reshape(-1, 2) for poses in (clip.poses, clip.truth) if poses is not None]
    places = np.concatenate([np.zeros((0, 2)), *known]).astype(np.float64)
    places = places[np.isfinite(places).all(-1)]
    if not len(places):
        return _FLOOR
    low, high = np.percentile(places, (1, 99), axis=0)
    if (low >= _FLOOR[0]).all() and (high <= _FLOOR[1]).all():
        return _FLOOR
    middle, reach = np.round((low + high) / 2), np.ceil((high - low) / 2) + 1
    return np.stack([middle - reach, middle + reach]).clip(-1000, 1000)


def floor(rig: CameraRig, size: tuple[int, int], scale: float, corners: np.ndarray = _FLOOR) -> np.ndarray:
    """Draw lines between the corners (2, 2) m of the floor, 1 m apart, or more on a large one, as one camera sees it.

    `size` is in px, `scale` in px/camera px.
    """
    canvas = np.full((size[1], size[0], 3), _EMPTY, np.uint8)
    step = max(1.0, np.ceil((corners[1] - corners[0]).max() / 40))
    grids = []
    for axis in (0, 1):
        (start, end), others = corners[:, axis], np.arange(corners[0, 1 - axis], corners[1, 1 - axis] + 0.5, step)
        along, across = np.meshgrid(np.linspace(start, end, 201), others)
        grids.append(np.stack([along, across, np.zeros_like(along)], -1)[..., [axis, 1 - axis, 2]])
    lines = np.concatenate(grids)
    pixels = rig.project(lines[None])[0][0, 0] * scale
    near = drawable(pixels, size[0])
    for line, fits in zip(pixels, near, strict=True):
        edges = np.flatnonzero(np.diff(fits)) + 1
        for run, inside in zip(np.split(line, edges), np.split(fits, edges), strict=True):
            if inside[0]:
                draw_line(canvas, run, _GRID, 1)
    return canvas


def _fixed(points: np.ndarray) -> np.ndarray:
    """Return pixels (n, 2) as OpenCV's fixed-point numbers with `_FINE` fractional bits."""
    return np.round(points * (1 << _FINE)).astype(np.int32)


# What hides joints

COLOURS = {
    Visibility.VISIBLE: (52, 211, 123),
    Visibility.HIDDEN_BY_SELF: (255, 190, 11),
    Visibility.HIDDEN_BY_PERSON: (255, 45, 120),
    Visibility.HIDDEN_BY_OBJECT: (72, 149, 255),
    Visibility.OUTSIDE_IMAGE: (150, 156, 164),
    Visibility.BEHIND_CAMERA: (150, 156, 164),
    Visibility.ABSENT: (150, 156, 164),
}
"""RGB of a joint's mark. Colour-blind readers can distinguish the colours, too."""
MEANINGS = {
    Visibility.VISIBLE: "visible",
    Visibility.HIDDEN_BY_SELF: "hidden by their own body",
    Visibility.HIDDEN_BY_PERSON: "by another person",
    Visibility.HIDDEN_BY_OBJECT: "by an object",
    Visibility.OUTSIDE_IMAGE: "outside the image",
}


def occluder_name(clip: Clip, frame: int, view: int, person: int, joint: int) -> str:
    """Return the name of the occluder of a joint in a view; an empty text if nothing hides it."""
    assert clip.occlusion is not None and clip.occlusion.occluder is not None
    at = (frame, view, person, joint)
    by = int(clip.occlusion.occluder[at])
    match Visibility(clip.occlusion.visibility[at]):
        case Visibility.HIDDEN_BY_SELF:
            return "itself"
        case Visibility.HIDDEN_BY_PERSON:
            return person_name(by)
        case Visibility.HIDDEN_BY_OBJECT:
            return clip.occlusion.objects[by]
    return ""


def occlusion_summary(clip: Clip, frame: int, view: int, person: int, joints: list[int]) -> list[tuple[str, RGB]]:
    """Return counts of a person's joints in a view by occluder, with their colours, the most frequent first."""
    assert clip.occlusion is not None
    code = clip.occlusion.visibility[frame, view, person, joints]
    if (code == Visibility.ABSENT).all():
        return [("absent", FAINT)]
    away = int((code > Visibility.HIDDEN_BY_OBJECT).sum())
    if away == len(code):
        return [("not in the image", FAINT)]
    hidden = np.flatnonzero((code > Visibility.VISIBLE) & (code <= Visibility.HIDDEN_BY_OBJECT))
    causes = Counter((occluder_name(clip, frame, view, person, joints[i]), Visibility(code[i])) for i in hidden)
    words = [(f"{count} behind {name}", COLOURS[cause]) for (name, cause), count in causes.most_common()]
    words.insert(0, (f"{int((code == Visibility.VISIBLE).sum())} seen", COLOURS[Visibility.VISIBLE]))
    return words + ([(f"{away} outside", FAINT)] if away else [])


# Layers: detections, measured joints, completed joints, and the truth

DETECTED = (250, 226, 130)
"""Colour of detections, which are not yet assigned to persons."""
TRUE = INK
"""Colour of true joints if there are poses."""


@dataclass(frozen=True)
class Layers:
    """The layers of a clip that are drawn."""

    # detections, measured, completed, truth: Whether each of these layers is drawn
    detections: bool
    measured: bool
    completed: bool
    truth: bool
    occlusion: bool  # Whether true joints have the colour of their occluder, and the text below the view names it
    lacking: tuple[str, ...]  # Names of the layers that the clip does not have

    @property
    def poses(self) -> bool:
        return self.measured or self.completed


def chosen_layers(clip: Clip, config: LayersConfig) -> Layers:
    """Return the layers to draw: the requested ones that the clip has."""
    has_poses = clip.poses is not None and bool((clip.poses.source != Source.ABSENT).any())
    has_truth = clip.truth is not None and bool(np.isfinite(clip.truth.xyz).any())
    has_detections = bool(clip.detections.observed.any())
    has_labels = clip.occlusion is not None and clip.occlusion.occluder is not None
    detections = has_detections and (not has_labels if config.detections is None else config.detections)
    measured, completed = has_poses and config.measured, has_poses and config.completed
    truth = has_truth and (not has_poses if config.truth is None else config.truth)
    lacking = [] if clip.has_images else ["images"]
    lacking += [] if has_poses else ["poses" if clip.poses is None else "person in its poses"]
    lacking += ["truth"] if config.truth and not has_truth else []
    lacking += [] if has_detections else ["detections"]
    return Layers(
        detections, measured, completed, truth, truth and has_labels and not (measured or completed), tuple(lacking)
    )


@dataclass
class Drawn:
    """Lines and marks in one view, in the order in which they are drawn."""

    # End points (2, 2), px, colour, and whether the line has a dark outline
    lines: list[tuple[np.ndarray, RGB, bool]] = field(default_factory=list)
    # Point (2,), px, shape and colour of each mark
    marks: list[tuple[np.ndarray, Mark, RGB]] = field(default_factory=list)


def first_joints(poses: Poses3D) -> list[int]:
    """Return the indices of a fused skeleton's first part, or all joints of any other."""
    first = poses.skeleton.joints[0].rpartition(".")[0]
    return [i for i, name in enumerate(poses.skeleton.joints) if name.rpartition(".")[0] == first]


def drawn_plainly(pixels: np.ndarray, bones: Sequence[tuple[int, int]], mark: Mark, colours: Sequence[RGB]) -> Drawn:
    """Return the drawing of detections or true joints (P, J, 2), px: marks in a colour each person, with thin lines."""
    drawn = Drawn()
    for joints, colour in zip(pixels, colours, strict=True):
        known = np.isfinite(joints).all(-1)
        drawn.lines += [(joints[list(bone)], colour, False) for bone in bones if known[list(bone)].all()]
        drawn.marks += [(joints[joint], mark, colour) for joint in np.flatnonzero(known)]
    return drawn


def drawn_poses(pixels: np.ndarray, source: np.ndarray, bones: list[tuple[int, int]], layers: Layers) -> Drawn:
    """Return the drawing of poses (P, J, 2) px: discs in the colour of the person, and red squares where completed.

    Args:
        source: (P, J) `Source`.
        bones: (parent, child) pairs.
    """
    drawn, above = Drawn(), Drawn()
    for person, joints in enumerate(pixels):
        completed = source[person] == Source.COMPLETED
        known = np.isfinite(joints).all(-1) & np.where(completed, layers.completed, True)
        for bone in map(list, bones):
            # A bone is red if one of its ends is completed, as in the paper's figures.
            red = completed[bone].any()
            if known[bone].all() and (red or layers.measured):
                (above if red else drawn).lines.append((joints[bone], RED if red else person_colour(person), True))
        for joint in np.flatnonzero(known):
            if completed[joint]:
                above.marks.append((joints[joint], Mark.SQUARE, RED))
            elif layers.measured:
                drawn.marks.append((joints[joint], Mark.DISC, person_colour(person)))
    return Drawn(drawn.lines + above.lines, drawn.marks + above.marks)


def drawn_occlusion(pixels: np.ndarray, codes: np.ndarray, bones: list[tuple[int, int]]) -> Drawn:
    """Return the drawing of true joints (P, J, 2), px, in the colours of their occluders, by `Visibility` (P, J)."""
    hidden, seen = Drawn(), Drawn()
    for person, joints in enumerate(pixels):
        known = np.isfinite(joints).all(-1)
        for bone in map(list, bones):
            if known[bone].all():
                # A bone has the colour of the end that is more hidden.
                worst = Visibility(max(codes[person, bone]))
                visible = worst == Visibility.VISIBLE
                (seen if visible else hidden).lines.append((joints[bone], COLOURS[worst], visible))
        for joint in np.flatnonzero(known & (codes[person] <= Visibility.HIDDEN_BY_OBJECT)):
            code = Visibility(codes[person, joint])
            (seen if code == Visibility.VISIBLE else hidden).marks.append((joints[joint], Mark.DISC, COLOURS[code]))
    return Drawn(hidden.lines + seen.lines, hidden.marks + seen.marks)


# The views


@dataclass(frozen=True)
class Overlay:
    """Draws the views of a clip. For a fused skeleton, only the joints of its first part are drawn."""

    clip: Clip  # The clip to draw
    width: int  # Width of a view in the drawing, px
    layers: Layers  # The layers to draw
    # An image of the room for each view, (H, W, 3) uint8, for clips without images. Without room images, a grid on the
    # floor is drawn.
    rooms: Sequence[np.ndarray] | None = None

    @cached_property
    def shown(self) -> Poses3D | None:
        """The poses or the truth in which people are numbered; None if only detections are drawn."""
        return self.clip.poses if self.layers.poses else self.clip.truth if self.layers.truth else None

    @cached_property
    def ground(self) -> np.ndarray:
        """The corners (2, 2) of the floor, m."""
        return floor_of(self.clip)

    def tiles(self, frame: int, images: Sequence[np.ndarray | None]) -> list[np.ndarray]:
        """Return drawings (h, width, 3) uint8 of all views of one frame, over their images (H, W, 3) or the room."""
        truth, poses = (
            None if part is None else rig.project(part.xyz[frame : frame + 1, :, first_joints(part)])[0][0]
            for part, rig in (
                (self.clip.truth if self.layers.truth else None, self.clip.actual_rig),
                (self.clip.poses if self.layers.poses else None, self.clip.rig),
            )
        )
        return [
            self._tile(
                frame, view, image, truth if truth is None else truth[view], poses if poses is None else poses[view]
            )
            for view, image in enumerate(images)
        ]

    def _tile(
        self, frame: int, view: int, image: np.ndarray | None, truth: np.ndarray | None, poses: np.ndarray | None
    ) -> np.ndarray:
        width, height = self.clip.actual_rig.size[view]
        scale = self.width / width
        size = (self.width, round(height * scale))
        image = self.rooms[view] if image is None and self.rooms else image
        if image is None:
            canvas = floor(self.clip.actual_rig[view : view + 1], size, scale, self.ground)
        else:
            canvas = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        for drawn, thick in self._drawn(frame, view, truth, poses):
            self._draw(canvas, drawn, scale, thick)
        picture = Image.new("RGB", (size[0], size[1] + self._foot), PAPER)
        picture.paste(Image.fromarray(canvas))
        draw = ImageDraw.Draw(picture, "RGBA")
        letters = font(self._line - 3)
        label = f"{camera_label(self.clip.rig.names[view])}   {frame / self.clip.fps:.2f} s"
        draw.rectangle((0, 0, draw.textlength(label, letters) + 12, self._line + 3), fill=(*PAPER, 205))
        draw.text((6, 1), label, INK, letters)
        self._number_people(draw, truth if poses is None else poses, frame, view, scale)
        self._write_below(draw, frame, view, size[1])
        return np.asarray(picture)

    def _drawn(self, frame: int, view: int, truth: np.ndarray | None, poses: np.ndarray | None):
        """Yield the layers of a view from bottom to top, each with the thickness of its lines."""
        clip, thick = self.clip, max(1, self.width // 320)
        if self.layers.detections:
            found = clip.detections.xy[frame, view]
            yield drawn_plainly(found, clip.detections.skeleton.bones, Mark.CROSS, [DETECTED] * len(found)), 1
        if truth is not None and clip.truth is not None:
            joints = first_joints(clip.truth)
            if self.layers.occlusion and clip.occlusion is not None:
                codes = clip.occlusion.visibility[frame, view][:, joints]
                yield drawn_occlusion(truth, codes, self.bones(clip.truth)), thick
            else:
                colours = [TRUE if self.layers.poses else person_colour(person) for person in range(len(truth))]
                yield drawn_plainly(truth, self.bones(clip.truth), Mark.RING, colours), 1
        if poses is not None and clip.poses is not None:
            source = clip.poses.source[frame][:, first_joints(clip.poses)]
            yield drawn_poses(poses, source, self.bones(clip.poses), self.layers), thick

    @staticmethod
    def bones(poses: Poses3D) -> list[tuple[int, int]]:
        """Return the bones (parent, child) between joints that are drawn."""
        joints = first_joints(poses)
        return [bone for bone in poses.skeleton.bones if set(bone) <= set(joints)]

    def _draw(self, canvas: np.ndarray, drawn: Drawn, scale: float, thick: int) -> None:
        for points, colour, outlined in drawn.lines:
            places = (points + 0.5) * scale - 0.5
            if drawable(places, self.width).all():
                draw_line(canvas, places, colour, thick, outlined=outlined)
        for point, mark, colour in drawn.marks:
            place = (point + 0.5) * scale - 0.5
            if drawable(place, self.width):
                draw_mark(canvas, place, mark, colour, thick)

    @property
    def _line(self) -> int:
        """Height of a line of text, px."""
        return max(13, self.width // 30)

    @property
    def _foot(self) -> int:
        """Height of the text under a view, px."""
        lines = self.clip.truth.xyz.shape[1] if self.layers.occlusion and self.clip.truth else 1
        return lines * self._line + self._line // 2

    def _number_people(
        self, draw: ImageDraw.ImageDraw, pixels: np.ndarray | None, frame: int, view: int, scale: float
    ) -> None:
        width, height = self.clip.actual_rig.size[view]
        for person, joints in enumerate([] if pixels is None else pixels):
            inside = np.isfinite(joints).all(-1) & ((joints >= 0) & (joints < (width, height))).all(-1)
            if self.layers.occlusion and self.clip.occlusion and self.clip.truth:
                codes = self.clip.occlusion.visibility[frame, view, person, first_joints(self.clip.truth)]
                inside &= codes <= Visibility.HIDDEN_BY_OBJECT
            if inside.any():
                points = joints[inside] * scale
                x, y = points[points[:, 1].argmin()]
                half = self._line * 0.6
                y = max(y - 1.5 * self._line, self._line + 4 + half)
                # A person's colour could be mistaken for the colour of an occluder.
                edge = INK if self.layers.occlusion else person_colour(person)
                draw.ellipse((x - half, y - half, x + half, y + half), (*PAPER, 225), edge, width=2)
                draw.text((x, y), person_name(person), INK, font(self._line - 3, bold=True), anchor="mm")

    def _write_below(self, draw: ImageDraw.ImageDraw, frame: int, view: int, top: int) -> None:
        letters = font(self._line - 3)
        if self.layers.occlusion and self.clip.truth:
            joints = first_joints(self.clip.truth)
            rows = [
                [(person_name(person), INK), *occlusion_summary(self.clip, frame, view, person, joints)]
                for person in range(self.clip.truth.xyz.shape[1])
            ]
        else:
            rows = [self._counts(frame, view)]
        for row, words in enumerate(rows):
            x, y = 6.0, top + self._line // 4 + row * self._line
            for text, colour in words:
                if x + draw.textlength(text, letters) > self.width:
                    draw.text((x, y), "…", colour, letters)
                    break
                draw.text((x, y), text, colour, letters)
                x += draw.textlength(text + "   ", letters)

    def _counts(self, frame: int, view: int) -> list[tuple[str, RGB]]:
        clip, words = self.clip, []
        if self.layers.detections:
            people = int(clip.detections.observed[frame, view].any(-1).sum())
            words.append((f"{people} detected", DETECTED))
        if self.layers.poses and clip.poses:
            joints = first_joints(clip.poses)
            completed = (clip.poses.source[frame][:, joints] == Source.COMPLETED).sum()
            measured = clip.poses.measured[frame][:, joints].sum()
            words += [(f"{measured} joints measured", INK)] if self.layers.measured else []
            words += [(f"{completed} completed", RED)] if self.layers.completed and completed else []
        return words


def images_of(clip: Clip, frames: np.ndarray) -> Iterator[Sequence[np.ndarray | None]]:
    """Yield the images of all views, frame by frame; None for a view without images."""
    if clip.images is None or not clip.has_images:
        return repeat([None] * len(clip.rig), len(frames))
    images = clip.images.select(frames, clip.rig.names)
    return zip(*(images.read("rgb", name) for name in clip.rig.names), strict=True)
