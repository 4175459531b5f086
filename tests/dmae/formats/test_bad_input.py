"""Every format, with people that leave much out: a file with gaps that its reader accepts, or one clear line."""

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
from pycocotools.coco import COCO

import dmae
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14
from dmae.formats.registry import pose_writer
from dmae.formats.writing import write_poses
from tests.support.animals import DOG, dog
from tests.support.clips import full_clip, walkers
from tests.support.robots import needs_robot
from tests.support.trc_files import read_independently

_LOWER = [n for n, joint in enumerate(BODY25.joints) if joint[2:] in ("hip", "knee", "ankle", "heel", "big_toe",
          "small_toe") or joint == "mid_hip"]  # fmt: skip


def _without(joints) -> Poses3D:
    xyz = walkers(6, 1).xyz.copy()
    xyz[:, :, joints] = np.nan
    return Poses3D(BODY25, xyz)


GIVEN = {
    "lower half": _without(_LOWER),  # never seen
    "upper half": _without([n for n in range(25) if n not in _LOWER]),
    "left half": _without([n for n, joint in enumerate(BODY25.joints) if joint.startswith("l_")]),
    "nothing": _without(range(25)),
    "one frame": walkers(1, 1),
    "no feet": convert(walkers(6, 1), SHELF14),
    "animal": Poses3D(DOG, dog(6, rng=np.random.default_rng(0))[:, None]),
    "nobody": Poses3D(BODY25, np.empty((6, 0, 25, 3))),
    "no frame": Poses3D(BODY25, np.empty((0, 1, 25, 3))),
}
NOBODY = "and format=FORMAT needs one at least"
BODY = {
    "lower half": "P1: never known: l_hip, r_hip; without hips and shoulders there is no body",
    "upper half": "P1: never known: l_shoulder, r_shoulder; without hips and shoulders there is no body",
    "left half": "P1: never known: l_hip, l_shoulder; without hips and shoulders there is no body",
    "nothing": "P1: never known: l_hip, r_hip, l_shoulder, r_shoulder; without hips and shoulders there is no body",
    "nobody": f"found 0 people in 6 frames, {NOBODY}",
    "no frame": f"found 1 people in 0 frames, {NOBODY}",
}
ROBOT = {
    "lower half": "P1: l_hip, r_hip, l_ankle, r_ankle are never known",
    "upper half": "P1: l_shoulder, r_shoulder are never known",
    "left half": "P1: l_hip, l_ankle, l_shoulder are never known",
    "nothing": "P1: l_hip, r_hip, l_ankle, r_ankle, l_shoulder, r_shoulder are never known",
    "animal": "format=FORMAT is always of body25, and dog19 has 4 of its 25 joints",
}
MARKERS = {name: BODY[name] for name in ("nobody", "no frame")}
FORMATS = {
    ("npz", None): {},
    ("coco", None): {},
    ("openpose", None): {},
    ("movement", None): {},
    ("panoptic", None): {"animal": "format=panoptic is always of panoptic19, and dog19 has 4 of its 19 joints"},
    ("csv", None): {},
    ("jsonl", None): {},
    ("trc", None): MARKERS,
    ("c3d", None): MARKERS,
    ("mot", None): BODY | {"animal": "joint angles need hips and shoulders, and dog19 has none"},
    ("bvh", None): BODY,
    ("bvh", "body25"): BODY | {"animal": BODY["nothing"]},
    ("bvh", "soma"): BODY | {"animal": "P1: skeleton=soma needs a whole person; never known: head, "},
    ("bvh", "lafan1"): BODY | {"animal": "P1: skeleton=lafan1 needs a whole person; never known: head, "},
    ("glb", None): BODY,
    ("g1", None): ROBOT | MARKERS,
    ("lerobot", None): ROBOT | dict.fromkeys(MARKERS, "expected people to retarget, found"),
}
"""What is refused, by format and skeleton; everything else is written, and read by something else."""


def test_no_format_is_left_out():
    assert {format for format, _ in FORMATS} == set(pose_writer)


def clip_of(poses: Poses3D) -> Clip:
    empty = np.full((len(poses.xyz), 4, 0, len(poses.skeleton)), np.nan)
    detections = Detections2D(poses.skeleton, np.stack([empty] * 2, -1), empty)
    found = full_clip(max(len(poses.xyz), 1))
    return replace(found, truth=None, occlusion=None, detection_labels=None, detections=detections, poses=poses)


@pytest.mark.parametrize(("format", "skeleton"), FORMATS, ids=lambda each: each or "")
def test_a_file_with_gaps_or_one_clear_line(format: str, skeleton: str | None, tmp_path: Path):
    if format in ("g1", "lerobot"):
        needs_robot()
    for name, poses in GIVEN.items():
        clip, refused = clip_of(poses), FORMATS[format, skeleton].get(name)
        out = tmp_path / name.replace(" ", "_")
        out.mkdir()
        if refused:
            with pytest.raises(ValueError) as error:
                write_poses(clip, out / "a", format, skeleton=skeleton)
            said = str(error.value)
            assert refused.replace("FORMAT", format) in said and "\n" not in said, (name, said)
            assert not list(out.iterdir()), name
            assert ("dmae complete places" in said) == ("never known" in said), "what to do"
            continue
        written = write_poses(clip, out / "a", format, skeleton=skeleton)
        assert all(file.exists() for file in written.files), name
        if (skeleton or format) in READ:
            known = READ[skeleton or format](written.files[0], written.poses)
            if known is not None:
                np.testing.assert_array_equal(known, ~np.isnan(written.poses.xyz).any(-1), err_msg=name)


