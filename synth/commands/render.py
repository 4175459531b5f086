"""`synth render`: render existing clips again."""

from dataclasses import replace
from pathlib import Path

from dmae.reporting.tables import counted
from synth.datasets.config import RenderConfig
from synth.datasets.render import forecast_rendering, render


def run(config: RenderConfig, out: Path) -> None:
    config = replace(config, out=str(out))
    if config.dry_run:
        print(f"{out}: {forecast_rendering(config)}")
        return
    lines = render(config)
    print(f"{out}: {counted(len(lines), 'clip')}")


def interrupted(config: RenderConfig, out: Path) -> str:
    whole = len(list(Path(out).glob("[!.]*/clip.json")))
    return f"{whole} clips in {out} are whole; the same command makes the others"
