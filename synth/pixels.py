"""What the images of ids say of people: how much of each shows, and whether their joints' labels are true."""

from typing import NamedTuple

import cv2
import numpy as np

from dmae.clip import Clip, Visibility
from dmae.images import FIRST_OBJECT_ID, Images
from synth.render import Renderer


def person_pixels(renderer: Renderer, qpos: np.ndarray, images: Images, persons: int) -> tuple[np.ndarray, np.ndarray]:
    """Count the pixels of people of any number.

    Args:
        renderer: Of the scene that the images show.
        qpos: (F, nq) states.
        images: What was rendered of them, ids included.
        persons: P, how many people there are.

    Returns:
        visible: (F, V, P) int32 pixels that show each person.
        amodal: (F, V, P) int32 pixels that would if nothing and nobody else were there.
    """
    visible = np.zeros((len(qpos), len(images.views), persons), np.int32)
    amodal = np.zeros_like(visible)
    for view, name in enumerate(images.views):
        for frame, (state, ids) in enumerate(zip(qpos, images.read("ids", name), strict=True)):
            visible[frame, view] = np.bincount(ids.ravel(), minlength=1 + persons)[1 : 1 + persons]
            for person in range(persons):
                amodal[frame, view, person] = np.count_nonzero(renderer.alone(state, view, person))
    return visible, amodal


class Agreement(NamedTuple):
    """How many joints were compared with the pixel at their place, and how many of the labels it bears out.

    Attributes:
        compared: (4,) of the joints said to be visible, hidden by themselves, by another person, by an object.
        agreeing: (4,) of these.
    """

    compared: np.ndarray
    agreeing: np.ndarray


def agreement(clip: Clip, margin: int = 5) -> Agreement:
    """Compare visibility with the images of ids: a joint's pixel must show its person, or else what hides it.

    Left out, for there a pixel says little, are joints outside the image, those nearer than `margin` px to any
    silhouette, and the top of the head, which Shelf's annotators put into the air before the brow.

    Args:
        clip: With truth, visibility and images of ids; the cameras are those it was truly made with.
        margin: px.
    """
    rig = clip.rig if clip.true_rig is None else clip.true_rig
    xy, _ = rig.project(clip.truth.xyz)
    on_body = [not name.endswith("top_head") for name in clip.truth.skeleton.joints]
    around, compared, agreeing = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8), np.zeros(4, int), np.zeros(4, int)
    for view, name in enumerate(clip.rig.names):
        for frame, ids in enumerate(clip.images.read("ids", name)):
            codes, owner = clip.visibility[frame, view], clip.hidden_by[frame, view].astype(int)
            judged = (codes <= Visibility.HIDDEN_BY_OBJECT) & on_body & np.isfinite(xy[frame, view]).all(-1)
            person, joint = np.nonzero(judged)
            column, row = np.clip(np.round(xy[frame, view, person, joint]).astype(int), 0, rig.size[view] - 1).T
            clear = cv2.dilate(ids, around)[row, column] == cv2.erode(ids, around)[row, column]
            code, by = codes[person, joint], owner[person, joint]
            said = np.where(
                code == Visibility.HIDDEN_BY_OBJECT,
                FIRST_OBJECT_ID + by,
                1 + np.where(code == Visibility.HIDDEN_BY_PERSON, by, person),
            )
            compared += np.bincount(code[clear], minlength=4)
            agreeing += np.bincount(code[clear & (said == ids[row, column])], minlength=4)
    return Agreement(compared, agreeing)
