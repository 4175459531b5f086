"""Options of drawings and videos of clips."""

from dataclasses import dataclass, field

from dmae.data.typed import Configuration
from dmae.formats.config import DataConfig


@dataclass(frozen=True)
class LayersConfig(Configuration):
    """Layers that are drawn, if the clip has them."""

    detections: bool | None = None
    """2D detections, crosses; by default if there are no occlusion labels."""
    measured: bool = True
    """Measured joints, discs in the colour of their person."""
    completed: bool = True
    """Completed joints, red squares: fewer than two cameras agree on them, or they were rejected."""
    truth: bool | None = None
    """True joints: white rings if there are poses, otherwise in the colours of their occluders; by default if there are
    no poses."""


@dataclass(frozen=True)
class ShowConfig(Configuration):
    """Draw recorded, simulated, captured or completed clips: `sheet.png`, a video, a recording for Rerun."""

    data: DataConfig = field(default_factory=DataConfig)
    out: str = "runs/show"
    """Folder of the drawings; of a data set each clip has a folder in it."""
    frames: int = 4
    """Number of frames on the sheet, evenly spread over the clip."""
    cameras: list[str] = field(default_factory=list)
    """Names of the cameras to draw; none for all."""
    width: int = 480
    """px; width of a view."""
    layers: LayersConfig = field(default_factory=LayersConfig)
    video: bool = False
    """Also write `clip.mp4`, all views of all frames: about a minute for ten seconds of five cameras."""
    rerun: bool = False
    """Whether to write `clip.rrd` for the Rerun viewer, which `pip install 'dmae-synth[viz]'` adds."""
