"""Physical labels of simulated clips: body states, contacts, support forces, points on body surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from synth.datasets.physical_labels import add_labels
from synth.labels.physical_labels import KINDS, PhysicalLabels, load_physical_labels
from synth.physics.body_state import BodyState, load_state


def label(data: str | Path, labels: Sequence[str] = KINDS, *, workers: int = 1) -> int:
    """Add labels from physics to existing clips, in place. Nothing is simulated again.

    Args:
        data: Data set that `generate` made, or one clip of it.
        labels: `contacts` (the touching parts, their places and forces), `forces` (ground reaction of each foot,
            residual at the pelvis), `surface` (256 named points on each person, and their visibility in each camera).
            Existing labels of a clip are kept.
        workers: Processes; -1 for one per core.

    Returns:
        The number of clips that lacked any of these labels.

    Raises:
        FileNotFoundError: there is no clip, or it contains no body state.
        ValueError: a label is unknown, a clip is damaged, or its frames are too far apart.

    Examples:
        >>> for clip in synth.generate("scene.seconds=1", "scene.persons=[1,1]", clips=1, out="walks"): pass
        >>> synth.label("walks", ["forces"])
        1
        >>> forces = synth.physical_labels("walks/000000").forces
        >>> forces.ground_reaction.shape
        (25, 1, 2, 3)
        >>> synth.verify("walks")
        []
    """
    return add_labels(Path(data), labels, workers=workers)


def physical_labels(clip: str | Path) -> PhysicalLabels:
    """Read the labels that `label` added to a clip: `contacts`, `forces`, `surface`. Missing ones are None.

    Args:
        clip: Folder of the clip.

    Raises:
        FileNotFoundError: the clip has no such labels.
        ValueError: the file is malformed.

    Examples:
        >>> for clip in synth.generate("scene.seconds=0.2", "scene.persons=[1,1]", clips=1, out="walks"): pass
        >>> synth.label("walks", ["surface"])
        1
        >>> points = synth.physical_labels("walks/000000").surface
        >>> points.names[0], points.xyz.shape
        ('pelvis.1.front', (5, 1, 256, 3))
    """
    return load_physical_labels(Path(clip))


def body_state(clip: str | Path) -> BodyState:
    """Read the state of the bodies of a simulated clip: pose, shape, forces, contacts, actions.

    Args:
        clip: Folder of the clip.

    Raises:
        FileNotFoundError: the clip has no body state, because it was not simulated or comes from an older version.
        ValueError: the file is malformed.

    Examples:
        >>> for clip in synth.generate("scene.seconds=0.2", "scene.persons=[1,1]", clips=1, out="walks"): pass
        >>> state = synth.body_state("walks/000000")
        >>> state.rotations.shape, len(state.action_names) > 0
        ((5, 1, 16, 4), True)
    """
    return load_state(Path(clip))
