"""Layers of a drawing of a clip: detections, measured joints, completed joints, and the truth."""

from dataclasses import dataclass, field

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.labels import Visibility
from dmae.viewing.canvas import INK, RED, RGB, Mark, person_colour
from dmae.viewing.occlusion import COLOURS

DETECTED = (250, 226, 130)
"""Colour of detections, which are not yet assigned to persons."""
TRUE = INK
"""Colour of true joints if there are poses."""


@dataclass(frozen=True)
class LayersConfig:
    """Layers that are drawn, if the clip has them."""

    detections: bool | None = None
    """2D detections, crosses; by default if there are no occlusion labels."""
    measured: bool = True
    """Measured joints, discs in the colour of their person."""
    completed: bool = True
    """Completed joints, red squares: no camera measured them."""
    truth: bool | None = None
    """True joints: white rings if there are poses, otherwise in the colours of their occluders; by default if there are
    no poses."""


@dataclass(frozen=True)
class Layers:
    """The layers of a clip that are drawn.

    Attributes:
        detections, measured, completed, truth: Whether each of these layers is drawn.
        occlusion: Whether true joints have the colour of their occluder, and the text below the view names it.
        lacking: Names of the layers that the clip does not have.
    """

    detections: bool
    measured: bool
    completed: bool
    truth: bool
    occlusion: bool
    lacking: tuple[str, ...]

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
    lacking = [] if clip.images is not None and "rgb" in clip.images.kinds else ["images"]
    lacking += [] if has_poses else ["poses" if clip.poses is None else "person in its poses"]
    lacking += ["truth"] if config.truth and not has_truth else []
    lacking += [] if has_detections else ["detections"]
    return Layers(
        detections, measured, completed, truth, truth and has_labels and not (measured or completed), tuple(lacking)
    )


@dataclass
class Drawn:
    """Lines and marks in one view, in the order in which they are drawn.

    Attributes:
        lines: End points (2, 2), px, colour, and whether the line has a dark outline.
        marks: Point (2,), px, shape and colour of each mark.
    """

    lines: list[tuple[np.ndarray, RGB, bool]] = field(default_factory=list)
    marks: list[tuple[np.ndarray, Mark, RGB]] = field(default_factory=list)


def first_joints(poses: Poses3D) -> list[int]:
    """Return the joint indices of the first part of a fused skeleton, or of all joints of any other skeleton."""
    first = poses.skeleton.joints[0].rpartition(".")[0]
    return [i for i, name in enumerate(poses.skeleton.joints) if name.rpartition(".")[0] == first]


def drawn_detections(xy: np.ndarray, bones: list[tuple[int, int]]) -> Drawn:
    """Return the drawing of detections (D, J, 2), px: crosses that are connected by thin lines."""
    drawn = Drawn()
    for joints in xy:
        known = np.isfinite(joints).all(-1)
        drawn.lines += [(joints[list(bone)], DETECTED, False) for bone in bones if known[list(bone)].all()]
        drawn.marks += [(joints[joint], Mark.CROSS, DETECTED) for joint in np.flatnonzero(known)]
    return drawn


def drawn_poses(pixels: np.ndarray, source: np.ndarray, bones: list[tuple[int, int]], layers: Layers) -> Drawn:
    """Return the drawing of poses: discs in the colour of the person, and red squares for completed joints.

    Args:
        pixels: (P, J, 2) px.
        source: (P, J) `Source`.
        bones: (parent, child) pairs.
        layers: The layers to draw.
    """
    drawn, above = Drawn(), Drawn()
    for person, joints in enumerate(pixels):
        completed = source[person] == Source.COMPLETED
        known = np.isfinite(joints).all(-1) & np.where(completed, layers.completed, True)
        for bone in map(list, bones):
            # A bone is red if no camera measured one of its ends, as in the paper's figures.
            red = completed[bone].any()
            if known[bone].all() and (red or layers.measured):
                (above if red else drawn).lines.append((joints[bone], RED if red else person_colour(person), True))
        for joint in np.flatnonzero(known):
            if completed[joint]:
                above.marks.append((joints[joint], Mark.SQUARE, RED))
            elif layers.measured:
                drawn.marks.append((joints[joint], Mark.DISC, person_colour(person)))
    return Drawn(drawn.lines + above.lines, drawn.marks + above.marks)


def drawn_truth(pixels: np.ndarray, bones: list[tuple[int, int]], layers: Layers) -> Drawn:
    """Return the drawing of true joints (P, J, 2), px: rings that are connected by thin lines.

    They are white if the poses are drawn, too, and otherwise have the colour of the person.
    """
    drawn = Drawn()
    for person, joints in enumerate(pixels):
        known = np.isfinite(joints).all(-1)
        colour = TRUE if layers.poses else person_colour(person)
        drawn.lines += [(joints[list(bone)], colour, False) for bone in bones if known[list(bone)].all()]
        drawn.marks += [(joints[joint], Mark.RING, colour) for joint in np.flatnonzero(known)]
    return drawn


def drawn_occlusion(pixels: np.ndarray, codes: np.ndarray, bones: list[tuple[int, int]]) -> Drawn:
    """Return the drawing of true joints in the colours of their occluders.

    Args:
        pixels: (P, J, 2) px.
        codes: (P, J) `Visibility`.
        bones: (parent, child) pairs.
    """
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
