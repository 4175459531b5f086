"""Occluders of the joints of a simulated clip: their colours and names."""

from collections import Counter

import numpy as np

from dmae.data.clip import Clip
from dmae.data.labels import Visibility
from dmae.viewing.canvas import FAINT, RGB

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
    at = (frame, view, person, joint)
    by = int(clip.occlusion.occluder[at])
    match Visibility(clip.occlusion.visibility[at]):
        case Visibility.HIDDEN_BY_SELF:
            return "itself"
        case Visibility.HIDDEN_BY_PERSON:
            return f"person {by}"
        case Visibility.HIDDEN_BY_OBJECT:
            return clip.occlusion.objects[by]
    return ""


def occlusion_summary(clip: Clip, frame: int, view: int, person: int, joints: list[int]) -> list[tuple[str, RGB]]:
    """Return counts of a person's joints in a view by occluder, with their colours, the most frequent first."""
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
