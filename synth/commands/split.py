"""`synth split`: divide clips, or takes of recorded motion, for training and testing, without leaks."""

import json
from pathlib import Path

from dmae.data.store import MANIFEST, clip_folders
from dmae.files.contents import write_atomic
from dmae.reporting.tables import counted
from synth.commands.config import SplitCommand
from synth.datasets.splits import as_table, find_leaks, read_splits, split, takes
from synth.motion.readers.takes import LIST, find_subject_leaks


def _has_clips(data: Path) -> bool:
    return any((data / name).exists() for name in (MANIFEST, "clip.json"))


def default_out(config: SplitCommand) -> Path:
    data = Path(config.data)
    if config.check is not None or _has_clips(data):
        return data / ("leaks.json" if config.check else "splits.json")
    return data / "takes.tsv" if data.is_dir() else data.with_name(f"{data.stem}_checked.tsv")


def run(config: SplitCommand, out: Path) -> None:
    """Divide or check, and write the result.

    Raises ValueError if there are leaks, shares do not add up to 1, or there is too little to divide, and
    FileNotFoundError.
    """
    data = Path(config.data)
    if not data.exists():
        raise FileNotFoundError(f"data={data}: expected a data set, a folder of takes, or a list of takes (TSV)")
    if config.check is not None:
        _check(config, data, out)
    elif _has_clips(data):
        splits = split(data, config.by.name, **_shares(config), seed=config.seed, out=out)
        total = sum(map(len, splits.values()))
        for name, clips in splits.items():
            print(f"{out}: {name}: {counted(len(clips), 'clip')}, {len(clips) / total:.0%}")
    else:
        _list_takes(config, data, out)


def _shares(config: SplitCommand) -> dict[str, float]:
    return {"train": config.train, "validation": config.validation, "test": config.test}


def _check(config: SplitCommand, data: Path, out: Path) -> None:
    path = Path(str(config.check))
    splits = read_splits(path, [folder.name for folder in clip_folders(data)])
    text = [str(leak) for leak in find_leaks(data, splits, [config.by])]
    write_atomic(out, json.dumps({"leaks": text}, indent=1))
    if text:
        raise ValueError(f"{path}: {len(text)} leaks; {text[0]}; all are in {out}")
    print(f"{path}: no {config.by.name} is in two splits")


def _list_takes(config: SplitCommand, path: Path, out: Path) -> None:
    is_list = path.suffix.lower() == LIST and path.is_file()
    try:
        found = takes(path, **({} if is_list else _shares(config)), seed=config.seed)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"data={path}: expected a data set ({MANIFEST}), or takes of motion; {error}") from None
    write_atomic(out, as_table(found, out.parent))
    readable = [take for take in found if take.readable]
    for take in found:
        if not take.readable:
            print(take.notes)
    for name in sorted({take.listed.set for take in readable}):
        part = [take for take in readable if take.listed.set == name]
        people = len({take.listed.subject for take in part})
        minutes = sum(take.seconds for take in part) / 60
        print(f"{out}: set {name}: {counted(len(part), 'take')} of {counted(people, 'subject')}, {minutes:.1f} minutes")
    print(f"{out}: {counted(len(readable), 'take')}, {len(found) - len(readable)} left out")
    leaks = find_subject_leaks(take.listed for take in found)
    if leaks:
        raise ValueError(f"{path}: {len(leaks)} leaks; {leaks[0]}")
