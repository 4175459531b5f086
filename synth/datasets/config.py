"""The options of data sets: what is generated, rendered again, divided and exported."""

import re
from dataclasses import dataclass, field
from enum import Enum
from math import inf

from dmae.data.labels import KINDS
from dmae.data.typed import REQUIRED, Configuration
from dmae.parallel import ProcessesConfig
from synth.checks import check_range
from synth.detector.config import DetectorConfig
from synth.interactions.registry import InteractionConfig
from synth.motion.config import MotionConfig
from synth.rendering.config import ImageQuality, ImagingConfig
from synth.rigs.config import NO_RIG, RigConfig
from synth.rooms.config import PropsConfig
from synth.scene.config import MOST_CLIPS, SceneConfig

IMAGE_CHOICES = ("none", "all", *KINDS)
"""The values of `images=`: one of these or a list of them."""


class RgbFormat(Enum):
    """Files of colour images: one video per camera, or one file per image."""

    h264 = "h264"
    png = "png"
    jpeg = "jpeg"


def image_kinds(choices: list[str] | tuple[str, ...] | str) -> tuple[str, ...]:
    """Return the kinds of images that one or several `IMAGE_CHOICES` mean.

    Raises ValueError if a choice is unknown, or `none` is combined with others.
    """
    choices = [choices] if isinstance(choices, str) else list(choices)
    unknown = [choice for choice in choices if choice not in IMAGE_CHOICES]
    if unknown or ("none" in choices and len(set(choices)) > 1):
        raise ValueError(f"images: expected none, all, or a list of {', '.join(KINDS)}; found {choices}")
    return KINDS if "all" in choices else tuple(kind for kind in KINDS if kind in choices)


@dataclass(frozen=True)
class OcclusionConfig(Configuration):
    """Target occlusion: how many of the joints of BODY_25 are hidden, over a clip."""

    target: list[float] = field(default_factory=list)
    """Least and greatest fraction of joints that are hidden from a camera, averaged over cameras; empty for any. It
    determines the layout of people and props: `scene.gathering` is only the start of the search, and only the least
    number of `scene.props` is used."""
    views: int | None = None
    """Count instead the joints that are hidden from this many cameras or more at the same time."""
    by_self: bool = True
    """Whether joints hidden by their own person's body count, which no layout changes."""

    def __post_init__(self):
        super().__post_init__()
        if self.target and not (len(self.target) == 2 and 0 <= self.target[0] < self.target[1] <= 1):
            raise ValueError(
                f"occlusion.target: expected [least, greatest] fraction of joints, 0 <= least < greatest <= 1, "
                f"found {list(self.target)}"
            )
        check_range("occlusion", self, 1, inf, "views")


@dataclass(frozen=True)
class AboutConfig(Configuration):
    """What only the publisher of a data set knows, for its Croissant metadata, datasheet and citation."""

    name: str | None = None
    """Name of the data set."""
    creator: str | None = None
    """Who publishes it."""
    licence: str | None = None
    """URL of the licence; by default none is stated. `DATASHEET.md` says which terms of inputs apply."""
    url: str | None = None
    """Page of the data set."""
    date: str | None = None
    """Date of publication, as 2026-11-24."""

    def __post_init__(self):
        super().__post_init__()
        if self.licence is not None and not self.licence.lower().startswith(("https://", "http://")):
            raise ValueError(
                f"about.licence={self.licence}: expected its address, as https://creativecommons.org/licenses/by/4.0/"
            )
        if self.date is not None and not re.fullmatch(r"\d{4}-(0\d|1[0-2])-([0-2]\d|3[01])", self.date):
            raise ValueError(f"about.date={self.date}: expected year-month-day, as 2026-11-24")


