"""Weights and Poses3D to completed Poses3D."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from math import ceil
from pathlib import Path

import numpy as np
import torch

from dmae.baselines import present
from dmae.bodyframe import turn
from dmae.calibrate import Factors, inflated
from dmae.clip import Poses3D, Source
from dmae.fusion import answer, derive, nobody
from dmae.mapping import convert
from dmae.metrics import gap_lengths
from dmae.model import DMAE
from dmae.rejection import contradicted
from dmae.resample import resample
from dmae.skeleton import Skeleton
from dmae.trust import as_captured, nearby, share
from dmae.weights import find_shipped, load_model, pick_device
from dmae.windows import Rows, make_rows

_BATCH = 128
_SAME_RATE = 0.01
"""Rates within this share of each other are taken as equal."""
_AGILE = 40.0
"""m/s^2; allowing for less, rejection dropped more of what people who jump and dance truly did than errors."""
_AGREED = 3
"""Views; of joints that so many agree on and the frames around contradict, three in four were right. Moved to where a
model puts them, they came no nearer to what annotators say."""


@dataclass(frozen=True)
class Completer:
    """A trained model, ready to fill in what no camera measured.

    A callable of poses (F, P, J) and their frames per second that returns poses of the same shape:

    - Every joint that is absent while its person is present (`dmae.baselines.present`: seen, or missing for
      at most a second between two sightings) is predicted and marked `COMPLETED`. It used no views; its
      covariance is isotropic and calibrated: 90 % regions held 90 % of the truth of clips that training did
      not see. Nobody is invented before the first or after the last sighting, nor in a longer absence.
    - Farther than 0.2 s from any sighting of the person covariances are unknown (NaN).
    - Windows overlap by two thirds; what they add to the interpolation is blended with weights that fall
      linearly from the middle of a window. A window without a sighting adds nothing: in the middle of an
      absence, and however long a gap is, the interpolation over the whole recording is what stands; so it is, nearly,
      in short holes of exact poses (`dmae.trust.share`).
    - Measured joints are returned to the bit as they were. With `denoise` those of fewer than three views (or
      unknown) are moved to where the model puts them and marked `DENOISED`; their covariances then are upper bounds.
      With `reject` such joints that the frames around contradict (`dmae.rejection`) are dropped first, and completed
      like others.
    - What was `COMPLETED` before is no evidence: the model does not see it, and it is completed anew.
      Neither is what is not finite, which becomes absent.
    - Poses at another rate than the model's are resampled, and what the model adds is resampled back.
    - Poses of another skeleton are completed by way of the joints that it has in common with the model's
      (`dmae.mapping.convert`); other joints stay as they are. `notes` tells of either.
    - Weights of two skeletons side by side (`dmae.fusion`) take poses of the first, or of one that has all its joints,
      and return poses of the second, see `dmae.fusion.answer`; no joint of theirs is `MEASURED`.

    With `frames`, those alone are completed and returned, with all the others to go by.

    Raises (when called):
        ValueError: the skeletons have no joint in common, or fps is not positive and finite.
    """

    model: DMAE
    skeleton: Skeleton
    device: torch.device
    denoise: bool = False
    factors: Factors | None = None
    """See `dmae.calibrate.inflated`; without them completed joints have no covariance."""
    reject: bool = False
    """Brings real recordings nearer the truth, and people who jump and dance no nearer."""

    def __call__(self, poses: Poses3D, fps: float, frames: slice = slice(None)) -> Poses3D:
        if not (np.isfinite(fps) and fps > 0):
            raise ValueError(f"fps must be positive, found {fps}")
        poses = poses.without(np.isinf(poses.xyz).any(-1))
        if poses.skeleton != self.skeleton.parts[0]:
            if not self.target:
                return self._by_common_joints(poses, fps, frames)
            poses = self._as_source(poses)
        poses = self._evidence(poses, fps)
        if self.target:
            return self._fuse(poses, fps, frames)
        absent = ((poses.source == Source.ABSENT) & present(poses, fps)[..., None])[frames]
        moved = _doubtful(poses)[frames] & self.denoise
        if not (absent | moved).any():
            return poses.select(frames)
        predicted, scale = self._predict(poses, fps, frames)
        given = poses.select(frames)
        xyz = np.where((absent | moved)[..., None], predicted, given.xyz)
        source = np.where(absent, Source.COMPLETED, np.where(moved, Source.DENOISED, given.source))
        deviation = self._deviation(poses, fps, scale, frames)
        return _state(replace(given, xyz=xyz, source=source), absent, deviation)

    @property
    def target(self) -> Skeleton | None:
        """What poses are turned into; None where they stay on their skeleton."""
        return self.skeleton.parts[1] if len(self.skeleton.parts) > 1 else None

    def _as_source(self, poses: Poses3D) -> Poses3D:
        """Poses that have all the joints of the first of two skeletons, on it."""
        wanted, found = self.skeleton.parts[0], poses.skeleton
        if not set(wanted.joints) <= set(found.joints):
            raise ValueError(
                f"the weights turn {wanted.name!r} into {self.target.name!r}, the poses are {found.name!r}; convert "
                "them (dmae.mapping.convert), or train on their skeleton"
            )
        return convert(poses, wanted)

    def _fuse(self, poses: Poses3D, fps: float, frames: slice) -> Poses3D:
        """The poses of the source turned into those of the target."""
        there, count = present(poses, fps)[frames], len(self.target)
        if not there.any():
            return nobody(self.target, *there.shape)
        predicted, scale = (part[:, :, -count:] for part in self._predict(poses, fps, frames))
        done = answer(poses.select(frames), self.target, predicted, there)
        return _state(done, there[..., None], self._deviation(poses, fps, scale, frames))

    def doubts(self, poses: Poses3D, fps: float) -> tuple[np.ndarray, np.ndarray]:
        """What says how far to trust the scales that the model states, for `dmae.calibrate.inflated`: (F, P, J) how
        long what each joint that is returned rests on is not measured, and (F, P, 1) how exact the poses are."""
        rests_on = (derive(poses, self.target) if self.target else poses).measured
        lengths = np.where(rests_on.any(0), gap_lengths(rests_on), np.inf)
        return lengths * (self.model.config.fps / fps), as_captured(poses)

    @property
    def stride(self) -> float:
        """s from one window to the next: what a recording may be cut at without a change in what follows."""
        return max(1, self.model.config.frames // 3) / self.model.config.fps

    def notes(self, poses: Poses3D, fps: float) -> list[str]:
        """What whoever reads the result should know of how poses like these are completed."""
        notes, config = [], self.model.config
        if not self._same_rate(fps):
            notes.append(f"{fps:g} frames/s, resampled to the {config.fps:g} of the weights and back")
        if self.target:
            notes.append(f"poses are {poses.skeleton.name}, returned as {self.target.name}")
        elif poses.skeleton != self.skeleton:
            others = [joint for joint in poses.skeleton.joints if joint not in self.skeleton.joints]
            left = f"; not completed: {', '.join(others)}" if others else ""
            notes.append(f"poses are {poses.skeleton.name}, completed with weights for {self.skeleton.name}{left}")
        return notes

    def _same_rate(self, fps: float) -> bool:
        return abs(self.model.config.fps / fps - 1) < _SAME_RATE

    def _evidence(self, poses: Poses3D, fps: float) -> Poses3D:
        """The poses less what is no evidence."""
        poses = poses.without(poses.source == Source.COMPLETED)
        if not self.reject:
            return poses
        return poses.without(_doubtful(poses) & contradicted(poses.xyz, fps, _AGILE))

    def _by_common_joints(self, poses: Poses3D, fps: float, frames: slice) -> Poses3D:
        try:
            theirs = convert(poses, self.skeleton)
            common = np.isin(poses.skeleton.joints, self.skeleton.joints)
            done = convert(self(theirs, fps, frames), poses.skeleton)
        except KeyError as error:
            raise ValueError(
                f"the weights are for skeleton {self.skeleton.name!r}, the poses are {poses.skeleton.name!r}, and "
                f"{error.args[0]}; convert the poses (dmae.mapping.convert), or train on their skeleton"
            ) from None
        poses = poses.select(frames)
        taken = common | ((done.source != Source.ABSENT) & ~poses.measured)
        joints = {}
        for name in (field.name for field in fields(Poses3D) if field.name != "skeleton"):
            new, old = getattr(done, name), getattr(poses, name)
            joints[name] = np.where(taken.reshape(*taken.shape, *(1,) * (new.ndim - 3)), new, old)
        return Poses3D(poses.skeleton, **joints)

    def _deviation(self, poses: Poses3D, fps: float, scale: np.ndarray, frames: slice) -> np.ndarray | None:
        """Standard deviations along each axis, m, of what is predicted in those frames, where their scales are given;
        NaN where unknown, None where it is of every joint."""
        if self.factors is None:
            return None
        lengths, captured = (part[frames] for part in self.doubts(poses, fps))
        known = np.where(nearby(poses, fps), 1, np.nan)[frames]
        return known * inflated(scale, lengths, captured, self.factors)

    def _predict(self, poses: Poses3D, fps: float, asked: slice) -> tuple[np.ndarray, np.ndarray]:
        """Where every joint is in those frames, (F, P, J, 3), meaningful while its person is present; and the scale of
        its error (F, P, J), m, NaN where the model was not asked."""
        config = self.model.config
        rest = self.model.rest.cpu().numpy()
        frames, persons = poses.xyz.shape[:2]
        wanted = range(frames)[asked]
        rows = make_rows(poses, fps, rest, config.frames, target=self.target)
        base = _frames(rows.base, persons)[:frames]
        if self._same_rate(fps):
            added = _frames(self._correct(rows, persons, wanted), persons)[:frames]
        else:
            rows = make_rows(resample(poses, fps, config.fps), config.fps, rest, config.frames, target=self.target)
            ratio = config.fps / fps
            around = range(int(wanted.start * ratio), ceil(wanted.stop * ratio) + 1)
            correction = _frames(self._correct(rows, persons, around), persons)
            time = np.arange(frames) * ratio
            first = np.minimum(time.astype(int), len(correction) - 1)
            between = (time - first).clip(0, 1)[:, None, None, None]
            second = np.minimum(first + 1, len(correction) - 1)
            added = correction[first] * (1 - between) + correction[second] * between
        # What poses are turned into lies elsewhere, however short a hole is.
        counts = 1 if self.target else share(poses, fps)
        return (base + np.nan_to_num(added[..., :3]) * counts)[asked], np.exp(added[..., 3])[asked]

    def _correct(self, rows: Rows, persons: int, asked: range) -> np.ndarray:
        """(S, J, 4): what the model adds to the interpolation, m, world, and the logarithm of its scale; blended over
        windows, NaN where there are none."""
        config = self.model.config
        frames = config.frames
        length = len(rows.base) // persons
        start = rows.starts % length
        time = np.arange(len(rows.base)) % length
        here = rows.present & (time >= asked.start) & (time < asked.stop)
        wanted = here[:, None] & (~rows.observed | self.denoise)
        held = wanted.any(1)[rows.starts[:, None] + np.arange(frames)].any(1)
        starts = rows.starts[held & ((start % max(1, frames // 3) == 0) | (start == length - frames))]
        weight = np.minimum(np.arange(1, frames + 1), np.arange(frames, 0, -1)).astype(float)

        total, weights = np.zeros((*rows.observed.shape, 4)), np.zeros(len(rows.base))
        for begin in range(0, len(starts), _BATCH):
            batch = starts[begin : begin + _BATCH]
            windows, _, where = rows.cut(batch, frames, config.turn_to_front)
            with torch.inference_mode():
                predicted = [part.cpu() for part in self.model(*(tensor.to(self.device) for tensor in windows))]
            added = turn((predicted[0] - windows.base).numpy().astype(np.float64), where.front[:, None, None])
            added = np.concatenate([added, predicted[1].numpy()[..., None]], -1)
            for t in range(frames):
                total[batch + t] += weight[t] * added[:, t]
                weights[batch + t] += weight[t]
        return total / np.where(weights > 0, weights, np.nan)[:, None, None]


def load_completer(weights: Path, device: str = "auto", denoise: bool = False, reject: bool = False) -> Completer:
    """The completer of a folder that `dmae train` wrote.

    Args:
        device: As torch names it; `auto` is a GPU if there is one.
        denoise: Move measured joints of few views too.
        reject: Drop measured joints of few views that the frames around contradict.

    Raises:
        FileNotFoundError: there is no model in the folder.
        ValueError: its files are malformed, damaged, or of another version; or `denoise` is asked of a model
            that was not taught to, or that poses do not stay on their skeleton with.
    """
    model, skeleton, record = load_model(weights)
    if denoise and len(skeleton.parts) > 1:
        raise ValueError(
            f"{weights}: this model turns {skeleton.parts[0].name!r} into {skeleton.parts[1].name!r}, and "
            "all joints are where it puts them; leave out denoise"
        )
    if denoise and not record["denoises"]:
        raise ValueError(f"{weights}: this model was not trained to denoise; train with shown_weight above 0")
    where = pick_device(device)
    factors = record["calibration"] and tuple(map(tuple, record["calibration"]))
    return Completer(model.to(where), skeleton, where, denoise, factors, reject)


def completers(weights: Path | None, **options) -> Callable[[Skeleton], Completer]:
    """The completer for poses of a skeleton: that of a folder, or without one, of the weights that come with the
    package (`dmae.weights.find_shipped`). The options and errors are those of `load_completer`.
    """
    if weights is None:
        return cache(lambda skeleton: load_completer(find_shipped(skeleton), **options))
    completer = load_completer(weights, **options)
    return lambda skeleton: completer


def _state(done: Poses3D, predicted: np.ndarray, deviation: np.ndarray | None) -> Poses3D:
    """The poses with the covariances of the joints that were predicted."""
    if deviation is None:
        return done
    variance = deviation[..., None, None] ** 2 * np.eye(3)
    return replace(done, cov=np.where(predicted[..., None, None], variance, done.cov))


def _doubtful(poses: Poses3D) -> np.ndarray:
    """(F, P, J) True where a joint was measured by few views, or by nobody knows how many."""
    return poses.measured & (poses.views < _AGREED)


def _frames(rows: np.ndarray, persons: int) -> np.ndarray:
    """Rows (S, ...) as (frames, P, ...)."""
    return rows.reshape(persons, -1, *rows.shape[1:]).swapaxes(0, 1)
