"""The configuration of a plan: room, people, allowed places of cameras, lenses, and the search."""

from dataclasses import dataclass, field, replace

import numpy as np

from dmae.data.typed import Configuration
from dmae.parallel import ProcessesConfig
from synth.checks import check_pairs, check_range
from synth.detector.config import DetectorConfig
from synth.interactions.registry import InteractionConfig
from synth.motion.config import MotionConfig
from synth.rigs.config import NO_RIG, RigConfig
from synth.rooms.config import mjcf_names, room_folder
from synth.scene.config import SceneConfig

MOST_CAMERAS, MOST_PLACES = 32, 500
"""Greatest numbers of cameras and of places in a plan."""


@dataclass(frozen=True)
class MountConfig(Configuration):
    """Where cameras may be mounted. Heights are the least and the greatest, m above the floor."""

    walls: list[float] | None = None
    """Heights of cameras on walls; empty for none. By default 1.8 and 2.6, or the top of lower walls."""
    ceiling: bool = True
    """Whether cameras may hang from the ceiling, or from a frame at the top of the walls."""
    tripods: list[float] = field(default_factory=lambda: [1.2, 2.0])
    """Heights of cameras on tripods, which stand outside the people's area; empty for none."""
    area: list[float] = field(default_factory=list)
    """Cameras are mounted only in this rectangle: least x, least y, greatest x, greatest y, m; empty for the whole
    room. Rooms without walls need it."""
    places: int = 120
    """Number of candidate places, spread evenly over the allowed surfaces."""
    steepest_deg: float = 50.0
    """Greatest angle at which cameras look down, degrees. The detector presets are fitted to views from the side, and
    are not valid for views from above."""

    def __post_init__(self):
        super().__post_init__()
        heights = [name for name in ("walls", "tripods") if getattr(self, name)]
        check_pairs("mount", self, 0, np.inf, *heights, above=True, unit=" m")
        if self.walls is not None and not (self.walls or self.ceiling or self.tripods):
            raise ValueError("mount: no camera can be mounted anywhere; allow walls, ceiling or tripods")
        x0, y0, x1, y1 = self.area or (0, 0, 1, 1)
        if len(self.area) not in (0, 4) or not (x0 < x1 and y0 < y1) or not np.isfinite((x0, y0, x1, y1)).all():
            raise ValueError(
                f"mount.area: expected least x, least y, greatest x and greatest y, m, found {list(self.area)}"
            )
        check_range("mount", self, 2, MOST_PLACES, "places")
        check_range("mount", self, 0, 90, "steepest_deg", above=True)


@dataclass(frozen=True)
class LensConfig(Configuration):
    """The new cameras: pinhole cameras of one image size.

    Attributes:
        view_deg: Horizontal fields of view, degrees. If there are several, the search chooses one for each camera.
        size: Image width and height, px.
    """

    view_deg: list[float] = field(default_factory=lambda: [65.0])
    size: list[int] = field(default_factory=lambda: [1280, 960])

    def __post_init__(self):
        super().__post_init__()
        if not self.view_deg or not all(1 <= angle <= 150 for angle in self.view_deg):
            raise ValueError(f"lens.view_deg: expected fields of view of 1 to 150 degrees, found {list(self.view_deg)}")
        if len(self.size) != 2 or not all(1 <= side <= 20_000 for side in self.size):
            raise ValueError(f"lens.size: expected [width, height], 1 to 20000 px each, found {list(self.size)}")

    def matrix(self, view_deg: float) -> np.ndarray:
        """Return (3, 3) K for a horizontal field of view, px."""
        from dmae.formats.rig import intrinsics

        return intrinsics(self.size[0] / 2 / np.tan(np.radians(view_deg) / 2), self.size)


@dataclass(frozen=True)
class SearchConfig(Configuration):
    """Search for cameras, and check of the resulting rigs.

    Attributes:
        clips: Number of simulated clips for the search.
        frames: Number of frames of each clip, evenly spread, in which the visibility of joints is computed.
        check_clips: Number of simulated clips of other people, which are captured to check the rigs.
    """

    clips: int = 6
    frames: int = 12
    check_clips: int = 8

    def __post_init__(self):
        super().__post_init__()
        check_range("search", self, 1, np.inf, "clips", "frames")
        check_range("search", self, 2, np.inf, "check_clips")


@dataclass(frozen=True)
class PlanConfig(ProcessesConfig):
    """Plan where to mount cameras: the best places for 4, 5, ... cameras, and the expected capture for each number.

    People are simulated once. Cameras are chosen by the visibility of joints. The resulting rigs are checked by
    capturing simulated detections of other people, who were not used in the search.
    """

    arena: str | None = field(default=None, metadata={"reads": "path", "words": mjcf_names(room_folder())})
    """Room of `scenes/`, or path of an MJCF file; by default as in `scene`."""
    views: list[int] = field(default_factory=lambda: [4, 6])
    """Least and greatest number of cameras; one number is both."""
    persons: list[int] = field(default_factory=list)
    """Least and greatest number of people; by default as in `scene`."""
    mount: MountConfig = field(default_factory=MountConfig)
    lens: LensConfig = field(default_factory=LensConfig)
    rig: RigConfig = field(default_factory=lambda: NO_RIG)
    """Existing cameras: the best of them are chosen, and no new ones are mounted."""
    scene: SceneConfig = field(default_factory=SceneConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    interaction: InteractionConfig = field(default_factory=InteractionConfig)
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    seed: int = 0
    """Seed of people, detector and ties; 0 is a valid seed."""
    dry_run: bool = False
    """Only print what would be simulated and captured, and an estimate of the time."""
    out: str = "runs/plan"
    """Folder of the page, the rigs and the lists to print; written whole or not at all."""

    def __post_init__(self):
        super().__post_init__()
        if len(self.views) == 1:
            object.__setattr__(self, "views", 2 * self.views)
        # One camera measures no joint.
        check_pairs("", self, 2, MOST_CAMERAS, "views")
        check_range("", self, 0, np.inf, "seed")
        self.setting()

    @property
    def numbers(self) -> range:
        """The numbers of cameras for which rigs are planned."""
        return range(self.views[0], self.views[1] + 1)

    def setting(self) -> SceneConfig:
        """Return the configuration of scenes, with `arena` and `persons` filled in."""
        persons = list(self.persons) or list(self.scene.persons)
        return replace(self.scene, arena=self.arena or self.scene.arena, persons=persons)
