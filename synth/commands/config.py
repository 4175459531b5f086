"""The options of the commands of `synth` whose rooms declare none of their own."""

from dataclasses import dataclass, field
from enum import Enum
from math import inf

from dmae.data.typed import REQUIRED, Configuration
from dmae.detection.registry import PoseDetectorConfig
from dmae.parallel import ProcessesConfig
from synth.checks import check_range
from synth.datasets.config import MIN_SECONDS, AboutConfig, ImageFormat, SplitBy
from synth.datasets.exporters import exporter
from synth.detector.config import DetectorConfig, ErrorReference, Limits
from synth.interactions.registry import InteractionConfig
from synth.motion.config import MotionConfig, ReadingConfig
from synth.scene.config import SceneConfig

LABELS = ("contacts", "forces", "surface")
"""Labels that are added to clips."""


@dataclass(frozen=True)
class LabelCommand(ProcessesConfig):
    """Add labels from physics to existing clips, in place. Nothing is simulated again.

    Contacts: the parts and objects that touch, the place, and the force. Forces: the ground reaction of each foot, and
    the residual at the pelvis, by inverse dynamics. Surface: 512 named points on each person, which camera sees
    them, and what they touch.
    """

    data: str = field(default=REQUIRED, metadata={"reads": "clips"})
    """Data set that `synth generate` made, or one clip of it."""
    labels: list[str] = field(default_factory=lambda: list(LABELS), metadata={"choices": LABELS})
    """Labels to add. Existing labels of a clip are kept."""


@dataclass(frozen=True)
class VerifyCommand(Configuration):
    """Check that clips are complete and correct. Exits with status 1 if they are not."""

    data: str = field(default=REQUIRED, metadata={"reads": "path"})
    """Folder of a data set, or of a clip."""
    fast: bool = False
    """Compare only sizes of files, and the contents of JSON files, with their checksums."""
    out: str | None = None
    """JSON file of the findings; by default `verify.json` in the checked folder."""


@dataclass(frozen=True)
class SplitCommand(Configuration):
    """Divide the clips of a data set so that no person, motion or rig is in two splits, or takes of recorded motion so
    that no subject is in two sets; or check an existing division.

    Takes are listed with their subjects and lengths. Those that cannot be read are listed with the reason, and are not
    in any set.
    """

    data: str = field(default=REQUIRED, metadata={"reads": "path"})
    """Folder of a data set; or a folder of takes; or a list of takes (TSV) to check."""
    by: SplitBy = SplitBy.person
    """Property that two splits of clips must not share."""
    train: float = 0.8
    """Share of the clips, or of the seconds of the takes. With all three 0, takes are only listed."""
    validation: float = 0.1
    """Share; 0 for no such split."""
    test: float = 0.1
    """Share; 0 for no such split."""
    seed: int = 0
    """Seed of the order in which clips or subjects are drawn."""
    check: str | None = field(default=None, metadata={"reads": "path"})
    """JSON file of splits to check, instead of making new ones. Exits with status 1 if there are leaks."""
    out: str | None = None
    """File to write: the splits, by default `splits.json` in the data set; for a check the leaks, by default
    `leaks.json` there; the list of takes, by default `takes.tsv` in their folder."""


@dataclass(frozen=True)
class StatsCommand(ProcessesConfig):
    """Describe a data set: occlusion by joint and cause, contacts, people, distances, angles, motion."""

    data: str = field(default=REQUIRED, metadata={"reads": "clips"})
    """Folder of a data set, or of a clip."""
    extra_data: list[str] = field(default_factory=list, metadata={"reads": "clips"})
    """More data sets that the same page describes."""
    out: str | None = None
    """Folder of the page, its figure and the numbers; by default `statistics` in the data set."""


@dataclass(frozen=True)
class RealismCommand(ProcessesConfig):
    """Run a detector on people in plain sight in rendered images, and measure how many it finds and the errors of their
    joints.

    A person is in plain sight if at least 80 % of the joints are visible, or hidden only by the person's own body. Each
    person is cut out of the image, and detected without further information.
    """

    data: str = field(default=REQUIRED, metadata={"reads": "clips"})
    """Folder of a data set with colour images, or of a clip."""
    extra_data: list[str] = field(default_factory=list, metadata={"reads": "clips"})
    """More data sets for the same table."""
    detector: PoseDetectorConfig = field(default_factory=PoseDetectorConfig)
    every: int = 1
    """Number of frames from one examined image of a camera to the next."""
    real: str = field(default="", metadata={"reads": "path"})
    """A video of real people, or a folder of videos or of images: the silhouettes, skin and edges of both kinds of
    people in one table. Empty for none."""
    shown: int = 36
    """Number of people in the figure, those with the worst detections."""
    out: str | None = None
    """Folder of the results and the figure; by default `realism` in the data set."""

    def __post_init__(self):
        super().__post_init__()
        check_range("", self, 1, inf, "every", "shown")


