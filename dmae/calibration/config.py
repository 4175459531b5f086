"""Options of the refinement of a calibration."""

from dataclasses import dataclass, field

from dmae.data.typed import Configuration

AUTO = "auto"
"""The cameras that differ from their calibration."""
ALL = "all"
ENOUGH_S = 30.0
"""s; of shorter recordings the errors of a detector, which are the same for a person in a camera, cannot be told from a
displaced camera."""


def describe_shortness(seconds: float) -> str | None:
    """Return what is wrong with the length of a recording from which cameras are refined, s; None if it is enough."""
    if seconds >= ENOUGH_S:
        return None
    return (
        f"the recording lasts {seconds:.1f} s, so dmae calibrate leaves larger errors than it needs to; record people "
        f"who walk through the whole volume for {ENOUGH_S:g} s or longer"
    )


@dataclass(frozen=True)
class RefineConfig(Configuration):
    """Parameters that are calibrated."""

    cameras: list[str] = field(default_factory=lambda: [AUTO])
    """Names of the cameras that may change, `all`, or `auto`: cameras that clearly differ from their calibration."""
    known: bool = True
    """Whether extrinsics are roughly right. Otherwise they are estimated from intrinsics only, which requires frames in
    which two cameras see one person; the world is then level."""
    extrinsics: bool = True
    """Refine the positions and directions of these cameras."""
    focal: bool = False
    """Refine their focal lengths; fx / fy does not change."""
    distortion: bool = False
    """Refine k1."""
    offsets: bool = False
    """Refine the time offset of each camera, to a fraction of a frame."""
    drift: bool = False
    """Refine the drift of each time offset."""
    bones: bool = True
    """Expect bones of constant length."""
    bodies: int = 1000
    """Largest number of bodies (a person in a frame) that are compared."""
    stature: float | None = None
    """m; scale the world so that the people have this mean stature."""
    level: bool = False
    """Turn the world so that z is up, by the feet and bodies of people, and move the floor to z = 0. With
    extrinsics=false nothing else changes."""

    def __post_init__(self):
        super().__post_init__()
        if self.bodies < 20:
            raise ValueError(f"bodies={self.bodies}: expected 20 or more")
        if self.stature is not None and not 0.5 <= self.stature <= 2.5:
            raise ValueError(f"stature={self.stature:g}: expected metres, 0.5 to 2.5")
        if not self.known and not (self.extrinsics and self.cameras in ([AUTO], [ALL])):
            raise ValueError("known=false estimates the extrinsics of all cameras; leave out cameras and extrinsics")
        if not self.frees_cameras and not self.level and self.stature is None:
            raise ValueError("nothing to refine: set extrinsics, focal, distortion, offsets, drift, stature or level")

    @property
    def frees_cameras(self) -> bool:
        """True if any parameter of a camera may change, apart from the choice of the world."""
        return any((self.extrinsics, self.focal, self.distortion, self.offsets, self.drift))
