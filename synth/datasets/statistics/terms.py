"""The terms of use of a data set, which follow from its inputs: free parts, and parts with separate terms."""

from synth.datasets.statistics.histograms import Statistics
from synth.rooms.catalogue import room_choices

_PROCEDURAL = "procedural"


def terms(found: Statistics) -> str:
    """Return the section on rights for the page of a data set, in Markdown."""
    motion, rooms = _by(found, "motion="), _by(found, "arena=")
    recorded = {kind: count for kind, count in motion.items() if kind != _PROCEDURAL}
    foreign = {room: count for room, count in rooms.items() if room not in room_choices()}
    lines = [
        "People, clothes, textures, rooms and detectors of dmae-synth are made by its code, from published statistics. "
        "The clips that it makes of them belong to you, for commercial use as well."
    ]
    if recorded:
        lines.append(
            f"**Recorded motion** ({_listed(recorded)}): the terms of those takes apply to these clips. "
            "`clip.json` names the take of each person."
        )
    if foreign:
        lines.append(f"**Rooms from files** ({_listed(foreign)}): the terms of those files apply to images of them.")
    if not motion:
        lines.append(
            "**Not simulated by this project**: the clips do not state their origin. Ask the source of the clips."
        )
    return "\n\n".join(lines)


def _by(found: Statistics, prefix: str) -> dict[str, int]:
    return {key.removeprefix(prefix): count for key, count in found.scenes.items() if key.startswith(prefix)}


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name}: {count} {'clip' if count == 1 else 'clips'}" for name, count in sorted(counts.items()))
