"""C3D, BVH and GLB, read back by programs that share nothing with the writers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25, SKELETONS, Skeleton
from dmae.formats import c3d
from dmae.formats.animation import WORLD_Y_UP, joint_rotations
from dmae.formats.writing import write_poses
from dmae.numerics.body import rotate_z, rotation_z
from synth.motion.readers.bvh import read_bvh
from synth.motion.retargeting import retarget
from synth.people.body import PARENTS, SEGMENTS, Body, landmarks, segment_origins
from tests.support.animals import DOG, dog
from tests.support.clips import full_clip, walkers

_RIG = {"LeftForeArm": "l_elbow", "RightHand": "r_wrist", "LeftFoot": "l_ankle"}
"""Our joints by joints of both rigs of other programs."""


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


def simulated(skeleton: Skeleton, frames: int = 40, lean: float = 0.0) -> tuple[Poses3D, np.ndarray]:
    """A person of our generator who squats, turns and swings the arms, and the true flexion of the left knee, rad.

    The trunk leans by `lean`, rad, and more in the squat.
    """
    phase = np.linspace(0, 2 * np.pi, frames)
    turns = np.zeros((frames, len(SEGMENTS), 3))
    at = SEGMENTS.index
    bent = 0.5 * (1 - np.cos(phase))
    turns[:, at("l_thigh"), 1] = turns[:, at("r_thigh"), 1] = -bent
    turns[:, at("l_shin"), 1] = turns[:, at("r_shin"), 1] = 1.4 * bent
    turns[:, at("l_foot"), 1] = turns[:, at("r_foot"), 1] = -0.4 * bent
    turns[:, at("spine"), 1], turns[:, at("chest"), 1] = 0.2 * bent + lean, 0.15 * bent
    turns[:, at("l_upper_arm"), 0] = -1.2 + 0.5 * np.sin(phase)
    turns[:, at("r_upper_arm"), 0] = 1.2 + 0.5 * np.sin(phase)
    turns[:, at("r_forearm"), 2] = turns[:, at("l_forearm"), 2] = 0
    turns[:, at("l_forearm"), 2], turns[:, at("r_forearm"), 2] = -bent, bent
    world = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(frames, -1, 3, 3)
    world[:, 0] = rotation_z(phase / 2)
    for segment, parent in enumerate(PARENTS[1:], 1):
        world[:, segment] = world[:, parent] @ world[:, segment]
    body = Body()
    root = np.stack([phase / 5, 0 * phase, 0.95 - 0.1 * bent], -1)
    on, points, _ = landmarks(body, skeleton)
    xyz = segment_origins(body, root, world)[:, on] + (world[:, on] @ points[..., None])[..., 0]
    return Poses3D(skeleton, xyz[:, None]), 1.4 * bent


def written(poses: Poses3D, path: Path, format: str, **options) -> Path:
    clip = replace(full_clip(len(poses.xyz)), truth=None, occlusion=None, detection_labels=None, poses=poses)
    return write_poses(clip, path, format, **options).files[0]


def by_name_bvh(path: Path) -> dict[str, np.ndarray]:
    """Joints (F, 3) m, world, by a reader of our generator."""
    found = read_bvh(path)
    xyz = found.forward()[0] @ WORLD_Y_UP
    return {joint: xyz[:, number] for number, joint in enumerate(found.joints)}


def by_name_glb(path: Path, frames: int) -> dict[str, np.ndarray]:
    """Nodes (F, 3) m, world, by forward kinematics over the JSON and the buffer alone."""
    pygltflib = pytest.importorskip("pygltflib")
    file = pygltflib.GLTF2().load(str(path))
    buffer = file.binary_blob()

    def values(number: int) -> np.ndarray:
        accessor = file.accessors[number]
        view = file.bufferViews[accessor.bufferView]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor.type]
        return np.frombuffer(buffer, "<f4", accessor.count * width, view.byteOffset).reshape(accessor.count, width)

    samplers = file.animations[0].samplers
    tracks = {
        (channel.target.node, channel.target.path): values(samplers[channel.sampler].output)
        for channel in file.animations[0].channels
    }
    found = {}

    def place(node: int, at: np.ndarray, turned: np.ndarray) -> None:
        move = tracks.get((node, "translation"), np.array(file.nodes[node].translation or [0, 0, 0]))
        at = at + (turned @ np.broadcast_to(move, (frames, 3))[..., None])[..., 0]
        if (node, "rotation") in tracks:
            found[file.nodes[node].name] = at @ WORLD_Y_UP
            turned = turned @ Rotation.from_quat(tracks[node, "rotation"]).as_matrix()
            for child in file.nodes[node].children:
                place(child, at, turned)

    for skin in file.skins:
        place(skin.joints[0], np.zeros((frames, 3)), np.broadcast_to(np.eye(3), (frames, 3, 3)))
    return found


@pytest.mark.parametrize("skeleton", list(SKELETONS.values()), ids=lambda skeleton: skeleton.name)
def test_every_skeleton_moves_as_its_joints_in_bvh_and_glb(skeleton, tmp_path):
    """Every joint is there, near where it was, on bones of constant length below a root at the pelvis."""
    poses, _ = simulated(skeleton)
    bvh = by_name_bvh(written(poses, tmp_path / "a.bvh", "bvh"))
    glb = by_name_glb(written(poses, tmp_path / "a.glb", "glb"), len(poses.xyz))
    assert next(iter(bvh)) == "mid_hip"
    for joint, xyz in zip(skeleton.joints, np.moveaxis(poses.xyz[:, 0], 1, 0), strict=True):
        error = np.linalg.norm(bvh[joint] - xyz, axis=-1)
        assert np.median(error) < 0.015 and error.max() < 0.04, joint
        np.testing.assert_allclose(glb[f"P1: {joint}"], bvh[joint], atol=1e-4)


@pytest.mark.parametrize("skeleton", list(SKELETONS.values()), ids=lambda skeleton: skeleton.name)
def test_the_rest_pose_is_a_t_pose_that_faces_x(skeleton):
    motion = joint_rotations(simulated(skeleton)[0], 25.0, 0)
    rest = np.zeros_like(motion.offsets)
    for node, parent in enumerate(motion.parents):
        rest[node] = motion.offsets[node] + (rest[parent] if parent >= 0 else 0)
    at = dict(zip(motion.joints, rest, strict=True))
    for side, sign in (("l", 1), ("r", -1)):
        arm = [at[f"{side}_{joint}"] for joint in ("shoulder", "elbow", "wrist")]
        leg = [at[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle")]
        for bones, towards in ((arm, (0, sign, 0)), (leg, (0, 0, -1))):
            for bone in np.diff(bones, axis=0):
                np.testing.assert_allclose(bone / np.linalg.norm(bone), towards, atol=1e-9)
        assert sign * leg[0][1] > 0.05
        if f"{side}_big_toe" in at:
            assert at[f"{side}_big_toe"][0] > leg[2][0] + 0.1
    np.testing.assert_allclose((at["l_shoulder"] + at["r_shoulder"])[1], 0, atol=1e-9)
    # The trunk stands upright.
    for joint in {"spine", "neck", "head"} & {*at}:
        assert abs(at[joint][1]) < 0.02 and abs(at[joint][0]) < 0.1 < at[joint][2], joint
    assert at["l_shoulder"][2] > 0.3


@pytest.mark.parametrize(("rig", "count"), [("soma", 78), ("lafan1", 22)])
def test_rigs_of_other_programs_stand_where_the_person_stands(rig, count, tmp_path):
    """In cm, with the axes of their readers: SOMA's T-pose faces z, and LAFAN1's bones run along x."""
    poses, _ = simulated(BODY25)
    path = written(poses, tmp_path / "a.bvh", "bvh", skeleton=rig)
    found = read_bvh(path)
    joints = [joint for joint in found.joints if not joint.endswith(".end")]
    assert len(joints) == count
    at, turned = found.forward()
    at = at / 100 @ WORLD_Y_UP
    if rig == "soma":
        # And the generator takes it as recorded motion; its people face y.
        motion = retarget(found)
        for part, start, end, axis in (("forearm", "elbow", "wrist", (0, 1, 0)), ("thigh", "hip", "knee", (0, 0, -1))):
            first, last = (poses.xyz[:, 0, BODY25.index(f"l_{joint}")[0]] for joint in (start, end))
            bone = rotate_z((last - first) / np.linalg.norm(last - first, axis=-1, keepdims=True), np.pi / 2)
            np.testing.assert_allclose(motion.rotations[:, SEGMENTS.index(f"l_{part}")] @ axis, bone, atol=0.05)
    leg = "Leg" if rig == "soma" else "UpLeg"
    pairs = {"LeftForeArm": "l_elbow", "RightHand": "r_wrist", f"Left{leg}": "l_hip", "RightFoot": "r_ankle"}
    for theirs, ours in pairs.items():
        error = at[:, found.joints.index(theirs)] - poses.xyz[:, 0, BODY25.index(ours)[0]]
        assert np.linalg.norm(error, axis=-1).max() < 0.04
    axes = WORLD_Y_UP.T @ turned[0, found.joints.index("Hips")]
    left, up, ahead = (axes.T @ way for way in np.eye(3)[[1, 2, 0]])
    if rig == "soma":
        np.testing.assert_allclose([left, up, ahead], np.eye(3), atol=0.15)
    else:
        np.testing.assert_allclose([left, up, ahead], np.eye(3)[[2, 0, 1]], atol=0.15)
        for joint in ("LeftLeg", "RightForeArm", "LeftForeArm", "RightFoot", "LeftHand"):
            offset = found.offsets[found.joints.index(joint)]
            assert offset[0] > 0.98 * np.linalg.norm(offset)
    with pytest.raises(ValueError, match="is always in cm"):
        written(poses, tmp_path / "b.bvh", "bvh", skeleton=rig, unit="mm")


@pytest.mark.parametrize(
    ("rig", "metre", "pairs"),
    [
        (None, 1, {joint: joint for joint in BODY25.joints}),
        ("soma", 100, _RIG | {"LeftLeg": "l_hip", "RightShin": "r_knee"}),
        ("lafan1", 100, _RIG | {"LeftUpLeg": "l_hip", "RightLeg": "r_knee"}),
    ],
    ids=("body25", "soma", "lafan1"),
)
def test_another_library_reads_the_same_motion(rig, metre, pairs, tmp_path):
    bvhio = pytest.importorskip("bvhio", reason="bvhio, of the extra `dev`, is not installed")
    poses, _ = simulated(BODY25)
    path = written(poses, tmp_path / "a.bvh", "bvh", **({} if rig is None else {"skeleton": rig}))
    root = bvhio.readAsHierarchy(str(path))
    nodes = [root.filter(name, isEqual=True)[0] for name in pairs]
    for frame in range(0, len(poses.xyz), 8):
        root.loadPose(frame)
        found = np.array([[*node.PositionWorld] for node in nodes]) / metre @ WORLD_Y_UP
        error = np.linalg.norm(found - poses.xyz[frame, 0, BODY25.index(*pairs.values())], axis=-1)
        assert np.median(error) < 0.002 and error.max() < 0.015


def test_joints_that_are_never_known_are_left_out_and_a_missing_body_is_refused():
    poses, _ = simulated(BODY25)
    gone = np.zeros(poses.source.shape, bool)
    gone[:, :, BODY25.index("l_knee", "l_ankle", "l_heel", "l_big_toe", "l_small_toe")] = True
    motion = joint_rotations(poses.without(gone), 25.0, 0)
    assert not {"l_knee", "l_ankle", "l_heel"} & set(motion.joints) and "r_knee" in motion.joints
    gone[:, :, BODY25.index("l_hip")] = gone[:, :, BODY25.index("mid_hip")] = True
    with pytest.raises(ValueError, match="P1: never known: l_hip; without hips and shoulders"):
        joint_rotations(poses.without(gone), 25.0, 0)


def test_your_own_skeleton_keeps_its_tree():
    rng = np.random.default_rng(0)
    poses = Poses3D(DOG, dog(20, rng=rng)[:, None])
    motion = joint_rotations(poses, 25.0, 0)
    error = np.linalg.norm(motion.xyz - poses.xyz[:, 0][:, DOG.index(*motion.joints)], axis=-1)
    assert motion.joints[0] == DOG.joints[DOG.parents.index(-1)] and np.median(error) < 0.05


def test_a_name_of_two_words_is_one_word_in_bvh(tmp_path):
    """Readers take the first word after JOINT: `ear 1` and `ear 2` would be one bone."""
    bvhio = pytest.importorskip("bvhio", reason="bvhio, of the extra `dev`, is not installed")
    skeleton = replace(DOG, joints=tuple(joint.replace("_", " ") for joint in DOG.joints))
    poses = Poses3D(skeleton, dog(3, rng=np.random.default_rng(0))[:, None])
    write_poses(replace(full_clip(frames=3), poses=poses), tmp_path / "a.bvh", "bvh")
    read = bvhio.readAsBvh(str(tmp_path / "a.bvh"))
    assert sorted(bone.Name for bone, _, _ in read.Root.layout()) == sorted(DOG.joints)


@pytest.mark.parametrize(("unit", "metre"), [("m", 1), ("cm", 100)])
def test_a_bvh_holds_the_motion(clip, tmp_path, unit, metre):
    write_poses(clip, tmp_path / "walk.bvh", "bvh", unit=unit)
    for person, frames in ((0, 30), (1, 20)):
        found = read_bvh(tmp_path / f"walk_P{person + 1}.bvh")
        assert found.fps == pytest.approx(clip.fps)
        ours = [joint for joint in found.joints if joint in BODY25.joints]
        assert len(ours) == 25
        xyz = found.forward()[0][:, [found.joints.index(joint) for joint in ours]] / metre @ WORLD_Y_UP
        expected = clip.poses.xyz[:, person][:, BODY25.index(*ours)]
        assert np.nanmax(np.linalg.norm(xyz - expected, axis=-1)[:frames]) < 0.002


def test_a_glb_holds_the_motion_and_marks_what_was_not_measured(clip, tmp_path):
    pygltflib = pytest.importorskip("pygltflib")
    write_poses(clip, tmp_path / "walk.glb", "glb")
    found = by_name_glb(tmp_path / "walk.glb", 30)
    for person, frames in ((0, 30), (1, 20)):
        for number, joint in enumerate(BODY25.joints):
            error = np.linalg.norm(found[f"P{person + 1}: {joint}"] - clip.poses.xyz[:, person, number], axis=-1)
            assert error[:frames].max() < 0.002, joint
    file = pygltflib.GLTF2().load(str(tmp_path / "walk.glb"))
    buffer, names = file.binary_blob(), [node.name for node in file.nodes]

    def scale(name: str) -> np.ndarray:
        (channel,) = [
            each
            for each in file.animations[0].channels
            if (each.target.node, each.target.path) == (names.index(name), "scale")
        ]
        accessor = file.accessors[file.animations[0].samplers[channel.sampler].output]
        start = file.bufferViews[accessor.bufferView].byteOffset
        return np.frombuffer(buffer, "<f4", 3 * accessor.count, start).reshape(-1, 3)[:, 0]

    np.testing.assert_array_equal(np.flatnonzero(scale("P1: r_wrist not measured")), np.arange(4, 9))
    np.testing.assert_array_equal(np.flatnonzero(scale("P2: mid_hip")), np.arange(20))
    # Blender makes one armature of all skins whose joints stand below the same node.
    above = {child: node.name for node in file.nodes for child in node.children or []}
    assert [above[skin.joints[0]] for skin in file.skins] == ["P1", "P2"]


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


def test_normals_in_a_glb_have_length_1(clip, tmp_path):
    pygltflib = pytest.importorskip("pygltflib")
    file = pygltflib.GLTF2().load(str(written(clip.poses, tmp_path / "walk.glb", "glb")))
    for mesh in file.meshes:
        accessor = file.accessors[mesh.primitives[0].attributes.NORMAL]
        start = file.bufferViews[accessor.bufferView].byteOffset
        normals = np.frombuffer(file.binary_blob(), "<f4", 3 * accessor.count, start).reshape(-1, 3)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
