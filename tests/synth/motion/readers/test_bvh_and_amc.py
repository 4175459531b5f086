"""BVH and AMC files of known content, and malformed ones."""

import numpy as np
import pytest

from synth.motion.readers.amc import read_amc
from synth.motion.readers.bvh import read_bvh
from synth.motion.retargeting import retarget
from synth.people.body import SEGMENTS
from tests.support.motion_files import amc, bvh
from tests.support.stick_figure import elbows, knees

# At rest, elbows in these files bend 30 degrees above the front, ours to the front: only the upper arm is turned.
_T_POSE = {f"{s}{part}": (0, x, 0) for s in "lr" for part, x in (("Shldr", 30), ("ForeArm", -30))}
_ARMS_DOWN = {"lShldr": (-90, 0, 0), "rShldr": (90, 0, 0)}


def segment(motion, name):
    return motion.rotations[0, SEGMENTS.index(name)]


@pytest.mark.parametrize("scale", [1.0, 100.0, 1000.0, 0.45 / 0.0254])
def test_t_pose_is_the_identity_in_any_unit(tmp_path, scale):
    recording = read_bvh(bvh(tmp_path / "take.bvh", [_T_POSE | {"root": (0.3, 0.5, 0)}] * 8, scale))
    assert recording.fps == pytest.approx(60, abs=1e-3)
    motion = retarget(recording)
    assert len(motion) == 2, "the synthetic T-pose and the frames that blend out of it are left out"
    assert np.allclose(motion.rotations, np.eye(3), atol=1e-9)
    # The offset of the root, 1 m up, is added to its channels, and the floor is under the feet.
    assert recording.root[0] / scale == pytest.approx([0.3, 1.5, 0])
    assert motion.hip_height == pytest.approx(0.83 * 1.0794, abs=1e-3)
    assert motion.root[0] == pytest.approx([0, 0.3, motion.hip_height], abs=1e-6)


def test_joint_angles_turn_the_right_segments(tmp_path):
    # Channels z, x, y: z swings limbs sideways, x forward and back, y about the vertical.
    left = {"hip": (0, 0, 90), **_ARMS_DOWN}
    bent = {"lThigh": (0, -40, 0), "lShin": (0, 70, 0), "rForeArm": (0, 0, 60), "head": (0, 20, 0)}
    motion = retarget(read_bvh(bvh(tmp_path / "take.bvh", [left | bent])))
    assert segment(motion, "pelvis")[:, 0] == pytest.approx([0, 1, 0], abs=1e-9), "faces +y"
    assert segment(motion, "l_upper_arm")[:, 1] == pytest.approx([0, 0, -1], abs=1e-6), "hangs"
    assert segment(motion, "r_upper_arm")[:, 1] == pytest.approx([0, 0, 1], abs=1e-6), "hangs"
    assert -segment(motion, "l_thigh")[:, 2] == pytest.approx([0, np.sin(0.698), -np.cos(0.698)], abs=1e-3)
    assert segment(motion, "head")[:, 0] == pytest.approx([0, np.cos(0.349), -np.sin(0.349)], abs=1e-3), "nods"
    assert np.degrees(knees(motion)[0]) == pytest.approx([70, 0], abs=1e-5)
    assert np.degrees(elbows(motion)[0, 0]) == pytest.approx(0, abs=1e-5)


def test_acclaim_at_rest_has_its_arms_out_and_its_legs_splayed(tmp_path):
    motion = retarget(read_amc(amc(tmp_path / "99_01.amc", [{}, {}])))
    assert motion.fps == 120
    assert -segment(motion, "l_thigh")[:, 2] == pytest.approx(
        [0, np.sin(np.radians(20)), -np.cos(np.radians(20))], abs=1e-5
    )
    for name in ("pelvis", "spine", "chest", "head", "l_forearm", "l_hand", "r_hand"):
        assert np.allclose(segment(motion, name), np.eye(3), atol=1e-5), name


def test_acclaim_legs_together_are_the_canonical_ones(tmp_path):
    # Angles are about axes turned by the splay of the legs, which leaves z as it is.
    together = {"lfemur": (0, 0, -20), "rfemur": (0, 0, 20), "lhumerus": (0, 0, -90), "ltibia": (35, 0, 0)}
    motion = retarget(read_amc(amc(tmp_path / "99_01.amc", [together, together])))
    for name in ("r_thigh", "r_shin", "r_foot"):
        assert np.allclose(segment(motion, name), np.eye(3), atol=1e-5), name
    assert np.degrees(knees(motion)[0]) == pytest.approx([35, 0], abs=1e-3)


