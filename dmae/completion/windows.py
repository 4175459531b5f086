"""Poses to windows that a network takes. Here NaN ends: torch sees `observed` and zeros.

A row is one person in one frame: the persons of a recording, one after the other, each padded to the length of a
window. S rows, B windows, T frames in a window, J joints.
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dmae.completion.features import bone_length_offsets, bone_stretch, held_offsets, jitter
from dmae.completion.fusion import derive
from dmae.completion.gaussian_process import fill_gaussian_process
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import Skeleton
from dmae.numerics.body import body_heading, parents_first, rotate_z
from dmae.numerics.filling import present
from dmae.numerics.paths import connect, frames_away


def in_window(xyz: np.ndarray, origin: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Return points of the world (B, ..., 3) in frames with their origin at (B, 3) m, and +x along (B,) rad."""
    ones = (1,) * (xyz.ndim - 2)
    return rotate_z(xyz - origin.reshape(-1, *ones, 3), -heading.reshape(-1, *ones))


def mid_hip(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the mid hip of bodies (..., J, 3), by that name or between the hips, (..., 3); NaN where unknown.

    Raises KeyError if the skeleton has no hips.
    """
    if "mid_hip" in skeleton.joints:
        return xyz[..., skeleton.index("mid_hip")[0], :]
    return xyz[..., skeleton.index("l_hip", "r_hip"), :].mean(-2)


def rest_pose(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the mean of bodies (..., J, 3) about their mid hip, facing +x, (J, 3) m; used for joints never measured.

    Of two skeletons side by side, the first gives the mid hip and the heading.

    Raises ValueError if a joint is never known together with the hips and a pair of hips or shoulders.
    """
    flat = xyz.reshape(-1, *xyz.shape[-2:]).astype(np.float64)
    first = skeleton.parts[0]
    upright = in_window(flat, mid_hip(flat, first), body_heading(flat, first))
    known = ~np.isnan(upright).any(-1)
    never = [joint for joint, count in zip(skeleton.joints, known.sum(0), strict=True) if not count]
    if never:
        raise ValueError(f"skeleton {skeleton.name!r}: nothing to learn {never} from, the truth never has them")
    return np.where(known[..., None], upright, 0).sum(0) / known.sum(0)[:, None]


_MOST_GAP_FRAMES = 1000  # Since and until a measurement


class Windows(NamedTuple):
    """What the network is given, (B, T, J, ...), about the body of the middle frame, which may face +x (`Rows.cut`)."""

    x: Tensor
    """(..., 3) m, float32, zero where not observed."""
    observed: Tensor
    """(...) True where the joint was measured and is not masked."""
    base: Tensor
    """(..., 3) m; `x` where observed, elsewhere the interpolation over the whole recording."""
    gap: Tensor
    """(..., 2) frames since the joint was last observed and until it is next observed."""
    ray: Tensor
    """(..., 3) unit direction of the ray on which `base` is, of the one camera that detected the joint; else zero."""
    candidate_offset: Tensor
    """(..., 6, 3) m, from `base`: `held_offsets` and `bone_length_offsets` of `dmae.completion.features`."""
    noise_level: Tensor
    """(..., 6) `jitter` and `bone_stretch` of `dmae.completion.features`."""


@dataclass(frozen=True)
class Rows:
    """Recordings prepared to be cut into windows."""

    base: np.ndarray  # (S, J, 3) m, world: measured where observed, interpolated elsewhere; never NaN
    observed: np.ndarray  # (S, J)
    gap: np.ndarray  # (S, J, 2) frames since and until the joint was observed, at most 1000
    ray: np.ndarray  # (S, J, 3) world, unit direction of the ray on which a joint that is not observed is; else zero
    candidate_offset: np.ndarray  # (S, J, 6, 3) m, world, see `Windows`
    noise_level: np.ndarray  # (S, J, 6) see `Windows`
    truth: np.ndarray  # (S, J, 3) NaN where unknown; all NaN when there is none
    origin: np.ndarray  # (S, 3) m, and `heading`: (S,) rad: where the body is and faces
    heading: np.ndarray
    present: np.ndarray  # (S,) True while the person is present, `dmae.numerics.filling.present`
    starts: np.ndarray  # (W,) the first rows of all windows that hold a measurement

    def cut(self, starts: np.ndarray, frames: int, align_heading: bool) -> tuple[Windows, np.ndarray, np.ndarray]:
        """Return the windows that begin at `starts`, their truth (B, T, J, 3), and the headings (B,) that are +x there.

        The middle frame sets the origin of a window.
        """
        index = starts[:, None] + np.arange(frames)
        middle = starts + frames // 2
        heading = self.heading[middle] if align_heading else np.zeros(len(starts))
        observed = self.observed[index]
        base, truth = (
            in_window(part[index], self.origin[middle], heading).astype(np.float32) for part in (self.base, self.truth)
        )
        x = np.where(observed[..., None], base, np.float32(0))
        ray = rotate_z(self.ray[index], -heading[:, None, None]).astype(np.float32)
        offset = rotate_z(self.candidate_offset[index], -heading[:, None, None, None]).astype(np.float32)
        arrays = (x, observed, base, self.gap[index], ray, offset, self.noise_level[index])
        windows = Windows(*map(torch.from_numpy, arrays))
        return windows, truth, heading


def join_rows(parts: list[Rows]) -> Rows:
    """Return several recordings as one."""
    offsets = np.cumsum([0, *(len(part.base) for part in parts[:-1])])
    arrays = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Rows)}
    starts = np.concatenate([part.starts + offset for part, offset in zip(parts, offsets, strict=True)])
    return Rows(**arrays | {"starts": starts})


