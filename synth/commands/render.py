"""`synth render`: render existing clips again."""

from dataclasses import replace
from pathlib import Path

from dmae.reporting.tables import counted
from synth.datasets.config import RenderConfig
from synth.datasets.render import render


def run(config: RenderConfig, out: Path) -> None:
    lines = render(replace(config, out=str(out)))
    print(f"{out}: {counted(len(lines), 'clip')}")


def interrupted(config: RenderConfig, out: Path) -> str:
    whole = len(list(Path(out).glob("[!.]*/clip.json")))
    return f"{whole} clips in {out} are whole; the same command makes the others"
