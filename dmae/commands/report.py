"""`dmae report`: what a clip or a data set is worth, with a player, and scores, as one page."""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.evaluation.report.page import TITLE, read_scores, write_clips_report
from dmae.formats.config import DataConfig
from dmae.formats.reading import load

WRITES = "file"
EXAMPLES = (
    "dmae report clip=runs/completed",
    "dmae report scores=[runs/scores,runs/scores_shelf] clip=runs/completed out=runs/report.html",
)


@dataclass(frozen=True)
class ReportCommand:
    """Make one page with a player for clips, and with scores: an HTML file that loads no other files."""

    title: str = TITLE
    """Heading of the page."""
    scores: list[str] = field(default_factory=list)
    """Folders that `dmae evaluate` wrote."""
    clip: str | None = None
    """Folder of a clip, captured and completed or not yet, or of a data set of them."""
    out: str | None = None
    """File of the page; by default `report.html` in the folder of the clip, or else of the first scores."""


def default_out(config: ReportCommand) -> Path:
    folders = [*([config.clip] if config.clip else []), *config.scores]
    if not folders:
        raise ValueError("nothing to report: name scores=[folder,...] or clip=folder, or both")
    return Path(folders[0]) / "report.html"


def run(config: ReportCommand, out: Path) -> None:
    default_out(config)
    scores = [read_scores(Path(folder) / "scores.json") for folder in config.scores]
    clips = load(DataConfig(name="clip", path=config.clip)) if config.clip else None
    write_clips_report(out, clips, scores, title=config.title)
    print(out)
