"""Options of what scores: `dmae evaluate`, `stress`, `benchmark` and `table`. Imports nothing heavy."""

from dataclasses import dataclass, field
from enum import StrEnum

from dmae.completion.methods import completion_method
from dmae.data.typed import Configuration
from dmae.evaluation.corruption.registry import corruption
from dmae.formats.config import DataConfig
from dmae.metrics.registry import protocol
from dmae.parallel import ProcessesConfig
from dmae.reconstruction.config import CaptureConfig, capture_method

SCORED = ("measured", "linear", "gaussian_process", "dmae_denoise")
"""Methods that `dmae evaluate` scores by default."""
STRESSED = ("measured", "linear", "linear_body", "kalman", "gaussian_process", "dmae", "paper")
"""Methods that `dmae stress` scores by default."""
PAPER = "paper"
"""Name of the contender that captures with the thresholds of the paper."""
INSTEAD = {
    PAPER: f"{PAPER} is of dmae stress, which captures for it alone: methods=[dmae] weights={PAPER} capture={PAPER} "
    "scores it here"
}
"""What to write instead of methods of other commands."""


class Input(StrEnum):
    """The poses that methods complete."""

    captured_poses = "captured_poses"
    """Captured from the detections, with the gaps that the cameras left."""
    true_poses = "true_poses"
    """True poses with synthetic gaps."""
    perturbed_poses = "perturbed_poses"
    """True poses with synthetic gaps and errors as capture makes them."""


class ReferencePoses(StrEnum):
    """The poses that results are compared with."""

    truth = "truth"
    """The true poses of the clip."""
    capture = "capture"
    """Joints that all cameras together measured in three views or more: real gaps, and no annotation needed."""


@dataclass(frozen=True, kw_only=True)
class PartConfig(ProcessesConfig):
    """Options of what takes a part of a data set."""

    first: int = 0
    """Number of the first clip of the data set, counted from 0."""
    clips: int | None = None
    """Number of clips; by default all from `first` on."""


