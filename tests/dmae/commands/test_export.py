"""Files of `dmae export` and `dmae convert`, read back by the readers and by JSON alone."""

import json
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pycocotools.coco import COCO

import dmae as python_package
from dmae.commands import convert as convert_command
from dmae.commands import export as export_command
from dmae.commands.config import ConvertCommand, ExportCommand
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.skeleton import (
    BLAZEPOSE33,
    BODY25,
    COCO17,
    PANOPTIC19,
    SHELF14,
    SKELETONS,
    Skeleton,
    get_skeleton,
)
from dmae.data.store import load_clip, save_clip
from dmae.formats import panoptic
from dmae.formats.calibrations import read_calibration
from dmae.formats.labelled_images import joint_labels
from dmae.formats.openpose import CALIBRATION
from dmae.formats.own import read_npz
from dmae.formats.poses import REGIONS, read_poses
from dmae.formats.reading import Clips, DataConfig
from dmae.formats.registry import pose_writer, recording_writer
from dmae.formats.trc import opensim_marker, read_trc
from dmae.formats.writing import write_poses
from tests.support.clips import full_clip, image_clip, walkers
from tests.support.commands import dmae
from tests.support.recordings import recording, same_detections, write_openpose_recording
from tests.support.robots import needs_robot


@pytest.fixture
def captured() -> Clip:
    """Poses with every source there is, in a clip that begins at frame 7."""
    poses = walkers()
    xyz, source = poses.xyz.copy(), poses.source.copy()
    xyz[2, 1, 3:6], source[2, 1, 3:6] = np.nan, Source.ABSENT
    source[:, 0, BODY25.index("l_wrist")] = Source.COMPLETED
    return replace(full_clip(), poses=Poses3D(BODY25, xyz, source), provenance={"first_frame": 7})


def export(clip: Clip, tmp_path: Path, format: str, out: str, **options) -> Path:
    save_clip(clip, tmp_path / "clip")
    export_command.run(ExportCommand(str(tmp_path / "clip"), format, out=out, **options), tmp_path / out)
    return tmp_path / out


def test_npz_and_trc(captured, tmp_path, capsys):
    poses, _ = read_npz(export(captured, tmp_path, "npz", "a.npz", skeleton="shelf14"))
    assert poses.skeleton == SHELF14
    export(captured, tmp_path, "trc", "b.trc")
    found, fps = read_trc(tmp_path / "b_P1.trc", BODY25)
    assert fps == 25
    np.testing.assert_allclose(found.xyz[:, 0], captured.poses.xyz[:, 0], atol=1e-6)
    np.testing.assert_array_equal(found.source[:, 0], captured.poses.source[:, 0])
    said = capsys.readouterr().out.splitlines()[-1].removesuffix(": 12 frames, 2 people, body25").split(", ")
    assert [Path(file).name for file in said] == ["b_P1.trc", "b_P2.trc", "b.provenance.csv"]
    assert all(Path(file).is_file() for file in said)


def test_panoptic(captured, tmp_path):
    folder = export(captured, tmp_path, "panoptic", "pan")
    found, wanted = panoptic.read_poses(folder), convert(captured.poses, PANOPTIC19)
    assert sorted(found.xyz) == list(range(7, 19))
    xyz = np.where((wanted.source == Source.COMPLETED)[..., None], np.nan, wanted.xyz)
    np.testing.assert_allclose(np.stack(list(found.xyz.values())), xyz, atol=1e-5)
    np.testing.assert_allclose(read_calibration(folder).projections, captured.rig.projections, atol=1e-6)
    with pytest.raises(ValueError, match=r"skeleton=body25: format=panoptic is always of panoptic19"):
        export(captured, tmp_path, "panoptic", "pan2", skeleton="body25")


