"""The paper's way of learning and completing: windows about the hips, dual masks, and the network alone.

The network is `dmae.completion.network.DMAE` without `residual`; `dmae.completion.training` trains it. Nothing of the
default completion is used: no interpolation, no features, no blending of windows.

What differs from the paper, and why:

- Windows are centred on the mean of the observed hips, else of all observed joints. The paper's mid hip may be missing.
- Both masks hide an exact number of joints, so that the tokens of a batch need no padding. One batch in four is masked
  as the released code does it: joints of the masked frames alone.
- Fusion is learned on simulated captures before annotations, which are of few people in few poses.
- Of captured windows at most 160 of the observed joints are shown in training.
- Windows in which nothing is observed predict nothing.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from dmae.completion import fusion
from dmae.completion.config import TrainConfig
from dmae.completion.features import noisiness, smooth_by_noise
from dmae.completion.network import DMAE
from dmae.completion.pieces import check_given, in_pieces
from dmae.completion.training_data import Examples, PosePair, Recipe, mask_captured, mask_scattered
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.resources import read_preset
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import Skeleton
from dmae.numerics.body import rotate_z
from dmae.numerics.filling import are_stills, present, resample
from dmae.numerics.paths import linear
from dmae.parallel import one_thread

PAPER = read_preset(TrainConfig, "model", "paper")
"""The paper's network and its training: the preset `model=paper`, which says what of it is the paper's."""


class PaperWindows(NamedTuple):
    """What the network is given, and beside it interpolation inside the windows."""

    x: Tensor
    """(B, T, J, 3) m, float32, about the hips, zero where not observed."""
    observed: Tensor
    """(B, T, J)"""
    base: Tensor | None = None
    """(B, T, J, 3) m, observed joints by straight lines, held at the ends; the mean height where a window has none."""


class PaperRows(NamedTuple):
    """People one after another; windows do not reach from one to the next."""

    given: np.ndarray
    """(S, J, 3) m, world, NaN where unknown: what the encoder may look at. Joints of a target are never known."""
    truth: np.ndarray
    """(S, J, 3) m, world, NaN where unknown."""
    starts: np.ndarray
    """(W,) first rows of the windows."""
    captured: bool
    """Whether the poses to look at were captured; then they have gaps of their own."""


def _all_captured(captured: Iterable[bool]) -> bool:
    """Return whether all recordings are captured; none are if there are none."""
    kinds = set(captured)
    if len(kinds) > 1:
        raise ValueError(
            "some recordings have captured poses and others have true ones alone; expected captured poses in all, or "
            "in none: capture the others first (dmae capture)"
        )
    return kinds == {True}


def paper_rows(pairs: Sequence[PosePair], frames: int) -> PaperRows:
    """Return the rows of recordings: of their captured poses, or where none has some of their true ones.

    Of captured poses of two skeletons the target alone is learned. Windows need a known joint to look at and one to
    learn.

    Raises ValueError if some have captured poses and others have not.
    """
    parts: list[tuple[np.ndarray, ...]] = []
    offset, captured = 0, _all_captured(bool(pair.captured) for pair in pairs)
    for pair in pairs:
        source, fuses = len(pair.truth.skeleton.parts[0]), captured and len(pair.truth.skeleton.parts) > 1
        truth = pair.truth.xyz if fuses else pair.truth.xyz[:, :, :source]
        given = np.full(truth.shape, np.nan)
        given[:, :, :source] = pair.captured.xyz if captured and pair.captured else truth
        if fuses:
            truth = np.where(np.arange(truth.shape[2])[:, None] < source, np.nan, truth)
        count, people = truth.shape[:2]
        length = max(count, frames)
        pad = ((0, length - count), (0, 0), (0, 0), (0, 0))
        given, truth = (
            np.pad(part, pad, constant_values=np.nan).swapaxes(0, 1).reshape(people * length, *part.shape[2:])
            for part in (given, truth)
        )
        known = [np.concatenate([[0], np.cumsum((~np.isnan(part[..., 0])).any(-1))]) for part in (given, truth)]
        starts = (np.arange(people)[:, None] * length + np.arange(length - frames + 1)).ravel()
        holds = np.all([total[starts + frames] > total[starts] for total in known], 0)
        parts.append((given.astype(np.float32), truth.astype(np.float32), starts[holds] + offset))
        offset += len(given)
    if not parts:
        return PaperRows(np.zeros((0, 0, 3), np.float32), np.zeros((0, 0, 3), np.float32), np.zeros(0, int), False)
    given, truth, starts = map(np.concatenate, zip(*parts, strict=True))
    return PaperRows(given, truth, starts, captured)


def hips(skeleton: Skeleton) -> list[int]:
    """Return the indices of the hips; of two skeletons side by side, in the first."""
    return [i for i, joint in enumerate(skeleton.parts[0].joints) if joint in ("mid_hip", "l_hip", "r_hip")]


def centre(x: np.ndarray, observed: np.ndarray, hips: list[int]) -> np.ndarray:
    """Return the middle of each window's person, (B, 1, 1, 3) m: the mean of observed hips, else of observed joints.

    Args:
        x: (B, T, J, 3) m; not read where `observed` (B, T, J) is False.
    """
    places, counts = np.where(observed[..., None], x, 0), observed[..., None]
    total, count = (part[:, :, hips].sum((1, 2), keepdims=True) for part in (places, counts))
    every, number = (part.sum((1, 2), keepdims=True) for part in (places, counts))
    return np.where(count > 0, total, every) / np.maximum(np.where(count > 0, count, number), 1)


def cut(
    rows: PaperRows, starts: np.ndarray, masked: np.ndarray, skeleton: Skeleton, *, angle: np.ndarray | float = 0.0
) -> Examples:
    """Return the windows that begin at `starts`, about their hips and turned about the vertical, and their truth.

    Args:
        masked: (B, T, J) joints that the encoder may not look at. The windows have the first J joints of the rows.
        angle: (B,) rad.
    """
    index, joints = starts[:, None] + np.arange(masked.shape[1]), masked.shape[2]
    given, truth = rows.given[index, :joints], rows.truth[index, :joints]
    known = ~np.isnan(truth[..., 0])
    observed = ~np.isnan(given[..., 0]) & ~masked
    middle = centre(given, observed, hips(skeleton))
    turned = np.broadcast_to(np.reshape(angle, (-1, 1, 1)), observed.shape)
    given, truth = (rotate_z(np.nan_to_num(part - middle), turned).astype(np.float32) for part in (given, truth))
    return Examples(
        PaperWindows(torch.from_numpy(np.where(observed[..., None], given, 0)), torch.from_numpy(observed)),
        torch.from_numpy(truth),
        torch.from_numpy(known & ~observed),
        torch.from_numpy(known & observed),
    )


_MOST = (40, 160)
"""Most tokens of a captured window that are shown, drawn for each batch. That is a third of its tokens: fewer
take half the time, and windows with equally many need no padding."""


def _all_but(count: int, values: np.ndarray) -> np.ndarray:
    """Return (B, T, J) True for all but the `count` least values of each window (B, T, J)."""
    flat = values.reshape(len(values), -1)
    return (flat.argsort(1).argsort(1) >= count).reshape(values.shape)


class PaperBatches(Dataset):
    """Batches of windows. Batch i is the same whenever it is made.

    Joints of true poses are masked twice. Of captured poses some are masked at random in addition to what was not
    measured.
    """

    def __init__(
        self,
        pools: Sequence[tuple[float, PaperRows]],
        skeleton: Skeleton,
        recipe: Recipe,
        *,
        seed: int,
        epoch: int,
        steps: int,
        batch: int,
        share: slice = slice(None),
    ):
        """
        Args:
            pools: Groups of recordings, all captured or none: the share of windows taken from each, and its rows.
            share: Which windows of each batch this process takes.
        """
        self.pools, self.skeleton, self.recipe, self.seed, self.share = pools, skeleton, recipe, seed, share
        self.first, self.steps, self.batch = epoch * steps, steps, batch
        self.captured = _all_captured(rows.captured for _, rows in pools if len(rows.starts))

    def __len__(self) -> int:
        return self.steps

    def __getitem__(self, step: int) -> Examples:
        if not 0 <= step < self.steps:
            raise IndexError(step)
        rng, config = generator(self.seed, self.first + step, Stream.WINDOWS), self.recipe.masking
        shares = np.array([share * bool(len(rows.starts)) for share, rows in self.pools])
        drawn = rng.choice(len(self.pools), self.batch, p=shares / shares.sum())
        frames, angle = self.recipe.model.frames, rng.uniform(-np.pi, np.pi, self.batch)
        shape = (frames, self.batch, max(rows.truth.shape[1] for _, rows in self.pools))
        if self.captured:
            # Masked tokens come last in the order in which tokens are shown.
            order = rng.random(shape) + mask_captured(shape, config, rng=rng)
            most = int(rng.integers(*_MOST, endpoint=True))
        else:
            order = mask_scattered(shape, config.joints, config.frames, rng.random() < config.released, rng=rng)
        order, parts = order.swapaxes(0, 1)[self.share], []
        for number, (_, rows) in enumerate(self.pools):
            mine = drawn[self.share] == number
            if len(rows.starts):
                starts = rng.choice(rows.starts, self.batch)[self.share][mine]
                masked = order[mine] >= 1
                if self.captured:
                    absent = np.isnan(rows.given[starts[:, None] + np.arange(frames)][..., 0])
                    masked |= _all_but(most, order[mine] + 2 * absent)
                parts.append(cut(rows, starts, masked, self.skeleton, angle=angle[self.share][mine]))
        windows = PaperWindows(*(torch.cat(part) for part in zip(*(each.windows[:2] for each in parts), strict=True)))
        return Examples(windows, *(torch.cat(part) for part in zip(*(each[1:] for each in parts), strict=True)))


def paper_validation(
    pairs: Sequence[PosePair], skeleton: Skeleton, recipe: Recipe, rest: np.ndarray, *, seed: int, batch: int
) -> list[Examples]:
    """Return examples of every recording, with interpolation inside the windows beside them.

    True poses are masked as the paper says; of captured ones nothing is, in addition to what was not measured. Windows
    overlap by half.
    """
    frames, rows, found = recipe.model.frames, paper_rows(pairs, recipe.model.frames), []
    starts, joints = rows.starts[:: max(1, frames // 2)], rows.truth.shape[1]
    rng = generator(seed, rows.captured, Stream.VALIDATION)
    for begin in range(0, len(starts), batch):
        part = starts[begin : begin + batch]
        masked = np.zeros((len(part), frames, joints), bool)
        if not rows.captured:
            shape = (frames, len(part), joints)
            masked = mask_scattered(shape, recipe.masking.joints, recipe.masking.frames, rng=rng).swapaxes(0, 1)
        made = cut(rows, part, masked, skeleton)
        base = interpolated(made.windows, rest)
        if rows.captured:
            # A target's joints start where the source's joints of the same name are, at their own heights.
            same = fusion.namesakes(skeleton) or list(range(joints))
            base = base[:, :, same] + torch.from_numpy((rest - rest[same]) * (0, 0, 1)).float()
        found.append(made._replace(windows=made.windows._replace(base=base)))
    return found


def interpolated(windows: PaperWindows, rest: np.ndarray) -> Tensor:
    """Return `PaperWindows.base` of windows; of `rest` (J, 3) m the heights."""
    x = np.where(windows.observed.numpy()[..., None], windows.x.numpy(), np.nan)
    filled = linear(x.swapaxes(0, 1)).swapaxes(0, 1)
    heights = rest[: x.shape[2]] * (0, 0, 1)
    return torch.from_numpy(np.where(np.isnan(filled), heights, filled).astype(np.float32))


# Completion by the network alone.

_BATCH = 64


@dataclass(frozen=True)
class PaperCompleter:
    """A callable of poses (F, P, J) and their frames per second that returns poses completed by the network alone.

    Each frame is predicted once, from the window with this frame in the middle; at the ends of a recording from the
    first or the last window. A frame is completed if its person is present (`dmae.numerics.filling.present`) and its
    window contains a measurement. Measured joints stay as they were. The result has the network's own skeleton. With
    `all_joints` it keeps the skeleton of the poses; joints that the network does not know are not completed. With
    `fuse` it has the second skeleton of the network, and no measured joint. Covariances are unknown. With `smooth`, all
    joints are smoothed over these seconds at the end. Long recordings are completed in pieces.

    Raises (when called):
        KeyError: the skeleton cannot be converted to the network's.
        ValueError: fps is not positive and finite, or poses are not in m.
    """

    model: DMAE
    skeleton: Skeleton
    fuse: bool = False
    smooth: float = 0.0
    all_joints: bool = False

    def __call__(self, poses: Poses3D, fps: float, frames: slice = slice(None)) -> Poses3D:
        check_given(poses, fps)
        with one_thread():
            return in_pieces(self._whole, poses, fps, frames)

    def notes(self, poses: Poses3D, fps: float) -> list[str]:
        """Return what users of the result should know about how poses like these are completed."""
        notes = [f"{fps:g} frames/s: stills, each completed by itself"] if are_stills(fps) else []
        returned = self.skeleton.parts[1 if self.fuse else 0]
        if poses.skeleton != returned and self.all_joints and not self.fuse:
            others = [joint for joint in poses.skeleton.joints if joint not in returned.joints]
            left = f"; not completed: {', '.join(others)}" if others else ""
            notes.append(f"poses are {poses.skeleton.name}, completed with weights for {returned.name}{left}")
        elif poses.skeleton != returned:
            notes.append(
                f"poses are {poses.skeleton.name}, returned as {returned.name}, on which the paper's network works"
            )
        return notes

    def _whole(self, poses: Poses3D, fps: float, frames: slice) -> Poses3D:
        done = self._complete(poses, fps)
        if self.all_joints and not self.fuse and done.skeleton != poses.skeleton:
            done = convert(done, poses.skeleton)
            common = np.isin(poses.skeleton.joints, self.skeleton.parts[0].joints)
            done = poses.taking(common | ((done.source != Source.ABSENT) & ~poses.measured), done)
        if self.smooth:
            noisy = noisiness(poses.without(poses.source == Source.COMPLETED), fps)
            done = smooth_by_noise(done, noisy, fps, self.smooth)
        return done.select(frames)

    def _complete(self, poses: Poses3D, fps: float) -> Poses3D:
        source = self.skeleton.parts[0]
        poses = convert(poses.without(poses.source == Source.COMPLETED), source)
        rate = self.model.config.fps
        slow = poses if abs(rate / fps - 1) < 0.01 else resample(poses, fps, rate)
        known = slow.measured & np.isfinite(slow.xyz).all(-1)
        predicted = self._predict(np.where(known[..., None], slow.xyz, np.nan))
        if slow is not poses:
            predicted = _at_times(predicted, np.arange(len(poses.xyz)) * rate / fps)
        there = present(poses, fps) & ~np.isnan(predicted).any((2, 3))
        if self.fuse:
            return fusion.fused(poses, self.skeleton.parts[1], predicted, there)
        filled = (poses.source == Source.ABSENT) & there[..., None]
        xyz = np.where(filled[..., None], predicted, poses.xyz)
        return replace(poses, xyz=xyz, source=np.where(filled, Source.COMPLETED, poses.source))

    def _predict(self, xyz: np.ndarray) -> np.ndarray:
        """Return the joints that are asked for, (F, P, J, 3) m, world, NaN where a window holds no measurement."""
        count, people, source = xyz.shape[:3]
        frames, joints = self.model.config.frames, len(self.skeleton) if self.fuse else source
        length = max(count, frames)
        padded = np.full((length, people, joints, 3), np.nan, np.float32)
        padded[:count, :, :source] = xyz
        asked = np.arange(joints) >= (source if self.fuse else 0)
        first = np.clip(np.arange(count) - frames // 2, 0, length - frames)
        places = np.array([(person, frame) for person in range(people) for frame in range(count)]).reshape(-1, 2)
        found = np.full((count, people, asked.sum(), 3), np.nan)
        device = next(self.model.parameters()).device
        for begin in range(0, len(places), _BATCH):
            person, frame = places[begin : begin + _BATCH].T
            x = padded[first[frame][:, None] + np.arange(frames), person[:, None]]
            observed = ~np.isnan(x[..., 0])
            middle = centre(x, observed, hips(self.skeleton))
            wanted = np.zeros(observed.shape, bool)
            wanted[np.arange(len(frame)), frame - first[frame]] = asked
            inputs = (np.nan_to_num(x - middle).astype(np.float32), observed)
            with torch.inference_mode():
                done = self.model(
                    *(torch.from_numpy(part).to(device) for part in inputs), wanted=torch.from_numpy(wanted).to(device)
                )
            done = done.xyz.cpu().numpy()[wanted].reshape(len(frame), -1, 3) + middle[:, 0]
            seen = observed.any((1, 2))
            found[frame[seen], person[seen]] = done[seen]
        return found


def _at_times(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return (F, ...) at other times, in frames, by straight lines."""
    first = np.minimum(time.astype(int), len(values) - 1)
    second = np.minimum(first + 1, len(values) - 1)
    share = (time - first).clip(0, 1).reshape(-1, *[1] * (values.ndim - 1))
    return np.where(share > 0, values[first] * (1 - share) + values[second] * share, values[first])
