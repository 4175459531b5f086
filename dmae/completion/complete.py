"""From captured poses to completed ones: evidence, interpolation, the network's corrections, covariances, smoothing.

Long recordings are completed in pieces. `load_completer` and `completers` find the weights.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from dmae.completion import fusion
from dmae.completion.config import SMOOTHING
from dmae.completion.features import correction_weight, near_measurement, noisiness, smooth_by_noise
from dmae.completion.fillings import contradicted
from dmae.completion.methods import Fill, completion_method
from dmae.completion.network import DMAE
from dmae.completion.pieces import WHOLE, check_given, in_pieces
from dmae.completion.pose_prior import ANKLES, floor_height, likely_pose, lower_ankles, stand_on_floor
from dmae.completion.weights import SHIPPED, find_shipped, load_model, weights_folder
from dmae.completion.windows import Rows, make_rows
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton
from dmae.data.typed import check_arguments
from dmae.files.contents import cached_until_changed
from dmae.files.mapped import in_steps
from dmae.metrics.position import GAPS
from dmae.numerics.body import rotate_z
from dmae.numerics.filling import are_stills, keep_rejected, present, resample
from dmae.numerics.paths import gap_lengths
from dmae.parallel import one_thread

if TYPE_CHECKING:
    from dmae.completion.paper import PaperCompleter

# Prediction: a network's corrections of a whole recording, blended over overlapping windows.

_BATCH = 4  # Windows that the network is given together
_SAME_RATE = 0.01  # Rates within this share of each other are taken as equal


def has_rate(model: DMAE, fps: float) -> bool:
    """Return whether poses at a rate need no resampling for a model."""
    return abs(model.config.fps / fps - 1) < _SAME_RATE


def stride(model: DMAE) -> int:
    """Return the frames from one window to the next."""
    return max(1, model.config.frames // 3)


def predict(
    model: DMAE, poses: Poses3D, fps: float, frames: slice, wanted: np.ndarray, target: Skeleton | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Predict joints in some frames of a recording, by all of its frames.

    Args:
        wanted: (F, P, J) of those frames, True for the joints to be predicted while their person is present; of the
            target if there is one.
        target: Skeleton that the model turns poses into, if any; its joints follow the joints of the poses.

    Returns:
        (F, P, J, 3) m, world, meaningful where wanted; and the scale of the error, (F, P, J) m, NaN where the model was
        not used.
    """
    config = model.config
    rest = model.rest.cpu().numpy()
    count, persons = poses.xyz.shape[:2]
    needed = np.zeros((count, persons, len(rest)), bool)
    needed[frames, :, -wanted.shape[2] :] = wanted
    rows = make_rows(poses, fps, rest, config.frames, target=target)
    base = _by_frame(rows.base, persons)[:count]
    if has_rate(model, fps):
        correction = _by_frame(_corrections(model, rows, needed), persons)[:count]
    else:
        rows = make_rows(resample(poses, fps, config.fps), config.fps, rest, config.frames, target=target)
        time, last = np.arange(count) * (config.fps / fps), len(rows.base) // persons - 1
        first = np.minimum(time.astype(int), last)
        second = np.minimum(first + 1, last)
        around = np.zeros((last + 1, *needed.shape[1:]), bool)
        for index in (first, second):
            np.logical_or.at(around, index, needed)
        resampled = _by_frame(_corrections(model, rows, around), persons)
        before, after = resampled[first], resampled[second]
        # At the ends of a person's presence one of them is known.
        before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
        weight = (time - first).clip(0, 1)[:, None, None, None]
        correction = before * (1 - weight) + after * weight
    # The target's joints lie elsewhere than what they are derived from, however short a gap is.
    weight = 1 if target else correction_weight(poses, fps)
    return (base + np.nan_to_num(correction[..., :3]) * weight)[frames], np.exp(correction[..., 3])[frames]