def test_openpose_is_a_recording_of_its_own(captured, tmp_path):
    folder = export(captured, tmp_path, "openpose", "op", skeleton="coco17")
    (clip,) = Clips(DataConfig("openpose", str(folder), fps=25.0))
    assert clip.provenance["first_frame"] == 7
    assert clip.detections.skeleton == COCO17
    xy, _ = captured.rig.project(convert(captured.poses, COCO17).xyz)
    xy[~captured.rig.inside(xy)] = np.nan
    np.testing.assert_allclose(clip.detections.xy, xy, atol=1e-3)
    with pytest.raises(ValueError, match="expected no such folder yet, or an empty one"):
        export(captured, tmp_path, "openpose", "op")


def annotations(path: Path, rig: CameraRig) -> dict:
    """By (frame, camera, person)."""
    content = json.loads(path.read_text())
    images = {image["id"]: (image["frame"], rig.names.index(image["camera"])) for image in content["images"]}
    return {(*images[a["image_id"]], a["track_id"]): a for a in content["annotations"]}


def test_coco_of_captured_poses_says_what_was_completed(captured, tmp_path):
    found = annotations(export(captured, tmp_path, "coco", "k.json"), captured.rig)
    v = np.reshape(found[9, 0, 1]["keypoints"], (25, 3))[:, 2]
    assert set(v[3:6]) == {0}
    assert found[9, 0, 1]["joint_source"][3:6] == [0, 0, 0]
    wrist = BODY25.index("l_wrist")[0]
    v = np.reshape(found[9, 0, 0]["keypoints"], (25, 3))[:, 2]
    assert v[wrist] == 1
    assert (np.delete(v, wrist) == 2).all()


def test_coco_of_simulated_truth_has_its_visibility(tmp_path):
    """2 seen, 1 hidden but in the image, 0 outside; where the cameras truly are, not where the calibration has them."""
    clip = full_clip()
    found = annotations(export(clip, tmp_path, "coco", "k.json"), clip.rig)
    xy, _ = clip.true_rig.project(clip.truth.xyz)
    inside = clip.rig.inside(xy)
    wanted = np.where(inside, np.where(clip.occlusion.visibility == Visibility.VISIBLE, 2, 1), 0)
    assert {0, 1, 2} >= set(np.unique(wanted)) >= {1, 2}
    for (frame, view, person), annotation in found.items():
        joints = np.reshape(annotation["keypoints"], (25, 3))
        np.testing.assert_array_equal(joints[:, 2], wanted[frame, view, person])
        known = joints[:, 2] > 0
        np.testing.assert_allclose(joints[known, :2], xy[frame, view, person][known], atol=1e-3)
    assert len(found) == (wanted > 0).any(-1).sum()


def test_a_derived_joint_is_as_visible_as_the_least_visible_of_its_own():
    truth = walkers(1, 1, COCO17)
    visibility = np.full((1, 4, 1, 17), Visibility.VISIBLE)
    visibility[0, 2, 0, COCO17.index("l_hip")] = Visibility.HIDDEN_BY_OBJECT
    clip = replace(recording(COCO17, 1), truth=truth, occlusion=OcclusionLabels(visibility))
    flags = joint_labels(clip, truth, BODY25).flags
    joints = BODY25.index("mid_hip", "l_hip", "r_hip", "neck", "l_big_toe")
    assert flags[0, :, 0, joints].T.tolist() == [[2, 2, 2, 2, 0], [2, 2, 2, 2, 0], [1, 1, 2, 2, 0], [2, 2, 2, 2, 0]]


def test_of_two_fused_skeletons_the_first_is_written(tmp_path):
    skeleton = get_skeleton("body25+shelf14")
    both = Poses3D(skeleton, np.concatenate([walkers(3, 1).xyz, walkers(3, 1, SHELF14).xyz], 2))
    clip = replace(recording(BODY25, 3), truth=both)
    assert len(read_trc(export(clip, tmp_path, "trc", "a.trc"))[0].skeleton) == 25
    found = annotations(export(clip, tmp_path, "coco", "b.json", skeleton="shelf14"), clip.rig)
    assert len(found[0, 0, 0]["keypoints"]) == 3 * 14
    assert read_npz(export(clip, tmp_path, "npz", "c.npz"))[0].skeleton == skeleton


