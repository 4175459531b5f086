"""Damage a data set with images, and verify it: `python -m tests.endurance.damages --flips 500 --structural 60`.

A flip changes one random bit of a file. Kinds of files take turns, so that small ones are hit as often as large.
Structural damages are those of `tests.support.damages`, each in turn. After each damage the data set is restored.
"""

import argparse
import json
import shutil
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

from dmae.progress import progress
from synth.datasets.config import GenerateConfig
from synth.datasets.generate import generate
from synth.datasets.verify import verify
from synth.rendering.config import ImageQuality
from synth.rigs.config import RigConfig, RingConfig
from synth.scene.config import SceneConfig
from tests.support.damages import OWN, flip_bit, structural


def data_set(out: Path, **options) -> GenerateConfig:
    """Return the configuration of three clips in three frames of two cameras, with all images."""
    return GenerateConfig(
        out=str(out),
        seed=3,
        clips=3,
        images=["all"],
        quality=ImageQuality.draft,
        scene=SceneConfig(persons=[1, 1], seconds=0.12),
        rig=RigConfig(ring=RingConfig(views=2, focal=90, size=[96, 72])),
        **options,
    )


def restore(data: Path, sound: Path) -> None:
    """Put the sound data set in the place of a damaged one."""
    shutil.rmtree(data)
    shutil.copytree(sound, data)


def undetected(data: Path, sound: Path, name: str, concerned: set[str]) -> list[str]:
    """Verify a damaged data set, restore it, and return what was not found."""
    found = verify(data)
    restore(data, sound)
    named = {problem.clip for problem in found.problems}
    missed = [] if concerned <= named else [f"{name}: {concerned} among {named}"]
    return missed + ([] if set(found.again) >= concerned - OWN else [f"{name}: {concerned} not to be made again"])


def flip_often(count: int, data: Path, sound: Path, seed: int = 0) -> list[str]:
    """Flip one bit at a time; return which were not found."""
    rng = np.random.default_rng(seed)
    missed = []
    for number in progress(range(count), "flipping bits", count):
        missed += undetected(data, sound, f"flip {number}", flip_bit(data, number, rng))
    return missed


def damage_often(count: int, data: Path, sound: Path, seed: int = 0) -> list[str]:
    """Do each structural damage in turn, at random clips and files; return which were not found."""
    rng, missed = np.random.default_rng(seed), []
    for number in progress(range(count), "damaging", count):
        possible = list(structural(data, rng))
        name, damage = possible[number % len(possible)]
        missed += undetected(data, sound, name, damage())
    return missed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flips", type=int, default=500, help="bits that are flipped, one at a time")
    parser.add_argument("--structural", type=int, default=60, help="structural damages")
    parser.add_argument("--out", type=Path, help="JSON file of the figures")
    asked = parser.parse_args()
    warnings.filterwarnings("ignore", "no OpenGL")
    made: dict = {"command": f"python -m tests.endurance.damages --flips {asked.flips} --structural {asked.structural}"}
    with tempfile.TemporaryDirectory() as folder:
        sound, data = Path(folder, "sound"), Path(folder, "data")
        generate(data_set(sound))
        shutil.copytree(sound, data)
        files = [path for path in sound.rglob("*") if path.is_file()]
        made |= {"files": len(files), "bytes": sum(path.stat().st_size for path in files)}
        for name, often, count in (("flips", flip_often, asked.flips), ("structural", damage_often, asked.structural)):
            missed = often(count, data, sound)
            made[name] = {"damages": count, "found": count - len(missed), "missed": missed}
            print(f"{name}: {count - len(missed)} of {count} found", *missed, sep="\n", flush=True)
            if asked.out:
                asked.out.write_text(json.dumps(made, indent=1) + "\n")
    sys.exit(any(made[name]["missed"] for name in ("flips", "structural")))


if __name__ == "__main__":
    main()
