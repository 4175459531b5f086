"""What the CMU motion capture database says of its takes, but their files do not."""

import re
from pathlib import Path

# From the database's index: these takes, and all of these subjects, were captured at 60 Hz, all others at 120.
_SIXTY_HZ = frozenset({33, 34, 42, 60, 61, 62, 74, 75, 77, 79, 80, 87, 88, 89})
_SIXTY_HZ_TAKES = frozenset({(136, 19)})
_PARTNER_SUBJECTS = {18: 19, 20: 21, 22: 23, 33: 34, 60: 61}
"""Subjects captured together, in the same trials and the same world."""


def true_fps(stem: str, stated: float) -> float:
    """The rate at which a take was captured, of which conversions often state 120 where it was 60.

    It is told by the take's name, `<subject>_<trial>`, where `salsa_` stands for subjects 60 and 61: 120 stated for a
    take of 60 Hz is corrected, anything else believed. Motion itself does not tell. Only who jumps must fall as
    fast as gravity has it, and salsa at twice its rate sinks at no more than 0.6 g.
    """
    take = subject_and_trial(stem)
    return 60.0 if (take[0] in _SIXTY_HZ or take in _SIXTY_HZ_TAKES) and 119 < stated < 121 else stated


def partner(path: Path) -> Path | None:
    """The take of the other person of a two-person take, frame for frame and in the same world, if it lies beside."""
    subject, trial = subject_and_trial(path.stem)
    if path.stem.startswith("salsa_"):
        stems = [f"salsa_{trial + 15:02}" if subject == 60 else f"salsa_{trial:02}"]
    else:
        others = _PARTNER_SUBJECTS | {b: a for a, b in _PARTNER_SUBJECTS.items()}
        stems = [f"{others[subject]:0{digits}}_{trial:02}" for digits in (2, 3) if subject in others]
    there = [path.with_stem(stem) for stem in stems if path.with_stem(stem).is_file()]
    return there[0] if there else None


def subject_and_trial(stem: str) -> tuple[int, int]:
    """Subject and trial that a file's stem names; (0, 0) if it names none."""
    if match := re.fullmatch(r"salsa_(\d+)", stem):
        # 1 to 15 are subject 60, 16 to 30 subject 61.
        return 60 + (int(match[1]) > 15), (int(match[1]) - 1) % 15 + 1
    match = re.match(r"(?:cmu_)?(\d+)_(\d+)", stem)
    return (int(match[1]), int(match[2])) if match else (0, 0)