def test_coco_of_a_clip_with_images_has_masks_true_boxes_and_images(tmp_path, capsys):
    clip = image_clip(tmp_path / "images")
    path = export(clip, tmp_path, "coco", "a.json", skeleton="coco17")
    coco = COCO(path)
    assert coco.dataset["info"]["images"] and coco.dataset["info"]["objects"] == ["box"]
    ids = {name: list(clip.images.read("ids", name)) for name in clip.rig.names}
    assert len(coco.anns) == 12
    for image in coco.loadImgs(coco.getImgIds()):
        colours = cv2.imread(str(tmp_path / image["file_name"]))
        assert colours.shape == (image["height"], image["width"], 3) == (150, 240, 3)
        for annotation in coco.loadAnns(coco.getAnnIds(image["id"])):
            mask = ids[image["camera"]][image["frame"] - 5] == 1 + annotation["track_id"]
            np.testing.assert_array_equal(coco.annToMask(annotation), mask)
            assert annotation["area"] == mask.sum()
            assert annotation["bbox_of"] == ("pixels" if mask.any() else "joints")
    with pytest.raises(ValueError, match=r"a_images: expected no such folder yet"):
        export(clip, tmp_path, "coco", "a.json")


def test_coco_without_images_says_so(tmp_path):
    content = json.loads(export(full_clip(), tmp_path, "coco", "a.json").read_text())
    assert content["info"]["images"] is False
    assert {each["bbox_of"] for each in content["annotations"]} == {"joints"}
    assert not (tmp_path / "a_images").exists()


def test_nothing_to_export_is_said(tmp_path):
    with pytest.raises(ValueError, match="neither poses nor truth"):
        export(recording(BODY25), tmp_path, "coco", "a.json")


@pytest.mark.parametrize("format", ["openpose", "easymocap", "coco"])
def test_a_recording_converted_is_the_same_recording(tmp_path, format, capsys):
    clip = recording(BODY25)
    source = write_openpose_recording(clip, tmp_path / "source", first=30)
    out = tmp_path / "out"
    convert_command.run(ConvertCommand(DataConfig("openpose", str(source), fps=25.0), format, str(out)), out)
    said = capsys.readouterr().out
    assert "12 frames at 25 frames/s, 4 cameras, body25" in said
    fps = None if format == "coco" else 25.0
    assert ("data.fps=25" in said) == (fps is not None)
    (found,) = Clips(DataConfig(format, str(out), fps=fps))
    same_detections(found.detections, clip.detections)
    np.testing.assert_allclose(found.rig.projections, clip.rig.projections, atol=1e-6)
    assert found.provenance["first_frame"] == 30
    with pytest.raises(ValueError, match="expected no such folder yet"):
        convert_command.run(ConvertCommand(DataConfig("openpose", str(source), fps=25.0), format, str(out)), out)


def test_a_recording_becomes_a_clip_with_what_was_absent_noted(tmp_path, capsys):
    source = write_openpose_recording(recording(BODY25), tmp_path / "source")
    (source / "cam1" / "cam1_000000000004_keypoints.json").write_text("{")
    convert_command.run(ConvertCommand(DataConfig("openpose", str(source), fps=25.0)), tmp_path / "clip")
    assert "cam1: 1 of frames 0 to 11 are absent; 1 files could not be read" in capsys.readouterr().out
    clip = load_clip(tmp_path / "clip")
    assert not clip.detections.observed[4, 1].any()
    assert len(clip.provenance["notes"]) == 1


