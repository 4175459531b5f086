"""The registry of interactions: a function under the decorator `interaction` in a module of this package is one.

It takes a `Cast`, and `rng` by keyword, and returns the `Script` (`synth.interactions.script`). The choices of
`interaction=`, its help, and the tests over all interactions follow. An interaction of your own,
`interaction.kind=package.module:function`, is a function under the same decorator.
"""

from dataclasses import dataclass, field

from dmae.registry import Entry, Registry

NO_INTERACTION = "none"
"""The choice of no interaction: each person follows a motion of their own."""


@dataclass(frozen=True)
class Interaction(Entry):
    """What several people do together.

    Attributes:
        persons: Least and greatest number of people.
    """

    persons: tuple[int, int] = field(kw_only=True)

    def __post_init__(self):
        if not 1 <= self.persons[0] <= self.persons[1]:
            raise ValueError(f"interaction {self.name!r}: expected persons=(least, greatest), got {self.persons}")


interaction = Registry("interaction", Interaction, __package__, option="interaction.kind", plain=False)
find_interaction = interaction.find


@dataclass(frozen=True)
class InteractionConfig:
    """What people do together, if anything.

    Attributes:
        kind: Name of the interaction, or `<module>:<function>` of your own. The scene's number of people is clipped to
            the numbers that the interaction allows.
    """

    kind: str = NO_INTERACTION

    def __post_init__(self):
        interaction.check(self.kind, NO_INTERACTION)

    @property
    def together(self) -> bool:
        """Whether people do something together."""
        return self.kind != NO_INTERACTION


def interaction_choices() -> dict[str, str]:
    """Return the line of help of each interaction, and of none, by name."""
    help = {name: each.help for name, each in interaction.items()}
    return {NO_INTERACTION: "Each person follows a motion of their own."} | help
