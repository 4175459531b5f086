"""People retargeted to Unitree G1 robots, played back on the robot's own model, and files of joint angles."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, COCO17, Skeleton
from dmae.formats.config import LengthUnit
from dmae.formats.g1 import episodes, write_episodes, write_joint_csv
from dmae.formats.retargeting import Contact, load_robot, retarget, speeds
from dmae.formats.writing import write_poses
from tests.support.clips import full_clip, t_pose
from tests.support.robots import TwoRobots, needs_robot

FPS, FRAMES = 25.0, 50


@pytest.fixture(autouse=True, scope="module")
def installed():
    needs_robot()


def shaking_hands() -> Poses3D:
    """Two people who face each other and shift their weight; the right hands meet between frames 19 and 31."""
    body = t_pose()
    for side, joints in (("l", ("l_elbow", "l_wrist")), ("r", ("r_elbow", "r_wrist"))):
        shoulder = body[BODY25.index(f"{side}_shoulder")[0]]
        for number, joint in enumerate(joints, 1):
            body[BODY25.index(joint)[0]] = shoulder + (0, 0, -0.28 * number)
    xyz = np.tile(body, (FRAMES, 2, 1, 1))
    sway = 0.03 * np.sin(np.linspace(0, 2 * np.pi, FRAMES))
    upper = [BODY25.joints.index(name) for name in BODY25.joints if not name.endswith(("ankle", "toe", "heel"))]
    xyz[:, :, upper, 1] += sway[:, None, None]
    raised = np.clip(1 - (np.abs(np.arange(FRAMES) - 25) - 6) / 15, 0, 1)
    raised = (raised * raised * (3 - 2 * raised))[:, None]
    shoulder = xyz[:, :, BODY25.index("r_shoulder")[0]]
    down = np.array([0, 0, -1.0])
    # Palms are 9 cm ahead of wrists: they meet on the line between the two bodies.
    for joint, ahead, length in (("r_elbow", (0.45, 0.2, -0.6), 0.28), ("r_wrist", (0.95, 0.3, -0.1), 0.28)):
        direction = down + raised[:, None] * (np.array(ahead) - down)
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        above = shoulder if joint == "r_elbow" else xyz[:, :, BODY25.index("r_elbow")[0]]
        xyz[:, :, BODY25.index(joint)[0]] = above + length * direction
    palm = xyz[25, 0, BODY25.index("r_wrist")[0]] + 0.09 * np.array([0.95, 0.3, -0.1])
    xyz[:, 1] *= (-1, -1, 1)  # half a turn
    xyz[:, :, :, :2] -= np.array([[palm[0], palm[1]], [-palm[0], -palm[1]]])[:, None] * 0.97
    return Poses3D(BODY25, xyz)


@pytest.fixture(scope="module")
def robot():
    return load_robot()


@pytest.fixture(scope="module")
def motion(robot):
    return retarget(shaking_hands(), FPS, robot)


@pytest.fixture
def clip():
    """Three frames."""
    poses = shaking_hands().select(slice(3))
    return replace(full_clip(frames=3), poses=poses, truth=None, occlusion=None, detection_labels=None, images=None)


def places(robot, qpos: np.ndarray, *bodies: str) -> np.ndarray:
    """Return (F, bodies, 3) m of one robot."""
    data, found = mujoco.MjData(robot), []
    for each in qpos:
        data.qpos[:] = each
        mujoco.mj_kinematics(robot, data)
        found.append(
            [data.body(name).xpos.copy() if "hand" not in name else data.site(name).xpos.copy() for name in bodies]
        )
    return np.array(found)


def test_limits_of_position_and_speed_are_kept(motion, robot):
    low, high = robot.jnt_range[1:].T
    angles = motion.qpos[..., 7:]
    assert ((angles >= low) & (angles <= high)).all()
    step = np.abs(np.diff(angles, axis=0))
    assert (step * FPS < 0.5 * np.array(list(speeds(robot).values()))).all()
    assert step.max() < 0.4  # rad: nothing jumps
    assert np.isfinite(motion.qpos).all()


def test_standing_feet_stay_and_are_on_the_floor(motion, robot):
    assert motion.standing.all()
    for person in range(2):
        feet = places(robot, motion.qpos[:, person], "left_ankle_roll_link", "right_ankle_roll_link")
        assert np.abs(np.diff(feet, axis=0)).max() * FPS < 0.01
        np.testing.assert_allclose(feet[..., 2], 0.035, atol=0.002)
        assert np.linalg.norm(feet[0, 0, :2] - feet[0, 1, :2]) > 0.15


def test_hands_that_touch_touch_and_do_not_overlap(motion):
    assert motion.touching[20:30, :, 1].all()
    assert not motion.touching[:5].any()
    assert not motion.touching[..., 0].any()
    pair = TwoRobots()
    hands = [pair.gap(qpos, "right_wrist_yaw", "right_wrist_yaw") for qpos in motion.qpos]
    assert np.abs(hands[20:30]).max() < 0.01
    assert hands[0] > 0.3
    # Nothing else of one robot is in the other, either.
    assert min(pair.gap(qpos) for qpos in motion.qpos[20:30]) > -0.01


@pytest.mark.parametrize("height", [0.1, 0.4, 0.7])
def test_a_hand_on_a_trunk_touches_its_surface(robot, height):
    """The robot's trunk has no constant thickness: near the pelvis it is half as deep as at the chest."""
    poses = shaking_hands().select(slice(16, 34))
    xyz = poses.xyz.copy()
    hips, neck = (xyz[:, 1, BODY25.index(joint)[0]] for joint in ("mid_hip", "neck"))
    point = hips + height * (neck - hips) - (0.13, 0, 0)
    reach = point - (0.09, 0, 0) - xyz[:, 0, BODY25.index("r_wrist")[0]]
    xyz[:, 0, BODY25.index("r_wrist")[0]] += reach
    xyz[:, 0, BODY25.index("r_elbow")[0]] += reach / 2
    contact = Contact(0, 1, 1, "trunk", 0, point)
    motion = retarget(replace(poses, xyz=xyz), FPS, robot, [contact])
    pair = TwoRobots()
    gaps = [min(pair.gap(qpos, "right_wrist_yaw", part) for part in ("torso", "pelvis")) for qpos in motion.qpos[4:]]
    assert np.abs(gaps).max() < 0.015