def _corrections(model: DMAE, rows: Rows, needed: np.ndarray) -> np.ndarray:
    """Return what the model adds to the interpolation, m, world, and the logarithm of its error scale, (S, J, 4).

    Windows overlap by two thirds, weighted by a triangle. NaN outside windows, and where not `needed` (F, P, J).
    """
    config = model.config
    frames, device = config.frames, next(model.parameters()).device
    count, persons = needed.shape[:2]
    length = len(rows.base) // persons
    start = rows.starts % length
    needed = np.concatenate([needed, np.zeros((length - count, *needed.shape[1:]), bool)])
    needed = needed.swapaxes(0, 1).reshape(rows.observed.shape) & rows.present[:, None]
    useful = np.any(needed, 1)[rows.starts[:, None] + np.arange(frames)].any(1)
    starts = rows.starts[useful & ((start % stride(model) == 0) | (start == length - frames))]
    triangle = np.minimum(np.arange(1, frames + 1), np.arange(frames, 0, -1)).astype(float)

    total, weights = np.zeros((*rows.observed.shape, 4)), np.zeros(rows.observed.shape)
    for begin in range(0, len(starts), _BATCH):
        batch = starts[begin : begin + _BATCH]
        windows, _, heading = rows.cut(batch, frames, config.align_heading)
        wanted = needed[batch[:, None] + np.arange(frames)]
        with torch.inference_mode():
            inputs = (tensor.to(device) for tensor in windows)
            xyz, log_scale = (part.cpu() for part in model(*inputs, wanted=torch.from_numpy(wanted).to(device)))
        added = rotate_z((xyz - windows.base).numpy().astype(np.float64), heading[:, None, None])
        added = np.concatenate([added, log_scale.numpy()[..., None]], -1)
        weight = triangle[:, None] * wanted
        for t in range(frames):
            total[batch + t] += weight[:, t, :, None] * added[:, t]
            weights[batch + t] += weight[:, t]
    return total / np.where(weights > 0, weights, np.nan)[..., None]


def _by_frame(rows: np.ndarray, persons: int) -> np.ndarray:
    return rows.reshape(persons, -1, *rows.shape[1:]).swapaxes(0, 1)


# Uncertainty: predicted scales of errors, calibrated to the errors found on held-back clips.

Factors = tuple[tuple[float, ...], tuple[float, ...]]
"""Of exact poses and of noisy ones, each for the classes of gaps."""
CLASSES = len(GAPS) + 1
"""Number of gap classes: one for each range of lengths in the scores, and one for joints never measured."""


def calibrated(scale: np.ndarray, lengths: np.ndarray, noisy: np.ndarray, factors: Factors) -> np.ndarray:
    """Return standard deviations along each axis, m, of joints with predicted scales `scale` (...), m.

    Args:
        lengths: (...) of the gaps that the joints are in, frames at the model's rate; infinite where they are never
            measured.
        noisy: (...) see `dmae.completion.features.noisiness`.
        factors: By which scales are multiplied.
    """
    of_exact, of_noisy = np.log(factors)[:, gap_classes(lengths)]
    return np.exp(of_exact + noisy * (of_noisy - of_exact)) * scale


def gap_classes(lengths: np.ndarray) -> np.ndarray:
    """Return the index in `GAPS` of gaps of those lengths; one more where they are infinite."""
    return np.searchsorted([*(high for _, high in GAPS if high), np.finfo(float).max], np.rint(lengths))


# The completer: a trained model applied to poses, with sources and covariances.

_ACCELERATION = 40.0
"""m/s^2; with a lower limit, rejection dropped more true joints of people who jump and dance than errors."""
_LARGEST_DEVIATION = 0.06
"""m along each axis. Measured joints that state more were 89 mm wrong on simulated captures, the median 71; completed
in their place 37 mm, the median 30 (787 joints of 14 clips by 2 to 4 cameras)."""
_LONGEST_WITHOUT = 0.6
"""s; longest gap that dropping these joints may leave. Without this limit, arms that one of two cameras saw badly for
seconds went from 110 to 244 mm (Pose2Sim's cameras 1 and 3), and from 51 to 65 mm (899 joints of 5 simulated clips)."""
_AGREEING_VIEWS = 3
"""Three in four joints on which this many views agree and that the frames around contradict were right. Denoised, they
came no nearer to annotations."""