def test_the_calibration_goes_along(tmp_path):
    clip = full_clip()
    save_clip(clip, tmp_path / "clip")
    out = tmp_path / "out"
    convert_command.run(ConvertCommand(DataConfig(path=str(tmp_path / "clip")), "openpose"), out)
    np.testing.assert_allclose(read_calibration(out / CALIBRATION).projections, clip.rig.projections, atol=1e-6)


@pytest.mark.parametrize(("format", "file"), [("glb", "walk.glb"), ("npz", "walk.npz"), ("coco", "walk.json")])
def test_a_file_without_a_suffix_gets_that_of_its_format(captured, tmp_path, format, file, capsys):
    save_clip(captured, tmp_path / "clip")
    export_command.run(ExportCommand(str(tmp_path / "clip"), format), tmp_path / "walk")
    assert (tmp_path / file).is_file()
    assert str(tmp_path / file) in capsys.readouterr().out


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("walk.csv", r"format=npz writes \.npz files; \.csv files are of format=csv \(A table as text"),
        ("walk.trc", r"format=npz writes \.npz files; \.trc files are of format=trc \(OpenSim's markers.*\)$"),
        ("walk.xyz", r"no format writes \.xyz files; expected .*\.glb \(format=glb\).*\.npz \(format=npz\)"),
        ("S1.take2", r"format=npz writes \.npz files, and no format writes \.take2 files"),
    ],
)
def test_a_file_with_a_suffix_of_no_or_another_format_is_refused(captured, tmp_path, file, message):
    with pytest.raises(ValueError, match=message):
        export(captured, tmp_path, "npz", file)
    with pytest.raises(ValueError, match=message):
        python_package.export(captured, tmp_path / file, "npz")
    assert not (tmp_path / file).exists()


@pytest.mark.parametrize(
    ("out", "files"),
    [
        ("walk.trc", ["walk_P1.trc"]),
        ("walk.TRC", ["walk_P1.TRC"]),
        ("walk.glb", ["walk.glb"]),
        ("walk.npz", ["walk.npz"]),
        ("walk.csv", ["walk.csv"]),
        ("walk.jsonl", ["walk.jsonl"]),
        ("walk", ["walk.npz"]),
        ("panoptic", ["panoptic.npz"]),
    ],
)
def test_the_format_is_by_default_that_of_the_suffix(captured, tmp_path, out, files):
    save_clip(captured, tmp_path / "clip")
    python_package.export(captured, tmp_path / out)
    done = dmae(tmp_path, "export", "clip=clip", f"out=by/{out}")
    assert done.returncode == 0, done.stderr
    assert all((folder / file).is_file() for folder in (tmp_path, tmp_path / "by") for file in files)


def test_two_formats_without_a_suffix_are_recorded_beside_each_file(captured, tmp_path):
    save_clip(captured, tmp_path / "clip")
    record = tmp_path / "clip/config.yaml"
    record.write_text("of the command that made the clip")
    for format in ("npz", "trc"):
        done = dmae(tmp_path, "export", "clip=clip", f"format={format}", "out=clip")
        assert done.returncode == 0, done.stderr
        assert f"format: {format}" in (tmp_path / f"clip.{format}.config.yaml").read_text()
    assert record.read_text() == "of the command that made the clip"


def test_what_is_printed_names_the_skeleton_that_was_written(captured, tmp_path, capsys):
    save_clip(captured, tmp_path / "clip")
    for skeleton in ("soma", "coco17"):
        export_command.run(ExportCommand(str(tmp_path / "clip"), "bvh", skeleton=skeleton), tmp_path / "walk")
        assert capsys.readouterr().out.endswith(f": 12 frames, 2 people, {skeleton}\n")


def test_who_is_left_out_is_not_counted_as_written(captured, tmp_path, capsys):
    hidden = np.zeros(captured.poses.source.shape, bool)
    hidden[:, 1, BODY25.index("l_hip", "r_hip", "mid_hip")] = True
    save_clip(replace(captured, poses=captured.poses.without(hidden)), tmp_path / "clip")
    export_command.run(ExportCommand(str(tmp_path / "clip"), "mot"), tmp_path / "walk")
    said = capsys.readouterr()
    assert "P2: never known" in said.err
    assert "P2" not in said.out
    assert said.out.endswith(": 12 frames, 1 person, body25\n")


