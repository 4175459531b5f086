"""Physical labels with arbitrary numbers, generated quickly."""

import numpy as np

from synth.labels.forces import BodyForces, ContactSource, PeopleContacts
from synth.labels.physical_labels import PhysicalLabels
from synth.labels.surfaces import NAMES, SurfaceLabels


def made_labels(frames: int, views: int, persons: int) -> PhysicalLabels:
    """Labels of people who stand on the right foot; in each frame the first touches the floor."""
    rng = np.random.default_rng(0)
    names = ("floor", *(f"person{p}/{part}" for p in range(persons) for part in ("l_foot", "r_foot")))
    contacts = PeopleContacts(
        np.arange(frames), [(0, 2)] * frames, names, rng.random((frames, 3)), [(1, 2, 700.0)] * frames,
        np.zeros(frames), np.full(frames, ContactSource.SOLVED),
    )  # fmt: skip
    pairs = rng.random((4, frames, persons, 2, 3)).astype(np.float32)
    pairs[1, :, :, 0] = np.nan
    forces = BodyForces(
        np.full(persons, 700, np.float32), rng.random((frames, persons, 3)).astype(np.float32), *pairs,
        np.zeros((frames, persons, 2), np.float32),
    )  # fmt: skip
    xyz = rng.random((frames, persons, len(NAMES), 3)).astype(np.float32)
    codes = rng.integers(0, 4, (frames, views, persons, len(NAMES))).astype(np.uint8)
    touches = np.where(rng.random(xyz.shape[:3]) < 0.1, 256, 0).astype(np.uint16)
    surface = SurfaceLabels(NAMES, xyz, xyz, codes, np.where(codes == 0, -1, 0).astype(np.int16), touches)
    return PhysicalLabels(contacts, forces, surface)
