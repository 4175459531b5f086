"""`dmae report`: what a clip or a data set is worth, with a player, and scores, as one page."""

from pathlib import Path

from dmae.commands.config import ReportCommand
from dmae.evaluation.report.page import read_shown_scores, write_clips_report
from dmae.formats.config import DataConfig
from dmae.formats.reading import Clips


def default_out(config: ReportCommand) -> Path:
    return Path(config.clip or config.scores[0]) / "report.html"


def written_path(config: ReportCommand, out: Path) -> Path:
    if out.suffix.lower() not in ("", ".html", ".htm"):
        raise ValueError(f"out={out}: the report is a page, .html; a browser prints it to PDF")
    return out if out.suffix else out.with_suffix(".html")


def run(config: ReportCommand, out: Path) -> None:
    scores = [read_shown_scores(Path(folder)) for folder in config.scores]
    clips = Clips(DataConfig(name="clip", path=config.clip)) if config.clip else None
    write_clips_report(out, clips, scores, title=config.title)
    print(out)
