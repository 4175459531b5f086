"""`dmae review`: rank joints that may be wrong, and record decisions on them."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from dmae.commands.config import ReviewCommand
from dmae.data.clip import person_name
from dmae.data.store import load_clip
from dmae.evaluation.report.findings import OFF, Doubt, check_ranking, rank_doubts
from dmae.evaluation.review import DECISIONS, Decision, ReviewVerdict, load_decisions, save_decisions
from dmae.files.contents import write_atomic
from dmae.formats.poses import source_word
from dmae.reporting.tables import counted

_SHOWN = 20
_COLUMNS = ("entry", "person", "joint", "first", "last", "worst", "doubt_mm", "reason", "source", "detected", "views")


def default_out(config: ReviewCommand) -> Path:
    folder = Path(config.clip)
    folder = folder.resolve() if folder.name in ("", "..") else folder
    return folder.parent / f"{folder.name}_review.csv"


def written_path(config: ReviewCommand, out: Path) -> Path:
    if out.suffix.lower() not in ("", ".csv"):
        raise ValueError(f"out={out}: the ranking is a table, .csv; dmae report makes a page that shows these joints")
    return out.with_suffix(".csv")


def run(config: ReviewCommand, out: Path) -> None:
    folder = Path(config.clip)
    clip = load_clip(folder)
    decisions = load_decisions(folder, clip.poses)
    ranking = rank_doubts(clip, decisions)
    if clip.poses is not None and (new := _new_decisions(config, ranking)):
        decisions += new
        save_decisions(folder, clip.poses, decisions)
        print(f"{folder / DECISIONS}: {len(decisions)} decisions, {len(new)} of them new")
        ranking = rank_doubts(clip, decisions)
    write_atomic(out, _table(ranking))
    for line in _table(ranking[:_SHOWN]).splitlines():
        print(line)
    print(f"{out}: {len(ranking)} entries, the most doubtful first")
    found = check_ranking(clip, ranking)
    if found and found.off:
        off = f"{counted(found.off, 'joint')} {'is' if found.off == 1 else 'are'} more than {OFF:.0f} mm off"
        share = f"{found.found / found.off:.0%} of them"
        print(f"by the truth: {off}; the first {found.first} of {found.entries} entries have {share}")


def _new_decisions(config: ReviewCommand, ranking: Sequence[Doubt]) -> tuple[Decision, ...]:
    """Return the decisions on entries by their number in the ranking, which counts from 1."""
    given = {verdict: getattr(config, verdict.value) for verdict in ReviewVerdict}
    entries = [entry for numbers in given.values() for entry in numbers]
    for entry in entries:
        if not 1 <= entry <= len(ranking):
            raise ValueError(f"entry {entry}: expected 1 to {len(ranking)}, a number of the ranking")
    if twice := sorted({entry for entry in entries if entries.count(entry) > 1}):
        raise ValueError(f"entry {twice[0]}: expected one decision on an entry, found several")
    return tuple(ranking[entry - 1].decision(verdict) for verdict, numbers in given.items() for entry in numbers)


def _table(ranking: Sequence[Doubt]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for entry, doubt in enumerate(ranking, 1):
        writer.writerow(
            (entry, person_name(doubt.person), doubt.joint, doubt.first, doubt.last, doubt.worst,
             f"{1000 * doubt.doubt:.0f}", doubt.reason, source_word(doubt.source, doubt.views), doubt.detected,
             doubt.views)
        )  # fmt: skip
    return text.getvalue()
