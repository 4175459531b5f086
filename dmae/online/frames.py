"""Frames that come one by one: finished ones, from poses and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from dmae.data.clip import Poses3D, Source

JOINTS = [field.name for field in fields(Poses3D) if field.name != "skeleton"]
"""What poses hold of each joint."""


@dataclass(frozen=True)
class FinishedFrame:
    """One frame that will not change any more.

    Attributes:
        number: Of the frame, from 0 on.
        people: (P,) numbers of the people who are present; a number is the same person in all frames.
        poses: (1, P, J, ...) with joints, sources, covariances and views.
    """

    number: int
    people: np.ndarray
    poses: Poses3D


def split_frames(poses: Poses3D, people: np.ndarray, number: int = 0) -> list[FinishedFrame]:
    """Return poses (F, P, J) of people (P,) frame by frame, numbered from `number`, each with the people present."""
    frames = []
    for i, present in enumerate((poses.source != Source.ABSENT).any(-1)):
        joints = {name: getattr(poses, name)[i : i + 1, present] for name in JOINTS}
        frames.append(FinishedFrame(number + i, people[present], Poses3D(poses.skeleton, **joints)))
    return frames


def join_frames(frames: Sequence[FinishedFrame], people: np.ndarray) -> Poses3D:
    """Return poses (F, P, J) of one frame or more, with a row for each of the people (P,), ascending."""
    skeleton = frames[0].poses.skeleton
    number = np.repeat(np.arange(len(frames)), [len(frame.people) for frame in frames])
    person = np.concatenate([frame.people for frame in frames])
    wanted = np.isin(person, people)
    place = number[wanted], np.searchsorted(people, person[wanted])
    joints = {}
    whole = Poses3D(skeleton, np.full((len(frames), len(people), len(skeleton), 3), np.nan))
    for name in JOINTS:
        joints[name] = getattr(whole, name).copy()
        joints[name][place] = np.concatenate([getattr(frame.poses, name)[0] for frame in frames])[wanted]
    return Poses3D(skeleton, **joints)