def make_rows(
    poses: Poses3D,
    fps: float,
    rest: np.ndarray,
    frames: int,
    truth: np.ndarray | None = None,
    target: Skeleton | None = None,
) -> Rows:
    """Interpolate absent joints over the whole recording and lay the persons out as rows.

    Joints that a Gaussian process cannot fill (persons out of the scene, joints never measured) are placed relative to
    their parent as in the rest pose.

    Args:
        poses: F frames, P persons, J joints.
        rest: (J, 3) m, see `rest_pose`.
        frames: Length of the windows.
        truth: (F, P, J, 3) m, world.
        target: A second skeleton. Its joints follow the joints of the poses in `rest`, `truth` and the rows. They are
            never observed: they are derived from the other joints, and have the gaps of these.
    """
    skeleton, target_rest = poses.skeleton, rest[len(poses.skeleton) :]
    rest = rest[: len(skeleton)]
    count, persons = poses.xyz.shape[:2]
    observed = ~np.isnan(poses.xyz).any(-1)
    gap = np.stack(frames_away(observed), -1)
    filled = fill_gaussian_process(poses, fps)
    base = filled.xyz.astype(np.float64)
    ray = np.where((filled.source == Source.COMPLETED)[..., None], np.nan_to_num(poses.rays[..., 1, :]), 0)
    origin, heading = _place_and_heading(base, skeleton, rest)
    _fill_from_rest_pose(base, skeleton, rest, origin, heading)
    offset, noise = _features(poses.xyz.astype(np.float64), base, skeleton, heading)
    if target is not None:
        derived = derive(Poses3D(skeleton, base, np.where(observed, Source.MEASURED, Source.COMPLETED)), target)
        start = derived.xyz.astype(np.float64)
        _fill_from_rest_pose(start, target, target_rest, origin, heading)
        found = _features(np.where(derived.measured[..., None], derived.xyz, np.nan), start, target, heading)
        offset, noise = (np.concatenate(both, 2) for both in zip((offset, noise), found, strict=True))
        base = np.concatenate([base, start], 2)
        gap = np.concatenate([gap, np.stack(frames_away(derived.measured), -1)], 2)
        observed = np.concatenate([observed, np.zeros_like(derived.measured)], 2)
        # The target's joints differ a little from the source's: they are not on their rays.
        ray = np.concatenate([ray, np.zeros_like(start)], 2)

    length = max(count, frames)
    inside = np.arange(length) < count

    def lay_out(array: np.ndarray) -> np.ndarray:
        padded = np.concatenate([array, np.repeat(array[-1:], length - count, 0)])
        return padded.swapaxes(0, 1).reshape(persons * length, *array.shape[2:])

    observed = lay_out(observed) & np.tile(inside, persons)[:, None]
    truth = np.full(base.shape, np.nan) if truth is None else truth
    return Rows(
        base=lay_out(base),
        observed=observed,
        gap=np.minimum(lay_out(gap), _MOST_GAP_FRAMES).astype(np.float32),
        ray=lay_out(ray),
        candidate_offset=lay_out(offset).astype(np.float32),
        noise_level=lay_out(noise).astype(np.float32),
        truth=np.where(np.tile(inside, persons)[:, None, None], lay_out(truth), np.nan),
        origin=lay_out(origin),
        heading=lay_out(heading),
        present=lay_out(present(poses, fps)) & np.tile(inside, persons),
        starts=_starts(observed.any(-1).reshape(persons, length), frames),
    )


