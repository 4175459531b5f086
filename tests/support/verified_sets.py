"""Data sets that are damaged and verified."""

from dataclasses import replace
from pathlib import Path

from dmae.data.store import load_clip, save_clip
from synth.datasets.verify import verify

CLIP = "000000"


def changed(data: Path, **fields) -> None:
    """Save the first clip with other fields, checksum and all."""
    save_clip(replace(load_clip(data / CLIP), **fields), data / CLIP)


def found(data: Path) -> list[tuple[str, str, str]]:
    """Return clip, check and description of each problem that verification finds."""
    return [tuple(problem) for problem in verify(data)[1]]


def only(data: Path, check: str, *words: str) -> None:
    """Assert that the first clip fails this check and no other, and that the problems contain these words."""
    problems = found(data)
    assert {(clip, name) for clip, name, _ in problems} == {(CLIP, check)}, problems
    for word in words:
        assert any(word in what for _, _, what in problems), (word, problems)