@dataclass(frozen=True)
class EvaluateConfig(PartConfig):
    """Score methods of completion over clips and subsets of cameras."""

    data: DataConfig = field(default_factory=DataConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    methods: list[str] | None = field(default=None, metadata={"choices": completion_method, "instead": INSTEAD})
    """How joints on which fewer than two cameras agree are filled: completion methods, module:function of your own, or
    folders that `dmae train` wrote; by default measured, linear, gaussian_process and, if weights know the body,
    dmae_denoise."""
    poses: str | None = field(default=None, metadata={"reads": "poses"})
    """Poses made elsewhere, which are scored in place of `methods`: a file, or a folder with one for each clip."""
    weights: str | None = field(default=None, metadata={"reads": "model", "words": ("paper",)})
    """Folder that `dmae train` wrote, for learned methods; by default the weights that come with the package."""
    views: list[int] = field(default_factory=list)
    """Numbers of cameras: all subsets of each size are scored; by default all cameras only."""
    input: Input = Input.captured_poses
    """Poses that methods complete: captured, or true ones with synthetic gaps, exact or perturbed."""
    seed: int = 0
    """Seed of synthetic gaps and perturbation."""
    reference: ReferencePoses = ReferencePoses.truth
    """Poses that results are compared with: the truth, or what all cameras together measured."""
    skeleton: str | None = field(default=None, metadata={"reads": "skeleton"})
    """Skeleton on which poses are compared; by default that of the truth, or its second one if it has two."""
    smooth: float = 0.1
    """s; smoothing after every method except `measured` and online ones, which smooth themselves. Noisy poses are
    smoothed in full, exact poses not at all. With it, `methods=[dmae_denoise]` scores what `dmae complete` makes."""
    angles: bool = False
    """Also score joint angles of hips, knees and ankles, degrees, against angles of true joints. It takes about a
    second for 150 frames of a person and method."""
    baseline: str | None = field(default=None, metadata={"reads": "path"})
    """`scores.json` of an earlier run, or its folder: exit status 2 if a figure is worse by more than its interval."""
    changed: list[str] = field(default_factory=list)
    """Options that differ from the baseline on purpose; figures are compared all the same."""
    dry_run: bool = False
    """Only print the number of clips and frames to score, and the time that this takes, measured on parts of some
    clips."""
    out: str = "runs/evaluate"
    """Folder for `scores.json`."""

    def __post_init__(self):
        super().__post_init__()
        synthetic, captured = self.input != Input.captured_poses, self.reference == ReferencePoses.capture
        if self.skeleton and (synthetic or captured):
            raise ValueError(
                f"skeleton={self.skeleton}: with input={Input.true_poses}, input={Input.perturbed_poses} or "
                "reference=capture poses are compared on the skeleton of the detections; leave it out"
            )
        if (synthetic or self.poses) and (self.views or captured):
            given = f"poses={self.poses}" if self.poses else f"input={self.input}"
            raise ValueError(
                f"{given}: nothing is captured, and poses are compared with the truth, whatever cameras they are of; "
                "leave out views, reference"
            )


OURS = "capture"
"""Name of the capture that comes with the package, without completion, in a benchmark."""


class StressSize(StrEnum):
    """How many levels of each axis, pairs of axes and seeds."""

    small = "small"
    """Two or three levels, one pair, one seed: 45 cells per clip."""
    full = "full"
    """Three or four levels, four pairs, three seeds: about 280 cells per clip."""


@dataclass(frozen=True)
class StressConfig(PartConfig):
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
    """Levels of an axis, as levels.jitter=[1,2,4]; others have the levels of `size`."""
    methods: list[str] | None = field(default=None, metadata={"choices": (*completion_method, "paper")})
    """Completion methods, `paper`, or module:function of your own; by default measured, linear, linear_body, kalman,
    gaussian_process and, if weights know the body, dmae and paper. `paper` captures with the paper's thresholds."""
    captures: list[str] = field(default_factory=list, metadata={"choices": capture_method})
    """Captures that are compared as they measure, with nothing filled: published systems, or module:function of a clip,
    or of a clip and its CaptureConfig."""
    weights: str | None = field(default=None, metadata={"reads": "model", "words": ("paper",)})
    """Folder that `dmae train` wrote, for learned methods; by default the weights that come with the package."""
    paper_weights: str | None = field(default=None, metadata={"reads": "model"})
    """Folder that `dmae train model=paper` wrote, for the method `paper`; by default the weights of the paper's network
    that come with the package."""
    angles: bool = False
    """Also score joint angles of hips, knees and ankles, degrees. It takes about a second for 150 frames of a person, a
    method and a cell."""
    seed: int = 0
    """Seed of the random numbers."""
    dry_run: bool = False
    """Only print how many cells are to be computed, and a forecast of the time, measured on a few of them."""
    out: str = "runs/stress"
    """Folder of `stress.json`, `stress.html`, and `cache.jsonl`, from which later runs reuse results."""

    def __post_init__(self):
        super().__post_init__()
        if self.methods == [] and not self.captures:
            raise ValueError(f"methods=[]: expected some of {', '.join([*completion_method, PAPER])}, or captures")
        for name in self.captures:
            capture_method.check(name)
        if self.paper_weights and self.methods is not None and PAPER not in self.methods:
            raise ValueError(f"paper_weights={self.paper_weights}: expected {PAPER} among the methods")
        for pair in self.pairs or ():
            for name in pair.split("+"):
                corruption.check(name)


class BenchmarkSize(StrEnum):
    """Number of clips of each set."""

    small = "small"
    full = "full"


@dataclass(frozen=True)
class BenchmarkConfig(ProcessesConfig):
    """Score completion and capture on a benchmark of occlusion, which is generated, not downloaded.

    Clips are simulated from a definition and its seed, and their checksums are compared with the published ones.
    Methods fill the gaps of the same captured poses; captures make poses from the detections. A method or a capture is
    a name, package.module:function, or a folder of poses with a file LEVEL/SET/CLIP.npz for each clip.
    """

    name: str = "occlusion-v2"
    """The benchmark: one of the package, or your own YAML file."""
    size: BenchmarkSize = BenchmarkSize.small
    """Number of clips: small takes minutes; published tables use full."""
    methods: list[str] = field(default_factory=lambda: ["linear", "pchip_body", "gaussian_process", "dmae"])
    """Methods that fill gaps: completion methods, module:function of poses and their frame rate, or folders of
    poses."""
    captures: list[str] = field(default_factory=lambda: [OURS])
    """Methods that make poses from detections: `capture` (this package), published systems as `mvpose`,
    module:function of a clip, or folders of poses."""
    weights: str | None = field(default=None, metadata={"reads": "model", "words": ("paper",)})
    """Folder that `dmae train` wrote, for learned methods; by default the weights that come with the package."""
    angles: bool = False
    """Also score joint angles of hips, knees and ankles, degrees, of completed poses. It takes about a second for 150
    frames of a person and method."""
    against: str | None = field(default=None, metadata={"reads": "path"})
    """Earlier scores, a `scores.json` or its folder, to compare with: paired differences with intervals."""
    data_folder: str | None = None
    """Folder of the clips, which runs can share; by default `data` in `out`."""
    out: str = "runs/benchmark"
    """Folder for `scores.json`, `benchmark.html` and the clips."""


NUMBERS = {
    1: "PCP of each actor",
    2: "PCP by number of cameras",
    3: "people who interact, and transfer",
    4: "fusion limb by limb",
    5: "the codes of joint and time",
    6: "error and recall by number of cameras",
}
"""The tables of the paper; 6 is our own."""


class TableSize(StrEnum):
    """Amount of computation for a table."""

    full = "full"
    """All methods and full trainings: on two cores minutes for tables 1 and 2, a quarter of an hour for 3 and 4, about
    an hour for 5."""
    small = "small"
    """Fewer methods and short trainings: all five tables in minutes."""


@dataclass(frozen=True)
class TableConfig(Configuration):
    """Reproduce a table of the paper: published rows and rows measured here, with intervals.

    Tables 1 and 2 (PCP of each actor; by number of cameras) and 4 (pose fusion, limb by limb) score one recording with
    truth on Shelf's joints. Table 3 (people who interact, and transfer), 5 (the codes) and 6 (mm and recall with two,
    three, ... cameras, which is not in the paper) take a generated data set.
    Writes `table_N.json` and `table_N.md`.
    """

    number: int = 1
    """Number of the table, 1 to 5 of the paper, or 6."""
    data: DataConfig = field(default_factory=DataConfig)
    extra_data: list[str] = field(default_factory=list, metadata={"reads": "path"})
    """Folders of further data sets. Tables 1, 2 and 4 learn fusion from simulated clips, best captured with few and
    many cameras before; without them, rows of fusion are not measured. Table 3 takes more clips, table 5 clips to learn
    from."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    protocol: str = field(default="strict", metadata={"choices": protocol})
    """How limbs are counted in the rows measured here; the others are for comparison with rows published under them."""
    size: TableSize = TableSize.full
    """Amount of computation: all methods and full trainings, or a table in a few minutes."""
    systems: list[str] | None = field(default=None, metadata={"choices": capture_method})
    """Published systems, or module:function of a clip, that capture the same detections in rows of their own in tables
    1 to 3; by default all published ones, or with size=small none."""
    angles: bool = False
    """Also score joint angles of hips and knees, degrees, in the tables with errors in mm: 3, 4 and 6. It takes
    about a second for 150 frames of a person and method."""
    weights: str | None = field(default=None, metadata={"reads": "model", "words": ("paper",)})
    """Folder that `dmae train` wrote, for `dmae`; by default the weights that come with the package."""
    seed: int = 0
    """Seed of trainings and masks."""
    out: str = "runs/table"
    """Folder for the table."""

    def __post_init__(self):
        super().__post_init__()
        if self.number not in NUMBERS:
            tables = "; ".join(f"{number}, {title}" for number, title in NUMBERS.items())
            raise ValueError(f"number={self.number}: the tables are {tables}")
        protocol.find(self.protocol)
        for name in self.systems or ():
            capture_method.check(name)
        if self.angles and self.number not in (3, 4, 6):
            raise ValueError(f"angles=true: table {self.number} has no errors of joints; tables 3, 4 and 6 have them")
        if self.number == 6 and self.protocol != "strict":
            raise ValueError("table 6 counts joints, not limbs; leave out protocol")
        if self.number == 5 and (self.protocol != "strict" or self.weights):
            raise ValueError(
                "table 5 counts joints, not limbs, and trains its own networks; leave out protocol and weights"
            )


TITLE = "Multi-view motion: measured and completed"
