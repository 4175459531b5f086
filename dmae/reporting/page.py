"""One self-contained HTML page: sections of text, tables and figures."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import jinja2
import numpy as np
from matplotlib.figure import Figure

from dmae.data.clip import Clip, Source
from dmae.data.store import write_atomic
from dmae.reporting.figures import views_figure
from dmae.reporting.tables import Table


@dataclass(frozen=True)
class CaptionedFigure:
    """A figure to embed, with its caption."""

    caption: str
    figure: Figure

    @property
    def png(self) -> str:
        """Base64 of the rendered figure."""
        buffer = io.BytesIO()
        self.figure.savefig(buffer, format="png", dpi=90)
        return base64.b64encode(buffer.getvalue()).decode()


@dataclass(frozen=True)
class Section:
    """A heading, and under it text, tables and figures in this order."""

    heading: str
    text: str = ""
    tables: Sequence[Table] = ()
    figures: Sequence[CaptionedFigure] = ()


def write_report(path: Path, title: str, sections: Sequence[Section]) -> None:
    """Write the page as one file that loads nothing from elsewhere."""
    template = jinja2.Template(
        resources.files("dmae").joinpath("report.html").read_text(), autoescape=True, undefined=jinja2.StrictUndefined
    )
    write_atomic(path, template.render(title=title, sections=sections))


def frames_to_draw(clip: Clip, number: int) -> list[int]:
    """Return the frames of a clip with most completed joints, or else with most missing ones, or else most persons."""
    source = clip.poses.source
    present = (source != Source.ABSENT).any(-1, keepdims=True)
    kinds = (source == Source.COMPLETED, (source == Source.ABSENT) & present, source != Source.ABSENT)
    return frames_with_most(next((kind for kind in kinds if kind.any()), kinds[0]).sum((1, 2)), number)


def frames_with_most(counts: np.ndarray, number: int, apart: int = 10) -> list[int]:
    """Return the frames with the largest counts (F,), at least `apart` frames from each other, in order of time."""
    left, chosen = counts.copy(), []
    while len(chosen) < number and (left >= 0).any():
        frame = int(left.argmax())
        chosen.append(frame)
        left[max(0, frame - apart) : frame + apart + 1] = -1
    return sorted(chosen)


def views_section(clip: Clip, number: int = 2) -> Section:
    """Return pictures of a clip's poses: of the frames with most completed joints, or else with most missing ones."""
    if clip.poses is None:
        return Section(f"Clip {clip.id}: no poses", "This clip has no captured poses; dmae capture makes them.")
    source = clip.poses.source
    present = (source != Source.ABSENT).any(-1, keepdims=True)
    if not present.any():
        return Section(f"Clip {clip.id}: no persons", "Capture found no person in this clip.")
    completed, missing = source == Source.COMPLETED, (source == Source.ABSENT) & present
    joints = present.sum() * source.shape[-1]
    heading = f"Clip {clip.id}: {'completed' if completed.any() else 'captured'} poses"
    if completed.any():
        text = f"{completed.sum() / joints:.1%} of the joints are completed, drawn in red: no camera measured them."
        text += f" {missing.sum() / joints:.1%} are missing." if missing.any() else ""
        text += " These are the frames with the most completed joints."
    elif missing.any():
        text = f"No joint is completed; {missing.sum() / joints:.1%} are missing. These are the frames with the most."
    else:
        text = "Every joint was measured; no joint is completed. These are frames with the most persons."
    return Section(
        heading,
        text,
        figures=[
            CaptionedFigure(f"Frame {f}, reprojected into every view.", views_figure(clip, f))
            for f in frames_to_draw(clip, number)
        ],
    )