def broken(path, edit):
    lines = path.read_text().splitlines()
    edit(lines)
    path.write_text("\n".join(lines) + "\n")
    return path


def replace(lines, old, new):
    i = next(i for i, line in enumerate(lines) if old in line)
    lines[i] = lines[i].replace(old, new)


def placed(path, poses, moved=(0, 0, 0), zeros=False):
    """Write a BVH file in which every joint has position channels; the last joint moves in the last frame."""
    lines = bvh(path, poses).read_text().splitlines()
    offsets = [line.split()[1:] for line in lines if line.startswith("OFFSET") and line != "OFFSET 0 0 0"]
    lines = [line.replace("CHANNELS 3", "CHANNELS 6 Xposition Yposition Zposition") for line in lines]
    for i in range(-len(poses), 0):
        words = lines[i].split()
        offsets = [["0"] * 3] * len(offsets) if zeros else offsets
        rows = [words[:6], *([*offset, *words[3 * n : 3 * n + 3]] for n, offset in enumerate(offsets[1:], 2))]
        if i == -1:
            rows[-1][:3] = [str(float(at) + by) for at, by in zip(rows[-1][:3], moved, strict=True)]
        lines[i] = " ".join(word for row in rows for word in row)
    path.write_text("\n".join(lines) + "\n")
    return path


def test_position_channels_of_all_joints_stand_for_their_offsets(tmp_path):
    poses = [{}, {"hip": (0, 0, 90), "lThigh": (0, -40, 0), "root": (0.3, 0, 0)}]
    plain = read_bvh(bvh(tmp_path / "plain.bvh", poses)).forward()
    for all_placed in (placed(tmp_path / "all.bvh", poses), placed(tmp_path / "zeros.bvh", poses, zeros=True)):
        for found, expected in zip(read_bvh(all_placed).forward(), plain, strict=True):
            assert found == pytest.approx(expected, abs=1e-9)
    with pytest.raises(
        ValueError, match=r"bones of constant lengths, found 'r.*' 0\.5 from its usual place .* frame 3"
    ):
        read_bvh(placed(tmp_path / "torn.bvh", [{}] * 3, moved=(0.5, 0, 0)))


