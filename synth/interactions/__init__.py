"""What people do together: they meet, touch, carry things, and work at furniture."""

from synth.interactions.registry import (
    NO_INTERACTION,
    Interaction,
    InteractionConfig,
    find_interaction,
    interaction,
    interaction_choices,
)

__all__ = [
    "NO_INTERACTION",
    "Interaction",
    "InteractionConfig",
    "find_interaction",
    "interaction",
    "interaction_choices",
]
