"""`dmae report`: scores and pictures as one page."""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.data.store import clip_folders, load_clip
from dmae.evaluation.report_section import read_scores, scores_section
from dmae.reporting.page import views_section, write_report

WRITES = "file"
EXAMPLES = (
    "dmae report clip=runs/completed",
    "dmae report scores=[runs/scores,runs/scores_shelf] clip=runs/completed out=runs/report.html",
)


@dataclass(frozen=True)
class ReportCommand:
    """Put scores and pictures on one page, an HTML file that loads nothing from elsewhere."""

    title: str = "Occluded multi-view motion, captured and completed"
    """Heading of the page."""
    scores: list[str] = field(default_factory=list)
    """Folders that `dmae evaluate` wrote."""
    clip: str | None = None
    """Folder of a captured or completed clip to draw, or of a data set of them."""
    out: str | None = None
    """File of the page; by default `report.html` in the folder of the clip, or else of the first scores."""


def default_out(config: ReportCommand) -> Path:
    folders = [*([config.clip] if config.clip else []), *config.scores]
    if not folders:
        raise ValueError("nothing to report: name scores=[folder,...] or clip=folder, or both")
    return Path(folders[0]) / "report.html"


def run(config: ReportCommand, out: Path) -> None:
    default_out(config)
    sections = [scores_section(read_scores(Path(folder) / "scores.json")) for folder in config.scores]
    if config.clip:
        for folder in clip_folders(Path(config.clip)):
            clip = load_clip(folder)
            if clip.poses is None:
                raise ValueError(f"{folder}: has no poses to report; run dmae capture on it first")
            sections.append(views_section(clip))
    write_report(out, config.title, sections)
    print(out)
