"""From one stance to another on the same spot, step by step."""

from dataclasses import dataclass

import numpy as np

from synth.motion.act import Stance, step
from synth.motion.gait import smoothstep
from synth.motion.journey import Passage
from synth.motion.legs import ANKLE
from synth.motion.rotations import about

_SHARPEST = np.radians(55)
"""By how much a foot turns in a step on the spot, at most."""


@dataclass(frozen=True)
class TurnTo:
    """A turn on the spot, step by step, the foot on the side to which it leads first.

    Attributes:
        start: The stance before.
        angle: rad, left if positive.
        pace: 1 on average, greater for the quick.
    """

    start: Stance
    angle: float
    pace: float

    @property
    def stop(self) -> Stance:
        """The stance after."""
        return self._turned(1.0)

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return (2 * self._rounds + 0.4) * self._beat

    @property
    def _rounds(self) -> int:
        return max(1, int(np.ceil(abs(self.angle) / _SHARPEST)))

    @property
    def _beat(self) -> float:
        return 0.45 / self.pace

    def _turned(self, share: float) -> Stance:
        x, y, heading = self.start.middle
        return Stance.at(x, y, heading + share * self.angle, self.start.width, self.start.toe_out)

    def passage(self, times: np.ndarray) -> Passage:
        """The lower body at times (F,) since the start, s."""
        rounds, beat = self._rounds, self._beat
        places = np.tile(self.start.feet, (len(times), 1, 1))
        up, aside = np.zeros((2, len(times), 2))
        leading = 0 if self.angle > 0 else 1
        for number in range(rounds):
            before, after = self._turned(number / rounds).feet, self._turned((number + 1) / rounds).feet
            for order, leg in enumerate((leading, 1 - leading)):
                begin = (2 * number + order + 0.2) * beat
                gone, height = step(times, begin, begin + 0.95 * beat, 0.045)
                places[:, leg] += gone[:, None] * (after[leg] - before[leg])
                up[:, leg] += height
                # The other foot bears meanwhile.
                aside[:, 1 - leg] += smoothstep((times - begin + 0.2 * beat) / (0.6 * beat))
                aside[:, 1 - leg] -= smoothstep((times - begin - 0.6 * beat) / (0.6 * beat))
        root = np.tile(self.start.root, (len(times), 1))
        middle = places.mean(1)
        root[:, :2] = middle[:, :2] + 0.3 * (aside[..., None] * (places[..., :2] - middle[:, None, :2])).sum(1)
        heading = middle[:, 2]
        ahead = self.start.middle[2] + self.angle * smoothstep((times - 0.1) / (self.seconds - 0.5))
        return Passage(
            root=root,
            pelvis=about("z", heading + 0.25 * (ahead - heading)),
            ankles=np.concatenate([places[..., :2], up[..., None] + ANKLE], axis=2),
            feet=about("z", places[..., 2]),
            heading=heading + 0.6 * (ahead - heading),
            going=0.5 * smoothstep(times / 0.4) * smoothstep((self.seconds - times) / 0.4),
            swing=0.5 * (aside[:, 0] - aside[:, 1]),
        )
