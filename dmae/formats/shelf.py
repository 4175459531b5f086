"""The Shelf recording in the text format of the 4DAssociation release; cameras of it and of VoxelPose in JSON."""

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25, SHELF14
from dmae.files.checks import MOST_METRES, child
from dmae.files.contents import read_text
from dmae.files.structured import read_json
from dmae.formats.calibrations import CameraTable, ParsedCamera, calibration_format, camera_tables, make_rig
from dmae.formats.config import Convention, LengthUnit
from dmae.formats.registry import reader

FPS = 25.0
FIRST_FRAME = 300
"""Number in the published recording of the first frame of the release."""
ANNOTATION_ERROR = {
    "ankle": 0.017, "knee": 0.019, "hip": 0.044, "wrist": 0.028, "elbow": 0.017, "shoulder": 0.024,
    "bottom_head": 0.021, "top_head": 0.072,
}  # fmt: skip
"""m along each axis; how far the annotators' joints lie from those that at least three cameras agree on (the median
distance, less the stated error of the latter). Hips and heads were annotated where OpenPose does not see them."""
_BODY25_TYPE = 4
_TRUTH_JOINTS = 15
_ACTORS = 4


def _camera(entry: CameraTable) -> ParsedCamera:
    pose = entry.numbers("RT", 12).reshape(3, 4)
    R = entry.rotation("RT", pose[:, :3])
    return ParsedCamera(entry.camera, entry.intrinsics("K"), np.zeros(5), R, pose[:, 3], entry.size("imgSize"))


def _is_shelf(content: object) -> bool:
    return bool(_keys(content) & {"RT", "imgSize"})


def _keys(content: object) -> set:
    cameras = content.values() if isinstance(content, dict) else ()
    return {key for camera in cameras if isinstance(camera, dict) for key in camera}


@calibration_format("shelf", syntax="json", matches=_is_shelf, files=("*alib*.json", "*alib*/*.json"))
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """JSON cameras with K, RT, imgSize (4DAssociation).

    Return the cameras of the file: cam_from_world, m.
    """
    return make_rig(path, map(_camera, camera_tables(path, read_json(path))), size)


def _voxelpose_camera(entry: CameraTable) -> ParsedCamera:
    fx, fy, cx, cy = (entry.numbers(key, 1).item() for key in ("fx", "fy", "cx", "cy"))
    entry.check_focal("fx", fx)
    entry.check_focal("fy", fy)
    (k1, k2, k3), (p1, p2) = entry.numbers("k", 3), entry.numbers("p", 2)
    R = entry.rotation("R")
    return ParsedCamera(
        entry.camera,
        np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        np.array([k1, k2, p1, p2, k3]),
        R,
        -R @ entry.numbers("T", 3),
        None,
    )


def _is_voxelpose(content: object) -> bool:
    return bool(_keys(content) & {"T", "fx", "fy"}) and not _is_shelf(content)


@calibration_format(
    "voxelpose",
    syntax="json",
    matches=_is_voxelpose,
    convention=Convention(unit=LengthUnit.mm),
    files=("*alib*.json", "*alib*/*.json"),
)
def read_voxelpose_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """JSON cameras with R, T, fx (VoxelPose).

    Return the cameras of the file: cam_from_world, mm. `T` is the centre of the camera: x = R (X - T).

    The files contain no image sizes (Shelf 1032 x 776 px, Campus 360 x 288 px).
    """
    return make_rig(path, map(_voxelpose_camera, camera_tables(path, read_json(path))), size)


@reader("shelf", signs=[["calibration.json", "detection/*.txt"]])
def read_shelf(path: Path) -> Clip:
    """The Shelf recording as 4DAssociation releases it: calibration.json, detection/<camera>.txt, maybe gt.txt.

    Detections are assembled from joint candidates and part affinities. The truth contains the actors 0 to 3, with NaN
    where an actor is not annotated, and the covariance of `ANNOTATION_ERROR`.

    Raises:
        FileNotFoundError: the calibration, or the detections of one of its cameras, are missing.
        ValueError: a file is malformed or cut short, or the files do not fit together.
    """
    path = Path(path)
    rig = read_cameras(path / "calibration.json")
    files = [child(path / "detection", f"{name}.txt", "camera") for name in rig.names]
    views = [_read_detections(file, size) for file, size in zip(files, rig.size, strict=True)]
    frames = len(views[0])
    for name, view in zip(rig.names, views, strict=True):
        if len(view) != frames:
            raise ValueError(
                f"{path / 'detection' / f'{name}.txt'}: expected {frames} frames as in {rig.names[0]}.txt, "
                f"found {len(view)}"
            )
    most = max(len(found) for view in views for found in view)
    values = np.full((frames, len(views), most, len(BODY25), 3), np.nan)
    for v, view in enumerate(views):
        for f, found in enumerate(view):
            values[f, v, : len(found)] = found
    truth = path / "gt.txt"
    return Clip(
        id=path.name or "shelf",
        fps=FPS,
        rig=rig,
        detections=Detections2D(BODY25, values[..., :2], values[..., 2]),
        truth=_read_truth(truth, frames) if truth.is_file() else None,
        provenance={"format": "shelf", "path": str(path), "first_frame": FIRST_FRAME},
    )


