"""`synth label`: add contacts, forces and surface points to existing clips, from their body states."""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.data.store import clip_folders
from dmae.parallel import Backend, running_on
from synth.datasets.physical_labels import add_labels
from synth.labels.physical_labels import FILE, KINDS

WRITES = None
EXAMPLES = (
    "synth label data=runs/data",
    "synth label data=runs/data labels=[contacts,forces] workers=2",
)


@dataclass(frozen=True)
class LabelCommand:
    """Add labels from physics to existing clips, in place. Nothing is simulated again.

    Contacts: the parts and objects that touch, the place, and the force. Forces: the ground reaction of each foot, and
    the residual at the pelvis, by inverse dynamics. Surface: 256 named points on each person, and which camera sees
    them.
    """

    data: str = "???"
    """Data set that `synth generate` made, or one clip of it."""
    labels: list[str] = field(default_factory=lambda: list(KINDS), metadata={"choices": KINDS})
    """Labels to add. Existing labels of a clip are kept."""
    workers: int = 1
    """Processes; -1 for one per core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""


def run(config: LabelCommand, out: None) -> None:
    with running_on(config.backend):
        made = add_labels(Path(config.data), config.labels, workers=config.workers)
    print(f"{config.data}: {made} of {len(clip_folders(Path(config.data)))} clips have got {FILE}")


def interrupted(config: LabelCommand, out: None) -> str:
    return "clips are complete, each with its labels or without; the same command labels the others"
