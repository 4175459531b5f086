"""Poses to windows that a network takes. Here NaN ends: torch sees `observed` and zeros.

A row is one person in one frame: the persons of a recording, one after the other, each padded to the
length of a window. S rows, B windows, T frames in a window, J joints.
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dmae.baselines import fill_recall, present
from dmae.bodyframe import turn
from dmae.clip import Poses3D, Source
from dmae.fusion import derive
from dmae.gaps import neighbours
from dmae.hints import carried, mended, roughness, stretch
from dmae.skeleton import Skeleton

_FAR = 1000
"""Frames to a measurement that does not exist."""


class Windows(NamedTuple):
    """What the network sees, (B, T, J, ...), in the frames of a `Normalisation`."""

    x: Tensor
    """(..., 3) m, float32, zero where not observed."""
    observed: Tensor
    """(...) True where the joint was measured and is shown."""
    base: Tensor
    """(..., 3) m; `x` where observed, what interpolation makes of the whole recording elsewhere."""
    gap: Tensor
    """(..., 2) frames since the joint was last observed and until it is next."""
    ray: Tensor
    """(..., 3) unit direction in which the one camera that sees a joint does, on whose ray `base` is; else zero."""
    leads: Tensor
    """(..., 6, 3) m, from `base`, see `dmae.hints.carried` and `dmae.hints.mended`."""
    rough: Tensor
    """(..., 6) see `dmae.hints.roughness` and `dmae.hints.stretch`."""


@dataclass(frozen=True)
class Normalisation:
    """Where windows stand: window = turned by -front about z (world - origin).

    Attributes:
        origin: (B, 3) m, world: the mid hip, or its stand-in, in the middle frame.
        front: (B,) rad, the heading in the world that is +x in the window.
    """

    origin: np.ndarray
    front: np.ndarray

    def apply(self, xyz: np.ndarray) -> np.ndarray:
        """World to window, (B, ..., 3)."""
        return turn(xyz - self._spread(self.origin, xyz.ndim), -self._spread(self.front, xyz.ndim - 1))

    def undo(self, xyz: np.ndarray) -> np.ndarray:
        """Window to world, (B, ..., 3)."""
        return turn(xyz, self._spread(self.front, xyz.ndim - 1)) + self._spread(self.origin, xyz.ndim)

    @staticmethod
    def _spread(array: np.ndarray, ndim: int) -> np.ndarray:
        return array.reshape(len(array), *(1,) * (ndim - array.ndim), *array.shape[1:])


@dataclass(frozen=True)
class Rows:
    """Recordings made ready to be cut into windows.

    Attributes:
        base: (S, J, 3) m, world: measured where observed, interpolated elsewhere; never NaN.
        observed: (S, J)
        gap: (S, J, 2) frames since and until the joint was observed, at most 1000.
        ray: (S, J, 3) world, unit direction of the ray that a joint that is not observed is on; else zero.
        leads: (S, J, 6, 3) m, world, and `rough`: (S, J, 6), see `dmae.hints`.
        truth: (S, J, 3) NaN where unknown; all NaN when there is none.
        origin: (S, 3) m, front: (S,) rad: where the body is and faces.
        present: (S,) True while the person is there, `dmae.baselines.present`.
        starts: (W,) the first rows of all windows that hold a measurement.
    """

    base: np.ndarray
    observed: np.ndarray
    gap: np.ndarray
    ray: np.ndarray
    leads: np.ndarray
    rough: np.ndarray
    truth: np.ndarray
    origin: np.ndarray
    front: np.ndarray
    present: np.ndarray
    starts: np.ndarray

    def cut(self, starts: np.ndarray, frames: int, turn_to_front: bool) -> tuple[Windows, np.ndarray, Normalisation]:
        """The windows that begin at `starts`, their truth (B, T, J, 3) in the window's frame, and that frame."""
        index = starts[:, None] + np.arange(frames)
        middle = starts + frames // 2
        front = self.front[middle] if turn_to_front else np.zeros(len(starts))
        where = Normalisation(self.origin[middle], front)
        observed, base = self.observed[index], where.apply(self.base[index]).astype(np.float32)
        x = np.where(observed[..., None], base, np.float32(0))
        ray = turn(self.ray[index], -front[:, None, None]).astype(np.float32)
        leads = turn(self.leads[index], -front[:, None, None, None]).astype(np.float32)
        arrays = (x, observed, base, self.gap[index], ray, leads, self.rough[index])
        windows = Windows(*map(torch.from_numpy, arrays))
        return windows, where.apply(self.truth[index]).astype(np.float32), where


