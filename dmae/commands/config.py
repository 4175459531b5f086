"""Options of commands, where a command takes more options than its verb. Imports nothing heavy: help is quick."""

from dataclasses import dataclass, field
from enum import StrEnum

from dmae.calibration.config import RefineConfig
from dmae.completion.config import DELAY, SMOOTHING, check_delay
from dmae.completion.methods import completion_method
from dmae.data.resources import resource_folder
from dmae.data.typed import REQUIRED, Configuration
from dmae.detection.registry import OutputConfig, PoseDetectorConfig
from dmae.evaluation.config import TITLE, PartConfig
from dmae.formats.config import DataConfig, LengthUnit, UpDirection
from dmae.formats.registry import pose_writer, recording_writer
from dmae.parallel import ProcessesConfig
from dmae.reconstruction.config import CaptureConfig

_FILLS = ("none", *(name for name, method in completion_method.items() if not method.learned and name != "measured"))


def _presets(group: str) -> tuple[str, ...]:
    return tuple(sorted(file.stem for file in (resource_folder("dmae", "configs") / group).glob("*.yaml")))


@dataclass(frozen=True)
class WorldConfig(Configuration):
    """Conventions that the calibration does not state; by default those of its format."""

    unit: LengthUnit | None = None
    """Unit of lengths."""
    up: UpDirection | None = None
    """Axis that points up."""
    inverse: bool | None = None
    """Whether extrinsics are world_from_cam."""


class DemoSize(StrEnum):
    """How much is simulated and learned."""

    small = "small"
    """About a minute on two cores: enough to see every step work. The model is the shipped one, tuned for a moment."""
    full = "full"
    """Under five minutes on two cores: enough for a model that is better than interpolation on what it was made for."""


@dataclass(frozen=True)
class FilmedConfig(Configuration):
    """What `dmae detect` and `dmae run` detect people in."""

    videos: str | None = field(default=None, metadata={"reads": "path"})
    """Folder of a video, or a folder of images, for each camera, named as in the calibration."""
    calibration: str | None = field(default=None, metadata={"reads": "path"})
    """Calibration file, a folder with one, or a clip with these cameras; without one, `dmae detect` writes files of 2D
    keypoints."""
    clip: str | None = field(default=None, metadata={"reads": "clips"})
    """Instead of videos: folder of a clip with colour images, or of a data set of them; truth and labels are kept."""
    photos: str | None = field(default=None, metadata={"reads": "path"})
    """Instead of videos: folder of photographs taken together, in sets, with a folder for each camera or for each set;
    each set is a still. Without a calibration, `dmae detect` takes photographs of any sizes, or one, writes the people
    of each as 2D keypoints, and draws them."""
    detector: PoseDetectorConfig = field(default_factory=PoseDetectorConfig)
    fps: float | None = None
    """1/s; frame rate, by default that of the videos. Required for folders of images."""
    offsets: list[int | str] | None = None
    """Frames by which cameras started late: a number for each, in the order of the calibration, or [name:frames] for
    some; by default read from the videos."""
    frames: list[int] | None = None
    """[first, end] of the frames to take, as [0,500] for a first look; by default all."""
    world: WorldConfig = field(default_factory=WorldConfig)
    workers: int = 1
    """Processes that detect; -1 for one per core."""


@dataclass(frozen=True)
class RunCommand(FilmedConfig):
    """Turn videos of calibrated cameras into people in 3D: detect, capture, complete, report, export.

    The same command continues an interrupted run.
    """

    capture: CaptureConfig = field(default_factory=CaptureConfig)
    weights: str | None = field(default=None, metadata={"reads": "model", "words": ("paper",)})
    """Folder that `dmae train` wrote, or `paper`; by default the weights that come with the package."""
    export: list[str] = field(default_factory=lambda: ["trc"], metadata={"choices": pose_writer})
    """Formats of the poses that are written in addition to the report."""
    out: str = "runs/run"
    """Folder: `detected`, `captured` and `completed` clips, `report.html`, and `poses` in each format."""


