"""Occlusion of people: configuration of its target, its measurement, and its summary."""

from dataclasses import dataclass, field

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.labels import Visibility
from synth.errors import FailedSimulation

DETECTED = slice(0, 25)
"""The joints of `synth.people.landmarks.SKELETON` that detectors find: BODY_25."""


@dataclass(frozen=True)
class OcclusionConfig:
    """Target occlusion: a fraction of the joints of BODY_25, over a clip."""

    target: list[float] = field(default_factory=list)
    """Least and greatest fraction of joints that are hidden in at least `views` cameras; empty for any. It determines
    the layout of people and props: `scene.gathering` is only the start of the search, and only the least number of
    `scene.props` is used."""
    views: int = 3
    """Number of cameras in which a joint must be hidden to count."""
    by_self: bool = True
    """Whether joints hidden by their own person's body count, which no layout changes."""
    layouts: int = 12
    """Number of layouts that are tried before the people are drawn again."""

    def __post_init__(self):
        if self.target and not (len(self.target) == 2 and 0 <= self.target[0] < self.target[1] <= 1):
            raise ValueError(
                f"occlusion.target: expected [least, greatest] fraction of joints, 0 <= least < greatest <= 1, "
                f"got {list(self.target)}"
            )
        for name in ("views", "layouts"):
            if getattr(self, name) < 1:
                raise ValueError(f"occlusion.{name}: expected 1 or more, got {getattr(self, name)}")

    def check(self, rig: CameraRig) -> None:
        """Raise ValueError if the target counts more cameras than the rig has."""
        if self.target and self.views > len(rig):
            raise ValueError(
                f"occlusion.views: a joint cannot be hidden in {self.views} cameras, the rig has {len(rig)}; "
                f"expected 1 to {len(rig)}"
            )


def histogram(visibility: np.ndarray, *, by_self: bool = True) -> np.ndarray:
    """Return the fractions of joints that are hidden in 0, 1, ... V cameras.

    Args:
        visibility: (F, V, P, J) `Visibility`. Joints of absent persons do not count. A joint outside the image does not
            count as hidden.
        by_self: Whether joints hidden by their own person's body count as hidden.

    Returns:
        (V + 1,) fractions with a sum of 1; all zero if no person is present.
    """
    first = Visibility.HIDDEN_BY_SELF if by_self else Visibility.HIDDEN_BY_PERSON
    hidden = (visibility >= first) & (visibility <= Visibility.HIDDEN_BY_OBJECT)
    count = hidden.sum(1)[(visibility != Visibility.ABSENT).any(1)]
    return np.bincount(count, minlength=visibility.shape[1] + 1) / max(1, count.size)


def summary(visibility: np.ndarray, config: OcclusionConfig) -> dict:
    """Return the summary of a clip's occlusion for the manifest.

    Args:
        visibility: (F, V, P, J) `Visibility` of the joints of `synth.people.landmarks.SKELETON`.
        config: The target.

    Returns:
        The fraction of all joints with each `Visibility`, by its name; `hidden_in`, the fractions of the joints of
        BODY_25 that are hidden in 0, 1, ... V cameras; and `hidden_in_by_others`, the same without occlusion by a
        person's own body. If the configuration has a `target`: also `target`, `views`, `by_self`, and the achieved
        `share`.
    """
    found = {code.name.lower(): round(float((visibility == code).mean()), 4) for code in Visibility}
    joints = visibility[..., DETECTED]
    found["hidden_in"] = histogram(joints).round(4).tolist()
    found["hidden_in_by_others"] = histogram(joints, by_self=False).round(4).tolist()
    if config.target:
        found |= {
            "target": list(config.target),
            "views": config.views,
            "by_self": config.by_self,
            "share": round(share(visibility, config), 4),
        }
    return found


def share(visibility: np.ndarray, config: OcclusionConfig) -> float:
    """Return the fraction of the joints that count as hidden; (F, V, P, J) as for `summary`."""
    return float(histogram(visibility[..., DETECTED], by_self=config.by_self)[config.views :].sum())


def confirm(visibility: np.ndarray, config: OcclusionConfig) -> None:
    """Check that a clip meets the target; (F, V, P, J) as for `summary`.

    Raises:
        FailedSimulation: it does not meet the target; the message says what would help.
    """
    found = share(visibility, config)
    if config.target and not config.target[0] <= found <= config.target[1]:
        raise unmet([histogram(visibility[..., DETECTED], by_self=config.by_self)], config)


def unmet(found: list[np.ndarray], config: OcclusionConfig) -> FailedSimulation:
    """Return the error for a target that none of these histograms meets."""
    low, high = config.target
    shares = [float(shares[config.views :].sum()) for shares in found]
    least, most = min(shares), max(shares)
    reached = f"{least:.2f}" if most - least < 0.01 else f"{least:.2f} to {most:.2f}"
    others = [views for views in range(1, len(found[0])) if any(low <= h[views:].sum() <= high for h in found)]
    by_others = "" if config.by_self else "by others or objects "
    more = least < low
    remedies = [
        f"a target around {reached}",
        f"occlusion.views={others[-1]}" if others else f"{'fewer' if more else 'more'} occlusion.views",
        "more people (scene.persons), a smaller scene.radius, or a scene with more objects, as scene=warehouse"
        if more
        else "fewer people (scene.persons), an emptier scene, as scene=studio, or occlusion.by_self=false",
    ]
    listed = "; ".join(f"({number}) {remedy}" for number, remedy in enumerate(remedies, 1))
    return FailedSimulation(
        f"occlusion.target={[low, high]} is not met: of the joints, {reached} are hidden {by_others}in at "
        f"least {config.views} of {len(found[0]) - 1} cameras. What would help: {listed}"
    )
