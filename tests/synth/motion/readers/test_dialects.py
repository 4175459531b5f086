"""Unknown skeletons with a file of names; worlds and rest poses in other axes; malformed bones."""

import re

import numpy as np
import pytest

from synth.motion.config import MotionConfig, UpAxis
from synth.motion.readers.dialects import DIALECTS
from synth.motion.source import load_motion, read_take
from synth.people.body import SEGMENTS
from tests.support.motion_files import amc, bvh
from tests.support.stick_figure import joints

_OURS = {
    "hip": "pelvis", "abdomen": "spine", "chest": "chest", "head": "head",
    **{f"{s}{theirs}": f"{s}_{ours}" for s in "lr" for theirs, ours in (
        ("Shldr", "upper_arm"), ("ForeArm", "forearm"), ("Hand", "hand"), ("Mid1", "knuckle"),
        ("Thigh", "thigh"), ("Shin", "shin"), ("Foot", "foot"),
    )},
}  # fmt: skip


def poses(frames: int = 60) -> list[dict]:
    """A person who strides with arms down, and turns."""
    swing = 30 * np.sin(np.arange(frames) / 8)
    return [
        {
            "root": (0, 0, i / 100), "hip": (0, 0, i / 2), "chest": (0, 5, 0),
            "lShldr": (-80, s, 0), "rShldr": (80, 0, 0),
            "lThigh": (0, -s, 0), "rThigh": (0, s, 0), "lShin": (0, abs(s), 0), "rForeArm": (0, 0, 40),
        }
        for i, s in enumerate(swing)
    ]  # fmt: skip


def with_unknown_names(path):
    """Rename all joints of a file to unknown names."""
    text = re.sub(r"(ROOT|JOINT) (\w+)", r"\1 Bone_\2", path.read_text())
    path.write_text(text)
    return path


def names(path, mapping: dict[str, str]) -> str:
    path.write_text("".join(f"Bone_{theirs}: {ours}\n" for theirs, ours in mapping.items()))
    return str(path)


def test_a_mapping_to_a_known_skeleton_gives_its_motion(tmp_path):
    known = read_take(bvh(tmp_path / "known.bvh", poses()))
    path = with_unknown_names(bvh(tmp_path / "take.bvh", poses()))
    with pytest.raises(
        ValueError, match=r"found Bone_hip, .* lacks to be [^;]*: .*; mapped: .* motion\.mapping=<a YAML"
    ):
        read_take(path)
    mapping = names(tmp_path / "names.yaml", {theirs: theirs for theirs in ("neck", "lCollar", "rCollar", *_OURS)})
    mapped = read_take(path, mapping=mapping)
    assert "cgspeed for Daz" in mapped.name
    assert np.array_equal(mapped.rotations, known.rotations)


def test_a_mapping_to_our_names_reads_any_skeleton(tmp_path):
    known = read_take(bvh(tmp_path / "known.bvh", poses()))
    mapping = names(tmp_path / "names.yaml", _OURS)
    mapped = read_take(with_unknown_names(bvh(tmp_path / "take.bvh", poses())), mapping=mapping)
    assert "mapped" in mapped.name
    assert np.abs(joints(mapped) - joints(known)).max() < 1e-6
    # Elbows of this skeleton bend straight forward, where those of CMU's bend 30 degrees up.
    other = [i for i, name in enumerate(SEGMENTS) if "upper_arm" not in name]
    assert np.allclose(mapped.rotations[:, other], known.rotations[:, other], atol=1e-6)
    config = MotionConfig("bvh", path=str(tmp_path / "take.bvh"), mapping=mapping)
    assert len(load_motion(config, seconds=0.4, fps=25, rng=np.random.default_rng(0))) == 10


def test_a_skeleton_without_hands_is_refused_by_what_it_lacks(tmp_path):
    path = with_unknown_names(bvh(tmp_path / "take.bvh", poses()))
    arms = {theirs: ours for theirs, ours in _OURS.items() if "hand" not in ours and "knuckle" not in ours}
    with pytest.raises(ValueError, match=r"lacks to be mapped: l_wrist.*, r_knuckle\. If") as error:
        read_take(path, mapping=names(tmp_path / "names.yaml", arms))
    assert "\n" not in str(error.value)


def test_an_acclaim_skeleton_can_be_mapped(tmp_path):
    known = read_take(amc(tmp_path / "99_01.amc", [{}] * 40))
    for file in (tmp_path / "99.asf", tmp_path / "99_01.amc"):
        file.write_text(file.read_text().replace("femur", "oberschenkel"))
    (tmp_path / "names.yaml").write_text("loberschenkel: lfemur\nroberschenkel: rfemur\n")
    mapped = read_take(tmp_path / "99_01.amc", mapping=str(tmp_path / "names.yaml"))
    assert np.array_equal(mapped.rotations, known.rotations)


def test_skeletons_that_rest_with_z_up_are_turned_upright(tmp_path):
    known = read_take(bvh(tmp_path / "known.bvh", poses()))
    path = with_unknown_names(bvh(tmp_path / "take.bvh", poses()))
    head, motion = path.read_text().split("MOTION")

    def turned(match: re.Match) -> str:
        x, y, z = match[1].split()
        return f"OFFSET {x} {-float(z)} {y}"

    # x to the left, -y forward, z up: a turn about the file's forward axis is one about -y.
    head = re.sub(r"OFFSET (.*)", turned, head)
    head = head.replace("Zrotation Xrotation Yrotation", "Yrotation Xrotation Zrotation")
    lines = motion.splitlines()
    for i in range(3, len(lines)):
        words = [float(word) for word in lines[i].split()]
        words = [words[0], -words[2], words[1], *(-word if j % 3 == 0 else word for j, word in enumerate(words[3:]))]
        lines[i] = " ".join(map(str, words))
    path.write_text(head + "MOTION" + "\n".join(lines) + "\n")
    for up in (UpAxis.auto, UpAxis.z):
        mapped = read_take(path, mapping=names(tmp_path / "names.yaml", _OURS), up=up)
        assert np.abs(joints(mapped) - joints(known)).max() < 1e-6


