"""The completer: a trained model applied to poses, with sources and covariances."""

from dataclasses import dataclass, fields, replace
from math import ceil

import numpy as np

from dmae.completion import fusion
from dmae.completion.blending import near_measurement, noisiness, smooth_by_noise
from dmae.completion.gaussian_process.steps import Steps, finished
from dmae.completion.network.paper import DMAE
from dmae.completion.pieces import in_pieces
from dmae.completion.prediction import has_rate, one_thread, predict, stride
from dmae.completion.rejection import contradicted
from dmae.completion.uncertainty import Factors, calibrated
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton
from dmae.numerics.filling import present
from dmae.numerics.paths import gap_lengths

_ACCELERATION = 40.0
"""m/s^2; with a lower limit, rejection dropped more true joints of people who jump and dance than errors."""
_AGREEING_VIEWS = 3
"""Three in four joints on which this many views agree and that the frames around contradict were right. Denoised, they
came no nearer to annotations."""
_EVIDENCE_COST = 5.0
"""Of rejection, see `dmae.completion.gaussian_process.steps.Steps`."""


@dataclass(frozen=True)
class Completer:
    """A trained model, ready to fill in joints that no camera measured.

    A callable of poses (F, P, J) and their frames per second that returns poses of the same shape:

    - Every joint that is absent while its person is present (`dmae.numerics.filling.present`: measured, or missing for
      at most a second between two measurements) is predicted and marked `COMPLETED`. It used no views; its covariance
      is isotropic and calibrated: 90 % regions held 90 % of the truth of clips held back from training. Nothing is
      filled before a person's first and after its last measurement, nor in a longer absence.
    - Farther than 0.2 s from any measurement of the person covariances are unknown (NaN).
    - Windows overlap by two thirds; their corrections of the interpolation are blended with weights that fall linearly
      from the middle of a window. A window without a measurement adds nothing: in the middle of an absence the
      interpolation over the whole recording stands, however long a gap is.
    - Measured joints are returned unchanged, to the bit. With `denoise` those of fewer than three views (or unknown)
      are moved to where the model predicts them and marked `DENOISED`, the less the more exact the poses are
      (`dmae.completion.blending.correction_weight`); their covariances are then upper bounds. With
      `reject` such joints that the frames around contradict (`dmae.completion.rejection`) are dropped first, and
      completed like others.
    - Joints that are already `COMPLETED` are no evidence: the model does not see them, and they are completed again.
      Neither are joints that are not finite, which become absent.
    - Poses at another rate than the model's are resampled, and the corrections are resampled back.
    - Poses of another skeleton are completed through the joints that it has in common with the model's
      (`dmae.data.conversion.convert`); other joints stay as they are. `notes` says where either happens.
    - Weights of two skeletons side by side (`dmae.completion.fusion`) take poses of the first, or of one that has
      all its joints, and return poses of the second, see `dmae.completion.fusion.fused`; none of their joints is
      `MEASURED`.

    With `smooth`, all joints are smoothed over these seconds at the end: noise that measurements of two views have is
    greater than what smoothing takes from fast motion. With `frames`, only those are completed and returned, using all
    frames. Recordings of more than 4000 frames are completed in pieces (`dmae.completion.pieces`). The network runs on
    one thread of the CPU: it is so small that more threads take longer on a busy machine.

    Raises (when called):
        ValueError: the skeletons have no joint in common, or fps is not positive and finite.
    """

    model: DMAE
    skeleton: Skeleton
    denoise: bool = False
    factors: Factors | None = None
    """See `dmae.completion.uncertainty.calibrated`; without them completed joints have no covariance."""
    reject: bool = False
    """Improves real recordings; does not improve people who jump and dance."""
    smooth: float = 0.0
    """s; light smoothing of the completed poses, see `dmae.completion.blending.smooth_by_noise`."""

    def __call__(self, poses: Poses3D, fps: float, frames: slice = slice(None)) -> Poses3D:
        if not (np.isfinite(fps) and fps > 0):
            raise ValueError(f"fps must be positive, found {fps}")
        return in_pieces(lambda poses, frames: self._whole(poses, fps, frames), poses, fps, frames)

    def _whole(self, poses: Poses3D, fps: float, frames: slice) -> Poses3D:
        """Return some frames of poses that are completed in one piece."""
        with one_thread():
            if not self.smooth:
                return finished(self._complete(poses, fps, frames))
            # Neighbours of the requested frames take part in smoothing.
            asked, reach = range(len(poses.xyz))[frames], ceil(3 * self.smooth * fps)
            first = max(asked.start - reach, 0)
            done = finished(self._complete(poses, fps, slice(first, asked.stop + reach)))
            noisy = noisiness(poses.without(poses.source == Source.COMPLETED))[first : asked.stop + reach]
            done = smooth_by_noise(done, noisy, fps, self.smooth)
            return done.select(slice(asked.start - first, asked.stop - first))

    def in_steps(self, poses: Poses3D, fps: float, frames: slice, small_steps: bool) -> Steps[Poses3D]:
        """Complete some frames of the poses, without smoothing, in steps that can be spread over time.

        Args:
            small_steps: Whether steps are short, rather than fast altogether.
        """
        return self._complete(poses, fps, frames, small_steps)

    def _complete(self, poses: Poses3D, fps: float, frames: slice, small_steps: bool = False) -> Steps[Poses3D]:
        """Return some frames of the poses, completed and not yet smoothed, step by step."""
        poses = poses.without(np.isinf(poses.xyz).any(-1))
        if poses.skeleton != self.skeleton.parts[0]:
            if not self.target:
                return (yield from self._by_common_joints(poses, fps, frames, small_steps))
            poses = self._as_source(poses)
        poses = self._evidence(poses, fps)
        yield _EVIDENCE_COST
        if self.target:
            return (yield from self._fuse(poses, fps, frames, small_steps))
        absent = ((poses.source == Source.ABSENT) & present(poses, fps)[..., None])[frames]
        moved = _of_few_views(poses)[frames] & self.denoise
        if not (absent | moved).any():
            return poses.select(frames)
        predicted, scale = yield from predict(self.model, poses, fps, frames, absent | moved, None, small_steps)
        given = poses.select(frames)
        xyz = np.where((absent | moved)[..., None], predicted, given.xyz)
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
        if not has_rate(self.model, fps):
            notes.append(f"{fps:g} frames/s, resampled to the {self.model.config.fps:g} of the weights and back")
        if self.target:
            notes.append(f"poses are {poses.skeleton.name}, returned as {self.target.name}")
        elif poses.skeleton != self.skeleton:
            others = [joint for joint in poses.skeleton.joints if joint not in self.skeleton.joints]
            left = f"; not completed: {', '.join(others)}" if others else ""
            notes.append(f"poses are {poses.skeleton.name}, completed with weights for {self.skeleton.name}{left}")
        return notes

    def uncertainty_inputs(self, poses: Poses3D, fps: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what predicted scales are calibrated by, see `dmae.completion.uncertainty.calibrated`.

        They are the lengths (F, P, J) of the gaps that each returned joint is in, or the joints that it is derived
        from, in frames of the model; and the noisiness (F, P, 1) of the poses.
        """
        measured = (fusion.derive(poses, self.target) if self.target else poses).measured
        lengths = np.where(measured.any(0), gap_lengths(measured), np.inf)
        return lengths * (self.model.config.fps / fps), noisiness(poses)

    def _as_source(self, poses: Poses3D) -> Poses3D:
        """Return poses that have all the joints of the first of two skeletons, on that skeleton."""
        wanted, found = self.skeleton.parts[0], poses.skeleton
        if not set(wanted.joints) <= set(found.joints):
            raise ValueError(
                f"the weights turn {wanted.name!r} into {self.target.name!r}, the poses are {found.name!r}; convert "
                "them (dmae.data.conversion.convert), or train on their skeleton"
            )
        return convert(poses, wanted)

    def _fuse(self, poses: Poses3D, fps: float, frames: slice, small_steps: bool) -> Steps[Poses3D]:
        """Return the poses of the source turned into those of the target."""
        there, count = present(poses, fps)[frames], len(self.target)
        if not there.any():
            return fusion.absent(self.target, *there.shape)
        wanted = np.repeat(there[..., None], count, -1)
        predicted = yield from predict(self.model, poses, fps, frames, wanted, self.target, small_steps)
        xyz, scale = (part[:, :, -count:] for part in predicted)
        done = fusion.fused(poses.select(frames), self.target, xyz, there)
        return _with_covariances(done, there[..., None], self._deviation(poses, fps, scale, frames))

    def _evidence(self, poses: Poses3D, fps: float) -> Poses3D:
        """Return the poses without joints that are no evidence."""
        poses = poses.without(poses.source == Source.COMPLETED)
        if not self.reject:
            return poses
        return poses.without(_of_few_views(poses) & contradicted(poses.xyz, fps, _ACCELERATION))

    def _by_common_joints(self, poses: Poses3D, fps: float, frames: slice, small_steps: bool) -> Steps[Poses3D]:
        """Complete poses of another skeleton through the joints that it has in common with the model's."""
        try:
            converted = convert(poses, self.skeleton)
            common = np.isin(poses.skeleton.joints, self.skeleton.joints)
            done = convert((yield from self._complete(converted, fps, frames, small_steps)), poses.skeleton)
        except KeyError as error:
            raise ValueError(
                f"the weights are for skeleton {self.skeleton.name!r}, the poses are {poses.skeleton.name!r}, and "
                f"{error.args[0]}; convert the poses (dmae.data.conversion.convert), or "
                f"train on their skeleton"
            ) from None
        poses = poses.select(frames)
        taken = common | ((done.source != Source.ABSENT) & ~poses.measured)
        joints = {}
        for name in (field.name for field in fields(Poses3D) if field.name != "skeleton"):
            new, old = getattr(done, name), getattr(poses, name)
            joints[name] = np.where(taken.reshape(*taken.shape, *(1,) * (new.ndim - 3)), new, old)
        return Poses3D(poses.skeleton, **joints)

    def _deviation(self, poses: Poses3D, fps: float, scale: np.ndarray, frames: slice) -> np.ndarray | None:
        """Return standard deviations along each axis, m, of joints predicted in those frames with those scales.

        NaN where unknown; None where all are.
        """
        if self.factors is None:
            return None
        lengths, noisy = (part[frames] for part in self.uncertainty_inputs(poses, fps))
        known = np.where(near_measurement(poses, fps), 1, np.nan)[frames]
        return known * calibrated(scale, lengths, noisy, self.factors)


def _with_covariances(done: Poses3D, predicted: np.ndarray, deviation: np.ndarray | None) -> Poses3D:
    """Return the poses with the covariances of the joints that were predicted."""
    if deviation is None:
        return done
    variance = deviation[..., None, None] ** 2 * np.eye(3)
    return replace(done, cov=np.where(predicted[..., None, None], variance, done.cov))


def _of_few_views(poses: Poses3D) -> np.ndarray:
    """Return (F, P, J) True where a joint was measured by fewer than three views, or by an unknown number."""
    return poses.measured & (poses.views < _AGREEING_VIEWS)
