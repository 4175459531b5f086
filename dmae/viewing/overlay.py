"""Draw the data of a clip into its views."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from PIL import Image, ImageDraw

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.labels import Visibility
from dmae.viewing import layers as parts
from dmae.viewing.canvas import INK, PAPER, RED, RGB, draw_line, draw_mark, drawable, floor, font, person_colour
from dmae.viewing.layers import Drawn, Layers
from dmae.viewing.occlusion import occlusion_summary


@dataclass(frozen=True)
class Overlay:
    """Draws the views of a clip. For a fused skeleton, only the joints of its first part are drawn.

    Attributes:
        clip: The clip to draw.
        width: Width of a view in the drawing, px.
        layers: The layers to draw.
        rooms: An image of the room for each view, (H, W, 3) uint8, for clips without images. Without room images, a
            grid on the floor is drawn.
    """

    clip: Clip
    width: int
    layers: Layers
    rooms: Sequence[np.ndarray] | None = None

    @cached_property
    def true_rig(self) -> CameraRig:
        """The true cameras, with which the truth is projected and the images were made."""
        return self.clip.rig if self.clip.true_rig is None else self.clip.true_rig

    @cached_property
    def shown(self) -> Poses3D | None:
        """The poses or the truth in which people are numbered; None if only detections are drawn."""
        return self.clip.poses if self.layers.poses else self.clip.truth if self.layers.truth else None

    def tiles(self, frame: int, images: Sequence[np.ndarray | None]) -> list[np.ndarray]:
        """Return drawings (h, width, 3) uint8 of all views of one frame, over their images (H, W, 3) or the room."""
        truth, poses = (
            part and (rig.project(part.xyz[frame : frame + 1, :, parts.first_joints(part)])[0][0])
            for part, rig in (
                (self.clip.truth if self.layers.truth else None, self.true_rig),
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
        width, height = self.true_rig.size[view]
        scale = self.width / width
        size = (self.width, round(height * scale))
        image = self.rooms[view] if image is None and self.rooms else image
        if image is None:
            canvas = floor(self.true_rig[view : view + 1], size, scale)
        else:
            canvas = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        for drawn, thick in self._drawn(frame, view, truth, poses):
            self._draw(canvas, drawn, scale, thick)
        picture = Image.new("RGB", (size[0], size[1] + self._foot), PAPER)
        picture.paste(Image.fromarray(canvas))
        draw = ImageDraw.Draw(picture, "RGBA")
        letters = font(self._line - 3)
        label = f"camera {self.clip.rig.names[view]}   {frame / self.clip.fps:.2f} s"
        draw.rectangle((0, 0, draw.textlength(label, letters) + 12, self._line + 3), fill=(*PAPER, 205))
        draw.text((6, 1), label, INK, letters)
        self._number_people(draw, truth if poses is None else poses, frame, view, scale)
        self._write_below(draw, frame, view, size[1])
        return np.asarray(picture)

    def _drawn(self, frame: int, view: int, truth: np.ndarray | None, poses: np.ndarray | None):
        """Yield the layers of a view from bottom to top, each with the thickness of its lines."""
        clip, thick = self.clip, max(1, self.width // 320)
        if self.layers.detections:
            yield parts.drawn_detections(clip.detections.xy[frame, view], clip.detections.skeleton.bones), 1
        if truth is not None:
            joints = parts.first_joints(clip.truth)
            if self.layers.occlusion:
                codes = clip.occlusion.visibility[frame, view][:, joints]
                yield parts.drawn_occlusion(truth, codes, self.bones(clip.truth)), thick
            else:
                yield parts.drawn_truth(truth, self.bones(clip.truth), self.layers), 1
        if poses is not None:
            source = clip.poses.source[frame][:, parts.first_joints(clip.poses)]
            yield parts.drawn_poses(poses, source, self.bones(clip.poses), self.layers), thick

    @staticmethod
    def bones(poses: Poses3D) -> list[tuple[int, int]]:
        """Return the bones (parent, child) between joints that are drawn."""
        joints = parts.first_joints(poses)
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
        lines = self.clip.truth.xyz.shape[1] if self.layers.occlusion else 1
        return lines * self._line + self._line // 2

    def _number_people(
        self, draw: ImageDraw.ImageDraw, pixels: np.ndarray | None, frame: int, view: int, scale: float
    ) -> None:
        """Write the number of each person above the highest joint, in the person's colour."""
        width, height = self.true_rig.size[view]
        for person, joints in enumerate([] if pixels is None else pixels):
            inside = np.isfinite(joints).all(-1) & ((joints >= 0) & (joints < (width, height))).all(-1)
            if self.layers.occlusion:
                codes = self.clip.occlusion.visibility[frame, view, person, parts.first_joints(self.clip.truth)]
                inside &= codes <= Visibility.HIDDEN_BY_OBJECT
            if inside.any():
                points = joints[inside] * scale
                x, y = points[points[:, 1].argmin()]
                half = self._line * 0.6
                y = max(y - 1.5 * self._line, self._line + 4 + half)
                # A person's colour could be mistaken for the colour of an occluder.
                edge = INK if self.layers.occlusion else person_colour(person)
                draw.ellipse((x - half, y - half, x + half, y + half), (*PAPER, 225), edge, width=2)
                draw.text((x, y), str(person), INK, font(self._line - 3, bold=True), anchor="mm")

    def _write_below(self, draw: ImageDraw.ImageDraw, frame: int, view: int, top: int) -> None:
        letters = font(self._line - 3)
        if self.layers.occlusion:
            joints = parts.first_joints(self.clip.truth)
            rows = [
                [(f"person {person}", INK), *occlusion_summary(self.clip, frame, view, person, joints)]
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
        """Return the counts of detections and joints in a view as texts, each with its colour."""
        clip, words = self.clip, []
        if self.layers.detections:
            people = int(clip.detections.observed[frame, view].any(-1).sum())
            words.append((f"{people} detected", parts.DETECTED))
        if self.layers.poses:
            source = clip.poses.source[frame][:, parts.first_joints(clip.poses)]
            completed, measured = (source == Source.COMPLETED).sum(), clip.poses.measured[frame].sum()
            words += [(f"{measured} joints measured", INK)] if self.layers.measured else []
            words += [(f"{completed} completed", RED)] if self.layers.completed and completed else []
        return words