def test_skeletons_that_do_not_rest_upright_are_refused(tmp_path):
    path = with_unknown_names(bvh(tmp_path / "take.bvh", poses()))
    path.write_text(path.read_text().replace("OFFSET 0.0 -0.42 0.0", "OFFSET 0.0 0.42 0.0"))
    with pytest.raises(ValueError, match="stand upright along an axis of the file when all angles are zero"):
        read_take(path, mapping=names(tmp_path / "names.yaml", _OURS))


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        (None, FileNotFoundError, r"motion\.mapping: no such file .*names\.yaml"),
        ("", ValueError, "expected YAML lines `their name: our name`, found NoneType"),
        ("- hip\n", ValueError, "found list"),
        ("Bone_hip: [pelvis]\n", ValueError, r"expected a name after each colon, found 'Bone_hip': \['pelvis'\]"),
        ("{a: b", ValueError, r"names.yaml: expected YAML, while parsing"),
        ("!!python/object/apply:os.getcwd []\n", ValueError, "could not determine a constructor"),
        ("Hips: pelvis\n", ValueError, r"a name of motion\.mapping, which has Hips; found Bone_hip, "),
        ("Bone_hip: pelvis\nBone_chest: pelvis\n", ValueError, r"found several for pelvis"),
        ("Bone_hip: Becken\n", ValueError, r"found none for .*pelvis"),
        ("Bone_hip: pelvis\n", ValueError, r"mapped: spine\|chest, .*motion\.mapping"),
    ],
)
def test_mappings_that_do_not_fit_are_refused(tmp_path, text, error, message):
    path = with_unknown_names(bvh(tmp_path / "take.bvh", poses(20)))
    if text is not None:
        (tmp_path / "names.yaml").write_text(text)
    with pytest.raises(error, match=message):
        read_take(path, mapping=str(tmp_path / "names.yaml"))


def test_a_skeleton_matches_one_dialect_only():
    for dialect in DIALECTS:
        own = {name.casefold() for options in dialect.names().values() for name in options}
        for other in DIALECTS:
            if other is not dialect:
                wanted = [{name.casefold() for name in options} for options in other.names().values()]
                assert not all(options & own for options in wanted), (dialect.name, other.name)


@pytest.mark.parametrize("bone", ["0.28 0.0 0.0", "0.25 0.0 0.0", "0.09 0.0 0.0", "0.0 -0.42 0.0", "0.0 -0.41 0.0"])
def test_bones_without_length_are_named(tmp_path, bone):
    path = bvh(tmp_path / "take.bvh", poses(20))
    text = path.read_text()
    # The left one of each.
    path.write_text(text.replace(f"OFFSET {bone}", "OFFSET 0.0 0.0 0.0", 1))
    with pytest.raises(
        ValueError, match=r"expected bones of some length, found none between 'l\w+' and where l_\w+ ends"
    ):
        read_take(path)


def test_a_world_with_z_up_can_be_given(tmp_path):
    upright = read_take(bvh(tmp_path / "y.bvh", [{"lThigh": (0, -i / 2, 0), "lShldr": (-80, 0, 0)} for i in range(40)]))
    lying = [
        {"hip": (0, 90, 0), "root": (0, -1, 1), "lThigh": (0, -i / 2, 0), "lShldr": (-80, 0, 0)} for i in range(40)
    ]
    path = bvh(tmp_path / "z.bvh", lying)
    stood = read_take(path, up=UpAxis.z)
    assert np.allclose(stood.rotations[:, 0, 2], (0, 0, 1))
    stood, upright = (m.rotations[:, :1].swapaxes(-1, -2) @ m.rotations for m in (stood, upright))
    assert np.allclose(stood, upright, atol=1e-6), "whatever the heading"
    with pytest.raises(ValueError, match=r"body upright, found its chest along \+x .* give motion\.up=<the axis"):
        read_take(path)
    assert read_take(path, up=UpAxis.y).rotations[0, 0, 0, 2] == pytest.approx(1), "lying is accepted"


def test_a_unit_can_be_given_for_giants(tmp_path):
    path = bvh(tmp_path / "take.bvh", [{"lShldr": (-80, 0, 0)}] * 20, scale=5)
    with pytest.raises(ValueError, match=r"if it is correct, give motion\.unit"):
        read_take(path)
    motion = read_take(path, unit=0.2)
    assert "units of 0.2 m" in motion.name
    assert motion.hip_height == pytest.approx(0.83 * 1.0794, abs=1e-3)
    assert "inches" in read_take(bvh(tmp_path / "inches.bvh", [{"lShldr": (-80, 0, 0)}] * 20, scale=1 / 0.0254)).name


@pytest.mark.parametrize("setting", [{"fps": 0.0}, {"fps": -1.0}, {"unit": 0.0}, {"unit": float("inf")}])
def test_invalid_fps_and_unit_are_refused(setting):
    with pytest.raises(ValueError, match=rf"motion\.{next(iter(setting))}: expected more than 0"):
        MotionConfig(**setting)