def _features(
    xyz: np.ndarray, base: np.ndarray, skeleton: Skeleton, heading: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return `candidate_offset` and `noise_level` of poses (F, P, J, 3), NaN where not measured, filled in `base`."""
    parents = np.array([joint if parent < 0 else parent for joint, parent in enumerate(skeleton.parents)])
    offsets = (
        held_offsets(base, ~np.isnan(xyz[..., 0]), parents, heading),
        bone_length_offsets(base, xyz, skeleton.bones),
    )
    return np.concatenate(offsets, -2), np.concatenate((jitter(xyz), bone_stretch(xyz, skeleton.bones)), -1)


def _place_and_heading(xyz: np.ndarray, skeleton: Skeleton, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return origin (F, P, 3) and heading (F, P) of bodies (F, P, J, 3) with gaps; unknown hips are placed by the rest
    pose."""
    known_heading = body_heading(xyz, skeleton)
    direction = connect(np.stack([np.sin(known_heading), np.cos(known_heading)], -1))
    heading = np.arctan2(direction[..., 0], direction[..., 1])
    implied = xyz - rotate_z(np.broadcast_to(rest, xyz.shape), heading[..., None])
    known = ~np.isnan(implied).any(-1)
    mean = np.where(known[..., None], implied, 0).sum(2) / np.maximum(known.sum(2), 1)[..., None]
    measured = mid_hip(xyz, skeleton)
    origin = np.where(np.isnan(measured), np.where(known.any(2)[..., None], mean, np.nan), measured)
    return connect(origin), heading


def _fill_from_rest_pose(
    base: np.ndarray, skeleton: Skeleton, rest: np.ndarray, origin: np.ndarray, heading: np.ndarray
) -> None:
    """Put the joints of (F, P, J, 3) that are NaN where the rest pose has them, relative to their parents."""
    for joint in parents_first(skeleton):
        parent = skeleton.parents[joint]
        offset = rest[joint] - (rest[parent] if parent >= 0 else 0)
        start = base[:, :, parent] if parent >= 0 else origin
        placed = start + rotate_z(np.broadcast_to(offset, origin.shape), heading)
        base[:, :, joint] = np.where(np.isnan(base[:, :, joint]), placed, base[:, :, joint])


def _starts(seen: np.ndarray, frames: int) -> np.ndarray:
    """Return the first rows of the windows that hold a measurement; `seen` is (P, length)."""
    persons, length = seen.shape
    total = np.concatenate([np.zeros((persons, 1), int), np.cumsum(seen, 1)], 1)
    holds = total[:, frames:] > total[:, : length + 1 - frames]
    person, start = np.nonzero(holds)
    return person * length + start
