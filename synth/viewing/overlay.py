"""Draw the true joints of a simulated clip into its views, coloured by occlusion, with their occluders named below."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.labels import Visibility

COLOURS = {
    Visibility.VISIBLE: (52, 211, 123),
    Visibility.HIDDEN_BY_SELF: (255, 190, 11),
    Visibility.HIDDEN_BY_PERSON: (255, 45, 120),
    Visibility.HIDDEN_BY_OBJECT: (72, 149, 255),
    Visibility.OUTSIDE_IMAGE: (150, 156, 164),
}
"""RGB of a joint's mark, distinct for colour-blind readers too."""
MEANINGS = {
    Visibility.VISIBLE: "visible",
    Visibility.HIDDEN_BY_SELF: "hidden by their own body",
    Visibility.HIDDEN_BY_PERSON: "by another person",
    Visibility.HIDDEN_BY_OBJECT: "by an object",
    Visibility.OUTSIDE_IMAGE: "outside the image",
}
PAPER, INK, FAINT = (22, 25, 30), (233, 236, 240), (139, 148, 158)
_EMPTY, _GRID = (58, 63, 71), (84, 91, 101)
_FINE = 4
"""Bits of sub-pixel position that OpenCV draws with."""


@lru_cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return Matplotlib's default font at a size in px."""
    weight = "bold" if bold else "normal"
    return ImageFont.truetype(
        font_manager.findfont(font_manager.FontProperties(family="DejaVu Sans", weight=weight)), size
    )


