"""C3D, BVH and GLB, read back by programs that share nothing with the writers."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25, COCO17, SHELF14
from dmae.formats import c3d
from dmae.formats.bvh import Y_UP, joint_rotations
from dmae.formats.writing import write_poses
from dmae.numerics.body import rotate_z
from synth.motion.readers.bvh import read_bvh
from tests.support.clips import full_clip, walkers


def turning(frames: int = 30, persons: int = 2) -> Poses3D:
    """Rigid people who turn by a full turn while a forearm swings; joints with every source, and an absence."""
    poses = walkers(frames, persons)
    angle = np.linspace(0, 2 * np.pi, frames)[:, None, None]
    middle = poses.xyz[:, :, BODY25.index("mid_hip")]
    xyz = middle + rotate_z(poses.xyz - middle, np.broadcast_to(angle, poses.xyz.shape[:3]))
    source = np.full(xyz.shape[:3], Source.MEASURED)
    source[4:9, 0, 4], source[10, :, 7] = Source.COMPLETED, Source.DENOISED
    xyz[20:, 1:], source[20:, 1:] = np.nan, Source.ABSENT
    cov = np.tile(4e-4 * np.eye(3), (*source.shape, 1, 1))
    cov[np.isnan(xyz[..., 0])] = np.nan
    return Poses3D(BODY25, xyz, source, cov)


@pytest.fixture
def clip():
    poses = turning()
    return replace(full_clip(frames=30), poses=poses, truth=None, occlusion=None, detection_labels=None, images=None)


def test_rigid_bodies_are_where_they_were():
    poses = turning()
    for person, frames in ((0, 30), (1, 20)):
        motion = joint_rotations(poses, 25.0, person)
        error = np.linalg.norm(motion.xyz - poses.xyz[:, person][:, motion.order], axis=-1)
        assert np.nanmax(error[:frames]) < 0.002
        turned = motion.rotations @ motion.rotations.swapaxes(-1, -2)
        np.testing.assert_allclose(turned, np.broadcast_to(np.eye(3), turned.shape), atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(motion.rotations), 1)


def test_the_rest_pose_is_a_t_pose_that_faces_x():
    motion = joint_rotations(turning(), 25.0, 0)
    offset = dict(zip(motion.joints, motion.offsets, strict=True))
    for joint, axis, sign in (("l_elbow", 1, 1), ("r_wrist", 1, -1), ("l_knee", 2, -1), ("neck", 2, 1)):
        assert sign * offset[joint][axis] == pytest.approx(np.linalg.norm(offset[joint]), rel=0.02)
    assert offset["l_shoulder"][1] > 0 > offset["r_shoulder"][1]
    assert offset["l_big_toe"][0] > 0


@pytest.mark.parametrize("skeleton", [SHELF14, COCO17], ids=lambda skeleton: skeleton.name)
def test_every_skeleton_with_one_root_has_rotations(skeleton):
    poses = walkers(12, 1, skeleton)
    motion = joint_rotations(poses, 25.0, 0)
    error = np.linalg.norm(motion.xyz - poses.xyz[:, 0][:, motion.order], axis=-1)
    assert np.median(error) < 0.01


def test_joints_that_are_never_known_are_left_out_and_a_missing_root_is_refused():
    poses = turning(persons=1)
    gone = np.zeros(poses.source.shape, bool)
    gone[:, :, BODY25.index("l_elbow")] = True
    motion = joint_rotations(poses.without(gone), 25.0, 0)
    assert "l_elbow" not in motion.joints
    assert motion.joints[motion.parents[motion.joints.index("l_wrist")]] == "l_shoulder"
    gone[:, :, BODY25.index("mid_hip")] = True
    with pytest.raises(ValueError, match="P1: joint 'mid_hip', the root of body25, is never known"):
        joint_rotations(poses.without(gone), 25.0, 0)


@pytest.mark.parametrize(("unit", "metre"), [("m", 1), ("cm", 100)])
def test_a_bvh_holds_the_motion(clip, tmp_path, unit, metre):
    write_poses(clip, tmp_path / "walk.bvh", "bvh", unit=unit)
    for person, frames in ((0, 30), (1, 20)):
        found = read_bvh(tmp_path / f"walk_P{person + 1}.bvh")
        assert found.fps == pytest.approx(clip.fps)
        ours = [joint for joint in found.joints if not joint.endswith(".end")]
        xyz = found.forward()[0][:, [found.joints.index(joint) for joint in ours]] / metre @ Y_UP
        expected = clip.poses.xyz[:, person][:, BODY25.index(*ours)]
        assert np.nanmax(np.linalg.norm(xyz - expected, axis=-1)[:frames]) < 0.002


def test_a_glb_holds_the_motion_and_marks_what_was_not_measured(clip, tmp_path):
    pygltflib = pytest.importorskip("pygltflib")
    write_poses(clip, tmp_path / "walk.glb", "glb")
    file = pygltflib.GLTF2().load(str(tmp_path / "walk.glb"))
    buffer = file.binary_blob()

    def values(number: int) -> np.ndarray:
        accessor = file.accessors[number]
        view = file.bufferViews[accessor.bufferView]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor.type]
        return np.frombuffer(buffer, "<f4", accessor.count * width, view.byteOffset).reshape(accessor.count, width)

    tracks = {
        (channel.target.node, channel.target.path): values(file.animations[0].samplers[channel.sampler].output)
        for channel in file.animations[0].channels
    }

    def place(node: int, frame: int, at: np.ndarray, turned: np.ndarray, found: dict) -> None:
        from scipy.spatial.transform import Rotation

        move = tracks[node, "translation"][frame] if (node, "translation") in tracks else file.nodes[node].translation
        at = at + turned @ move
        if (node, "rotation") in tracks:
            found[file.nodes[node].name] = at
            turned = turned @ Rotation.from_quat(tracks[node, "rotation"][frame]).as_matrix()
            for child in file.nodes[node].children:
                if file.nodes[child].mesh is None:
                    place(child, frame, at, turned, found)

    for person, skin in enumerate(file.skins):
        for frame in (0, 7, 19):
            found = {}
            place(skin.joints[0], frame, np.zeros(3), np.eye(3), found)
            for number, joint in enumerate(BODY25.joints):
                expected = Y_UP @ clip.poses.xyz[frame, person, number]
                np.testing.assert_allclose(found[f"P{person + 1}: {joint}"], expected, atol=0.002)
    names = [node.name for node in file.nodes]
    red = tracks[names.index("P1: r_wrist not measured"), "scale"][:, 0]
    np.testing.assert_array_equal(np.flatnonzero(red), np.arange(4, 9))
    there = tracks[names.index("P2: mid_hip"), "scale"][:, 0]
    np.testing.assert_array_equal(np.flatnonzero(there), np.arange(20))


def test_a_glb_is_a_scene_of_upright_people_to_trimesh(clip, tmp_path):
    import trimesh

    write_poses(clip, tmp_path / "walk.glb", "glb")
    scene = trimesh.load(tmp_path / "walk.glb")
    assert {"P1", "P2"} <= set(scene.geometry)
    height = np.ptp(scene.geometry["P1"].bounds[:, 1])
    assert height == pytest.approx(np.nanmax(np.ptp(clip.poses.xyz[:, 0, :, 2], axis=-1)), abs=0.1)


def test_a_c3d_holds_markers_and_how_they_are_known(clip, tmp_path):
    ezc3d = pytest.importorskip("ezc3d")
    write_poses(clip, tmp_path / "walk.c3d", "c3d")
    file = ezc3d.c3d(str(tmp_path / "walk.c3d"))
    assert file["parameters"]["POINT"]["RATE"]["value"] == [pytest.approx(clip.fps)]
    labels = file["parameters"]["POINT"]["LABELS"]["value"]
    assert labels[0] == "P1:Nose" and labels[25 + 4] == "P2:RWrist" and len(labels) == 50
    xyz = file["data"]["points"][:3].transpose(2, 1, 0).reshape(30, 2, 25, 3) / 1000
    np.testing.assert_allclose(xyz, clip.poses.xyz, atol=1e-6)
    residual = file["data"]["meta_points"]["residuals"][0].T.reshape(30, 2, 25)
    assert (residual[4:9, 0, 4] == 0).all() and (residual[20:, 1] == -1).all()
    np.testing.assert_array_equal(residual[:4], 20)


def test_more_frames_than_a_c3d_counts_go_into_several(clip, tmp_path, monkeypatch):
    """With 65536 frames and more in one file, readers lose those from 65535 on."""
    ezc3d = pytest.importorskip("ezc3d")
    write_poses(clip, tmp_path / "walk.c3d", "c3d")
    monkeypatch.setattr(c3d, "_MOST_FRAMES", 20)
    monkeypatch.setattr(c3d, "_PART_FRAMES", 12)
    write_poses(clip, tmp_path / "parts" / "walk.c3d", "c3d")
    parts = [ezc3d.c3d(str(path))["data"] for path in sorted((tmp_path / "parts").glob("*.c3d"))]
    assert [path.name for path in sorted((tmp_path / "parts").glob("*.c3d"))] == [
        f"walk_{start:06d}.c3d" for start in (0, 12, 24)
    ]
    whole = ezc3d.c3d(str(tmp_path / "walk.c3d"))["data"]
    np.testing.assert_array_equal(np.concatenate([part["points"] for part in parts], -1), whole["points"])


@pytest.mark.parametrize("format", ["bvh", "glb", "c3d"])
def test_clips_without_frames_or_people_are_written_or_refused(clip, tmp_path, format):
    nothing = replace(clip.poses, xyz=clip.poses.xyz * np.nan, source=np.zeros_like(clip.poses.source), cov=None)
    none = replace(clip, poses=nothing)
    if format == "c3d":
        write_poses(none, tmp_path / "x.c3d", format)
    else:
        with pytest.raises(ValueError, match="is never known"):
            write_poses(none, tmp_path / f"x.{format}", format)
    assert not list(tmp_path.glob(".*"))
