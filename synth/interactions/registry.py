"""The registry of interactions. Each function with the decorator `interaction` in a module of this package is one.

An interaction takes a `Cast`, and `rng` by keyword, and returns the `Script` (`synth.interactions.script`). The choices
of `interaction=`, their help, and the tests of all interactions come from this registry. Your own interaction,
`interaction.kind=package.module:function`, is a function with the same decorator.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf

from dmae.data.typed import Configuration
from dmae.registry import Entry, Registry
from synth.checks import check_range

NO_INTERACTION = "none"
"""The kind without interaction: each person follows an independent motion."""


@dataclass(frozen=True)
class Interaction(Entry, Configuration):
    """What several people do together."""

    persons: tuple[int, int] = field(kw_only=True)
    """Least and greatest number of people."""

    def __post_init__(self):
        super().__post_init__()
        if not 1 <= self.persons[0] <= self.persons[1]:
            raise ValueError(f"interaction {self.name!r}: expected persons=(least, greatest), found {self.persons}")


interaction = Registry(
    "interaction", Interaction, __package__, option="interaction.kind", plain=False, returns=("Script",)
)
find_interaction = interaction.find


@dataclass(frozen=True)
class InteractionConfig(Configuration):
    """Interaction of people, if any."""

    kind: str = NO_INTERACTION
    """Name of the interaction, or `<module>:<function>` of your own."""
    bystanders: int = 0
    """Number of people who do not take part, each with an independent motion, added to `scene.persons`."""

    def __post_init__(self):
        super().__post_init__()
        interaction.check(self.kind, NO_INTERACTION)
        check_range("interaction", self, 0, inf, "bystanders", unit=" people")
        if self.bystanders and not self.together:
            raise ValueError(
                f"interaction.bystanders={self.bystanders}, but there is no interaction; choose one by "
                "interaction=..., or ask for more people by scene.persons=[least,greatest]"
            )

    def participants(self, asked: Sequence[int] | None, usual: tuple[int, int]) -> tuple[int, int]:
        """Return the least and greatest number of people who take part: those asked for, or the usual ones, within the
        numbers that the interaction takes.

        Raises ValueError if the interaction takes none of the requested numbers; the message lists what it takes.
        """
        least, most = asked or usual
        if not self.together:
            return least, most
        takes = find_interaction(self.kind).persons
        if asked and not (asked[0] <= takes[1] and takes[0] <= asked[1]):
            raise ValueError(
                f"scene.persons={list(asked)}: interaction={self.kind} takes {people(takes)}; give scene.persons="
                f"{list(takes)} or leave it out. interaction.bystanders=N adds people who do not take part"
            )
        return min(max(least, takes[0]), takes[1]), min(max(most, takes[0]), takes[1])

    @property
    def together(self) -> bool:
        """Whether people do something together."""
        return self.kind != NO_INTERACTION


def people(count: tuple[int, int]) -> str:
    """Return a least and greatest number of people in words."""
    least, greatest = count
    return f"{least} {'person' if least == 1 else 'people'}" if least == greatest else f"{least} to {greatest} people"


def interaction_choices() -> dict[str, str]:
    """Return a line of help for each interaction by name, and for none."""
    help = {name: f"{each.help} For {people(each.persons)}." for name, each in interaction.items()}
    return {NO_INTERACTION: "Each person follows an independent motion."} | help
