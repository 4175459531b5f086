"""Definitions of benchmarks: their clips, and the options and seeds that generate them."""

import hashlib
import json
import re
import shlex
import subprocess
import sys
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from importlib import metadata
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip
from dmae.data.json_values import decode
from dmae.data.labels import Visibility
from dmae.data.resources import resource_folder
from dmae.data.resume import claim_folder
from dmae.data.store import load_clip, read_manifest, save_clip
from dmae.evaluation.config import BenchmarkSize
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json, read_yaml
from dmae.parallel import backend_in_use, in_parallel
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from dmae.registry import unknown

_GROUPS = ("scene", "props", "motion", "interaction", "rig", "detector", "occlusion", "retries")
"""Options of `synth generate` that a definition can contain. The others set the output and the number of clips."""
_NAME = re.compile(r"[a-z][a-z0-9_]*")


_MOST_CLIPS = 1_000_000
"""Of a set."""


@dataclass(frozen=True)
class ClipSet:
    """Clips of one level that are made with the same options.

    Attributes:
        folder: `<number>_<level>/<set>`.
        level: Index of the level.
        options: Options of `synth generate`.
        seed: Seed of the data set.
        clips: Number of clips.
    """

    folder: str
    level: int
    options: tuple[str, ...]
    seed: int
    clips: int

    @property
    def ids(self) -> list[str]:
        """The ids of the clips: their paths in the benchmark's folder of clips."""
        return [f"{self.folder}/{number:06d}" for number in range(self.clips)]


@dataclass(frozen=True)
class Level:
    """A level of difficulty.

    Attributes:
        name: The main cause of its holes.
        about: One sentence about the level.
        sets: Options of `synth generate` for each set, as on a command line, by the name of the set.
        options: Options for all its sets. The options of a set override them.
    """

    name: str
    about: str
    sets: dict[str, str]
    options: str = ""

    def __post_init__(self):
        for name in (self.name, *self.sets):
            if not _NAME.fullmatch(name):
                raise ValueError(f"level {self.name!r}: expected names of small letters, digits and _, found {name!r}")
        if not self.sets:
            raise ValueError(f"level {self.name!r} has no sets")
        for options in (self.options, *self.sets.values()):
            split_options(options)


@dataclass(frozen=True)
class Definition:
    """A benchmark.

    Attributes:
        about: One sentence about the benchmark.
        seed: Seed of the whole benchmark.
        small, full: Number of clips of each set, by size. The small size uses the first clips of the full size.
        levels: Levels in the order of difficulty.
        options: Options of `synth generate` for all clips. The options of a level override them, and those of a set
            override both.
        file: File of the definition.
    """

    about: str
    seed: int
    small: int
    full: int
    levels: list[Level]
    options: str = ""
    file: str = ""

    def __post_init__(self):
        if self.seed < 0 or not 1 <= self.small <= self.full <= _MOST_CLIPS:
            raise ValueError(
                f"expected seed >= 0, 1 <= small <= full <= {_MOST_CLIPS} clips a set, found seed {self.seed}, small "
                f"{self.small}, full {self.full}"
            )
        names = [level.name for level in self.levels]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"expected levels, each with a name of its own, found {names}")
        split_options(self.options)

    @property
    def name(self) -> str:
        return Path(self.file).stem

    @property
    def checksums(self) -> Path:
        """The file of the published checksums, in the folder of the definition."""
        return Path(self.file).with_suffix(".checksums.json")

    def sets(self, size: BenchmarkSize) -> list[ClipSet]:
        """Return the sets of clips. Each has its own seed."""
        found = []
        for number, level in enumerate(self.levels):
            for name, options in level.sets.items():
                chosen = tuple(
                    option for part in (self.options, level.options, options) for option in split_options(part)
                )
                seed = self.seed * 1000 + len(found)
                clips = self.small if size == BenchmarkSize.small else self.full
                found.append(ClipSet(f"{number + 1}_{level.name}/{name}", number, chosen, seed, clips))
        return found


def split_options(options: str) -> list[str]:
    """Return the options of a command line as a list.

    Raises:
        ValueError: one of them is not an option of `synth generate` that a definition can contain.
    """
    found = shlex.split(options)
    for option in found:
        if "=" not in option or re.split(r"[.=]", option)[0] not in _GROUPS:
            raise ValueError(f"option {option!r}: expected key=value of one of {', '.join(_GROUPS)}")
    return found


