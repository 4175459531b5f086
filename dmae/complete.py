"""Weights and Poses3D to completed Poses3D."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from dmae.baselines import present
from dmae.calibrate import inflated
from dmae.clip import Poses3D, Source
from dmae.metrics import gap_lengths
from dmae.model import DMAE
from dmae.skeleton import Skeleton
from dmae.weights import load_model, pick_device
from dmae.windows import Rows, make_rows, resample, turn

_BATCH = 128
_SAME_RATE = 0.01
"""Rates within this share of each other are taken as equal."""


@dataclass(frozen=True)
class Completer:
    """A trained model, ready to fill in what no camera measured.

    A callable of poses (F, P, J) and their frames per second that returns poses of the same shape:

    - Every joint that is absent while its person is present (`dmae.baselines.present`: seen, or missing for
      at most a second between two sightings) is predicted and marked `COMPLETED`. It used no views; its
      covariance is isotropic and calibrated: 90 % regions held 90 % of the truth of clips that training did
      not see. Nobody is invented before the first or after the last sighting, nor in a longer absence.
    - Windows overlap by two thirds; what they add to the interpolation is blended with weights that fall
      linearly from the middle of a window. A window without a sighting adds nothing: in the middle of an
      absence, and however long a gap is, the interpolation over the whole recording is what stands, of
      unknown covariance.
    - Measured joints are returned to the bit as they were; with `denoise` they are moved to where the model
      puts them and marked `DENOISED`; their covariances then are upper bounds.
    - What was `COMPLETED` before is no evidence: the model does not see it, and it is completed anew.
    - Poses at another rate than the model's are resampled, and what the model adds is resampled back.

    Raises (when called):
        ValueError: the poses are of another skeleton than the weights, or fps is not positive.
    """

    model: DMAE
    skeleton: Skeleton
    device: torch.device
    denoise: bool = False
    factors: tuple[float, ...] | None = None
    """See `dmae.calibrate.inflated`; without them completed joints have no covariance."""

    def __call__(self, poses: Poses3D, fps: float) -> Poses3D:
        if poses.skeleton.name != self.skeleton.name:
            raise ValueError(
                f"the weights are for skeleton {self.skeleton.name!r}, the poses are {poses.skeleton.name!r}; "
                "convert the poses (dmae.mapping.convert), or train on their skeleton"
            )
        if not fps > 0:
            raise ValueError(f"fps must be positive, found {fps}")
        poses = _forget_completed(poses)
        absent = (poses.source == Source.ABSENT) & present(poses, fps)[..., None]
        moved = poses.measured & self.denoise
        if not (absent | moved).any():
            return poses
        predicted, scale = self._predict(poses, fps)
        xyz = np.where((absent | moved)[..., None], predicted, poses.xyz)
        source = np.where(absent, Source.COMPLETED, np.where(moved, Source.DENOISED, poses.source))
        if self.factors is None:
            return replace(poses, xyz=xyz, source=source)
        lengths = gap_lengths(poses.measured) * (self.model.config.fps / fps)
        variance = inflated(scale, lengths, self.factors)[..., None, None] ** 2 * np.eye(3)
        return replace(poses, xyz=xyz, source=source, cov=np.where(absent[..., None, None], variance, poses.cov))

    def _predict(self, poses: Poses3D, fps: float) -> tuple[np.ndarray, np.ndarray]:
        """Where every joint is, (F, P, J, 3), meaningful while its person is present; and the scale of its error
        (F, P, J), m, NaN where the model was not asked."""
        config = self.model.config
        rest = self.model.rest.cpu().numpy()
        frames, persons = poses.xyz.shape[:2]
        rows = make_rows(poses, fps, rest, config.frames)
        base = _frames(rows.base, persons)[:frames]
        if abs(config.fps / fps - 1) < _SAME_RATE:
            added = _frames(self._correct(rows, persons), persons)[:frames]
        else:
            rows = make_rows(resample(poses, fps, config.fps), config.fps, rest, config.frames)
            correction = _frames(self._correct(rows, persons), persons)
            time = np.arange(frames) * (config.fps / fps)
            first = np.minimum(time.astype(int), len(correction) - 1)
            share = (time - first).clip(0, 1)[:, None, None, None]
            second = np.minimum(first + 1, len(correction) - 1)
            added = correction[first] * (1 - share) + correction[second] * share
        return base + np.nan_to_num(added[..., :3]), np.exp(added[..., 3])

    def _correct(self, rows: Rows, persons: int) -> np.ndarray:
        """(S, J, 4): what the model adds to the interpolation, m, world, and the logarithm of its scale; blended over
        windows, NaN where there are none."""
        config = self.model.config
        frames = config.frames
        length = len(rows.base) // persons
        start = rows.starts % length
        wanted = rows.present[:, None] & (~rows.observed | self.denoise)
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


def load_completer(weights: Path, device: str = "auto", denoise: bool = False) -> Completer:
    """The completer of a folder that `dmae train` wrote.

    Args:
        device: As torch names it; `auto` is a GPU if there is one.
        denoise: Move measured joints too.

    Raises:
        FileNotFoundError: there is no model in the folder.
        ValueError: its files are malformed, damaged, or of another version; or `denoise` is asked of a model
            that was not taught to.
    """
    model, skeleton, record = load_model(weights)
    if denoise and not record["denoises"]:
        raise ValueError(f"{weights}: this model was not trained to denoise; train with shown_weight above 0")
    where = pick_device(device)
    factors = record["calibration"] and tuple(record["calibration"])
    return Completer(model.to(where), skeleton, where, denoise, factors)


def _forget_completed(poses: Poses3D) -> Poses3D:
    invented = poses.source == Source.COMPLETED
    xyz = np.where(invented[..., None], np.nan, poses.xyz)
    return replace(
        poses,
        xyz=xyz,
        source=np.where(invented, Source.ABSENT, poses.source),
        cov=np.where(invented[..., None, None], np.nan, poses.cov),
        views=np.where(invented, 0, poses.views),
    )


def _frames(rows: np.ndarray, persons: int) -> np.ndarray:
    """Rows (S, ...) as (frames, P, ...)."""
    return rows.reshape(persons, -1, *rows.shape[1:]).swapaxes(0, 1)
