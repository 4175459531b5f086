"""What formats of poses share: the reading of any of them, and the table of the sources of joints next to a file."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from glob import escape
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import DERIVED, convert
from dmae.data.skeleton import Skeleton
from dmae.data.store import MANIFEST, clip_folders
from dmae.files.contents import read_text, write_atomic, written
from dmae.files.mapped import empty, frame_blocks
from dmae.formats.registry import PoseReader, pose_reader

_BESIDE = (".provenance.csv", ".covariance.csv", ".angles.csv")  # Tables that are written beside poses
_PERSON = re.compile(r"_P\d+$")  # End of the names of files that contain one of several persons


@dataclass(frozen=True)
class PoseFile:
    """The content of a file or folder of poses."""

    poses: Poses3D  # (F, P, J, 3) m, world
    fps: float | None = None  # Frames per second; None if the file does not state it
    clip: str | None = None  # Id of the clip of these poses; None if the file does not state it
    first: int | None = None  # Number of the first frame in the recording; None if the file numbers none


def read_poses(path: Path) -> PoseFile:
    """Read the poses of one clip. The format is recognised by the name of the file, or by the files in the folder.

    Raises:
        FileNotFoundError: the path does not exist.
        ValueError: no format is recognised, or the file is malformed.
    """
    path = Path(path)
    found = _reader(path)
    if found is None and not path.exists():
        raise FileNotFoundError(f"{path}: expected poses, found no such file or folder")
    if found is None:
        raise ValueError(f"{path}: expected poses, {_expected(path)}; found none of them")
    try:
        return found.function(path)
    except KeyError as error:
        raise ValueError(error.args[0]) from None


def pose_paths(path: Path) -> dict[str, Path] | None:
    """Return the paths of poses of several clips, by clip id, `<id>.npz`, `<id>.trc`, `<id>/`; None for one clip.

    The path is a folder of pose files, or a data set of clips. Raises FileNotFoundError if it does not exist or has no
    poses, and ValueError if a clip has poses in two files.
    """
    path = Path(path)
    if _reader(path) is not None:
        return None
    if not path.exists():
        raise FileNotFoundError(f"{path}: expected poses, found no such file or folder")
    if (path / MANIFEST).is_file():
        return {folder.name: folder for folder in clip_folders(path)}
    found: dict[str, Path] = {}
    for item in sorted(path.iterdir()) if path.is_dir() else []:
        if _reader(item) is None:
            continue
        name = item.name
        if item.is_file():
            # Each person of a clip can have its own file. These files are read together.
            name = _PERSON.sub("", item.stem)
            item = item.with_stem(name)
        if found.setdefault(name, item) != item:
            raise ValueError(f"{path}: expected poses of clip {name!r} once, found {found[name].name} and {item.name}")
    if not found and path.is_file():
        raise ValueError(f"{path}: expected poses, {_expected(path)}; found another file")
    if not found:
        raise FileNotFoundError(f"{path}: expected poses, for each clip {_expected(path)}; found none")
    return found


def _reader(path: Path) -> PoseReader | None:
    if path.is_dir():
        return next((each for each in pose_reader.values() if any(any(path.glob(sign)) for sign in each.signs)), None)
    if path.name.endswith(_BESIDE):
        return None
    there = path.is_file() or any(path.parent.glob(f"{escape(path.stem)}_*{path.suffix}"))
    return next((each for each in pose_reader.values() if there and fnmatch(path.name, each.file)), None)


def _expected(path: Path) -> str:
    folders = " or ".join(each.signs[0] for each in pose_reader.values() if not each.file)
    formats = f"{', '.join(each.file for each in pose_reader.values() if each.file)} or a folder with {folders}"
    on_skin = " (markers of a C3D are on the skin, not at joints; our own poses as npz: docs/how-to/biomechanics.md)"
    return formats + on_skin * (path.suffix.lower() == ".c3d")


SOURCE_WORDS = {
    Source.ABSENT: "absent",
    Source.MEASURED: "measured",
    Source.DENOISED: "measured (smoothed)",
    Source.COMPLETED: "completed",
}
"""How the table of provenance calls the source of a joint."""
REJECTED = "completed (rejected)"
"""The same for a joint that cameras measured, if the measurement was rejected and the joint completed."""


def source_word(source: Source, views: int) -> str:
    """Return how the table of provenance calls the source of a joint that so many views measured."""
    return REJECTED if source == Source.COMPLETED and views else SOURCE_WORDS[source]


_NOT_ITS = "delete it if it is not its"


def write_provenance(path: Path, poses: Poses3D, fps: float, first: int, people: Sequence[str]) -> None:
    """Write `<name>.provenance.csv` beside a pose file: when each joint of each person was measured, in runs.

    It also has the joints that `convert` derives, so that all files of one run share it, whatever their skeleton. Poses
    have the skeleton of the capture. Frames are numbered from `first`; times count from the first frame of the file.
    `people` are the names of the persons.
    """
    skeleton = poses.skeleton
    if not skeleton.defined and len(skeleton.parts) == 1:
        joints = (*skeleton.joints, *(joint for joint in DERIVED if joint not in skeleton.joints))
        skeleton = Skeleton("all", joints, (-1,) * len(joints))
    # In blocks of frames, as a long recording does not fit into memory.
    source = empty((*poses.source.shape[:2], len(skeleton)), np.dtype(np.uint8))
    for part in frame_blocks(poses.cov):
        some = convert(poses.select(part), skeleton)
        source[part] = np.where(some.rejected, len(Source), some.source)
    names = [*(SOURCE_WORDS[kind] for kind in Source), REJECTED]

    def rows() -> Iterator[str]:
        yield "person,joint,first_frame,last_frame,first_s,last_s,source"
        for person in range(source.shape[1]):
            for number, joint in enumerate(skeleton.joints):
                kinds = source[:, person, number]
                if number >= len(poses.skeleton) and not kinds.any():
                    continue
                starts = np.r_[0, np.flatnonzero(np.diff(kinds)) + 1] if len(kinds) else []
                for start, end in zip(starts, [*starts[1:], len(kinds)], strict=True):
                    at, last = int(start), int(end) - 1
                    frames = f"{at + first},{last + first},{at / fps:.6f},{last / fps:.6f}"
                    yield f"{people[person]},{joint},{frames},{names[kinds[at]]}"

    write_atomic(provenance_table(path), written(rows()))


def read_provenance(path: Path, joints: Sequence[str], frames: int) -> np.ndarray | None:
    """Return the sources (F, J) of the named joints in a file of `person_paths`; None if there is no table beside it.

    Raises ValueError if the table is malformed, or has other frames or joints.
    """
    table, person = provenance_table(path), None
    if table.is_file():
        # A single file is one person, even if its name ends like one of several: squat_P2.
        person = next(iter(provenance_people(path)), None)
    else:
        splits = [(path.stem[:at], path.stem[at + 1 :]) for at, letter in enumerate(path.stem) if letter == "_"]
        for name, person in splits:
            table = provenance_table(path.with_stem(name))
            if person in provenance_people(path.with_stem(name)) or (table.is_file() and _PERSON.match(f"_{person}")):
                break
        else:
            return None
    source, first = np.full((frames, len(joints)), -1), None
    kinds = {word: kind for kind, word in SOURCE_WORDS.items()} | {REJECTED: Source.COMPLETED}
    place = {joint: number for number, joint in enumerate(joints)}
    for number, line in enumerate(read_text(table).splitlines()[1:], 2):
        cells = line.split(",")
        try:
            start, end, kind = int(cells[2]), int(cells[3]), kinds[cells[6]]
        except (ValueError, IndexError, KeyError):
            raise ValueError(
                f"{table}, line {number}: expected {', '.join(kinds)} in some frames, found {line!r:.80}"
            ) from None
        first = start if first is None else first
        if cells[0] == person and cells[1] in place:
            if not first <= start <= end < first + frames:
                raise ValueError(f"{table}, line {number}: expected frames of the {frames} in {path.name}; {_NOT_ITS}")
            source[start - first : end + 1 - first, place[cells[1]]] = kind
    if (source < 0).any():
        raise ValueError(f"{table}: expected all {frames} frames and joints of {path.name}; {_NOT_ITS}")
    return source


def provenance_people(path: Path) -> list[str]:
    """Return the names of the persons in the table of sources of a pose file, in their order; none without a table."""
    table = provenance_table(path)
    lines = read_text(table).splitlines()[1:] if table.is_file() else []
    return [*dict.fromkeys(line.split(",", 1)[0] for line in lines)]


def provenance_table(path: Path) -> Path:
    """Return the path of the table of sources, by the name that the pose files of all persons share."""
    return Path(path).with_suffix(".provenance.csv")


def person_paths(path: Path, people: Sequence[str]) -> list[Path]:
    """Return one path per named person: `<name>_P1.<suffix>` and so on, or only `path` if there is one person.

    Raises ValueError if there are files of other persons: readers would take them for a part of what is written.
    """
    path = Path(path)
    paths = [path] if len(people) == 1 else [path.with_name(f"{path.stem}_{name}{path.suffix}") for name in people]
    for other in sorted(path.parent.glob(f"{escape(path.stem)}*{path.suffix}")):
        if other not in paths and _PERSON.sub("", other.stem) == path.stem:
            raise ValueError(
                f"{other}: of an earlier export with other people; this one writes "
                f"{', '.join(each.name for each in paths)}. Remove the earlier files, or choose another out"
            )
    return paths


def stay(poses: Poses3D, person: int) -> tuple[int, int]:
    """Return the first and the last frame in which a person is known; IndexError if there is none."""
    known = np.flatnonzero((poses.source[:, person] != Source.ABSENT).any(-1)).tolist()
    return known[0], known[-1]


def describe_filled(poses: Poses3D, people: Sequence[str], fills: str) -> list[str]:
    """Say of each person how much an exported file holds that is not known; `fills` as in `PoseWriter`."""
    said, count = [], len(poses.xyz)
    for person, name in enumerate(people):
        known = poses.source[:, person] != Source.ABSENT
        if not known.any():
            continue
        first, last = stay(poses, person) if fills == "stay" else (0, count - 1)
        rows = known[first : last + 1]
        if not rows[:, known.any(0)].all() or len(rows) < count:
            there, filled = rows.any(-1).sum(), 1 - rows[:, known.any(0)].mean()
            then = f"; {filled:.1%} of its joints are absent there, and filled" if filled else ""
            said.append(f"{name}: frames {first} to {last} of {count}, with joints in {there} of them{then}")
    return said


REGIONS = (
    "covariances of completed joints are too small on real recordings: regions stated to hold 90 % of them held 55 to "
    "87 % on Shelf"
)
"""What readers of stated errors should know; the figures are those of `docs/explanation/uncertainty.md`."""


def states_completed(poses: Poses3D) -> bool:
    """Whether completed joints state a covariance."""
    return bool(np.isfinite(poses.cov[..., 0, 0][poses.source == Source.COMPLETED]).any())


_STEP_M = 1e-4


def pixel_covariances(poses: Poses3D, rig: CameraRig) -> np.ndarray | None:
    """Return covariances (F, V, P, J, 3) px^2, xx, xy, yy, of projected joints, to first order; None if unknown."""
    if not np.isfinite(poses.cov).any():
        return None
    xyz, cov = poses.xyz.astype(np.float64), poses.cov.astype(np.float64)
    steps = [rig.project(xyz + sign * _STEP_M * axis)[0] for axis in np.eye(3) for sign in (1, -1)]
    by_xyz = np.stack(
        [(ahead - behind) / (2 * _STEP_M) for ahead, behind in zip(steps[::2], steps[1::2], strict=True)], -1
    )
    found = by_xyz @ cov[:, None] @ by_xyz.swapaxes(-1, -2)
    return np.stack([found[..., 0, 0], found[..., 0, 1], found[..., 1, 1]], -1)


def covariance_entry(covariance: np.ndarray) -> list[list[float] | None]:
    """Return covariances (J, 3) px^2 as lists for JSON, rounded to 0.0001; None for joints where unknown."""
    known = np.isfinite(covariance).all(-1)
    return [row if there else None for row, there in zip(covariance.round(4).tolist(), known, strict=True)]