def test_hips_that_move_above_a_node_on_the_floor_are_the_root(tmp_path):
    lines = bvh(tmp_path / "take.bvh", [{"root": (0.3, 0.5, 0)}] * 8).read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("ROOT"))
    lines[first : first + 1] = [
        "ROOT world",
        "{",
        "OFFSET 0 0 0",
        "CHANNELS 3 Zrotation Xrotation Yrotation",
        "JOINT hip",
    ]
    motion = next(i for i, line in enumerate(lines) if line == "MOTION")
    lines[motion + 3 :] = [f"0 0 90 {line}" for line in lines[motion + 3 :]]
    (tmp_path / "above.bvh").write_text("\n".join([*lines[:motion], "}", *lines[motion:]]) + "\n")
    found = read_bvh(tmp_path / "above.bvh")
    # Turned by 90 degrees about y, x becomes -z. The channels stand for the offset, 1 m up.
    assert found.root[0] == pytest.approx([0, 0.5, -0.3])
    assert found.forward()[0][:, 1] == pytest.approx(found.root)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda ls: ls.pop(), r"take\.bvh, line \d+: expected 3 frames, .* found '2 frames'"),
        (lambda ls: ls.append(ls.pop()[:-20]), r"line \d+: expected 66 numbers, found '6\d numbers'"),
        (lambda ls: ls.append(ls.pop() + " 1"), r"line \d+: expected 66 numbers, found '67 numbers'"),
        (lambda ls: ls.append(ls.pop().replace("0.000000", "nan", 1)), "finite number in column 1, found 'nan'"),
        (lambda ls: ls.append(ls.pop().replace("0.000000", "zero", 1)), "line .*: expected 66 numbers, found 'zero"),
        (lambda ls: replace(ls, "CHANNELS 3", "CHANNELS 4"), "line .*: expected a count and that many of"),
        (lambda ls: replace(ls, "Yrotation", "Wrotation"), "line .*: expected a count and that many of"),
        (lambda ls: replace(ls, "OFFSET 0.0 0.2 0.0", "OFFSET 0.0 0.2"), "line .*: expected 3 numbers, found '2"),
        (lambda ls: ls.__delitem__(slice(20, None)), "line 20: expected MOTION before the file ends"),
        (lambda ls: ls.remove("}"), "line .*: expected a joint, OFFSET"),
        (lambda ls: replace(ls, "Frame Time:", "Frame Rate:"), "expected 'Frames: <count>' and 'Frame Time"),
        (lambda ls: replace(ls, "Frame Time: 0.0", "Frame Time: -0.0"), "expected 'Frames: <count>' and 'Frame Time"),
        (lambda ls: replace(ls, "HIERARCHY", "ANARCHY"), "line 1: expected HIERARCHY, found 'ANARCHY'"),
        (lambda ls: ls.clear(), "expected a text file, found an empty one"),
    ],
)  # fmt: skip
def test_a_malformed_bvh_is_refused_with_its_line(tmp_path, edit, message):
    with pytest.raises(ValueError, match=message):
        read_bvh(broken(bvh(tmp_path / "take.bvh", [{}] * 3), edit))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda ls: ls.pop(), r"99_01\.amc, line \d+: expected 20 bones a frame until the file ends"),
        (lambda ls: ls.append(ls.pop() + " 0"), r"line \d+: expected 3 numbers, found '4 numbers'"),
        (lambda ls: replace(ls, "lfemur 0 0 0", "lfemur 0 nan 0"), "line .*: expected a finite number in column 2"),
        (lambda ls: ls.insert(25, ls.pop(26)), "line .*: expected 'root', found"),
        (lambda ls: replace(ls, "lfemur", "lfemure"), "expected frames of a number and a line for each of head, "),
        (lambda ls: replace(ls, ":DEGREES", ":RADIANS"), "line 3: expected angles in :DEGREES"),
    ],
)  # fmt: skip
def test_a_malformed_amc_is_refused_with_its_line(tmp_path, edit, message):
    with pytest.raises(ValueError, match=message):
        read_amc(broken(amc(tmp_path / "99_01.amc", [{}] * 3), edit))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda ls: replace(ls, "length 7.5", "width 7.5"), "bone 'lfemur': .* length, axis, found no length"),
        (lambda ls: replace(ls, "direction 0 1 0", "direction 0 1"), "line .*: expected 3 numbers, found '2 numbers'"),
        (lambda ls: replace(ls, "lfemur ltibia", "lfemur lshank"), "line .*: expected a bone in the tree"),
        (lambda ls: replace(ls, "lfemur ltibia", "lfemur root"), "line .*: expected a bone in the tree"),
        (lambda ls: replace(ls, "angle deg", "angle rad"), "line .*: expected angles in deg, found 'angle rad'"),
        (lambda ls: replace(ls, "dof rx ry rz", "dof rx ry l"), "line .*: expected channels among rx ry rz"),
        (lambda ls: ls.__delitem__(slice(10, None)), "expected :root, :bonedata and :hierarchy"),
    ],
)  # fmt: skip
def test_a_malformed_asf_is_refused_with_its_line(tmp_path, edit, message):
    path = amc(tmp_path / "99_01.amc", [{}])
    broken(tmp_path / "99.asf", edit)
    with pytest.raises(ValueError, match=message):
        read_amc(path)


def test_an_amc_without_its_skeleton_is_refused(tmp_path):
    path = amc(tmp_path / "99_01.amc", [{}]).rename(tmp_path / "98_01.amc")
    with pytest.raises(FileNotFoundError, match=r"expected its skeleton at .*98\.asf, found \['99\.asf'\]"):
        read_amc(path)


def test_binary_and_missing_files_are_refused(tmp_path):
    path = tmp_path / "take.bvh"
    with pytest.raises(FileNotFoundError, match=r"take\.bvh"):
        read_bvh(path)
    path.write_bytes(b"HIERARCHY\0")
    with pytest.raises(ValueError, match="expected a text file, found binary data"):
        read_bvh(path)


def test_unknown_skeletons_are_refused_with_the_missing_joints(tmp_path):
    path = broken(bvh(tmp_path / "take.bvh", [{}] * 3), lambda ls: replace(ls, "JOINT lShldr", "JOINT lSchulter"))
    with pytest.raises(ValueError, match=r"found hip, abdomen, .*lSchulter.*cgspeed for Daz: lShldr"):
        retarget(read_bvh(path))


def test_legs_of_no_human_length_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"expected thigh and shin of .* found 4\.15 units, .* any of m, cm, mm, CMU"):
        retarget(read_bvh(bvh(tmp_path / "take.bvh", [{}] * 8, scale=5)))


def test_a_file_with_only_the_t_pose_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expected frames after the T-pose"):
        retarget(read_bvh(bvh(tmp_path / "take.bvh", [{}] * 6)))