@dataclass(frozen=True)
class DetectCommand(FilmedConfig):
    """Detect people in the videos of cameras, in the images of clips, or in photographs.

    The same command continues an interrupted run.
    """

    output: OutputConfig = field(default_factory=OutputConfig)
    out: str = "runs/detect"
    """Folder of the clip, or of the files of keypoints; for a data set, it contains a folder for each clip."""

    def __post_init__(self):
        super().__post_init__()
        if sum(given is not None for given in (self.videos, self.clip, self.photos)) != 1:
            raise ValueError(
                "expected videos=<folder of videos>, clip=<folder of a clip with images> or photos=<folder of "
                "photographs>, one of them"
            )
        if self.clip is not None and (self.calibration or self.fps or self.offsets):
            raise ValueError("clip=... holds its calibration, fps and offsets; leave them out")
        if self.clip is not None and self.frames:
            shorter = f"dmae convert data={self.clip} data.frames={[*self.frames]} out=shorter".replace(", ", ",")
            raise ValueError(f"frames are of videos and photographs; a shorter clip: {shorter}")
        if self.calibration is None and self.world != WorldConfig():
            raise ValueError("world.* are of calibration=..., and there is none; leave them out")
        if self.photos is not None and (self.offsets or (self.fps and not self.calibration)):
            raise ValueError("photos=... have no offsets, and without calibration=... no fps; leave them out")