def find_definition(name: str) -> Definition:
    """Return the benchmark of this name, or the benchmark that a YAML file defines.

    Raises:
        ValueError: the benchmark does not exist, or its file is malformed; the message names the file and the field.
    """
    file = Path(name)
    if file.suffix != ".yaml":
        shipped = {path.stem: path for path in (resource_folder("dmae", "configs") / "benchmark").glob("*.yaml")}
        if name not in shipped:
            raise ValueError(f"name={name}: {unknown('benchmark', name, sorted(shipped))}, or a .yaml file of your own")
        file = shipped[name]
    if not file.is_file():
        raise FileNotFoundError(f"name={name}: no such file")
    try:
        return replace(decode(Definition, read_yaml(file), file.name), file=str(file))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file}: expected a benchmark, as configs/benchmark/occlusion-v2.yaml: {error}") from None


# Frozen checksums: check that the clips generated here are the clips of the published scores.

_LABELS = (
    "rig.K", "rig.dist", "rig.cam_from_world", "rig.size", "truth.xyz", "occlusion.visibility", "occlusion.occluder",
)  # fmt: skip
_DETECTIONS = ("detections.xy", "detections.score", "detection_labels.person", "detection_labels.error")
PARTS = {"labels": _LABELS, "detections": _DETECTIONS}
"""The arrays that each checksum covers."""

_NEAR_M, _NEAR_SHARE = 0.02, 0.02
"""Clips are near if the centres of people differ by at most this distance, m, and the numbers of visible and of
detected joints differ by at most this share."""


class FrozenMatch(StrEnum):
    """Agreement of the clips here with the frozen ones, the best first."""

    equal = "equal"
    """Byte for byte."""
    near = "near"
    """The same scenes up to how this processor rounds. Scores differ in their last digits."""
    unchecked = "unchecked"
    """No checksums are frozen."""


def clip_checksums(clip: Clip) -> dict[str, str]:
    """Return two SHA-256 checksums of a clip: of its cameras and labels, and of its detections.

    They cover the types, shapes and bytes of the arrays. All NaN are equal, and the byte order is little-endian. Raises
    AttributeError if the clip has no labels.
    """
    return {part: _digest(clip, names) for part, names in PARTS.items()}


def freeze(clips: dict[str, Clip], file: Path) -> None:
    """Write the checksums of all clips by id, and the versions of the packages that made them.

    Raises:
        ValueError: the file exists. Frozen checksums never change; a new version of a benchmark has its own file.
    """
    if Path(file).exists():
        raise ValueError(
            f"{file}: exists; stored checksums are not overwritten. Remove the file only if no scores are published yet"
        )
    versions = next(iter(clips.values())).provenance.get("versions", {})
    # Write one line per clip.
    lines = ",\n".join(
        f"  {json.dumps(name)}: {json.dumps({**clip_checksums(clip), 'sample': _sample(clip)})}"
        for name, clip in sorted(clips.items())
    )
    write_atomic(file, f'{{\n "versions": {json.dumps(versions)},\n "clips": {{\n{lines}\n }}\n}}\n')


def check_clip(name: str, clip: Clip, file: Path) -> FrozenMatch:
    """Compare a clip with the frozen checksums and, if they differ, with the frozen sample of the clip.

    Contacts in the simulation amplify rounding differences between processors: without AVX2, joints differ by
    millimetres. Clips with such differences are `near`.

    Raises:
        ValueError: the clip is a different one; the message names the clip, the differences, and the likely reason.
    """
    frozen = read_json(file)
    if name not in frozen["clips"]:
        raise ValueError(
            f"clip {name}: has no checksum in {file}; the definition was changed after its checksums were stored"
        )
    found, expected = clip_checksums(clip), frozen["clips"][name]
    differing = [part for part in PARTS if found[part] != expected[part]]
    if not differing:
        return FrozenMatch.equal
    own = clip.provenance.get("versions", {})
    others = [
        f"{package} {version}, here {own.get(package)}"
        for package, version in frozen["versions"].items()
        if own.get(package) != version and package != "python"
    ]
    if not others and _is_near(_sample(clip), expected["sample"]):
        return FrozenMatch.near
    reason = (
        f"it was frozen with {'; '.join(others)}. Install the pinned versions: pip install -c constraints.txt"
        if others
        else "the versions are the same, so that the generator was changed since"
    )
    raise ValueError(
        f"clip {name}: its {' and '.join(differing)} are not those of the benchmark ({file.name}), so that scores "
        f"would not be comparable. Likely reason: {reason}"
    )


