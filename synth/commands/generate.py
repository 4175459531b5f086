"""`synth generate`: simulate clips with exact truth."""

from dataclasses import replace
from pathlib import Path

from dmae.reporting.tables import counted
from synth.datasets.config import GenerateConfig
from synth.datasets.forecast import forecast, is_long
from synth.datasets.generate import generate
from synth.rooms.room import load_room


def run(config: GenerateConfig, out: Path) -> None:
    for clause in load_room(config.scene.arena).filled:
        print(f"{config.scene.arena}: {clause}")
    config = replace(config, out=str(out))
    if config.dry_run:
        print(f"{out}: {forecast(config)}")
        return
    if is_long(config):
        print(f"{out}: {forecast(config)}", flush=True)
    lines = generate(config)
    failed = [line for line in lines if line["status"] != "ok"]
    for line in failed:
        print(f"{line['id']}: failed after {line['attempts']} attempts: {line['reason']}")
    print(f"{out}: {counted(len(lines) - len(failed), 'clip')}, {len(failed)} failed")


def interrupted(config: GenerateConfig, out: Path) -> str:
    whole = len(list(Path(out).glob("[!.]*/clip.json")))
    return f"{whole} of {len(config.numbers)} clips in {out} are whole; the same command makes the others"