@dataclass(frozen=True)
class Completer:
    """A trained model, ready to fill in joints on which fewer than two cameras agree.

    A callable of poses (F, P, J) and their frames per second that returns poses of the same shape:

    - Every joint that is absent while its person is present (`dmae.numerics.filling.present`: measured, or unmeasured
      for at most a second between two measurements) is predicted and marked `COMPLETED`, with an isotropic covariance
      whose 90 % regions held 90 % of the truth of held-back clips. Nothing is filled before a person's first and after
      its last measurement, nor in a longer absence.
    - Covariances are unknown (NaN) farther than 0.2 s from any measurement of the person, and for a joint that was
      never measured, if none of its children was (or, without children, its parent), as of a leg behind a table, or if
      the person was measured for less time than a window lasts.
    - Windows overlap by two thirds; their corrections of the interpolation are blended with weights that fall linearly
      from the middle of a window. A window without a measurement adds nothing.
    - Measured joints are returned unchanged, to the bit. With `denoise` joints of fewer than three views (or unknown)
      are moved to where the model predicts them and marked `DENOISED`, less where poses are more exact
      (`dmae.completion.features.correction_weight`); their covariances are then upper bounds. With `reject` some
      measured joints are dropped first: joints of few views that the frames around contradict
      (`dmae.completion.fillings`), and joints that state a greater error than completed ones in short gaps, if the gap
      stays short without them. They are completed like others; they keep their number of views (`Poses3D.rejected`).
    - Joints that are already `COMPLETED` are completed again, unseen by the model; joints that are not finite are
      absent.
    - Poses at another rate than the model's are resampled, and the corrections are resampled back. At less than one
      frame a second (`dmae.numerics.filling.STILLS`) each frame is completed by itself: by how poses vary in the
      training data (`dmae.completion.pose_prior`), or with weights of two skeletons by the network.
    - Legs that no camera ever detected are bent so that their feet are on the floor: where measured feet are in the
      recording, anybody's, or z = 0 if there are few.
    - Poses of another skeleton are completed through the joints that it has in common with the model's
      (`dmae.data.conversion.convert`); other joints stay as they are. `notes` says where either happens.
    - Weights of two skeletons side by side (`dmae.completion.fusion`) take poses of the first, or of one that has all
      its joints. They return poses of the second, and mark no joint of these as `MEASURED`.

    With `smooth`, all joints are smoothed over these seconds at the end. With `frames`, only those are completed and
    returned, using all frames. Recordings of more than 4000 frames are completed in pieces (`in_pieces`). The network
    runs on one thread of the CPU, as more take longer on a busy machine.

    Raises (when called):
        ValueError: the skeletons have no joint in common, fps is not positive and finite, or poses are not in m.
    """

    model: DMAE
    skeleton: Skeleton
    denoise: bool = False
    factors: Factors | None = None
    """See `calibrated`; without them completed joints have no covariance."""
    reject: bool = False
    """Improves real recordings; does not improve people who jump and dance."""
    smooth: float = 0.0
    """s; light smoothing of the completed poses, see `dmae.completion.features.smooth_by_noise`."""

    @check_arguments
    def __call__(self, poses: Poses3D, fps: float, frames: slice = slice(None)) -> Poses3D:
        check_given(poses, fps)
        floor = self._floor(poses, fps)
        done = in_pieces(partial(self._whole, floor=floor), poses, fps, frames)
        return keep_rejected(done, poses.select(frames)) if done.skeleton == poses.skeleton else done

    def _whole(self, poses: Poses3D, fps: float, frames: slice, floor: float) -> Poses3D:
        with one_thread():
            if not self.smooth:
                return self._complete(poses, fps, frames, floor)
            # Neighbours of the requested frames take part in smoothing.
            asked, reach = range(len(poses.xyz))[frames], ceil(3 * self.smooth * fps)
            first = max(asked.start - reach, 0)
            done = self._complete(poses, fps, slice(first, asked.stop + reach), floor)
            noisy = noisiness(poses.without(poses.source == Source.COMPLETED), fps)[first : asked.stop + reach]
            done = smooth_by_noise(done, noisy, fps, self.smooth)
            return done.select(slice(asked.start - first, asked.stop - first))

    def _floor(self, poses: Poses3D, fps: float) -> float:
        """Return the height of the floor, m, that everybody's measured ankles show."""
        if not set(ANKLES.joints) & set(poses.skeleton.parts[0].joints):
            return 0.0
        parts = []
        for start in in_steps(range(0, max(len(poses.xyz), 1), WHOLE)):
            ankles = convert(poses.select(slice(start, start + WHOLE)), ANKLES)
            parts.append(lower_ankles(self._evidence(ankles.without(np.isinf(ankles.xyz).any(-1)), fps)))
        return floor_height(np.concatenate(parts))

    def _complete(self, poses: Poses3D, fps: float, frames: slice, floor: float) -> Poses3D:
        """Return some frames of the poses, completed and not yet smoothed."""
        poses = poses.without(np.isinf(poses.xyz).any(-1))
        if poses.skeleton != self.skeleton.parts[0]:
            if not self.target:
                return self._by_common_joints(poses, fps, frames, floor)
            poses = self._as_source(poses)
        poses = self._evidence(poses, fps)
        if self.target:
            return self._fuse(poses, fps, frames, self.target)
        absent = ((poses.source == Source.ABSENT) & present(poses, fps)[..., None])[frames]
        moved = _of_few_views(poses)[frames] & self.denoise
        if not (absent | moved).any():
            return poses.select(frames)
        given = poses.select(frames)
        if len(poses.xyz) == 1 and self.model.config.residual:
            likely = likely_pose(poses, *(part.cpu().numpy() for part in (self.model.rest, self.model.pose_covariance)))
            xyz = self._on_floor(np.where(absent[..., None], likely, given.xyz), poses, floor)
            return replace(given, xyz=xyz, source=np.where(absent, Source.COMPLETED, given.source))
        predicted, scale = predict(self.model, poses, fps, frames, absent | moved)
        xyz = self._on_floor(np.where((absent | moved)[..., None], predicted, given.xyz), poses, floor)
        source = np.where(absent, Source.COMPLETED, np.where(moved, Source.DENOISED, given.source))
        deviation = self._deviation(poses, fps, scale, frames)
        return _with_covariances(replace(given, xyz=xyz, source=source), absent, deviation)

    @property
    def target(self) -> Skeleton | None:
        """The skeleton that poses are turned into; None where they stay on their own."""
        return self.skeleton.parts[1] if len(self.skeleton.parts) > 1 else None

    @property
    def stride(self) -> float:
        """s from one window to the next: a recording may be cut at multiples of it without a change in what follows."""
        return stride(self.model) / self.model.config.fps

    def notes(self, poses: Poses3D, fps: float) -> list[str]:
        """Return what users of the result should know about how poses like these are completed."""
        notes = []
        if are_stills(fps):
            notes.append(f"{fps:g} frames/s: stills, each completed by itself, with unknown errors")
        elif not has_rate(self.model, fps):
            made = f"made at {self.model.config.fps:g}/s and resampled"
            notes.append(f"joints keep their {fps:g} frames/s; corrections of the network are {made}")
        if self.target:
            notes.append(f"poses are {poses.skeleton.name}, returned as {self.target.name}")
        elif poses.skeleton != self.skeleton:
            others = [joint for joint in poses.skeleton.joints if joint not in self.skeleton.joints]
            left = f"; not completed: {', '.join(others)}" if others else ""
            notes.append(f"poses are {poses.skeleton.name}, completed with weights for {self.skeleton.name}{left}")
        return notes

    def uncertainty_inputs(self, poses: Poses3D, fps: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what predicted scales are calibrated by, see `calibrated`.

        Lengths (F, P, J) of gaps, in frames of the model: of the gap that a returned joint is in, or the joints from
        which it is derived. And the noisiness (F, P, 1) of the poses.
        """
        measured = (fusion.derive(poses, self.target) if self.target else poses).measured
        lengths = np.where(measured.any(0), gap_lengths(measured), np.inf)
        return lengths * (self.model.config.fps / fps), noisiness(poses, fps)

    def _as_source(self, poses: Poses3D) -> Poses3D:
        """Return poses that have all the joints of the first of two skeletons, on that skeleton."""
        (wanted, target), found = self.skeleton.parts, poses.skeleton
        if not set(wanted.joints) <= set(found.joints):
            raise ValueError(
                f"the weights turn {wanted.name!r} into {target.name!r}, the poses are {found.name!r}; convert "
                "them (dmae.data.conversion.convert), or train on their skeleton"
            )
        return convert(poses, wanted)

    def _fuse(self, poses: Poses3D, fps: float, frames: slice, target: Skeleton) -> Poses3D:
        there, count = present(poses, fps)[frames], len(target)
        if not there.any():
            return fusion.absent(target, *there.shape)
        wanted = np.repeat(there[..., None], count, -1)
        predicted = predict(self.model, poses, fps, frames, wanted, target)
        xyz, scale = (part[:, :, -count:] for part in predicted)
        done = fusion.fused(poses.select(frames), target, xyz, there)
        return _with_covariances(done, there[..., None], self._deviation(poses, fps, scale, frames))

    def _evidence(self, poses: Poses3D, fps: float) -> Poses3D:
        poses = poses.without(poses.source == Source.COMPLETED)
        if not self.reject or are_stills(fps):
            return poses
        contradict = _of_few_views(poses) & contradicted(poses.xyz, fps, _ACCELERATION)
        without = poses.without(poses.measured & (contradict | uncertain(poses)))
        # Across a long gap, or with no measurement of the joint left, completed joints are farther off.
        lengths = np.where(without.measured.any(0), gap_lengths(without.measured), np.inf)
        return poses.without(poses.measured & (contradict | (uncertain(poses) & (lengths <= _LONGEST_WITHOUT * fps))))

    def _by_common_joints(self, poses: Poses3D, fps: float, frames: slice, floor: float) -> Poses3D:
        """Complete poses of another skeleton through the joints that it has in common with the model's."""
        try:
            converted = convert(poses, self.skeleton)
            common = np.isin(poses.skeleton.joints, self.skeleton.joints)
            done = convert(self._complete(converted, fps, frames, floor), poses.skeleton)
        except KeyError as error:
            raise ValueError(
                f"the weights are for skeleton {self.skeleton.name!r}, the poses are {poses.skeleton.name!r}, and "
                f"{error.args[0]}; convert the poses (dmae.data.conversion.convert), or "
                f"train on their skeleton"
            ) from None
        poses = poses.select(frames)
        taken = common | ((done.source != Source.ABSENT) & ~poses.measured)
        return poses.taking(taken, done)

    def _on_floor(self, xyz: np.ndarray, poses: Poses3D, floor: float) -> np.ndarray:
        """Return completed joints (F, P, J, 3) with legs that no camera ever detected on the floor."""
        if not self.model.config.residual:
            return xyz
        never = ~(poses.measured | np.isfinite(poses.rays).all((-1, -2))).any(0)
        covariance = self.model.pose_covariance.cpu().numpy()
        for person in np.flatnonzero(never.any(1)):
            xyz[:, person] = stand_on_floor(xyz[:, person], never[person], floor, self.skeleton, covariance)
        return xyz

    def _deviation(self, poses: Poses3D, fps: float, scale: np.ndarray, frames: slice) -> np.ndarray | None:
        """Return standard deviations along each axis, m, of joints predicted in those frames; NaN where unknown, None
        if all are."""
        if self.factors is None:
            return None
        lengths, noisy = (part[frames] for part in self.uncertainty_inputs(poses, fps))
        config, there = self.model.config, poses.measured.any(-1)
        # Regions that should hold 90 % held 20 to 80 % of the joints never measured in glimpses of people, and 4 to
        # 68 % of those whose limb was measured nowhere farther out.
        never = np.isinf(lengths)
        glimpsed = there.sum(0) < config.frames * fps / config.fps
        unsure = never & (glimpsed[:, None] | _outer_unknown(never, self.target or self.skeleton))
        known = np.where(near_measurement(poses, fps)[frames] & ~unsure, 1, np.nan)
        return known * calibrated(scale, lengths, noisy, self.factors)


def _outer_unknown(unknown: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return (..., J) True where all of a joint's children are unknown, or the parent of a joint without children."""
    outer = np.empty_like(unknown)
    for joint, parent in enumerate(skeleton.parents):
        children = [child for child, inner in enumerate(skeleton.parents) if inner == joint]
        outer[..., joint] = unknown[..., children or [parent]].all(-1)
    return outer


def _with_covariances(done: Poses3D, predicted: np.ndarray, deviation: np.ndarray | None) -> Poses3D:
    if deviation is None:
        return done
    variance = deviation[..., None, None] ** 2 * np.eye(3)
    return replace(done, cov=np.where(predicted[..., None, None], variance, done.cov))


def uncertain(poses: Poses3D) -> np.ndarray:
    """Return (F, P, J) True where a joint states a greater error than completed joints have."""
    return np.trace(poses.cov, axis1=-2, axis2=-1) > 3 * _LARGEST_DEVIATION**2


def _of_few_views(poses: Poses3D) -> np.ndarray:
    """Return (F, P, J) True where a joint was measured by fewer than three views, or by an unknown number."""
    return poses.measured & (poses.views < _AGREEING_VIEWS)


def keep_smoothed(completed: Poses3D, given: Poses3D) -> Poses3D:
    """Return completed poses that keep the joints which were smoothed before: nothing is smoothed twice.

    If any joint was smoothed, so were those completed before.
    """
    smoothed = given.source == Source.DENOISED
    if completed.skeleton != given.skeleton or not smoothed.any():
        return completed
    return completed.taking(smoothed | (given.source == Source.COMPLETED), given)


# From weights to completed poses: load a completer, or find the shipped weights for a skeleton.


def load_completer(
    weights: Path, denoise: bool | None = False, reject: bool = False, smooth: float = 0.0, all_joints: bool = False
) -> "Completer | PaperCompleter":
    """Return the completer of a folder that `dmae train` wrote, or of the shipped weights `paper`, on a GPU if there is
    one.

    The paper's network has no use for `denoise` and `reject`.

    Args:
        denoise: Move measured joints of few views too; None where the model was trained for it.
        reject: Drop measured joints of few views that the frames around contradict, and joints with large stated
            errors.
        smooth: s; length of a light smoothing at the end.
        all_joints: Keep joints that the paper's network does not know; otherwise its result has only its own joints.

    Raises:
        FileNotFoundError: there is no model in the folder.
        ValueError: its files are malformed, damaged, or of another version; or `denoise` is asked of a model that was
            not trained to denoise, or that turns poses to another skeleton; or `smooth` is not 0 or more.
    """
    if not 0 <= smooth < np.inf:
        raise ValueError(f"smooth={smooth:g}: expected seconds, 0 (no smoothing) or more")
    model, skeleton, record = load_model(weights_folder(weights))
    model = model.to("cuda" if torch.cuda.is_available() else "cpu")
    if not model.config.residual:
        # It cuts windows as its training does, with modules that the default network does not need.
        from dmae.completion.paper import PaperCompleter

        if denoise:
            raise ValueError(f"{weights}: the paper's network keeps measured joints; leave out denoise")
        return PaperCompleter(model, skeleton, record["fuses"], smooth, all_joints)
    if denoise is None:
        denoise = record["denoises"] and len(skeleton.parts) == 1
    if denoise and len(skeleton.parts) > 1:
        raise ValueError(
            f"{weights}: this model turns {skeleton.parts[0].name!r} into {skeleton.parts[1].name!r}, and moves all "
            "joints; leave out denoise"
        )
    if denoise and not record["denoises"]:
        raise ValueError(
            f"{weights}: this model was not trained to denoise; train with learning.observed_weight above 0"
        )
    factors = record["calibration"] and tuple(map(tuple, record["calibration"]))
    return Completer(model, skeleton, denoise, factors, reject, smooth)


@cached_until_changed(16, lambda weights: weights_folder(weights) / "model.json" if weights else SHIPPED)
def completers(
    weights: str | Path | None,
    *,
    denoise: bool | None = None,
    reject: bool = True,
    smooth: float = SMOOTHING,
    all_joints: bool = True,
) -> Callable[[Skeleton], Any]:
    """Return a function from the skeleton of poses to their completer, by default as `dmae complete` completes.

    Without a folder of weights, each skeleton has the weights that come with the package
    (`dmae.completion.weights.find_shipped`). Options and errors are as in `load_completer`. The last sixteen are kept,
    until weights change.
    """
    options: dict[str, Any] = {"denoise": denoise, "reject": reject, "smooth": smooth, "all_joints": all_joints}
    if not weights:
        return cache(lambda skeleton: load_completer(find_shipped(skeleton), **options))
    completer = load_completer(Path(weights), **options)
    return lambda skeleton: completer


# The completion methods that use the network.


@completion_method("dmae", learned=True)
def dmae(weights: Path | None) -> Fill:
    """The trained network; measured joints stay as they are."""
    return _fill(weights, denoise=False, reject=False)


@completion_method("dmae_reject", learned=True)
def dmae_reject(weights: Path | None) -> Fill:
    """As dmae, after dropping joints of two views that are contradicted."""
    return _fill(weights, denoise=False)


@completion_method("dmae_denoise", learned=True)
def dmae_denoise(weights: Path | None) -> Fill:
    """As `dmae complete` runs: dmae_reject, and moves joints of two views if trained for it."""
    return _fill(weights)


def _fill(weights: Path | None, **options: bool) -> Fill:
    # Scores smooth every method alike, after it, and count only joints that a network returns.
    completer_for = completers(weights, smooth=0.0, all_joints=False, **options)
    return lambda poses, fps: completer_for(poses.skeleton)(poses, fps)
