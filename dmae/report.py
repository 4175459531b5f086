"""One self-contained HTML page: scores, error by length of gap, and the completed motion in every view."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import jinja2
from matplotlib.figure import Figure

from dmae.clip import Clip, Source
from dmae.draw import gaps_figure, views_figure
from dmae.store import write_atomic
from dmae.tables import Table, tables


@dataclass(frozen=True)
class Picture:
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
    """A heading with what stands under it, in this order."""

    heading: str
    text: str = ""
    tables: Sequence[Table] = ()
    figures: Sequence[Picture] = ()


def write_report(path: Path, title: str, sections: Sequence[Section]) -> None:
    """Write the page; it loads nothing from elsewhere."""
    template = jinja2.Template(
        resources.files("dmae").joinpath("report.html").read_text(), autoescape=True, undefined=jinja2.StrictUndefined
    )
    write_atomic(path, template.render(title=title, sections=sections))


def busiest_frames(clip: Clip, count: int, apart: int = 10) -> list[int]:
    """The frames with most completed joints, at least `apart` frames from each other, in order of time."""
    completed = (clip.poses.source == Source.COMPLETED).sum((1, 2))
    chosen = []
    while len(chosen) < count and (completed >= 0).any():
        frame = int(completed.argmax())
        chosen.append(frame)
        completed[max(0, frame - apart) : frame + apart + 1] = -1
    return sorted(chosen)


def views_section(clip: Clip, count: int = 2) -> Section:
    """Pictures of the frames in which most was completed."""
    share = (clip.poses.source == Source.COMPLETED).sum() / max(1, (clip.poses.source != Source.ABSENT).sum())
    return Section(
        f"Clip {clip.id}: what was completed",
        f"{share:.1%} of the joints are completed. These are the frames in which most are.",
        figures=[
            Picture(f"Frame {f}, reprojected into every view.", views_figure(clip, f))
            for f in busiest_frames(clip, count)
        ],
    )


def scores_section(scores: dict) -> Section:
    """What `dmae.evaluate.evaluate` returned: its tables, and the error by length of gap drawn."""
    return Section(
        f"Scores on {scores['recording']}",
        "Strict protocol: one-to-one matching within 0.5 m; a missed person or joint fails its limbs. Views are "
        "numbers of cameras; mean and worst are over all subsets of that many.",
        tables=tables(scores),
        figures=[Picture("Mean error of hidden joints by how long they were hidden.", gaps_figure(scores))],
    )