def _sample(clip: Clip) -> dict:
    """Return a small sample of a clip. It identifies the clip even if rounding differs."""
    frames = [0, len(clip) // 2, len(clip) - 1]
    middle = np.nanmean(clip.truth.xyz[frames].astype(np.float64), 2)
    return {
        "middle_m": np.nan_to_num(middle, nan=0.0).round(3).tolist(),
        "visible": int((clip.occlusion.visibility == Visibility.VISIBLE).sum()),
        "detected": int(clip.detections.observed.sum()),
    }


def _is_near(found: dict, frozen: dict) -> bool:
    one, other = (np.array(each["middle_m"]) for each in (found, frozen))
    if one.shape != other.shape or np.abs(one - other).max() > _NEAR_M:
        return False
    return all(abs(found[key] - frozen[key]) <= _NEAR_SHARE * frozen[key] for key in ("visible", "detected"))


def _digest(clip: Clip, names: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for name in names:
        owner, _, field = name.partition(".")
        array = np.asarray(getattr(getattr(clip, owner), field))
        array = array.astype(array.dtype.newbyteorder("<"))
        if array.dtype.kind == "f":
            array = np.where(np.isnan(array), array.dtype.type(np.nan), array)
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


# The clips of a benchmark on disk: generated by `synth`, checked, and captured once for all methods.

CLIPS, GIVEN = "clips", "given"
"""Folders of the benchmark's data: simulated clips, and the captured data that methods may use."""


def make_clips(definition: Definition, size: BenchmarkSize, data: Path, workers: int = 1) -> FrozenMatch:
    """Generate, check and capture those clips of a benchmark that do not exist yet.

    In `data`, the folder `clips/<id>` contains each clip with its truth and labels. The folder `given/<id>` contains
    the data that methods get: cameras, detections, and the poses that our capture computes from them.

    Args:
        definition: The benchmark.
        size: Size of the benchmark, which sets the number of clips.
        data: The data folder. Its whole content can be regenerated.
        workers: Number of processes; -1 for one per core.

    Returns:
        The agreement of the clips with the frozen ones: that of the worst clip.

    Raises:
        ValueError: the folder contains another benchmark, a clip cannot be generated, or a clip differs from the frozen
            one.
    """
    claim_folder(data / "benchmark.json", asdict(replace(definition, file=definition.name)), "a benchmark")
    # Captured poses depend on more settings than clips.
    made_by = {"capture": asdict(CaptureConfig()), "version": metadata.version("dmae-synth")}
    claim_folder(data / GIVEN / "capture.json", made_by, "poses captured")
    sets = definition.sets(size)
    for each in progress(sets, "generating sets of clips"):
        _generate(each, data, workers)
    ids = [name for each in sets for name in each.ids]
    tasks = [(definition, data, name) for name in ids]
    found = list(progress(in_parallel(_prepare, tasks, workers), "checking and capturing clips", len(ids)))
    return max(found, key=[*FrozenMatch].index)


def clip_of(data: Path, name: str) -> Clip:
    """Return a clip of a benchmark with its truth and labels."""
    return load_clip(data / CLIPS / name)


def given_clip(data: Path, name: str) -> Clip:
    """Return the data of a clip that methods get: cameras, detections and captured poses, without truth."""
    return load_clip(data / GIVEN / name)


def _generate(each: ClipSet, data: Path, workers: int) -> None:
    """Generate a set of clips unless it is complete.

    It runs the command `synth generate`, because this package does not import the simulator.
    """
    folder = data / CLIPS / each.folder
    if all((data / CLIPS / name / "clip.json").is_file() for name in each.ids):
        return
    command = [
        sys.executable, "-m", "synth.cli", "generate", f"out='{folder}'", f"seed={each.seed}", f"clips={each.clips}",
        f"workers={workers}", f"backend={backend_in_use()}", *each.options,
    ]  # fmt: skip
    if "'" in str(folder):
        raise ValueError(f"out: expected a path without quotes, found {folder}")
    if subprocess.run(command, stdout=subprocess.PIPE).returncode:
        raise ValueError(f"{each.folder}: synth generate failed for the reason above; options: {' '.join(command[4:])}")
    failed = [line for line in read_manifest(folder) if line["status"] != "ok"]
    if failed:
        raise ValueError(f"{each.folder}/{failed[0]['id']}: could not be generated: {failed[0]['reason']}")


def _prepare(definition: Definition, data: Path, name: str) -> FrozenMatch:
    """Check a clip, and capture it if its capture does not exist yet."""
    clip = clip_of(data, name)
    frozen = definition.checksums.is_file()
    agreement = check_clip(name, clip, definition.checksums) if frozen else FrozenMatch.unchecked
    if not (data / GIVEN / name / "clip.json").is_file():
        seen = replace(
            clip, truth=None, occlusion=None, detection_labels=None, true_rig=None, id=name.replace("/", "-")
        )
        save_clip(replace(seen, poses=capture(seen, CaptureConfig()), provenance={}), data / GIVEN / name)
    return agreement