@dataclass(frozen=True)
class GenerateConfig(ProcessesConfig):
    """Simulate clips with exact truth. The same configuration and seed give the same clips."""

    out: str = "runs/data"
    """Folder of the data set. Existing clips in it are kept."""
    seed: int = 0
    """Seed of the whole data set; 0 is a valid seed."""
    first: int = 0
    """Number of the first clip: `first=200 clips=50` makes clips 000200 to 000249, as in the whole data set."""
    clips: int = 8
    """Number of clips. Several machines can fill one folder, each with its own `first` and `clips`."""
    recheck: bool = False
    """Compare the contents of existing images with their checksums, not only their sizes."""
    dry_run: bool = False
    """Only print the number of clips, frames and images, and a forecast of time and disk space. A few short clips are
    made and deleted for the forecast."""
    prefix: str = ""
    """Text before the number in the name of each clip: `prefix=walk_` names them walk_000000, walk_000001, ..."""
    images: list[str] = field(default_factory=list, metadata={"choices": IMAGE_CHOICES})
    """Images that are rendered in addition to the labels, now or later: the same command with other images adds
    them."""
    quality: ImageQuality = ImageQuality.standard
    """Quality of the images."""
    rgb: RgbFormat = RgbFormat.h264
    """Files of colour images: one video per camera, or one file per image."""
    retries: int = 5
    """Number of times that a failed clip is tried again, with another seed (`attempt_seed`)."""
    scene: SceneConfig = field(default_factory=SceneConfig)
    props: PropsConfig = field(default_factory=PropsConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    interaction: InteractionConfig = field(default_factory=InteractionConfig)
    rig: RigConfig = field(default_factory=RigConfig)
    imaging: ImagingConfig = field(default_factory=ImagingConfig)
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    occlusion: OcclusionConfig = field(default_factory=OcclusionConfig)

    def __post_init__(self):
        super().__post_init__()
        check_range("", self, 0, inf, "seed", "first", "retries")
        check_range("", self, 1, inf, "clips")
        if self.first + self.clips > MOST_CLIPS:
            raise ValueError(f"first and clips: expected clips up to number {MOST_CLIPS - 1}, found {self.first}")
        if not re.fullmatch(r"([A-Za-z0-9_][A-Za-z0-9_.-]*)?", self.prefix):
            raise ValueError(f"prefix: expected letters, digits, _ - and ., not first, found {self.prefix!r}")
        image_kinds(self.images)

    @property
    def numbers(self) -> range:
        """The numbers of the clips to make."""
        return range(self.first, self.first + self.clips)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of images to render, from `dmae.data.images.KINDS`."""
        return image_kinds(self.images)


@dataclass(frozen=True)
class RenderConfig(ProcessesConfig):
    """Render simulated clips again: as other images, at another quality, or from other cameras. Nothing is simulated
    again.

    The clips are written to another folder with all of their labels. With another rig, visibility and detections are
    computed for its cameras, with the same result as generation with that rig.
    """

    data: str = field(default=REQUIRED, metadata={"reads": "clips"})
    """Data set that `synth generate` made, or one clip of it."""
    out: str = "runs/rendered"
    """Folder of the new data set. Existing clips in it are kept."""
    images: list[str] = field(default_factory=lambda: ["rgb"], metadata={"choices": IMAGE_CHOICES})
    """Images that are rendered."""
    quality: ImageQuality = ImageQuality.standard
    """Quality of the images."""
    rgb: RgbFormat = RgbFormat.h264
    """Files of colour images: one video per camera, or one file per image."""
    dry_run: bool = False
    """Only print the number of clips, frames and images, and a forecast of time and disk space, from a few images."""
    rig: RigConfig = field(default_factory=lambda: NO_RIG)
    """Other cameras than the clips have."""
    imaging: ImagingConfig = field(default_factory=ImagingConfig)
    first: int = 0
    """Number of the first clip of the data set, counted from 0."""
    clips: int | None = None
    """Number of clips; by default all from `first` on. Several machines can fill one folder."""

    def __post_init__(self):
        super().__post_init__()
        image_kinds(self.images)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of images to render, from `dmae.data.images.KINDS`."""
        return image_kinds(self.images)


class SplitBy(Enum):
    """Property that two splits must not share."""

    person = "person"
    """A person: the proportions of a body, independent of clothes."""
    motion = "motion"
    """A recorded take, by the name of its file. For procedural motion: the motion that one seed draws for one clip."""
    subject = "subject"
    """A recorded person, by the name of the file in the CMU database. For other takes the same as `motion`."""
    rig = "rig"
    """Cameras: their lenses and places, independent of their names."""


class ImageFormat(Enum):
    """File format of images."""

    jpg = "jpg"
    """JPEG of quality 95."""
    png = "png"


MIN_SECONDS = 0.4
"""Shortest length of a track, s. Shorter tracks have no reliable accelerations."""