@dataclass(frozen=True)
class CaptureCommand(PartConfig):
    """Turn the detections of several cameras into 3D poses, and print how far they reproject from the detections.

    Exits with status 1 where no person is found, and prints what is left after each step and what to change.
    """

    data: DataConfig = field(default_factory=DataConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    fill: str = field(default="none", metadata={"choices": _FILLS})
    """How joints on which fewer than two cameras agree are filled, or module:function of your own; they are marked
    completed in `source`."""
    smooth: float = 0.0
    """s; light smoothing after that (0.1 suits people; 0: none). What it moves is marked denoised."""
    level: bool = False
    """Turn the world so that z is up, and move its floor to z = 0, as feet and bodies show them: cameras, people and
    truth together."""
    draw: list[int] = field(default_factory=list)
    """Numbers of cameras: capture each clip of a data set with one of these numbers, drawn at random as the cameras
    are, and keep no other cameras, to learn what few cameras measure."""
    seed: int = 0
    """Seed of the cameras that are drawn."""
    dry_run: bool = False
    """Only print the number of clips and frames to capture, and the time and disk space that this takes, measured on
    parts of some clips."""
    out: str = "runs/capture"
    """Folder of the captured clip; of a data set a folder for each clip is made in it. Several machines can fill it,
    each with some clips."""

    def __post_init__(self):
        super().__post_init__()
        if not self.smooth >= 0:
            raise ValueError(f"smooth={self.smooth:g}: expected seconds, 0 (no smoothing) or more")


@dataclass(frozen=True)
class CompleteCommand(ProcessesConfig):
    """Fill joints on which fewer than two cameras agree, marked as such; smooth the others.

    By default all joints are smoothed; joints that fewer than three views measured are corrected; joints that
    neighbouring frames contradict are replaced. `reject=false denoise=false smooth=0` changes no measured joint.
    """

    clip: str = field(default=REQUIRED, metadata={"reads": "clips"})
    """Folder of a captured clip, or of a data set of them."""
    weights: str | None = field(default=None, metadata={"reads": "model", "words": ("paper",)})
    """Folder that `dmae train` wrote; `paper`: the weights of the paper's network; by default those that come with the
    package for the skeleton of the poses."""
    denoise: bool | None = None
    """Let the model also move joints that fewer than three views measured; they are then marked denoised. By default
    true if the weights were trained for it."""
    reject: bool = True
    """Remove joints measured by two views if the frames around contradict them, and
    complete them too."""
    smooth: float = SMOOTHING
    """s; light smoothing after completion (0: none). Exact poses are not smoothed. Joints that it moves are marked
    denoised."""
    online: bool = False
    """Complete as if cameras were running: each frame from the frames until `delay` after it."""
    delay: float = DELAY
    """s; delay of `online`."""
    damaged: bool = False
    """Complete a data set even if files are missing or were changed."""
    dry_run: bool = False
    """Only print the number of clips and frames to complete, and the time and disk space that this takes, measured on
    parts of some clips."""
    out: str = "runs/complete"
    """Folder of the completed clip; of a data set a folder for each clip is made in it."""

    def __post_init__(self):
        super().__post_init__()
        check_delay(self.delay, self.online)


@dataclass(frozen=True)
class ReportCommand(Configuration):
    """Make one page with a player for clips, and with scores: an HTML file that loads no other files."""

    title: str = TITLE
    """Heading of the page."""
    scores: list[str] = field(default_factory=list, metadata={"reads": "path"})
    """Folders that `dmae evaluate` wrote."""
    clip: str | None = field(default=None, metadata={"reads": "clips"})
    """Folder of a clip, captured and completed or not yet, or of a data set of them."""
    out: str | None = None
    """File of the page; by default `report.html` in the folder of the clip, or else of the first scores."""

    def __post_init__(self):
        super().__post_init__()
        if not (self.clip or self.scores):
            raise ValueError("nothing to report: name scores=[folder,...] or clip=folder, or both")


@dataclass(frozen=True)
class ReviewCommand(Configuration):
    """Rank the joints of a clip by their possible error; accept, blank or hand back entries of the ranking.

    Decisions are written to `decisions.json` in the folder of the clip. `dmae export` leaves out blanked and
    handed-back joints; `dmae complete` fills handed-back joints again. The next ranking contains the remaining joints.
    """

    clip: str = field(default=REQUIRED, metadata={"reads": "clip"})
    """Folder of a captured or completed clip."""
    accept: list[int] = field(default_factory=list)
    """Entries of the last ranking that are correct."""
    blank: list[int] = field(default_factory=list)
    """Entries that are wrong, to be left out."""
    hand_back: list[int] = field(default_factory=list)
    """Entries that are wrong, to be completed."""
    out: str | None = None
    """CSV file of the ranking; by default `<clip>_review.csv`, in the folder that the clip is in."""


@dataclass(frozen=True)
class LiveCommand(Configuration):
    """Answer detections of frames with poses, as lines of JSON (see `dmae.online.json_lines` or the documentation).

    Frames are read from standard input and answered on standard output, or on a socket with `listen`.
    """

    calibration: str = field(default=REQUIRED, metadata={"reads": "path"})
    """Calibration file of any supported format, its folder, or a clip with these cameras."""
    fps: float = REQUIRED
    """1/s; rate at which frames arrive."""
    world: WorldConfig = field(default_factory=WorldConfig)
    skeleton: str = field(default="body25", metadata={"reads": "skeleton"})
    """Skeleton of the detections."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    complete: bool = False
    """Also complete the joints on which fewer than two cameras agree; this adds to the delay."""
    weights: str | None = field(default=None, metadata={"reads": "model", "words": ("paper",)})
    """Folder that `dmae train` wrote, or `paper`; by default the weights that come with the package."""
    look_ahead: float | None = None
    """s; longest time that any step waits for later frames. Less than the 0.4 of capture and the 0.28 of completion
    reduces accuracy; by default the time that they use."""
    listen: str | None = None
    """host:port to listen on, for one program at a time; each connection starts a new capture. By default standard
    input."""

    def __post_init__(self):
        super().__post_init__()
        if self.weights is not None and not self.complete:
            raise ValueError(f"weights={self.weights}: nothing is completed; add complete=true, or leave weights out")
        if self.listen is None:
            return
        host, _, port = self.listen.rpartition(":")
        if not host or not port.isdecimal() or int(port) > 65535:
            raise ValueError(f"listen={self.listen}: expected host:port, as 127.0.0.1:5555")


@dataclass(frozen=True)
class ExportCommand(Configuration):
    """Write poses to a file that other programs read."""

    clip: str = field(default=REQUIRED, metadata={"reads": "clip"})
    """Folder of a clip; its captured or completed poses are exported, or its truth if it has none. What
    `dmae review` blanked or handed back is left out."""
    format: str | None = field(default=None, metadata={"choices": pose_writer})
    """Format of the file. By default the suffix of `out` decides, as in walk.trc; without one it is npz."""
    skeleton: str | None = field(default=None, metadata={"reads": "skeleton", "words": ("soma", "lafan1")})
    """Skeleton of the file; by default that of the poses. Of two fused skeletons all formats but npz write the
    first. `format=bvh` also takes `soma` and `lafan1`, in cm."""
    unit: LengthUnit = LengthUnit.m
    """Unit of lengths in TRC and BVH; of g1, m with radians or cm with degrees."""
    keep_mm: float | None = None
    """mm; leave out joints with a likely error above this, by their covariances, and completed joints without a
    covariance. By default all joints are written."""
    robot: str | None = field(default=None, metadata={"reads": "path"})
    """MJCF of the Unitree G1, for g1 and lerobot; by default that of an installed mjlab."""
    people: list[str] = field(default_factory=list)
    """Persons to write and their names in files, as [P1:anna,P3]; by default all, as P1, P2, ..."""
    out: str = REQUIRED
    """File to write, by default with the suffix of the format; for panoptic, openpose and lerobot a folder."""


@dataclass(frozen=True)
class ConvertCommand(Configuration):
    """Turn a recording into another format, or into a clip."""

    data: DataConfig = field(default_factory=DataConfig)
    format: str = field(default="clip", metadata={"choices": recording_writer})
    """Format to convert to."""
    out: str = REQUIRED
    """Folder to write; for a data set, it contains a folder for each clip."""


@dataclass(frozen=True)
class DoctorCommand(Configuration):
    """Find what is wrong with a calibration and its detections, and print how to correct it.

    Exits with status 1 if anything is wrong. Writes `doctor.json`, `doctor.png`, and a figure of epipolar arrows for
    each camera, `arrows_<camera>.png`.
    """

    data: DataConfig = field(default_factory=DataConfig)
    max_offset: int = 50
    """frames; the largest time offset between two cameras that is tested, in both directions."""
    out: str = "runs/doctor"
    """Folder of the results; for a data set, it contains a folder for each clip."""


@dataclass(frozen=True)
class CalibrateCommand(Configuration):
    """Refine a calibration by the people in a recording.

    Record people who walk through the whole volume for half a minute, better for a minute.
    Writes the cameras as TOML, which every command accepts as data.calibration, and the changes with their covariance
    as JSON in the same folder.
    """

    data: DataConfig = field(default_factory=DataConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)
    out: str = "runs/rig.toml"
    """Calibration file to write."""


@dataclass(frozen=True)
class PretrainCommand(Configuration):
    """Simulate people with your motion, cameras and detector, and train on them.

    Trains a model that `dmae train init=<model>` can then fine-tune on recordings: simulates, captures, trains,
    calibrates uncertainty on held-back subjects, scores on others, and writes the card. Every step is
    printed. The same command continues an interrupted run.
    """

    motion: str | None = field(default=None, metadata={"reads": "path"})
    """Folder of motion files, or a list of takes that `synth split` wrote; by default people move procedurally."""
    rig: str = field(default="random", metadata={"reads": "path", "words": _presets("rig")})
    """Calibration of any known format, a file or folder, or a clip with these cameras; or a preset of rigs, by its name
    or file."""
    detector: str = field(default="shelf_openpose", metadata={"reads": "path", "words": _presets("detector")})
    """Preset of the simulated detector, by its name or file, as `synth fit-detector` writes one."""
    clips: int = 60
    """Clips of 12 s to train on; a quarter of this number is used for calibration, and a quarter for scores."""
    seconds: float = 12.0
    """s; length of a clip."""
    views: list[int] = field(default_factory=list)
    """Numbers of cameras that capture people, drawn for each clip; by default 2 to 5, if the rig has so many."""
    steps: int = 6000
    """Steps of training. No step is limited by time: the same command makes the same weights on one machine."""
    workers: int = 1
    """Processes that simulate."""
    seed: int = 0
    """Seed of all steps."""
    out: str = "runs/pretrain"
    """Folder of the data sets, of the model (`model`) and of its scores."""

    def __post_init__(self):
        super().__post_init__()
        for name, least in (("clips", 2), ("steps", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected at least {least}, found {getattr(self, name)}")
        if min(self.views, default=2) < 2:
            raise ValueError(f"views={self.views}: expected numbers of cameras, 2 or more")


@dataclass(frozen=True)
class DemoCommand(Configuration):
    """Simulate people, detect, capture, train, complete, score and report. Every step is printed."""

    size: DemoSize = DemoSize.small
    """How much is simulated and learned."""
    shelf: str | None = field(default=None, metadata={"reads": "path"})
    """Folder of the Shelf recording; with it the model is scored on real people as well."""
    workers: int = 2
    """Processes that simulate, capture and score."""
    out: str = "runs/demo"
    """Folder of the results; the page is `report.html` in it."""


@dataclass(frozen=True)
class RegressCommand(Configuration):
    """Check any triangulation against a fixed set of cases. Exits with status 1 if a bound is broken.

    The solver is a plain function of keyword arrays (numpy is sufficient):

        def solver(*, K, dist, cam_from_world, size, xy, confidence): return xyz

        K (V, 3, 3) px; dist (V, 5) or (V, 8), OpenCV's k1 k2 p1 p2 k3 [k4 k5 k6], zeros for a pinhole;
        cam_from_world (V, 4, 4), OpenCV cameras (x right, y down, z forward), m; size (V, 2) width, height;
        xy (n, V, 2) pixels as detected, distorted, NaN where a view has none, (0, 0) the centre of the first pixel;
        confidence (n, V) in [0, 1], NaN where a view is not used; xyz (n, 3) m, NaN where the solver refuses. Rows are
        independent.

    To start from: dmae.regression.solvers:ours, :dlt, :opencv. In pytest: the fixture check_triangulation.
    """

    solver: str = REQUIRED
    """package.module:function; the current folder is searched first."""
    skip: list[str] = field(default_factory=list)
    """Names of cases to skip."""
    seconds: float = 30.0
    """s; time limit for one case."""
    report: str | None = None
    """An HTML page to write."""
