"""Fit a motion to a body: its size, and the floor under it."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d, percentile_filter

from synth.motion.feet import FEET, SOLE, sole_points
from synth.motion.motion import Motion
from synth.people.body import Body, segment_origins
from synth.people.capsules import capsules

_FLIGHT = 1.0
"""Window that is longer than the flight of a jump, so that it always contains floor contact, s."""
_TREAD = np.array((SOLE[0], (0.070, 0, SOLE[0, 2])))
"""(2, 3) heel and ball of a foot in its own frame, fractions of stature."""


def fit_to_body(motion: Motion, body: Body) -> Motion:
    """Scale a motion to a body and put the body on the floor.

    The step length scales with the leg length. The floor height follows the lower foot, or any other body part that is
    lower. It is smoothed over one second, so that the feet leave the floor in a jump but not in a stance. Feet count
    from heel to ball; toes bend and may be lower.
    """
    root = motion.root * (body.hip_height / motion.hip_height)
    segments, ends, radii = capsules(body)
    others = ~np.isin(segments, FEET)
    segments, ends, radii = segments[others], ends[others], radii[others]
    origins = segment_origins(body, root, motion.rotations)[:, segments, 2]
    heights = np.einsum("fcj,cej->fce", motion.rotations[:, segments, 2], ends)
    lowest = ((origins[..., None] + heights).min(2) - radii).min(1)
    feet = sole_points(body, root, motion.rotations, _TREAD)[..., 2].min((1, 2))
    window = max(1, round(_FLIGHT * motion.fps))
    floor = np.minimum(
        percentile_filter(feet, 25, window, mode="nearest"), minimum_filter1d(lowest, window, mode="nearest")
    )
    floor = gaussian_filter1d(floor, 0.15 * motion.fps, mode="nearest")
    root[:, 2] -= floor
    return replace(motion, root=root, hip_height=body.hip_height)