def join_rows(parts: list[Rows]) -> Rows:
    """Several recordings as one."""
    offsets = np.cumsum([0, *(len(part.base) for part in parts[:-1])])
    arrays = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Rows)}
    starts = np.concatenate([part.starts + offset for part, offset in zip(parts, offsets, strict=True)])
    return Rows(**arrays | {"starts": starts})


def body_front(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """(...) rad, the heading of bodies (..., J, 3) by hips and shoulders; NaN where neither pair tells it."""
    left = np.zeros((*xyz.shape[:-2], 2))
    for part in ("hip", "shoulder"):
        if {f"l_{part}", f"r_{part}"} <= set(skeleton.joints):
            left_joint, right_joint = skeleton.index(f"l_{part}", f"r_{part}")
            across = xyz[..., left_joint, :2] - xyz[..., right_joint, :2]
            length = np.linalg.norm(across, axis=-1, keepdims=True)
            left += np.where(length > 1e-6, across / np.maximum(length, 1e-6), 0)
    return np.where((left != 0).any(-1), np.arctan2(-left[..., 0], left[..., 1]), np.nan)


def hips(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """(..., 3) the mid hip of bodies (..., J, 3), by that name or between the hips; NaN where unknown.

    Raises:
        KeyError: the skeleton has no hips.
    """
    if "mid_hip" in skeleton.joints:
        return xyz[..., skeleton.index("mid_hip")[0], :]
    return xyz[..., skeleton.index("l_hip", "r_hip"), :].mean(-2)


def rest_pose(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """(J, 3) m, the mean of bodies (..., J, 3) about their mid hip, facing +x; stands in for what is never seen.

    Of two skeletons side by side the hips and the facing are the first's.

    Raises:
        ValueError: a joint is never known together with the hips and a pair of hips or shoulders.
    """
    flat = xyz.reshape(-1, *xyz.shape[-2:]).astype(np.float64)
    first = skeleton.parts[0]
    upright = Normalisation(hips(flat, first), body_front(flat, first)).apply(flat)
    known = ~np.isnan(upright).any(-1)
    never = [joint for joint, count in zip(skeleton.joints, known.sum(0), strict=True) if not count]
    if never:
        raise ValueError(f"skeleton {skeleton.name!r}: nothing to learn {never} from, the truth never has them")
    return np.where(known[..., None], upright, 0).sum(0) / known.sum(0)[:, None]


def make_rows(
    poses: Poses3D,
    fps: float,
    rest: np.ndarray,
    frames: int,
    truth: np.ndarray | None = None,
    target: Skeleton | None = None,
) -> Rows:
    """Interpolate what is absent over the whole recording and lay the persons out as rows.

    What `fill_recall` leaves open (persons out of the scene, joints never measured) hangs from the
    joint's parent as in the rest pose.

    Args:
        poses: F frames, P persons, J joints.
        rest: (J, 3) m, see `rest_pose`.
        frames: Length of the windows.
        truth: (F, P, J, 3) m, world.
        target: Skeleton whose joints come after those of the poses in all of these and in the rows, never observed;
            interpolated means derived from the other joints, its gaps are those of the joints that it is derived from.
    """
    skeleton, hanging = poses.skeleton, rest[len(poses.skeleton) :]
    rest = rest[: len(skeleton)]
    count, persons = poses.xyz.shape[:2]
    observed = ~np.isnan(poses.xyz).any(-1)
    gap = _gap(observed)
    filled = fill_recall(poses, fps)
    base = filled.xyz.astype(np.float64)
    ray = np.where((filled.source == Source.COMPLETED)[..., None], np.nan_to_num(poses.rays[..., 1, :]), 0)
    origin, front = _stance(base, skeleton, rest)
    _hang(base, skeleton, rest, origin, front)
    leads, rough = _hints(poses.xyz.astype(np.float64), base, skeleton, front)
    if target is not None:
        derived = derive(Poses3D(skeleton, base, np.where(observed, Source.MEASURED, Source.COMPLETED)), target)
        start = derived.xyz.astype(np.float64)
        _hang(start, target, hanging, origin, front)
        found = _hints(np.where(derived.measured[..., None], derived.xyz, np.nan), start, target, front)
        leads, rough = (np.concatenate(both, 2) for both in zip((leads, rough), found, strict=True))
        base, gap = np.concatenate([base, start], 2), np.concatenate([gap, _gap(derived.measured)], 2)
        observed = np.concatenate([observed, np.zeros_like(derived.measured)], 2)
        # The target's joints are not quite where the source's are: not on their rays.
        ray = np.concatenate([ray, np.zeros_like(start)], 2)

    length = max(count, frames)
    inside = np.arange(length) < count

    def lay(array: np.ndarray) -> np.ndarray:
        padded = np.concatenate([array, np.repeat(array[-1:], length - count, 0)])
        return padded.swapaxes(0, 1).reshape(persons * length, *array.shape[2:])

    shown = lay(observed) & np.tile(inside, persons)[:, None]
    nowhere = np.full(base.shape, np.nan) if truth is None else truth
    return Rows(
        base=lay(base),
        observed=shown,
        gap=np.minimum(lay(gap), _FAR).astype(np.float32),
        ray=lay(ray),
        leads=lay(leads).astype(np.float32),
        rough=lay(rough).astype(np.float32),
        truth=np.where(np.tile(inside, persons)[:, None, None], lay(nowhere), np.nan),
        origin=lay(origin),
        front=lay(front),
        present=lay(present(poses, fps)) & np.tile(inside, persons),
        starts=_starts(shown.any(-1).reshape(persons, length), frames),
    )


def _hints(xyz: np.ndarray, base: np.ndarray, skeleton: Skeleton, front: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`leads` and `rough` of poses (F, P, J, 3) that are NaN where not measured, interpolated in `base`."""
    parents = np.array([joint if parent < 0 else parent for joint, parent in enumerate(skeleton.parents)])
    leads = carried(base, ~np.isnan(xyz[..., 0]), parents, front), mended(base, xyz, skeleton.bones)
    rough = roughness(xyz), stretch(xyz, skeleton.bones)
    return np.concatenate(leads, -2), np.concatenate(rough, -1)


def _gap(observed: np.ndarray) -> np.ndarray:
    """Of (F, P, J): frames since and until each was observed, (F, P, J, 2)."""
    before, after = neighbours(observed)
    index = np.arange(len(observed))[:, None, None]
    return np.stack(
        [np.where(before < 0, _FAR, index - before), np.where(after == len(observed), _FAR, after - index)], -1
    )


def _stance(xyz: np.ndarray, skeleton: Skeleton, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origin (F, P, 3) and front (F, P) of bodies (F, P, J, 3) of which any joints may be NaN.

    Where the hips are unknown, they are put where the rest pose has them under the joints that are known.
    """
    turned = body_front(xyz, skeleton)
    front = np.arctan2(_interpolate(np.sin(turned)), _interpolate(np.cos(turned)))
    implied = xyz - turn(np.broadcast_to(rest, xyz.shape), front[..., None])
    known = ~np.isnan(implied).any(-1)
    mean = np.where(known[..., None], implied, 0).sum(2) / np.maximum(known.sum(2), 1)[..., None]
    measured = hips(xyz, skeleton)
    origin = np.where(np.isnan(measured), np.where(known.any(2)[..., None], mean, np.nan), measured)
    return np.stack([_interpolate(origin[..., axis]) for axis in range(3)], -1), front


def _interpolate(values: np.ndarray) -> np.ndarray:
    """(F, P) with NaN bridged in time, held at both ends, 0 where there is nothing at all."""
    known = ~np.isnan(values)
    filled = np.zeros_like(values)
    for person in np.flatnonzero(known.any(0)):
        frame = np.flatnonzero(known[:, person])
        filled[:, person] = np.interp(np.arange(len(values)), frame, values[frame, person])
    return filled


def _hang(base: np.ndarray, skeleton: Skeleton, rest: np.ndarray, origin: np.ndarray, front: np.ndarray) -> None:
    """Put the joints of (F, P, J, 3) that are NaN where the rest pose has them, seen from their parents."""
    done: list[int] = []
    while len(done) < len(skeleton):
        for joint, parent in enumerate(skeleton.parents):
            if joint in done or (parent >= 0 and parent not in done):
                continue
            offset = rest[joint] - (rest[parent] if parent >= 0 else 0)
            hung = (base[:, :, parent] if parent >= 0 else origin) + turn(np.broadcast_to(offset, origin.shape), front)
            base[:, :, joint] = np.where(np.isnan(base[:, :, joint]), hung, base[:, :, joint])
            done.append(joint)


def _starts(seen: np.ndarray, frames: int) -> np.ndarray:
    """First rows of the windows that hold a measurement; `seen` is (P, length)."""
    persons, length = seen.shape
    total = np.concatenate([np.zeros((persons, 1), int), np.cumsum(seen, 1)], 1)
    holds = total[:, frames:] > total[:, : length + 1 - frames]
    person, start = np.nonzero(holds)
    return person * length + start