# Readers that are not ours where there are any: which joints (F, P, J) the file says are known, if it can say so.


def _npz(path: Path, poses: Poses3D) -> np.ndarray:
    with np.load(path) as file:
        return ~np.isnan(file["joints"]).any(-1)


def _trc(path: Path, poses: Poses3D) -> np.ndarray:
    if find_spec("opensim"):
        import opensim

        assert len(opensim.TimeSeriesTableVec3(str(path)).getIndependentColumn()) == len(poses.xyz)
    return ~np.isnan(read_independently(path)[1]).any(-1)[:, None]


def _c3d(path: Path, poses: Poses3D) -> np.ndarray:
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d(str(path))
    return (file["data"]["meta_points"]["residuals"][0] >= 0).T[:, None]


def _mot(path: Path, poses: Poses3D) -> None:
    lines = path.read_text().splitlines()
    names = lines.index("endheader") + 1
    rows = np.array([[float(cell) for cell in line.split("\t")] for line in lines[names + 1 :]])
    assert rows.shape == (len(poses.xyz), len(lines[names].split("\t"))) and np.isfinite(rows).all()
    if find_spec("opensim"):
        import opensim

        assert opensim.TimeSeriesTable(str(path)).getNumRows() == opensim.Storage(str(path)).getSize() == len(rows)
    if poses.skeleton == SHELF14:
        assert set(pd.read_csv(path.with_suffix(".angles.csv"))["ankle_angle_r_source"]) == {"absent"}


def _bvh(path: Path, poses: Poses3D) -> None:
    bvhio = pytest.importorskip("bvhio")
    root = bvhio.readAsHierarchy(str(path))
    root.loadPose(0)
    assert len(root.Keyframes) == len(poses.xyz)
    assert all(np.isfinite([*node.PositionWorld]).all() for node, *_ in root.layout())


def _glb(path: Path, poses: Poses3D) -> None:
    assert trimesh.load(path).geometry


def _g1(path: Path, poses: Poses3D) -> None:
    rows = np.loadtxt(path, delimiter=",", ndmin=2)
    assert rows.shape == (len(poses.xyz), 36) and np.isfinite(rows).all()


def _lerobot(path: Path, poses: Poses3D) -> None:
    rows = pd.concat([pd.read_parquet(each) for each in path.glob("data/*/*.parquet")])
    assert len(rows) == len(poses.xyz)


def _coco(path: Path, poses: Poses3D) -> None:
    found = COCO(path)
    assert len(found.imgs) == 4 * len(poses.xyz)
    assert bool(found.anns) == bool(np.isfinite(poses.xyz).any())


def _openpose(path: Path, poses: Poses3D) -> None:
    files = [json.loads(each.read_text()) for each in path.glob("*/*_keypoints.json")]
    assert len(files) == 4 * len(poses.xyz)


def _movement(path: Path, poses: Poses3D) -> np.ndarray:
    import xarray

    with xarray.open_dataset(path, engine="h5netcdf") as found:
        return ~np.isnan(found.position.transpose("time", "individuals", "keypoints", "space").values).any(-1)


def _panoptic(path: Path, poses: Poses3D) -> np.ndarray | None:
    if not poses.source.size or not np.isfinite(poses.xyz).any():
        return None
    return ~np.isnan(dmae.read_poses(path).poses.xyz).any(-1)


READ = {
    "npz": _npz, "trc": _trc, "c3d": _c3d, "mot": _mot, "bvh": _bvh, "body25": _bvh, "soma": _bvh, "lafan1": _bvh,
    "glb": _glb, "g1": _g1, "lerobot": _lerobot, "coco": _coco, "openpose": _openpose, "movement": _movement,
    "panoptic": _panoptic,
}  # fmt: skip


@pytest.mark.parametrize("format", ["mot", "bvh", "glb"])
def test_others_are_written_without_the_one_who_has_no_body(format, tmp_path, capsys):
    xyz = walkers(3, 3).xyz.copy()
    xyz[:, 1, _LOWER] = np.nan
    files = [tmp_path / f"a_P{number}.{format}" for number in (1, 2, 3)]
    files[1].touch()  # of an earlier run
    written = write_poses(clip_of(Poses3D(BODY25, xyz)), tmp_path / "a", format)
    said = capsys.readouterr().err
    assert said == f"{BODY['lower half'].replace('P1', 'P2')}; this person is left out\n"
    if format == "glb":
        names = {node.get("name") for node in _json_of(written.files[0])["nodes"]}
        assert {"P1", "P3"} <= names and "P2" not in names
    else:
        assert [files[0].exists(), files[1].exists(), files[2].exists()] == [True, format == "glb", True]
    assert {line.split(",")[0] for line in (tmp_path / "a.provenance.csv").read_text().splitlines()[1:]} >= {"P1", "P3"}


def _json_of(path: Path) -> dict:
    data = path.read_bytes()
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
