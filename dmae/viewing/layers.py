"""Layers of a picture of a clip: detections, measured and completed joints, the truth."""

from dataclasses import dataclass, field

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.labels import Visibility
from dmae.viewing.canvas import INK, RED, RGB, Mark, person_colour
from dmae.viewing.occlusion import COLOURS

DETECTED = (250, 226, 130)
"""Colour of detections, which are of no person yet."""
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
        detections, measured, completed, truth: Whether each is.
        occlusion: Whether true joints have the colour of what hides them, and the text below names it.
        lacking: What the clip lacks of what could be shown, in words.
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
    """Return the layers of a clip that are drawn: those asked for that it has."""
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
        lines: Ends (2, 2), px, colour, and whether on a dark edge.
        marks: Point (2,), px, shape and colour.
    """

    lines: list[tuple[np.ndarray, RGB, bool]] = field(default_factory=list)
    marks: list[tuple[np.ndarray, Mark, RGB]] = field(default_factory=list)


def first_joints(poses: Poses3D) -> list[int]:
    """Return the indices of the joints of the first skeleton of fused ones; of others of all joints."""
    first = poses.skeleton.joints[0].rpartition(".")[0]
    return [i for i, name in enumerate(poses.skeleton.joints) if name.rpartition(".")[0] == first]


def drawn_detections(xy: np.ndarray, bones: list[tuple[int, int]]) -> Drawn:
    """Return detections (D, J, 2), px: crosses joined by thin lines."""
    drawn = Drawn()
    for joints in xy:
        known = np.isfinite(joints).all(-1)
        drawn.lines += [(joints[list(bone)], DETECTED, False) for bone in bones if known[list(bone)].all()]
        drawn.marks += [(joints[joint], Mark.CROSS, DETECTED) for joint in np.flatnonzero(known)]
    return drawn


def drawn_poses(pixels: np.ndarray, source: np.ndarray, bones: list[tuple[int, int]], layers: Layers) -> Drawn:
    """Return poses: discs in the colour of the person, and red squares for completed joints.

    Args:
        pixels: (P, J, 2) px.
        source: (P, J) `Source`.
        bones: (parent, child) pairs.
        layers: Which are drawn.
    """
    drawn, above = Drawn(), Drawn()
    for person, joints in enumerate(pixels):
        completed = source[person] == Source.COMPLETED
        known = np.isfinite(joints).all(-1) & np.where(completed, layers.completed, True)
        for bone in map(list, bones):
            # A bone with an end that no camera measured is red, as in the paper's figures.
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
    """Return true joints (P, J, 2), px: rings joined by thin lines, white if there are poses, otherwise in the colour
    of the person."""
    drawn = Drawn()
    for person, joints in enumerate(pixels):
        known = np.isfinite(joints).all(-1)
        colour = TRUE if layers.poses else person_colour(person)
        drawn.lines += [(joints[list(bone)], colour, False) for bone in bones if known[list(bone)].all()]
        drawn.marks += [(joints[joint], Mark.RING, colour) for joint in np.flatnonzero(known)]
    return drawn


def drawn_occlusion(pixels: np.ndarray, codes: np.ndarray, bones: list[tuple[int, int]]) -> Drawn:
    """Return true joints in the colours of what hides them.

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
                # A bone has the colour of its more hidden end.
                worst = Visibility(max(codes[person, bone]))
                visible = worst == Visibility.VISIBLE
                (seen if visible else hidden).lines.append((joints[bone], COLOURS[worst], visible))
        for joint in np.flatnonzero(known & (codes[person] <= Visibility.HIDDEN_BY_OBJECT)):
            code = Visibility(codes[person, joint])
            (seen if code == Visibility.VISIBLE else hidden).marks.append((joints[joint], Mark.DISC, COLOURS[code]))
    return Drawn(hidden.lines + seen.lines, hidden.marks + seen.marks)