@dataclass(frozen=True)
class Overlay:
    """Draws the joints of the first skeleton of a clip's truth into its views.

    Attributes:
        clip: With truth, visibility and occluders.
        width: Of a view in the drawing, px.
        rooms: Images of the room, (H, W, 3) uint8 a view, drawn where the clip has no images; without them, a grid on
            the floor is drawn.

    Raises:
        ValueError: the clip has no occlusion labels.
    """

    clip: Clip
    width: int
    rooms: Sequence[np.ndarray] | None = None

    def __post_init__(self):
        if self.clip.occlusion is None or self.clip.occlusion.occluder is None:
            raise ValueError(
                f"clip {self.clip.id!r} has no visibility to show: only simulated clips have occlusion labels. "
                "dmae report draws captured clips"
            )

    @cached_property
    def rig(self) -> CameraRig:
        """The true cameras."""
        return self.clip.rig if self.clip.true_rig is None else self.clip.true_rig

    @cached_property
    def joints(self) -> list[int]:
        """Indices of the joints that are drawn."""
        first = self.clip.truth.skeleton.joints[0].rpartition(".")[0]
        return [i for i, name in enumerate(self.clip.truth.skeleton.joints) if name.rpartition(".")[0] == first]

    @cached_property
    def bones(self) -> list[tuple[int, int]]:
        """(parent, child) among `joints`."""
        return [bone for bone in self.clip.truth.skeleton.bones if set(bone) <= set(self.joints)]

    @cached_property
    def pixels(self) -> np.ndarray:
        """(F, V, P, J, 2) projections of the joints, px."""
        return self.rig.project(self.clip.truth.xyz[:, :, self.joints])[0]

    def occluder_name(self, frame: int, view: int, person: int, joint: int) -> str:
        """Return the name of what hides a joint of `joints` in a view; empty for nothing."""
        at = (frame, view, person, self.joints[joint])
        by = int(self.clip.occlusion.occluder[at])
        match Visibility(self.clip.occlusion.visibility[at]):
            case Visibility.HIDDEN_BY_SELF:
                return "itself"
            case Visibility.HIDDEN_BY_PERSON:
                return f"person {by}"
            case Visibility.HIDDEN_BY_OBJECT:
                return self.clip.occlusion.objects[by]
        return ""

    def tile(self, frame: int, view: int, image: np.ndarray | None) -> np.ndarray:
        """Draw one view of one frame, (h, width, 3) uint8, over its image (H, W, 3) or, without one, over its room."""
        width, height = self.rig.size[view]
        scale = self.width / width
        size = (self.width, round(height * scale))
        image = self.rooms[view] if image is None and self.rooms else image
        if image is None:
            canvas = self._floor(view, size, scale)
        else:
            canvas = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        self._draw_people(canvas, frame, view, scale)
        picture = Image.new("RGB", (size[0], size[1] + self._foot), PAPER)
        picture.paste(Image.fromarray(canvas))
        self._write(ImageDraw.Draw(picture, "RGBA"), frame, view, scale, size[1])
        return np.asarray(picture)

    @property
    def _line(self) -> int:
        """Height of a line of text, px."""
        return max(13, self.width // 30)

    @property
    def _foot(self) -> int:
        """Height of the text under a view, px."""
        return self.clip.truth.xyz.shape[1] * self._line + self._line // 2

    def _floor(self, view: int, size: tuple[int, int], scale: float) -> np.ndarray:
        canvas = np.full((size[1], size[0], 3), _EMPTY, np.uint8)
        along, across = np.meshgrid(np.linspace(-5, 5, 201), np.arange(-5.0, 6.0))
        lines = np.stack([along, across, np.zeros_like(along)], -1)
        lines = np.concatenate([lines, lines[..., [1, 0, 2]]])
        pixels = self.rig[view : view + 1].project(lines[None])[0][0, 0] * scale
        near = np.isfinite(pixels).all(-1) & (np.abs(pixels) < 20 * self.width).all(-1)
        for line, fits in zip(pixels, near, strict=True):
            for run in np.split(line, np.flatnonzero(np.diff(fits)) + 1):
                if np.isfinite(run).all() and (np.abs(run) < 20 * self.width).all():
                    cv2.polylines(canvas, [_fine(run)], False, _GRID, 1, cv2.LINE_AA, _FINE)
        return canvas

    def _draw_people(self, canvas: np.ndarray, frame: int, view: int, scale: float) -> None:
        codes = self.clip.occlusion.visibility[frame, view][:, self.joints]
        pixels = (self.pixels[frame, view] + 0.5) * scale - 0.5
        thick = max(1, round(self.width / 320))
        drawable = np.isfinite(pixels).all(-1) & (np.abs(pixels) < 20 * self.width).all(-1)
        bones, marks = [], []
        for person in range(len(pixels)):
            for parent, child in ((self.joints.index(a), self.joints.index(b)) for a, b in self.bones):
                if drawable[person, [parent, child]].all():
                    # A bone has the colour of its more hidden end.
                    worst = max(codes[person, parent], codes[person, child])
                    bones.append((worst != Visibility.VISIBLE, pixels[person, [parent, child]], worst))
            shown = np.flatnonzero(drawable[person] & (codes[person] <= Visibility.HIDDEN_BY_OBJECT))
            marks += [(codes[person, j] != Visibility.VISIBLE, pixels[person, j], codes[person, j]) for j in shown]
        for hidden, line, code in sorted(bones, key=lambda bone: not bone[0]):
            if not hidden:
                cv2.polylines(canvas, [_fine(line)], False, PAPER, thick + 2, cv2.LINE_AA, _FINE)
            cv2.polylines(canvas, [_fine(line)], False, COLOURS[code], thick, cv2.LINE_AA, _FINE)
        for _, point, code in sorted(marks, key=lambda mark: not mark[0]):
            (at,) = _fine(point[None])
            cv2.circle(canvas, at.tolist(), (2 * thick + 1) << _FINE, PAPER, -1, cv2.LINE_AA, _FINE)
            cv2.circle(canvas, at.tolist(), (2 * thick) << _FINE, COLOURS[code], -1, cv2.LINE_AA, _FINE)

    def _write(self, draw: ImageDraw.ImageDraw, frame: int, view: int, scale: float, top: int) -> None:
        """Write the camera's name, a number at each head, and below how many joints each occluder hides."""
        letters, line = font(self._line - 3), self._line
        label = f"camera {self.rig.names[view]}   {frame / self.clip.fps:.2f} s"
        draw.rectangle((0, 0, draw.textlength(label, letters) + 12, line + 3), fill=(*PAPER, 205))
        draw.text((6, 1), label, INK, letters)
        codes = self.clip.occlusion.visibility[frame, view][:, self.joints]
        for person, code in enumerate(codes):
            shown = code <= Visibility.HIDDEN_BY_OBJECT
            if shown.any():
                points = self.pixels[frame, view, person, shown] * scale
                x, y = points[points[:, 1].argmin()]
                half = line * 0.6
                y = max(y - 1.5 * line, line + 4 + half)
                draw.ellipse((x - half, y - half, x + half, y + half), fill=(*PAPER, 225), outline=INK)
                draw.text((x, y), str(person), INK, font(self._line - 3, bold=True), anchor="mm")
            x, y = 6.0, top + line // 4 + person * line
            draw.text((x, y), f"person {person}", INK, letters)
            x += draw.textlength("person 00 ", letters)
            for words, colour in self._summary(frame, view, person, code):
                if x + draw.textlength(words, letters) > self.width:
                    draw.text((x, y), "…", colour, letters)
                    break
                draw.text((x, y), words, colour, letters)
                x += draw.textlength(words + "   ", letters)

    def _summary(self, frame: int, view: int, person: int, code: np.ndarray) -> list[tuple[str, tuple[int, int, int]]]:
        """Return counts of a person's joints in a view by occluder, with their colours, the most frequent first."""
        if (code == Visibility.ABSENT).all():
            return [("absent", FAINT)]
        away = int((code > Visibility.HIDDEN_BY_OBJECT).sum())
        if away == len(code):
            return [("not in the image", FAINT)]
        hidden = np.flatnonzero((code > Visibility.VISIBLE) & (code <= Visibility.HIDDEN_BY_OBJECT))
        causes = Counter((self.occluder_name(frame, view, person, joint), Visibility(code[joint])) for joint in hidden)
        words = [(f"{count} behind {name}", COLOURS[cause]) for (name, cause), count in causes.most_common()]
        words.insert(0, (f"{int((code == Visibility.VISIBLE).sum())} seen", COLOURS[Visibility.VISIBLE]))
        return words + ([(f"{away} outside", FAINT)] if away else [])

    def header(self, width: int) -> np.ndarray:
        """Draw a strip (h, width, 3) uint8 with the legend and the clip's fractions, in as many lines as needed."""
        clip, codes = self.clip, self.clip.occlusion.visibility[..., self.joints]
        persons, views = clip.truth.xyz.shape[1], len(clip.rig)
        about = f"{_count(persons, 'person')}, {_count(views, 'camera')}, {len(clip) / clip.fps:.1f} s"
        there = np.isfinite(clip.truth.xyz[:, :, self.joints]).all(-1)
        visible_views = clip.occlusion.visible_views[..., self.joints][there]
        seen = np.bincount(visible_views, minlength=views + 1) / max(1, there.sum())
        legend = [(f"{meaning} {np.mean(codes == cause):.0%}", COLOURS[cause]) for cause, meaning in MEANINGS.items()]
        counts = [(f"{number}: {share:.0%}", None) for number, share in enumerate(seen) if share > 0]
        lines = [
            [(f"clip {clip.id}", None), (about, None)],
            *_wrapped(legend, width),
            *_wrapped([("joints by number of cameras that see them", None), *counts], width),
        ]
        picture = Image.new("RGB", (width, 12 + 24 * len(lines)), PAPER)
        draw = ImageDraw.Draw(picture)
        for number, line in enumerate(lines):
            x, y = 10.0, 8 + 24 * number
            for words, colour in line:
                if colour:
                    draw.ellipse((x, y + 3, x + 11, y + 14), colour)
                    x += 17
                draw.text((x, y), words, INK if colour or y == 8 else FAINT, _LETTERS)
                x += draw.textlength(words, _LETTERS) + _SPACE
        return np.asarray(picture)


_LETTERS, _SPACE = font(14), 18


def _wrapped(items: list[tuple[str, tuple | None]], width: int) -> list[list[tuple[str, tuple | None]]]:
    """Wrap texts with their marks, if any, into lines of `width` px."""
    lines, x = [[]], 10.0
    for words, colour in items:
        needed = _LETTERS.getlength(words) + _SPACE + (17 if colour else 0)
        if lines[-1] and x + needed > width:
            lines, x = [*lines, []], 10.0
        lines[-1].append((words, colour))
        x += needed
    return lines


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _fine(points: np.ndarray) -> np.ndarray:
    """Return pixels (n, 2) in OpenCV's fixed point of `_FINE` fractional bits."""
    return np.round(points * (1 << _FINE)).astype(np.int32)
