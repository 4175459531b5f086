"""Configuration of `dmae evaluate`."""

from dataclasses import dataclass, field
from enum import StrEnum

from dmae.completion.methods.registry import completion_method
from dmae.evaluation.synthetic_gaps import GapConfig
from dmae.formats.reading import DataConfig
from dmae.parallel import Backend
from dmae.parts import numbers_of
from dmae.reconstruction.config import CaptureConfig


class Input(StrEnum):
    """The poses that methods complete."""

    captured_poses = "captured_poses"
    """Captured from the detections, with the gaps that the cameras left."""
    true_poses = "true_poses"
    """True poses with synthetic gaps."""
    perturbed_poses = "perturbed_poses"
    """True poses with synthetic gaps and errors like those of capture."""


class ReferencePoses(StrEnum):
    """The poses that results are compared with."""

    truth = "truth"
    """The true poses of the clip."""
    capture = "capture"
    """Joints that all cameras together measured in three views or more: real gaps, and no annotation needed."""


@dataclass(frozen=True)
class EvaluateConfig:
    """Score methods of completion over clips and subsets of cameras."""

    data: DataConfig = field(default_factory=DataConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    methods: list[str] = field(
        default_factory=lambda: [name for name, method in completion_method.items() if not method.learned],
        metadata={"choices": completion_method},
    )
    """How joints that no camera measured are filled: completion methods, or module:function of your own."""
    poses: str | None = None
    """Poses made elsewhere, which are scored in place of `methods`: a file, or a folder with one for each clip."""
    weights: str | None = None
    """Folder that `dmae train` wrote, for learned methods; by default the weights that come with the package."""
    views: list[int] = field(default_factory=list)
    """Numbers of cameras: all subsets of each size are scored; by default all cameras only."""
    input: Input = Input.captured_poses
    """Poses that methods complete: captured, or true ones with synthetic gaps, exact or perturbed."""
    gaps: GapConfig = field(default_factory=GapConfig)
    """Synthetic gaps, unless the input is captured poses."""
    seed: int = 0
    """Seed of synthetic gaps and perturbation."""
    reference: ReferencePoses = ReferencePoses.truth
    """Poses that results are compared with: the truth, or what all cameras together measured."""
    skeleton: str | None = None
    """Skeleton that poses are compared on; by default that of the truth."""
    smooth: float = 0.1
    """s; smoothing after every method except `measured` and online ones, which smooth themselves. Noisy poses are
    smoothed in full, exact poses not at all. With it, `methods=[dmae_denoise]` scores what `dmae complete` makes."""
    baseline: str | None = None
    """`scores.json` of an earlier run, or its folder: exit status 2 if a figure is worse by more than its interval."""
    changed: list[str] = field(default_factory=list)
    """Options that differ from those of the baseline on purpose; figures are compared all the same."""
    first: int = 0
    """Number of the first clip of the data set, counted from 0."""
    clips: int | None = None
    """Number of clips, of all shards together; by default all from `first` on."""
    shard: str | None = None
    """Part of the clips: `shard=3/16` is the third of sixteen, in its own folder; `dmae merge` joins them."""
    workers: int = 1
    """Processes, each with a clip at a time; -1 for one per core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    dry_run: bool = False
    """Only print the number of clips and frames to score, and the time that this takes, measured on parts of some
    clips."""
    out: str = "runs/evaluate"
    """Folder for `scores.json`."""

    def __post_init__(self):
        if self.workers == 0:
            raise ValueError("workers: expected a number of processes, or -1 for one per core; got 0")

    def numbers(self, total: int) -> range:
        """Return the numbers of the clips to score, out of the `total` clips of the data set."""
        return numbers_of(total, self.first, self.clips, self.shard)
