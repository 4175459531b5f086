"""Errors of the position of detected joints: noise that is correlated in time, and constant offsets."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaincinv, ndtr

from dmae.data.skeleton import BODY25
from dmae.numerics.statistics import ar1_noise, multiscale_noise
from synth.detector.ranges import check_amounts, check_probabilities
from synth.detector.view import ErrorStream, View, height

_MIRROR = list(BODY25.mirror)
_NECK, _MID_HIP = BODY25.index("neck", "mid_hip")
_SCALES = 3.0
"""Half of an error decorrelates slower than the given time by this factor, the other half faster by this factor."""
_MAX_WIDTH = 12.0
"""Greatest ratio of the width of the Gaussian under Student's t to its scale."""


@dataclass(frozen=True)
class Noise:
    """Errors of the positions of detected joints. `parts.<kind>.noise`, `.tail` and `.offset` say how large they
    are."""

    view_offset: float = 0.0
    """Fraction of a person's height in the image: standard deviation of an offset of a joint in a view that is the same
    for all people."""
    bias: float = 0.0
    """Fraction of the error's energy that is constant for a person, view and joint; long tails dilute it."""
    minimum: float = 0.0
    """px; added in quadrature to the scale of errors, for people of any size."""
    blur: float = 0.0
    """Fraction of a joint's motion in the image from frame to frame, added in quadrature to the scale of errors."""
    truncation: float = 0.0
    """Growth of errors with the fraction of a person's joints that is outside the image: by a factor of
    1 + `truncation` * fraction."""
    hidden: float = 1.0
    """Factor of the error at hidden joints that are detected, relative to visible ones."""

    def __post_init__(self):
        check_amounts("noise", self, ("view_offset", "minimum", "blur", "truncation", "hidden"))
        check_probabilities("noise", self, ("bias",))

    def apply(self, view: View) -> View:
        """Add offsets and noise to each joint.

        The noise has Student's t distribution: a Gaussian process with a constant part, scaled by a variance that is a
        random process as well (from quantiles of the chi-square distribution).
        """
        joints, tail = view.visibility.shape, view.parts["tail"]
        hidden_tail = view.of_hidden("tail")
        tail = np.where(view.hidden & (hidden_tail > 0), hidden_tail, tail)
        rng = view.random(ErrorStream.NOISE)
        times = [view.times.correlation * _SCALES, view.times.correlation / _SCALES]
        gaussian = np.sqrt(1 - self.bias) * multiscale_noise((*joints, 2), view.fps, times, rng=rng)
        spread = ar1_noise(joints, view.fps, view.times.bursts[0], rng=rng)
        if self.bias:
            gaussian += np.sqrt(self.bias) * view.random(ErrorStream.BIAS).standard_normal((*joints[1:], 2))
        precision = gammaincinv(tail / 2, ndtr(spread)) * 2 / tail
        t = gaussian * np.minimum(1 / np.sqrt(np.maximum(precision, 1e-9)), _MAX_WIDTH)[..., None]
        rank = 1 - (1 + (t**2).sum(-1) / tail) ** (-tail / 2)
        offset = np.take_along_axis(self._offset(view), view.owner[..., None].astype(int), 1)
        return replace(view, xy=view.xy + offset + t * self._scale(view)[..., None], error_rank=rank)

    def _scale(self, view: View) -> np.ndarray:
        """Return (F, P, 25) scales of the noise, px, by kind of joint, size, motion, truncation and visibility."""
        xy = view.true_xy
        size = height(xy)[..., None]
        scale = view.parts["noise"] * size
        own = view.of_hidden("noise")
        scale = np.where(view.hidden & (own > 0), own * size, scale)
        factor = np.where(view.hidden & (own == 0), self.hidden, 1)
        if self.minimum:
            scale = np.hypot(scale, self.minimum)
        if self.blur and len(xy) > 1:
            scale = np.hypot(scale, self.blur * np.nan_to_num(np.linalg.norm(np.gradient(xy, axis=0), axis=-1)))
        if self.truncation:
            with np.errstate(invalid="ignore"):
                outside = ~((xy >= -0.5) & (xy <= view.size - 0.5)).all(-1)
            scale = scale * (1 + self.truncation * outside.mean(-1, keepdims=True))
        return scale * factor

    def _offset(self, view: View) -> np.ndarray:
        """Return (F, P, 25, 2) offsets from the annotated position of joints to the detector's position, px."""
        xy, offset = view.true_xy, view.parts["offset"]
        found = np.zeros(xy.shape)
        if offset.any():
            trunk = np.nan_to_num(xy[:, :, _MID_HIP] - xy[:, :, _NECK])[:, :, None]
            found = offset[:, :1] * np.nan_to_num(xy - xy[:, :, _MIRROR]) + offset[:, 1:] * trunk
        if self.view_offset:
            constant = self.view_offset * view.random(ErrorStream.OFFSET).standard_normal((len(BODY25), 2))
            found = found + constant * height(xy)[..., None, None]
        return found