@dataclass(frozen=True)
class ExportDataCommand(ProcessesConfig):
    """Write a data set in the layout of another program: images and annotations."""

    data: str = field(default=REQUIRED, metadata={"reads": "clips"})
    """Folder of a data set, or of a clip."""
    format: str = field(default="coco", metadata={"choices": exporter})
    """Layout."""
    splits: str | None = field(default=None, metadata={"reads": "path"})
    """JSON file that `synth split` wrote; by default all clips are in the split train."""
    skeleton: str | None = field(default=None, metadata={"reads": "skeleton"})
    """Skeleton of the joints; by default coco17, for panoptic always panoptic19."""
    every: int = 1
    """Number of frames from one image to the next; 1 for all."""
    images: ImageFormat = ImageFormat.jpg
    """File format of images."""
    damaged: bool = False
    """Export even if files are missing or damaged."""
    robot: str | None = field(default=None, metadata={"reads": "path"})
    """MJCF of the Unitree G1, for g1 and lerobot; by default that of an installed mjlab."""
    about: AboutConfig = field(default_factory=AboutConfig)
    out: str = REQUIRED
    """Folder to write, whole or not at all; it must be empty or not exist."""


class CompareBy(Enum):
    """What of clips is compared."""

    detections = "detections"
    """How a detector errs: `compare.html`. Exits with status 1 if a limit is exceeded."""
    motion = "motion"
    """How people move: `motion.html`, `motion.png` and `motion.json`."""


@dataclass(frozen=True)
class CompareCommand(ProcessesConfig):
    """Compare simulated clips with recordings: detections of a recording and of its simulation, or the motion of
    recorded and of generated people."""

    by: CompareBy = CompareBy.detections
    """What is compared."""
    real: str = field(default=REQUIRED, metadata={"reads": "path"})
    """For detections, the recording: a clip, which `dmae convert` makes from any format, or Shelf's text files. For
    motion a take (BVH, ASF/AMC, AMASS-style npz, C3D) or a folder with takes at any depth; or a clip or data set of
    clips: the captured poses of each clip, or its truth if nothing was captured."""
    sim: str = field(default=REQUIRED, metadata={"reads": "clips"})
    """Folder of the simulated clips."""
    frames: list[int] | None = None
    """Detections: first frame of the recording, and the one after the last; by default all."""
    limits: Limits = field(default_factory=Limits)
    takes: list[str] = field(default_factory=lambda: ["*"])
    """Motion: only takes with a file name (without suffix) that matches one of these; `*` and `?` are wildcards."""
    longest: float = 10.0
    """Motion: longer takes, and people of longer clips, count as this long, s: by frames spread over all of it."""
    motion: ReadingConfig = field(default_factory=ReadingConfig)
    out: str = "runs/compare"
    """Folder of the page."""

    def __post_init__(self):
        super().__post_init__()
        if not self.longest >= MIN_SECONDS:
            raise ValueError(f"longest={self.longest}: expected {MIN_SECONDS} s or more")


@dataclass(frozen=True)
class FitDetectorCommand(ProcessesConfig):
    """Fit a detector's preset to a recording: `detector/<name>.yaml` and `compare.html`."""

    detections: str = field(default=REQUIRED, metadata={"reads": "path"})
    """Folder of the recording: a clip, which `dmae convert` makes from any format, or Shelf's text files; with
    `truth=annotated` also a data set."""
    extra_data: list[str] = field(default_factory=list, metadata={"reads": "clips"})
    """With `truth=annotated`, more data sets of the same detector."""
    held_back: list[str] = field(default_factory=list, metadata={"reads": "clips"})
    """With `truth=annotated`, held-back data sets of the same detector, which are not used in the fit. Distances on
    them are printed and written, and those between the detector's results on them and on the clips of the fit."""
    truth: ErrorReference = ErrorReference.others
    """Reference for the detections. With `annotated`, clips with truth and visibility labels, as `dmae detect clip=...`
    writes them, are themselves simulated again, and visible and hidden joints are fitted separately."""
    frames: list[int] | None = None
    """First frame to use, and the one after the last; by default all."""
    clips: str | None = field(default=None, metadata={"reads": "clips"})
    """Folder of simulated clips of a similar scene; by default clips are made with the cameras of the recording."""
    count: int = 4
    """Number of clips to make."""
    scene: SceneConfig = field(default_factory=SceneConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    interaction: InteractionConfig = field(default_factory=InteractionConfig)
    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """m; position of the middle of the scene on the floor, in the world of the recording."""
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    """Start of the fit. Options that the recording does not determine keep its values."""
    rounds: int = 8
    """Simulations."""
    seed: int = 0
    """Seed of the clips and of the detector."""
    name: str = "fitted"
    """Name of the preset."""
    out: str = "runs/detector"
    """Folder of the preset, the comparison page, and the new clips."""


@dataclass(frozen=True)
class DetectorErrorsCommand(ProcessesConfig):
    """Measure the errors of a detector against the truth, by the occluder of a joint, the distance in depth, the size
    of people, crowding, and the direction of view.

    The detections are those in the clips, as `dmae detect clip=...` makes them from images.
    """

    data: str = field(default=REQUIRED, metadata={"reads": "clips"})
    """Folder of a data set, or of a clip, with truth and detections."""
    extra_data: list[str] = field(default_factory=list, metadata={"reads": "clips"})
    """More data sets for the same table."""
    simulated: list[str] = field(default_factory=lambda: ["shelf_openpose", "hrnet_like"])
    """Presets of the simulated detector that are run on the same clips: names, or YAML files."""
    seed: int = 0
    """Seed of the simulated detectors."""
    out: str | None = None
    """Folder of the results and the figure; by default `errors` in the data set."""