class _Numbers:
    """A text file read as a stream of numbers; errors name file, line and position."""

    def __init__(self, path: Path):
        self.path, self.place, self.position = path, "header", 0
        self.tokens = read_text(path).split()
        try:
            self.values = np.array(self.tokens, np.float64)
        except ValueError:
            self.values = np.array([_number(token) for token in self.tokens])
        self.finite = int(np.argmin(np.append(np.abs(self.values) < MOST_METRES, False)))

    def error(self, expected: str, found: str) -> ValueError:
        ends = np.cumsum([len(line.split()) for line in read_text(self.path).splitlines()])
        line = max(min(np.searchsorted(ends, self.position, side="right") + 1, len(ends)), 1)
        place = f"line {line}, number {self.position + 1}, {self.place}"
        return ValueError(f"{self.path}, {place}: expected {expected}, found {found}")

    def take(self, length: int, what: str) -> np.ndarray:
        """Return the next `length` numbers."""
        start, end = self.position, self.position + length
        if end > self.finite:
            self.position = self.finite if end <= len(self.values) else len(self.values)
            if end > len(self.values):
                raise self.error(f"{length} numbers ({what})" if length > 1 else what, "the end of the file")
            raise self.error(f"a finite number ({what})", self.tokens[self.position])
        self.position = end
        return self.values[start:end]

    def count(self, what: str, at_most: int = 1_000_000) -> int:
        """Return the next number, which must be a whole number from 0 to `at_most`."""
        value = self.take(1, what).item()
        if value != int(value) or not 0 <= value <= at_most:
            self.position -= 1
            raise self.error(f"{what}, a whole number from 0 to {at_most}", self.tokens[self.position])
        return int(value)

    def header(self, kind: int, what: str) -> int:
        """Check the two numbers at the start of a file, its kind and its number of frames. Return the second."""
        found = self.count(what)
        if found != kind:
            self.position = 0
            raise self.error(f"{what} {kind}", str(found))
        frames = self.count("number of frames")
        if frames == 0:
            self.position = 1
            raise self.error("at least one frame", "0")
        return frames

    def end(self) -> None:
        if self.position < len(self.values):
            raise self.error("the end of the file", f"{len(self.values) - self.position} more numbers")


def _number(token: str) -> float:
    try:
        return float(token)
    except ValueError:
        return np.nan


def _read_detections(path: Path, size: np.ndarray) -> list[np.ndarray]:
    """Return a (D, 25, 3) array of x, y in px and confidence for each frame."""
    numbers = _Numbers(path)
    frames = numbers.header(_BODY25_TYPE, "skeleton type")
    scale = np.array([size[0] - 1, size[1] - 1, 1.0])
    found = []
    for frame in range(frames):
        candidates, counts, affinities = [], [], []
        for joint in BODY25.joints:
            numbers.place = f"frame {frame}, {joint}"
            count = numbers.count("number of candidates")
            counts.append(count)
            candidates.append(numbers.take(3 * count, "x, y and confidence of candidates").reshape(3, count))
        for a, b in BODY25_LINKS:
            numbers.place = f"frame {frame}, affinity {a}-{b}"
            affinities.append(numbers.take(counts[a] * counts[b], "affinities"))
        skeletons = assemble(counts, affinities)
        start = np.cumsum([0, *counts[:-1]])
        # An extra last row of NaN for joints without a candidate: index -1 selects it.
        rows = np.concatenate([*candidates, np.full((3, 1), np.nan)], 1).T * scale
        found.append(rows[np.where(skeletons >= 0, skeletons + start, -1)])
    numbers.place = f"after frame {frames - 1}"
    numbers.end()
    return found