def test_the_robot_faces_and_stands_where_the_person_does(motion):
    # Person 0 faces +x, person 1 -x, left of x = 0 and right of it.
    heading = Rotation.from_quat(motion.qpos[25, :, 3:7], scalar_first=True).apply([1.0, 0, 0])
    np.testing.assert_allclose(heading[:, 0], [1, -1], atol=0.02)
    middle = shaking_hands().xyz[25, :, BODY25.index("mid_hip")[0], 0]
    np.testing.assert_allclose(motion.qpos[25, :, 0], motion.scale * middle, atol=0.05)
    assert 0.68 < motion.scale < 0.8


def test_both_dialects_say_the_same(motion, tmp_path):
    write_joint_csv(motion, tmp_path / "pair.csv")
    write_joint_csv(motion, tmp_path / "seed.csv", LengthUnit.cm)
    plain = np.loadtxt(tmp_path / "pair_P2.csv", delimiter=",")
    header = (tmp_path / "seed_P2.csv").read_text().splitlines()[0].split(",")
    named = np.loadtxt(tmp_path / "seed_P2.csv", delimiter=",", skiprows=1)
    assert plain.shape == named.shape == (FRAMES, 36)
    assert header[:7] == ["Frame", *(f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ")]
    assert header[7] == "left_hip_pitch_joint_dof" and header[-1] == "right_wrist_yaw_joint_dof"
    np.testing.assert_array_equal(named[:, 0], np.arange(FRAMES))
    np.testing.assert_allclose(named[:, 1:4] / 100, plain[:, :3], atol=1e-6)
    np.testing.assert_allclose(np.radians(named[:, 7:]), plain[:, 7:], atol=1e-6)
    turned = Rotation.from_euler("xyz", named[:, 4:7], degrees=True) * Rotation.from_quat(plain[:, 3:7]).inv()
    assert turned.magnitude().max() < 1e-5


def test_lerobot_has_the_documented_files_and_columns(motion, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    write_episodes(tmp_path / "set", episodes(motion, "shake hands"), FPS)
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v3.0", 25, 2)
    table = parquet.read_table(tmp_path / "set" / info["data_path"].format(chunk_index=0, file_index=0))
    assert table.column_names == list(info["features"]) and len(table) == info["total_frames"] == 2 * FRAMES
    state, action = (np.array(table[name].to_pylist()) for name in ("observation.state", "action"))
    assert state.shape[1:] == tuple(info["features"]["observation.state"]["shape"]) == (36,)
    np.testing.assert_array_equal(action[: FRAMES - 1], state[1:FRAMES, 7:])
    np.testing.assert_allclose(table["timestamp"].to_pylist()[FRAMES + 10], 10 / FPS)
    rows = parquet.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(row["dataset_from_index"], row["dataset_to_index"]) for row in rows] == [(0, FRAMES), (FRAMES, 2 * FRAMES)]
    tasks = parquet.read_table(tmp_path / "set/meta/tasks.parquet").to_pandas()
    assert tasks.index.tolist() == ["shake hands"] and tasks["task_index"].tolist() == [0]
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())
    np.testing.assert_allclose(stats["action"]["mean"], action.mean(0), atol=1e-6)


@pytest.mark.parametrize(
    ("unknown", "needed"),
    [(("l_ankle", "r_ankle", "l_knee", "r_knee"), "l_ankle, r_ankle"), (("l_hip", "r_hip", "mid_hip"), "l_hip, r_hip")],
)
def test_half_a_body_never_seen_is_named(robot, unknown, needed):
    poses = shaking_hands()
    dropped = np.zeros(poses.source.shape, bool)
    dropped[:, 1, BODY25.index(*unknown)] = True
    with pytest.raises(ValueError, match=f"P2: {needed} are never known"):
        retarget(poses.without(dropped), FPS, robot)


def test_arms_never_seen_rest_and_say_so(robot):
    poses = shaking_hands().select(slice(20))
    dropped = np.zeros(poses.source.shape, bool)
    dropped[:, 0, BODY25.index("l_elbow", "l_wrist")] = True
    dropped[8:12, 0, BODY25.index("r_wrist")] = True
    motion = retarget(poses.without(dropped), FPS, robot)
    elbow, other = (motion.joints.index(f"{side}_elbow_joint") for side in ("left", "right"))
    assert (motion.source[:, 0, elbow] == Source.ABSENT).all()
    assert np.isnan(motion.residual[:, 0, 0]).all()
    assert set(motion.source[:, 0, other].tolist()) == {Source.MEASURED, Source.COMPLETED}
    assert (motion.source[..., -1] == Source.COMPLETED).all()  # nobody measured a hand
    assert np.ptp(motion.qpos[:, 0, 7 + elbow]) < 0.2


def test_one_frame_and_feet_without_toes(robot):
    poses = shaking_hands().select(slice(1))
    assert retarget(poses, FPS, robot).qpos.shape == (1, 2, 36)
    dropped = np.zeros(poses.source.shape, bool)
    dropped[..., BODY25.index("l_big_toe", "l_heel", "r_big_toe", "r_heel")] = True
    motion = retarget(poses.without(dropped), FPS, robot)
    np.testing.assert_allclose(places(robot, motion.qpos[:, 0], "left_ankle_roll_link")[..., 2], 0.035, atol=0.002)
    with pytest.raises(ValueError, match="found 0 in 1 frames"):
        retarget(
            replace(poses, **{name: getattr(poses, name)[:, :0] for name in ("xyz", "source", "cov", "views", "rays")}),
            FPS,
            robot,
        )
    with pytest.raises(ValueError, match=r"0\.2 frames/s: below 1 frame/s frames are stills"):
        retarget(poses, 0.2, robot)


def test_clips_are_written_by_name(clip, tmp_path):
    coco = replace(clip, poses=convert(clip.poses, COCO17))  # it has no feet
    written = write_poses(coco, tmp_path / "coco", "g1")
    assert [file.name for file in written.files] == ["coco_P1.csv", "coco_P2.csv", "coco.provenance.csv"]
    assert np.loadtxt(tmp_path / "coco_P1.csv", delimiter=",").shape == (3, 36)
    write_poses(clip, tmp_path / "set", "lerobot")
    assert json.loads((tmp_path / "set/meta/info.json").read_text())["total_frames"] == 6
    with pytest.raises(ValueError, match="unit=mm"):
        write_poses(clip, tmp_path / "odd", "g1", unit="mm")
    with pytest.raises(ValueError, match=r"robot=g1\.xml: format=trc is not of a robot"):
        write_poses(clip, tmp_path / "odd", "trc", robot="g1.xml")
    mouse = Skeleton("mouse", ("nose", "tail", "paw"), (-1, 0, 1), pairs=())
    animal = replace(clip, poses=Poses3D(mouse, np.zeros((3, 1, 3, 3))))
    with pytest.raises(ValueError, match=r"always of body25, and mouse has 1 of its 25 joints"):
        write_poses(animal, tmp_path / "mouse", "g1")


def test_a_model_of_something_else_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"robot=nowhere\.xml: no such file"):
        load_robot("nowhere.xml")
    other = tmp_path / "other.xml"
    other.write_text("<mujoco><worldbody><body name='pelvis'><freejoint/><geom size='1'/></body></worldbody></mujoco>")
    with pytest.raises(ValueError, match="expected the MJCF of a Unitree G1; no body 'left_hip_roll_link'"):
        load_robot(str(other))
    other.write_text("no xml")
    with pytest.raises(ValueError, match=r"other\.xml: expected the MJCF of a Unitree G1"):
        load_robot(str(other))
