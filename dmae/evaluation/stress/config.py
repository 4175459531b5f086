"""Options of the stress matrix."""

from dataclasses import dataclass, field
from enum import StrEnum

from dmae.completion.methods.registry import completion_method
from dmae.evaluation.corruption.registry import corruption
from dmae.formats.reading import DataConfig
from dmae.parallel import Backend
from dmae.parts import numbers_of
from dmae.reconstruction.config import CaptureConfig

PAPER = "paper"
"""Name of the contender that captures with the thresholds of the paper."""


class StressSize(StrEnum):
    """How many levels of each axis, pairs of axes and seeds."""

    small = "small"
    """Two or three levels, one pair, one seed: 45 cells per clip."""
    full = "full"
    """Three or four levels, four pairs, three seeds: about 280 cells per clip."""


@dataclass(frozen=True)
class StressConfig:
    """Corrupt clips step by step, and score every method at each step."""

    data: DataConfig = field(default_factory=DataConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    size: StressSize = StressSize.small
    """How many levels of each axis, pairs of axes and seeds."""
    axes: list[str] = field(default_factory=list, metadata={"choices": corruption})
    """Corruptions, one at a time, or your own module:function; by default all that the clips allow."""
    pairs: list[str] | None = None
    """Pairs of corruptions at the same time, such as [cameras+objects]; by default one pair, or with size=full four."""
    levels: dict[str, list[float]] = field(default_factory=dict)
    """Levels of an axis, as levels.jitter=[1,2,4]; others have those of the size."""
    methods: list[str] = field(
        default_factory=lambda: ["measured", "linear", "linear_body", "kalman", "gaussian_process", "dmae", "paper"],
        metadata={"choices": (*completion_method, "paper")},
    )
    """Completion methods, or module:function of your own; `paper` captures with the thresholds of the paper."""
    weights: str | None = None
    """Folder that `dmae train` wrote, for learned methods; by default the weights that come with the package."""
    paper_weights: str | None = None
    """Folder that `dmae train model=paper` wrote, for the method `paper`; without it that fills linearly."""
    seed: int = 0
    """Seed of the random numbers."""
    workers: int = 1
    """Processes; -1 for one per core. The results are the same."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    first: int = 0
    """Number of the first clip of the data set, counted from 0."""
    clips: int | None = None
    """Number of clips, of all shards together; by default all from `first` on."""
    shard: str | None = None
    """Part of the clips: `shard=3/16` is the third of sixteen, in its own folder; `dmae merge` joins them."""
    dry_run: bool = False
    """Only print how many cells are to be computed, and what time that takes, as a few of them show."""
    out: str = "runs/stress"
    """Folder of `stress.json` and `stress.html`, and of `cache`, from which later runs reuse results."""

    def numbers(self, total: int) -> range:
        """Return the numbers of the clips to stress, out of the `total` clips of the data set."""
        return numbers_of(total, self.first, self.clips, self.shard)

    def __post_init__(self):
        if not self.methods:
            raise ValueError(f"methods=[]: expected some of {', '.join([*completion_method, PAPER])}")
        if self.paper_weights and PAPER not in self.methods:
            raise ValueError(f"paper_weights={self.paper_weights}: expected {PAPER} among the methods")
