"""Configuration of the paper's tables."""

from dataclasses import dataclass, field
from enum import StrEnum

from dmae.completion.paper.config import PaperSize
from dmae.formats.reading import DataConfig
from dmae.metrics.protocols import protocol
from dmae.reconstruction.config import CaptureConfig

NUMBERS = {
    1: "PCP of each actor",
    2: "PCP by number of cameras",
    3: "people who interact, and transfer",
    4: "fusion limb by limb",
    5: "the codes of joint and time",
}
"""The tables of the paper."""


class TableSize(StrEnum):
    """Amount of computation for a table."""

    full = "full"
    """All methods and full trainings: on two cores minutes for tables 1 and 2, a quarter of an hour for 3 and 4, about
    an hour for 5."""
    small = "small"
    """Fewer methods and short trainings: all five tables in minutes."""


@dataclass(frozen=True)
class TableConfig:
    """Reproduce a table of the paper: published rows and rows measured here, with intervals.

    Tables 1 and 2 (PCP of each actor; by number of cameras) and 4 (pose fusion, limb by limb) score one recording with
    truth on Shelf's joints. Table 3 (people who interact, and transfer) and 5 (the codes) take a generated data set.
    Writes `table_N.json` and `table_N.md`.
    """

    number: int = 1
    """Number of the table in the paper, 1 to 5."""
    data: DataConfig = field(default_factory=DataConfig)
    extra_data: list[str] = field(default_factory=list)
    """Folders of further data sets: for tables 1, 2 and 4, simulated clips to train the paper's network and fusion
    (without them, their rows are not measured); for tables 3 and 5, more clips."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    protocol: str = field(default="strict", metadata={"choices": protocol})
    """How limbs are counted in the rows measured here; the others are for comparison with rows published under them."""
    size: TableSize = TableSize.full
    """Amount of computation: all methods and full trainings, or a table in a minute or two."""
    paper: PaperSize = PaperSize.small
    """Size of the paper's own network in tables 1 and 2: small enough for a CPU, or full."""
    weights: str | None = None
    """Folder that `dmae train` wrote, for `dmae`; by default the weights that come with the package."""
    seed: int = 0
    """Seed of trainings and masks."""
    out: str = "runs/table"
    """Folder for the table."""

    def __post_init__(self):
        if self.number not in NUMBERS:
            tables = "; ".join(f"{number}, {title}" for number, title in NUMBERS.items())
            raise ValueError(f"number={self.number}: the paper's tables are {tables}")
        protocol.find(self.protocol)
        if self.number == 5 and (self.protocol != "strict" or self.weights):
            raise ValueError(
                "table 5 counts joints, not limbs, and trains its own networks; leave out protocol and weights"
            )