def test_files_are_written_into_the_current_folder(captured, tmp_path, capsys, monkeypatch):
    save_clip(captured, tmp_path / "clip")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    export_command.run(ExportCommand("../clip", "openpose"), Path())
    assert capsys.readouterr().out == ".: 12 frames, 2 people, body25\n"


@pytest.mark.parametrize("format", pose_writer)
def test_all_files_that_are_written_are_announced_and_no_others(captured, tmp_path, format, capsys):
    if "robot" in pose_writer.find(format).options:
        needs_robot()
    cov = np.broadcast_to(1e-4 * np.eye(3), (*captured.poses.xyz.shape, 3))
    clip = replace(captured, poses=replace(captured.poses, cov=cov))
    save_clip(clip, tmp_path / "clip")
    folder = tmp_path / "written"
    folder.mkdir()
    export_command.run(ExportCommand(str(tmp_path / "clip"), format), folder / "walk")
    announced = capsys.readouterr().out.splitlines()[-1].rsplit(": ", 1)[0].split(", ")
    assert {Path(each) for each in announced} == set(folder.iterdir())


@pytest.mark.parametrize(("format", "states"), [("npz", True), ("bvh", False)])
def test_exports_of_errors_of_completed_joints_say_that_they_are_too_small(captured, tmp_path, capsys, format, states):
    cov = np.broadcast_to(1e-4 * np.eye(3), (*captured.poses.xyz.shape, 3))
    clip = replace(captured, poses=replace(captured.poses, cov=cov))
    for completed in (True, False):
        kept = clip.poses if completed else clip.poses.without(clip.poses.source == Source.COMPLETED)
        save_clip(replace(clip, poses=kept), tmp_path / f"clip{completed}")
        export_command.run(ExportCommand(str(tmp_path / f"clip{completed}"), format), tmp_path / f"walk{completed}")
        assert (REGIONS in capsys.readouterr().out) == (states and completed)


def test_files_of_one_clip_have_one_time_base(captured, tmp_path):
    """From 0 s on, whatever the number of the first frame in the recording (here 7)."""
    ezc3d, seconds = pytest.importorskip("ezc3d"), np.arange(12) / 25
    paths = {name: export(captured, tmp_path, name, f"walk.{name}") for name in ("trc", "mot", "c3d", "bvh", "glb")}
    table = np.loadtxt(tmp_path / "walk_P1.trc", skiprows=5, usecols=(0, 1))
    np.testing.assert_array_equal(table[:, 0], np.arange(7, 19))
    np.testing.assert_allclose(table[:, 1], seconds, atol=1e-6)
    rows = (tmp_path / "walk_P1.mot").read_text().split("endheader")[1].splitlines()[2:]
    np.testing.assert_allclose([float(row.split()[0]) for row in rows], seconds, atol=1e-6)
    points = ezc3d.c3d(str(paths["c3d"]))["header"]["points"]
    assert points["first_frame"] == 0 and points["last_frame"] == 11 and points["frame_rate"] == 25
    lines = (tmp_path / "walk_P1.bvh").read_text().splitlines()
    assert "Frames: 12" in lines and "Frame Time: 0.04" in lines
    content = paths["glb"].read_bytes()
    scene = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    inputs = {sampler["input"] for each in scene["animations"] for sampler in each["samplers"]}
    times = [scene["accessors"][each] for each in inputs]
    assert max(each["max"][0] for each in times) == pytest.approx(seconds[-1])
    assert min(each["min"][0] for each in times) == 0
    ends = [line.split(",")[4:6] for line in (tmp_path / "walk.provenance.csv").read_text().splitlines()[1:]]
    assert {"0.000000", "0.440000"} <= {cell for each in ends for cell in each}


