"""Frequency and force of contacts between the people of a clip."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from synth.physics.body_state import BodyState


class ClipContacts(NamedTuple):
    """Contacts between different people of one clip.

    Attributes:
        frames: Number of frames of the clip.
        touching: Number of frames in which a person touches another.
        touches: Number of uninterrupted stretches of such frames.
        force: Greatest force in a frame, N: the median over the frames with contact; 0 without contact.
    """

    frames: int
    touching: int
    touches: int
    force: float


def clip_contacts(state: BodyState) -> ClipContacts:
    """Return the contacts between people, counted in the body states of a clip."""
    owner = [name.partition("/")[0] if name.startswith("person") else "" for name in state.contact_names]
    one, other = np.array([*owner, ""])[state.contact_between].T
    between = (one != "") & (other != "") & (one != other)
    greatest = np.zeros(len(state.qpos))
    np.maximum.at(greatest, state.contact_frame[between], np.linalg.norm(state.contact_force[between], axis=1))
    touching = np.zeros(len(state.qpos), bool)
    touching[state.contact_frame[between]] = True
    touches = int(touching[0]) + int((touching[1:] & ~touching[:-1]).sum())
    force = float(np.median(greatest[touching])) if touching.any() else 0.0
    return ClipContacts(len(state.qpos), int(touching.sum()), touches, force)


def spread(clips: Sequence[ClipContacts]) -> dict[str, float]:
    """Return the number of clips, and the least, median and greatest value of each measure of contact over clips."""
    shares = np.array([clip.touching / clip.frames for clip in clips])
    found = {"clips": len(clips), "frames": sum(clip.frames for clip in clips)}
    measures = {"share": shares, "touches": [clip.touches for clip in clips], "force": [clip.force for clip in clips]}
    for name, values in measures.items():
        found |= {f"{name}_{which}": float(take(values)) for which, take in _SPREAD.items()}
    return found


_SPREAD = {"least": np.min, "median": np.median, "most": np.max}
