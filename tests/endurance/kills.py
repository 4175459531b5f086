"""Kill commands at random moments, and give them again: `python -m tests.endurance.kills --moments 20`.

Generation, capture and training are each killed by SIGKILL, which leaves a process no time to tidy up. The workers of
generation live for another half second. The same command then has to end with the files of a command that was never
killed. Only what is killed runs in a process of its own, because imports take longer than these commands.
"""

import argparse
import json
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.support.commands import command_line, run_command

_SMALL = (
    "model.encoder.dim=16", "model.encoder.depth=1", "model.encoder.heads=2", "model.encoder.head_dim=8",
    "model.encoder.mlp=32", "model.decoder.dim=8", "model.codes.signal=8",
)  # fmt: skip
# An epoch ends with a checkpoint, of which the last two are kept; examples are made anew for each, which takes longest.
_SHORT = ("learning.steps=6", "learning.epoch=2", "learning.batch=4")
_MADE = ("seed=3", "clips=6", "scene.seconds=0.6", "scene.persons=[1,2]", "workers=2")
LINES = {
    "generation": ("synth", "generate", *_MADE),
    "capture": ("dmae", "capture", "data=../generation/out"),
    "training": ("dmae", "train", "data=../capture/out", *_SHORT, *_SMALL),
}
"""What is killed. Each command starts from what the one before has made."""
_UNLIKE = ("tensorboard", "checkpoint")
"""Beginnings of the names of files that hold times of day, or what only a run that goes on needs."""


@dataclass(frozen=True)
class Kill:
    """What became of a command that was killed.

    Attributes:
        moment: When it was killed, s after it had made its folder.
        whole: Number of files that it had written by then.
        same: Whether the same command then made the files that it makes undisturbed.
    """

    moment: float
    whole: int
    same: bool


def run_undisturbed(folder: Path) -> dict[str, float]:
    """Run each command in a folder of its name; return how long it took, s, after it had written its first file."""
    took = {}
    for name in LINES:
        (folder / name).mkdir()
        run_here(name, folder / name)
        files = (path for path in (folder / name / "out").rglob("*") if path.is_file())
        took[name] = time.time() - min(path.stat().st_mtime for path in files)
    return took


def run_here(name: str, place: Path) -> None:
    """Run a command to its end, in this process."""
    done = run_command(place, *LINES[name], "out=out")
    assert done.returncode == 0, done.stderr


def kill_often(name: str, moments: int, folder: Path, took: float, seed: int = 0, first: int = 0) -> Iterator[Kill]:
    """Kill a command at random moments, each time in a new folder; yield what became of it.

    Args:
        name: One of `LINES`.
        folder: That `run_undisturbed` was given.
        took: How long the command took undisturbed, s.
        seed: Of the moments.
        first: Number of moments that are left out.
    """
    rng, expected = random.Random(f"{seed} {name}"), _contents(folder / name / "out")
    for number in range(moments):
        moment = rng.uniform(0, took)
        if number < first:
            continue
        place = folder / f"{name}_{number}"
        place.mkdir()
        process = _start(name, place)
        time.sleep(moment)
        process.kill()
        process.wait()
        whole = len(_contents(place / "out"))
        run_here(name, place)
        kill = Kill(moment, whole, _contents(place / "out") == expected)
        if kill.same:
            shutil.rmtree(place)
        yield kill


def _start(name: str, place: Path) -> subprocess.Popen:
    """Start a command, and wait until it has made its folder, or has ended."""
    line = command_line(*LINES[name], "out=out")
    process = subprocess.Popen(line, cwd=place, stdout=subprocess.DEVNULL)
    while not (place / "out").exists() and process.poll() is None:
        time.sleep(0.01)
    return process


def _contents(out: Path) -> dict[str, bytes]:
    """Return the files of a folder, those of unfinished clips among them."""
    files = (path for path in out.rglob("*") if path.is_file())
    named = {path.relative_to(out).as_posix(): path for path in files}
    return {name: path.read_bytes() for name, path in named.items() if not name.startswith(_UNLIKE)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=20, help="kills of each command")
    parser.add_argument("--commands", nargs="*", default=list(LINES), choices=LINES, help="what is killed")
    parser.add_argument("--out", help="JSON file of the figures; a run goes on where it ends")
    asked = parser.parse_args()
    made = {"command": f"python -m tests.endurance.kills --moments {asked.moments}", "found": {}}
    if asked.out and Path(asked.out).is_file():
        made["found"] = json.loads(Path(asked.out).read_text())["found"]
    with tempfile.TemporaryDirectory() as folder:
        took = run_undisturbed(Path(folder))
        for name in asked.commands:
            found = made["found"].setdefault(name, {"kills": 0, "same": 0, "with_files": 0})
            if found["kills"] >= asked.moments:
                continue
            for kill in kill_often(name, asked.moments, Path(folder), took[name], first=found["kills"]):
                found["kills"] += 1
                found["same"] += kill.same
                found["with_files"] += kill.whole > 0
                if asked.out:
                    Path(asked.out).write_text(json.dumps(made, indent=1) + "\n")
            counts = (
                f"{found['same']} of {found['kills']} end with the same files; {found['with_files']} had written some"
            )
            print(f"{name}: {counts}", flush=True)
    sys.exit(any(each["same"] < each["kills"] for each in made["found"].values()))


if __name__ == "__main__":
    main()