def smoothed_gaps(skeleton: Skeleton) -> Clip:
    """Two people of a skeleton as `dmae complete` returns them: smoothed, some joints completed, some absent."""
    poses = walkers(6, 2, skeleton)
    xyz, source = poses.xyz.copy(), np.full(poses.source.shape, Source.DENOISED)
    xyz[2, 1, 3:6], source[2, 1, 3:6] = np.nan, Source.ABSENT
    source[3:, 0, 2] = Source.COMPLETED
    return replace(recording(skeleton, 6), poses=Poses3D(skeleton, xyz, source))


def read_back(path: Path, format: str, clip: Clip) -> tuple[np.ndarray, np.ndarray | None]:
    """Return joints (F, P, J, 3) m of an export, on the skeleton of a clip, and their sources if the file has them."""
    skeleton, shape = clip.poses.skeleton, clip.poses.xyz.shape
    if format == "c3d":
        file = pytest.importorskip("ezc3d").c3d(str(path))
        labels = file["parameters"]["POINT"]["LABELS"]["value"]
        wanted = [f"P{person}:{opensim_marker(joint, skeleton)}" for person in (1, 2) for joint in skeleton.joints]
        points = file["data"]["points"][:3, [labels.index(each) for each in wanted]]
        return points.transpose(2, 1, 0).reshape(shape) / 1000, None
    if format == "jsonl":
        header, *lines = map(json.loads, path.read_text().splitlines())
        assert header["joints"] == list(skeleton.joints)
        people = [[each["people"][person] for person in (0, 1)] for each in lines]
        xyz = [[[joint or [np.nan] * 3 for joint in one["xyz"]] for one in each] for each in people]
        return np.array(xyz), np.array(
            [[[Source[name.upper()] for name in one["source"]] for one in each] for each in people]
        )
    poses = read_poses(path).poses
    joints = poses.skeleton.index(*skeleton.joints)
    return poses.xyz[:, :, joints], poses.source[:, :, joints]


READ_BACK = {"npz": "npz", "trc": "trc", "csv": "csv", "jsonl": "jsonl", "movement": "nc", "c3d": "c3d"}
"""Suffixes of formats that hold the joints of any skeleton in 3D, by format."""
IN_IMAGES = ("coco", "openpose")
OF_BODIES = {"panoptic", "bvh", "glb", "mot", "g1", "lerobot"}
"""Of one skeleton, or of a body that moves as the joints: `test_animation`, `test_mot` and `test_g1`."""


def test_every_format_of_poses_is_read_back():
    assert {*READ_BACK, *IN_IMAGES} | OF_BODIES == {*pose_writer}


@pytest.mark.parametrize("format", READ_BACK)
@pytest.mark.parametrize("skeleton", SKELETONS.values(), ids=lambda skeleton: skeleton.name)
def test_every_skeleton_is_read_back_as_it_was_written(skeleton, format, tmp_path):
    clip = smoothed_gaps(skeleton)
    path = tmp_path / f"walk.{READ_BACK[format]}"
    write_poses(clip, path, format)
    xyz, source = read_back(path, format, clip)
    np.testing.assert_allclose(xyz, clip.poses.xyz, atol=1e-4)
    if source is not None:
        np.testing.assert_array_equal(source, clip.poses.source)


