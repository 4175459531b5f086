"""`dmae train`: learn to complete poses."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from dmae.command_line import interruption
from dmae.completion.config import TrainConfig
from dmae.completion.training import train
from dmae.data.clip import Clip
from dmae.files.checksums import refuse_damaged
from dmae.formats.reading import Clips, DataConfig


def run(config: TrainConfig, out: Path, since: float | None = None) -> None:
    """Train. `since`: when the time of `max_minutes` began; by default when the command did."""
    paths = (config.extra_data, config.validation_data)
    if not config.examples.damaged:
        for path in (config.data.path, *config.extra_data, *config.validation_data):
            refuse_damaged(Path(path), "examples.damaged=true")
    extra, validation = ([Clips(DataConfig(path=path)) for path in group] for group in paths)
    # The time that the user waits begins with the command, not when torch is loaded.
    since = since or interruption.began or time.monotonic()
    print(train(config, _named([Clips(config.data)]), out, _named(validation), _named(extra, first=1), since=since))


def interrupted(config: TrainConfig, out: Path) -> str:
    if list(Path(out).glob("checkpoint*.ckpt")):
        return f"{out} holds a checkpoint; the same command continues"
    epoch = f"learning.epoch={config.learning.epoch}"
    return f"{out} holds no checkpoint yet (one is written every {epoch} steps); the same command starts again"


def _named(sets: list[Clips], first: int = 0) -> Iterator[Clip]:
    """Clips called as their folders are, and outside set 0 with the set's folder: each set counts from 0.

    If the folders of two sets have one name, as `a/captured` and `b/captured`, the number of the second is put before.
    """
    named: dict[str, Path] = {}
    for number, clips in enumerate(sets, first):
        for clip, folder in zip(clips, clips.folders, strict=True):
            name = f"{folder.parent.name}/{folder.name}" if number else folder.name
            another = named.setdefault(name, folder.resolve()) != folder.resolve()
            yield replace(clip, id=f"{number}/{name}" if another else name)
