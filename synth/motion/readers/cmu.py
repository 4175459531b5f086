"""Facts about takes of the CMU motion capture database that their files do not state."""

import re
from pathlib import Path

from synth.motion.readers import take_name

# From the database's index: all takes of these subjects, and these single takes, were captured at 60 Hz, others at 120.
_SIXTY_HZ = frozenset({33, 34, 42, 60, 61, 62, 74, 75, 77, 79, 80, 87, 88, 89})
_SIXTY_HZ_TAKES = frozenset({(136, 19)})
_PARTNER_SUBJECTS = {18: 19, 20: 21, 22: 23, 33: 34, 60: 61}
"""Pairs of subjects that were captured together, in the same trials and the same world."""


def true_fps(stem: str, stated: float) -> float:
    """Return the rate at which a take was captured, frames/s. Conversions often state 120 for takes at 60.

    The name of the take identifies it, `<subject>_<trial>`; `salsa_` stands for subjects 60 and 61. A stated rate of
    120 is corrected if the take was captured at 60 Hz. Any other rate is returned as stated. The motion itself does not
    show its rate, except in a jump, in which the body must fall with gravity.
    """
    take = subject_and_trial(stem)
    return 60.0 if (take[0] in _SIXTY_HZ or take in _SIXTY_HZ_TAKES) and 119 < stated < 121 else stated


def partner(path: Path) -> Path | None:
    """Return the take of the other person in a two-person take, in the same frames and world, if it is in the same
    folder."""
    name = take_name(path)
    subject, trial = subject_and_trial(name)
    if name.startswith("salsa_"):
        stems = [f"salsa_{trial + 15:02}" if subject == 60 else f"salsa_{trial:02}"]
    else:
        others = _PARTNER_SUBJECTS | {b: a for a, b in _PARTNER_SUBJECTS.items()}
        stems = [f"{others[subject]:0{digits}}_{trial:02}" for digits in (2, 3) if subject in others]
    places = [path.with_name(stem + path.name[len(name) :]) for stem in stems]
    there = [place for place in places if place.is_file()]
    return there[0] if there else None


def subject(path: Path) -> str:
    """Return the subject of a take from its name: partners count as one, as `60+61`; without a number, the name."""
    number = subject_and_trial(take_name(path))[0]
    for one, other in _PARTNER_SUBJECTS.items():
        if number in (one, other):
            return f"{one}+{other}"
    return str(number) if number else take_name(path)


def subject_and_trial(stem: str) -> tuple[int, int]:
    """Return subject and trial from a file's stem; (0, 0) if it has none."""
    if match := re.fullmatch(r"salsa_(\d+)", stem):
        # 1 to 15 are subject 60, 16 to 30 subject 61.
        return 60 + (int(match[1]) > 15), (int(match[1]) - 1) % 15 + 1
    match = re.match(r"(?:cmu_)?(\d+)_(\d+)", stem)
    return (int(match[1]), int(match[2])) if match else (0, 0)