def _read_truth(path: Path, frames: int) -> Poses3D:
    numbers = _Numbers(path)
    found = numbers.header(_TRUTH_JOINTS, "number of joints")
    if found != frames:
        numbers.position = 1
        raise numbers.error(f"{frames} frames as in the detections", str(found))
    xyz = np.full((frames, _ACTORS, len(SHELF14), 3), np.nan)
    for frame in range(frames):
        numbers.place = f"frame {frame}"
        seen = []
        for _ in range(numbers.count("number of persons", at_most=_ACTORS)):
            actor = numbers.count("actor id", at_most=_ACTORS - 1)
            if actor in seen:
                numbers.position -= 1
                raise numbers.error("an actor once a frame", f"actor {actor} again")
            seen.append(actor)
            # The 15th joint is the mean of the hips.
            rows = numbers.take(4 * _TRUTH_JOINTS, f"joints of actor {actor}").reshape(4, _TRUTH_JOINTS)[:, :-1]
            xyz[frame, actor] = np.where(rows[3, :, None] > 0, rows[:3].T, np.nan)
    numbers.place = f"after frame {frames - 1}"
    numbers.end()
    error = [ANNOTATION_ERROR[joint.removeprefix("l_").removeprefix("r_")] for joint in SHELF14.joints]
    known = ~np.isnan(xyz).any(-1)
    variance = np.where(known, np.square(error), np.nan)
    return Poses3D(SHELF14, xyz, cov=variance[..., None, None] * np.eye(3))


BODY25_LINKS = (
    (1, 8), (9, 10), (10, 11), (8, 9), (8, 12), (12, 13), (13, 14), (1, 2), (2, 3), (3, 4), (2, 17), (1, 5), (5, 6),
    (6, 7), (5, 18), (1, 0), (0, 15), (0, 16), (15, 17), (16, 18), (14, 19), (19, 20), (14, 21), (11, 22), (22, 23),
    (11, 24),
)  # fmt: skip
"""Joint pairs of BODY_25 with a part affinity field in OpenPose, in OpenPose's order.

The pairs of shoulder and ear, (2, 17) and (5, 18), close loops: they connect the head to the body if the nose is
hidden.
"""

_MIN_AFFINITY = 0.05  # Links with a smaller affinity are ignored. This is OpenPose's own threshold.


def assemble(counts: Sequence[int], affinities: Sequence[np.ndarray]) -> np.ndarray:
    """Join the candidates of one image into skeletons (D, J): indices of candidates, -1 for none, fullest first.

    This is Kruskal's algorithm on the graph of candidates. It takes links from the strongest to the weakest. Each link
    joins two parts of a skeleton, unless both parts contain the same joint. Links may form loops, the order of joints
    does not matter, and incomplete skeletons are kept, even of one joint.

    Args:
        counts: Numbers of candidates of the J joints.
        affinities: One (n_a, n_b) array of affinities in [0, 1] for each pair of joints of `BODY25_LINKS`.
    """
    first = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    total = int(first[-1])
    joint = np.repeat(np.arange(len(counts)), counts)
    skeleton = list(range(total))
    members = [[candidate] for candidate in range(total)]
    joints = [1 << j for j in joint.tolist()]
    for a, b in _strong_links(first, affinities):
        into, gone = skeleton[a], skeleton[b]
        if joints[into] & joints[gone]:
            continue
        if len(members[into]) < len(members[gone]):
            into, gone = gone, into
        for candidate in members[gone]:
            skeleton[candidate] = into
        members[into] += members[gone]
        joints[into] |= joints[gone]
        members[gone], joints[gone] = [], 0
    found = sorted(filter(None, members), key=len, reverse=True)
    assembled = np.full((len(found), len(counts)), -1)
    chosen = np.array(list(chain.from_iterable(found)), int)
    row, column = np.repeat(np.arange(len(found)), [len(candidates) for candidates in found]), joint[chosen]
    assembled[row, column] = chosen - first[column]
    return assembled


def _strong_links(first: np.ndarray, affinities: Sequence[np.ndarray]) -> Iterator[tuple[int, int]]:
    """Return pairs of candidates, strongest affinity first. Candidates are numbered across all joints."""
    flat = np.concatenate([affinity.ravel() for affinity in affinities])
    strong = np.flatnonzero(flat > _MIN_AFFINITY)
    strong = strong[np.argsort(-flat[strong], kind="stable")]
    offsets = np.cumsum([0, *(affinity.size for affinity in affinities)])
    link = offsets.searchsorted(strong, side="right") - 1
    side_a, side_b = np.asarray(BODY25_LINKS)[link].T
    row, column = np.divmod(strong - offsets[link], (first[side_b + 1] - first[side_b]))
    return zip((first[side_a] + row).tolist(), (first[side_b] + column).tolist(), strict=True)
