"""Tracks: the detections and joints of each person over time, and the state for the prediction of the next frame."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from tempfile import TemporaryFile
from typing import NamedTuple

import numpy as np

from dmae.files.mapped import by_frames, empty, release
from dmae.numerics.statistics import median_known
from dmae.reconstruction.association import NONE

_VELOCITY_FADE = 0.5
"""s; velocities decay to 1/e in this time unless they are measured again."""


class TrackedFrame(NamedTuple):
    """The T persons of one frame.

    Attributes:
        track: (T,) index of their tracks.
        assigned: (T, V, J) index of the detection that shows the joint in the view, or `NONE`.
        xyz: (T, J, 3) m, joints triangulated from these; NaN where absent.
        supported: (T,) True where views agree better than unrelated figures would.
    """

    track: np.ndarray
    assigned: np.ndarray
    xyz: np.ndarray
    supported: np.ndarray


@dataclass(frozen=True)
class Tracks:
    """P tracks over F frames.

    Attributes:
        assigned: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        xyz: (F, P, J, 3) m, joints triangulated from these; NaN where absent.
        supported: (F, P) True where views agree better than unrelated figures would.
    """

    assigned: np.ndarray
    xyz: np.ndarray
    supported: np.ndarray

    @classmethod
    def of(cls, frames: Sequence[TrackedFrame], track: np.ndarray, views: int, joints: int) -> Tracks:
        """Return the tracks with indices `track` (P,), ascending, from tracked frames."""
        assigned = np.full((len(frames), len(track), views, joints), NONE, np.int16)
        xyz = np.full((len(frames), len(track), joints, 3), np.nan)
        supported = np.zeros((len(frames), len(track)), bool)
        if frames:
            number = np.repeat(np.arange(len(frames)), [len(frame.track) for frame in frames])
            tracks, *parts = (np.concatenate(part) for part in zip(*frames, strict=True))
            wanted = np.isin(tracks, track)
            place = number[wanted], np.searchsorted(track, tracks[wanted])
            for array, part in zip((assigned, xyz, supported), parts, strict=True):
                array[place] = part[wanted]
        return cls(assigned, xyz, supported)

    @classmethod
    def of_blocks(cls, blocks: Iterable[Sequence[TrackedFrame]], frames: int, views: int, joints: int) -> Tracks:
        """Return all tracks of `frames` frames, which come in blocks. Only one block is in memory at a time."""
        births, sizes = 0, []
        with TemporaryFile(prefix="dmae-") as file:
            for block in blocks:
                index = np.unique(np.concatenate([np.empty(0, int), *(frame.track for frame in block)]))
                births = max(births, index.max(initial=-1) + 1)
                if len(block) == frames:
                    return cls.of(block, np.arange(births), views, joints)
                part = cls.of(block, index, views, joints)
                for array in (index, part.assigned, part.xyz, part.supported):
                    np.save(file, array)
                sizes.append(len(block))
            file.seek(0)
            tracks = cls(
                empty((frames, births, views, joints), np.int16),
                empty((frames, births, joints, 3), np.float64),
                empty((frames, births), bool),
            )
            arrays, start = (tracks.assigned, tracks.xyz, tracks.supported), 0
            for size in sizes:
                index, here = np.load(file), slice(start, start + size)
                for array, absent in zip(arrays, (NONE, np.nan, False), strict=True):
                    array[here] = absent
                    array[here, index] = np.load(file)
                release(*arrays)
                start += size
        return tracks

    def select(self, persons: np.ndarray) -> Tracks:
        """Return some of the tracks, by indices or by a mask (P,)."""
        arrays = (self.assigned, self.xyz, self.supported)
        return Tracks(*(by_frames(lambda array: array[:, persons], array) for array in arrays))


@dataclass
class TrackState:
    """State of the T currently followed tracks.

    Attributes:
        track: (T,) index of each track in the result.
        xyz: (T, J, 3) m, expected joints; NaN where unknown.
        velocity: (T, 3) m/s of the whole body.
        joint_unseen: (T, J) s since the joint was measured.
        unseen: (T,) s since the person was measured.
        age: (T,) s for which the person has been measured with support.
        unsupported: (T,) s since the person was measured with support.
    """

    track: np.ndarray
    xyz: np.ndarray
    velocity: np.ndarray
    joint_unseen: np.ndarray
    unseen: np.ndarray
    age: np.ndarray
    unsupported: np.ndarray

    @classmethod
    def birth(cls, first: int, xyz: np.ndarray) -> TrackState:
        """Return new tracks, numbered from `first` on, of people with joints (T, J, 3)."""
        count, joints = xyz.shape[:2]
        zero = np.zeros(count)
        return cls(first + np.arange(count), xyz, np.zeros((count, 3)), np.zeros((count, joints)), zero, zero, zero)

    def __getitem__(self, index) -> TrackState:
        return TrackState(*(getattr(self, f.name)[index] for f in fields(self)))

    def __add__(self, others: TrackState) -> TrackState:
        return TrackState(*(np.concatenate([getattr(self, f.name), getattr(others, f.name)]) for f in fields(self)))

    def predicted(self, dt: float) -> TrackState:
        """Return the state after `dt` s without a measurement."""
        return replace(
            self,
            xyz=self.xyz + self.velocity[:, None] * dt,
            velocity=self.velocity * np.exp(-dt / _VELOCITY_FADE),
            joint_unseen=self.joint_unseen + dt,
            unseen=self.unseen + dt,
            unsupported=self.unsupported + dt,
        )

    def updated(self, xyz: np.ndarray, supported: np.ndarray, dt: float, velocity_gain: float) -> TrackState:
        """Return the state with measured joints.

        Args:
            xyz: (T, J, 3) m; NaN where a joint or a person was not measured.
            supported: (T,) True where views agree better than unrelated figures would.
            dt: s since the frame before.
            velocity_gain: Share of each step that is added to the velocity.
        """
        measured = ~np.isnan(xyz[..., 0])
        velocity = self.velocity.copy()
        step = median_known(xyz - self.xyz)
        moved = ~np.isnan(step[:, 0])
        velocity[moved] += velocity_gain * step[moved] / dt
        return replace(
            self,
            xyz=np.where(measured[..., None], xyz, self.xyz),
            velocity=velocity,
            joint_unseen=np.where(measured, 0, self.joint_unseen),
            unseen=np.where(measured.any(-1), 0, self.unseen),
            age=self.age + np.where(measured.any(-1) & supported, dt, 0),
            unsupported=np.where(measured.any(-1) & supported, 0, self.unsupported),
        )