@pytest.mark.parametrize("skeleton", SKELETONS.values(), ids=lambda skeleton: skeleton.name)
def test_every_skeleton_is_where_the_cameras_see_it(skeleton, tmp_path):
    clip = smoothed_gaps(skeleton)
    xy, _ = clip.rig.project(clip.poses.xyz)
    xy[~clip.rig.inside(xy)] = np.nan
    write_poses(clip, tmp_path / "walk.json", "coco")
    found = annotations(tmp_path / "walk.json", clip.rig)
    for (frame, view, person), annotation in found.items():
        joints = np.reshape(annotation["keypoints"], (len(skeleton), 3))
        np.testing.assert_allclose(
            np.where(joints[:, 2:] > 0, joints[:, :2], np.nan), xy[frame, view, person], atol=1e-3
        )
        assert annotation["joint_source"] == clip.poses.source[frame, person].tolist()
    assert len(found) == np.isfinite(xy).any((-1, -2)).sum()
    write_poses(clip, tmp_path / "walk", "openpose")
    (read,) = Clips(DataConfig("openpose", str(tmp_path / "walk"), fps=clip.fps, skeleton=skeleton.name))
    np.testing.assert_allclose(read.detections.xy, xy, atol=1e-3)
    write_poses(clip, tmp_path / "panoptic", "panoptic")
    measured = clip.poses.without(clip.poses.source == Source.COMPLETED)
    xyz = [*panoptic.read_poses(tmp_path / "panoptic").xyz.values()]
    np.testing.assert_allclose(xyz, convert(measured, PANOPTIC19).xyz, atol=1e-5)


def test_the_table_of_sources_is_the_same_whatever_format_is_written_last(tmp_path):
    """Formats of bodies have nodes that the skeleton lacks (here the pelvis), and others in another order."""
    clip = smoothed_gaps(BLAZEPOSE33)
    tables = {}
    for format in ("trc", "mot", "c3d", "bvh", "glb"):
        write_poses(clip, tmp_path / f"walk.{format}", format)
        tables[format] = (tmp_path / "walk.provenance.csv").read_text()
    assert {*tables.values()} == {tables["trc"]}
    rows = [line.split(",") for line in tables["trc"].splitlines()[1:]]  # joints that are derived as well
    assert {row[0] for row in rows} == {"P1", "P2"} and {row[1] for row in rows} >= {*BLAZEPOSE33.joints}
    assert {row[-1] for row in rows} == {"measured (smoothed)", "completed", "absent"}
    assert [path.name for path in tmp_path.glob("*.csv") if "angles" not in path.name] == ["walk.provenance.csv"]


@pytest.mark.parametrize("there", [False, True])
@pytest.mark.parametrize("format", [name for name in recording_writer if name != "clip"])
def test_a_recording_that_cannot_be_written_leaves_nothing(captured, tmp_path, format, there, monkeypatch):
    """So that the same command makes it, once the disk has space."""
    if there:
        (tmp_path / "out").mkdir()
    written = []

    def full(file):
        if written:
            raise OSError(28, "No space left on device")
        written.append(file)

    with monkeypatch.context() as patch, pytest.raises(OSError, match="No space left"):
        patch.setattr(os, "fsync", full)
        python_package.convert(captured, tmp_path / "out", format)
    assert [*tmp_path.iterdir()] == [tmp_path / "out"] * there and not any((tmp_path / "out").glob("*"))
    python_package.convert(captured, tmp_path / "out", format)


def test_a_recording_is_written_into_the_current_folder(captured, tmp_path, monkeypatch):
    """The folder itself stays, as a shell is in it."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    folder = Path().stat().st_ino
    python_package.convert(captured, ".", "openpose")
    assert Path(tmp_path / "here").stat().st_ino == folder and (tmp_path / "here/calibration.toml").is_file()
    assert [*tmp_path.iterdir()] == [tmp_path / "here"]


def test_a_full_folder_of_temporary_files_is_named(captured, tmp_path, monkeypatch):
    """Its error names no file, and the disk of the output may have space."""
    save_clip(captured, tmp_path / "clip")

    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("dmae.formats.own.TemporaryFile", full)
    done = dmae(tmp_path, "export", "clip=clip", "out=walk.npz")
    where = f"No space left on device; temporary files are in {tempfile.gettempdir()}, unless TMPDIR names another"
    assert done.returncode == 1 and where in done.stderr
