"""Optical markers: a synthetic T-pose, malformed files, and real takes against the skeleton solved from them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from synth.motion.config import UpAxis
from synth.motion.readers.c3d import read_points
from synth.motion.source import read_take
from synth.people.body import SEGMENTS
from tests.support.marker_files import as_dec, as_integers, c3d, t_pose
from tests.support.stick_figure import elbows, joints, knees, soles

pytest.importorskip("ezc3d")


def moved(turn: Rotation, step=(0.0, 0.0, 0.0), frames: int = 60) -> dict[str, np.ndarray]:
    """Markers of the T-pose, rotated, and moved by a step per frame."""
    return {name: turn.apply(place) + np.arange(frames)[:, None] * step for name, place in t_pose().items()}


def walking(frames: int = 60) -> dict[str, np.ndarray]:
    return moved(Rotation.identity(), (0.01, 0, 0), frames)


def test_a_t_pose_is_nearly_the_canonical_one(tmp_path):
    motion = read_take(c3d(tmp_path / "take.c3d", walking()))
    assert motion.fps == 100
    assert len(motion) == 60
    angles = np.degrees(Rotation.from_matrix(motion.rotations[0]).magnitude())
    assert dict(zip(SEGMENTS, np.round(angles), strict=True)) == pytest.approx(dict.fromkeys(SEGMENTS, 0), abs=12)
    assert np.median(angles) < 4
    assert motion.hip_height == pytest.approx(0.90, abs=0.02)
    assert motion.root[0, 2] == pytest.approx(motion.hip_height, abs=0.03)
    assert np.diff(motion.root, axis=0)[:, 0] == pytest.approx(0.01, abs=1e-4)


def test_left_and_right_are_mirror_images(tmp_path):
    rotations = read_take(c3d(tmp_path / "take.c3d", walking())).rotations[0]
    mirror = np.diag((1, -1, 1))
    for part in ("upper_arm", "forearm", "hand", "thigh", "shin", "foot"):
        left, right = (rotations[SEGMENTS.index(f"{side}_{part}")] for side in "lr")
        assert np.allclose(mirror @ left @ mirror, right, atol=1e-5), part


def test_turns_and_steps_follow_the_markers(tmp_path):
    turn = Rotation.from_euler("z", 130, degrees=True)
    still, turned = (read_take(c3d(tmp_path / f"{i}.c3d", moved(r))) for i, r in enumerate((Rotation.identity(), turn)))
    # Each foot of a frozen body stands on one spot, which hardly determines the tilt of the floor.
    between = Rotation.from_matrix(turn.as_matrix() @ still.rotations[0]).inv() * Rotation.from_matrix(
        turned.rotations[0]
    )
    assert np.degrees(between.magnitude()).max() < 1.5


@pytest.mark.parametrize(
    ("scale", "units", "label"),
    [
        (1000.0, "mm", r"markers, mm, 100 fps\)"),
        (1.0, "m", r"markers, m, 100 fps\)"),
        (100.0, "cm", r"markers, cm, 100 fps\)"),
        (1 / 0.0254, "in", r"markers, inches, 100 fps\)"),
        (1.0, "mm", r"markers, m, 100 fps, stated in 'mm'\)"),
    ],
)
def test_units_follow_from_legs_whatever_the_file_states(tmp_path, scale, units, label):
    motion = read_take(c3d(tmp_path / "take.c3d", walking(), scale=scale, units=units))
    assert motion.name.endswith(label.replace("\\", ""))
    assert motion.hip_height == pytest.approx(0.90, abs=0.02)


def test_legs_that_fit_no_unit_need_one_to_be_given(tmp_path):
    path = c3d(tmp_path / "take.c3d", walking(), scale=4.0)
    with pytest.raises(ValueError, match=r"found 3\.\d+ units, which is not the length of a human leg .* motion\.unit"):
        read_take(path)
    assert read_take(path, unit=0.25).hip_height == pytest.approx(0.90, abs=0.02)


def test_axes_are_as_the_file_states_or_as_given(tmp_path):
    upright = read_take(c3d(tmp_path / "z.c3d", walking()))
    turned = {name: place[:, [1, 2, 0]] for name, place in walking().items()}
    for path, up in (
        (c3d(tmp_path / "y.c3d", turned, up="+Y"), UpAxis.auto),
        (c3d(tmp_path / "wrong.c3d", turned, up="+Z"), UpAxis.y),
    ):
        assert np.allclose(read_take(path, up=up).rotations, upright.rotations, atol=1e-6)
    with pytest.raises(
        ValueError, match=r"upright, found its chest along \+y .* in 100 % of the frames: give motion\.up"
    ):
        read_take(tmp_path / "wrong.c3d")


def test_dec_files_are_read(tmp_path):
    path = c3d(tmp_path / "take.c3d", walking())
    intel = read_take(path)
    dec = read_take(as_dec(path).rename(tmp_path / "dec.c3d"))
    assert dec.fps == intel.fps
    assert np.array_equal(dec.rotations, intel.rotations)


def test_integers_are_scaled(tmp_path):
    markers = walking() | {"LFIN": np.where(np.arange(60)[:, None] < 4, np.nan, walking()["LFIN"])}
    path = c3d(tmp_path / "take.c3d", markers)
    floats = read_points(path)
    integers = read_points(as_integers(path, 0.1))
    for label, places in floats.places.items():
        assert np.allclose(integers.places[label], places, atol=0.051, equal_nan=True), label


def test_short_gaps_are_filled_and_noted(tmp_path):
    markers = walking()
    whole = read_take(c3d(tmp_path / "whole.c3d", markers))
    markers["LKNE"][20:40] = np.nan
    markers["RSHO"][5:8] = 0
    gaps = read_take(c3d(tmp_path / "gaps.c3d", markers))
    assert "23 values interpolated" in gaps.name
    assert np.abs(gaps.rotations - whole.rotations).max() < 1e-3
    markers["RSHO"][:25] = np.nan
    markers["LKNE"][:19] = walking()["LKNE"][:19]
    late = read_take(c3d(tmp_path / "late.c3d", markers))
    assert len(late) == 35
    assert "20 values interpolated, frames 26-60 of 60" in late.name


def test_markers_with_long_gaps_are_named(tmp_path):
    markers = walking()
    markers["RANK"][10:50] = np.nan
    with pytest.raises(ValueError, match=r"at least half of 60 frames in a row .*; missing are RANK in 67 %"):
        read_take(c3d(tmp_path / "take.c3d", markers))


def test_the_fifth_metatarsals_may_be_missing(tmp_path):
    whole = read_take(c3d(tmp_path / "whole.c3d", walking()))
    lacking = {name: place for name, place in walking().items() if "MT5" not in name}
    other = read_take(c3d(tmp_path / "lacking.c3d", lacking))
    assert (
        np.degrees(Rotation.from_matrix(whole.rotations[0].swapaxes(1, 2) @ other.rotations[0]).magnitude()).max() < 8
    )


def test_labels_may_have_wearers_and_synonyms(tmp_path):
    plain = read_take(c3d(tmp_path / "plain.c3d", walking()))
    worn = {f"Takeo:{name.replace('FWT', 'ASI').replace('BWT', 'PSI')}": place for name, place in walking().items()}
    worn["*12"] = np.zeros(3)
    assert np.allclose(read_take(c3d(tmp_path / "worn.c3d", worn)).rotations, plain.rotations)
    strange = {f"marker {i}": place for i, place in enumerate(walking().values())}
    path = c3d(tmp_path / "strange.c3d", strange)
    with pytest.raises(
        ValueError, match=r"found marker 0, marker 1, .*; lacking are C7, T10, CLAV, .* motion\.mapping"
    ):
        read_take(path)
    names = tmp_path / "names.yaml"
    names.write_text("".join(f"{theirs}: {ours}\n" for theirs, ours in zip(strange, walking(), strict=True)))
    assert np.allclose(read_take(path, mapping=str(names)).rotations, plain.rotations)


def test_two_people_in_a_file_need_a_mapping(tmp_path):
    both = {f"{who}:{name}": place for who in ("Ada", "Bob") for name, place in walking().items()}
    path = c3d(tmp_path / "two.c3d", both)
    with pytest.raises(ValueError, match=r"markers of one person, found 2 of C7: Ada:C7, Bob:C7"):
        read_take(path)
    names = tmp_path / "names.yaml"
    names.write_text(
        "".join(f"Bob:{name}: other {name}\n" for name in walking()).replace("Bob:", "'Bob:").replace(": o", "': o")
    )
    with pytest.raises(ValueError, match=r"expected motion\.mapping to map"):
        read_take(path, mapping=str(names))
    names.write_text(names.read_text() + "".join(f"'Ada:{name}': {name}\n" for name in walking()))
    assert len(read_take(path, mapping=str(names))) == 60


def broken(path, at: int, data: bytes):
    content = bytearray(path.read_bytes())
    content[at : at + len(data)] = data
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda p: p.write_bytes(b""), "expected a C3D file"),
        (lambda p: p.write_bytes(b"HIERARCHY\n" * 100), "expected a C3D file"),
        (lambda p: p.write_bytes(p.read_bytes()[:400]), "expected a C3D file"),
        (lambda p: p.write_bytes(p.read_bytes()[:-3000]), r"expected 60 frames of 32 points, \d+ bytes, .* cut off"),
        (lambda p: broken(p, 8, b"\xff\xff"), r"expected 65535 frames of 32 points, \d+ bytes, .* cut off"),
        (lambda p: broken(p, 6, b"\xf0\x00"), "expected frames of points, the header states 32 points in -179 frames"),
        (lambda p: broken(p, 2, b"\x00\x00"), "expected frames of points, the header states 0 points"),
        (lambda p: broken(p, 2, b"\x10\x00"), "as many points in the header, .* found 16, 32 and 32"),
        (lambda p: broken(p, 20, b"\x00\x00\xf0\x42"), r"found 120 in the header and 100 in POINT:RATE; give motion"),
        (lambda p: broken(p, 515, b"\x10"), "expected a C3D file .*processor 84 to 86"),
        (lambda p: broken(p, 520, b"\xff" * 400), "expected groups of parameters"),
    ],
)  # fmt: skip
def test_files_with_wrong_headers_are_refused(tmp_path, harm, message):
    path = c3d(tmp_path / "take.c3d", walking())
    harm(path)
    with pytest.raises(ValueError, match=rf"take\.c3d: .*({message})"):
        read_take(path)


def test_markers_at_one_place_are_named(tmp_path):
    markers = walking() | {"LELB": walking()["LSHO"]}
    with pytest.raises(ValueError, match=r"expected markers apart that lie at the same place: LSHO and LELB$"):
        read_take(c3d(tmp_path / "take.c3d", markers))


def test_markers_in_line_are_refused_with_their_frame(tmp_path):
    markers = walking()
    markers["LWRA"][30] = markers["LWRB"][30]
    with pytest.raises(ValueError, match=r"show how l_upper_arm lies, .* in frame 31 of"):
        read_take(c3d(tmp_path / "take.c3d", markers))


def test_rates_can_be_replaced_and_must_be_plausible(tmp_path):
    path = c3d(tmp_path / "take.c3d", walking())
    assert read_take(path, 50.0).fps == 50
    with pytest.raises(ValueError, match=r"expected 5 to 1000 frames a second, found 2000; give motion.fps"):
        read_take(c3d(tmp_path / "fast.c3d", moved(Rotation.identity()), fps=2000.0))
    with pytest.raises(ValueError, match=r"no more than 12.5 m/s, found 20 m/s in frames .* at 100 a second"):
        read_take(c3d(tmp_path / "far.c3d", moved(Rotation.identity(), (0.2, 0, 0))))


@pytest.mark.parametrize(("take", "acclaim"), [("02_01.c3d", "02_01.amc"), ("cmu_02_05.c3d", "02_05.amc")])
def test_real_markers_and_the_skeleton_solved_from_them_agree(data_folder, take, acclaim):
    cmu = data_folder / "cmu"
    marked, solved = read_take(cmu / "c3d" / take), read_take(cmu / "asf_amc" / acclaim)
    assert len(marked) == len(solved)
    apart = np.linalg.norm(joints(marked) - joints(solved), axis=-1)
    assert apart.mean(0).max() < 0.030, dict(zip(SEGMENTS, apart.mean(0).round(3), strict=True))
    assert np.median(apart) < 0.016
    assert (apart < 0.030).mean() > 0.96
    assert marked.hip_height == pytest.approx(solved.hip_height, rel=0.02)
    between = Rotation.from_matrix((marked.rotations.swapaxes(-1, -2) @ solved.rotations).reshape(-1, 3, 3))
    mean = dict(zip(SEGMENTS, np.degrees(between.magnitude()).reshape(-1, len(SEGMENTS)).mean(0), strict=True))
    assert max(mean[part] for part in mean if "hand" not in part and "upper_arm" not in part) < 6, mean
    assert max(mean.values()) < 22, mean


@pytest.mark.parametrize("take", ["02_01.c3d", "cmu_02_05.c3d"])
def test_real_markers_move_as_people_do(data_folder, take):
    motion = read_take(data_folder / "cmu" / "c3d" / take)
    lowest = soles(motion)[..., 2].min((1, 2))
    assert abs(np.median(lowest)) < 0.03
    assert np.percentile(lowest, 2) > -0.06
    assert np.degrees(knees(motion).min()) > -6
    assert np.degrees(elbows(motion).min()) > -6
    assert np.median(motion.rotations[:, SEGMENTS.index("head"), 2, 2]) > 0.5


def test_real_markers_and_an_avatar_agree(data_folder):
    # 60 frames a second; another program has put the feet on another floor and kept the hips from moving up and down.
    marked = joints(read_take(data_folder / "cmu/c3d/02_01.c3d"))[1::2]
    avatar = joints(read_take(data_folder / "cmu/bvh_cc/002_01.bvh"))
    marked, avatar = (places - places.mean(1, keepdims=True) for places in (marked, avatar))
    apart = np.linalg.norm(marked - avatar, axis=-1)
    assert apart.mean(0).max() < 0.030, dict(zip(SEGMENTS, apart.mean(0).round(3), strict=True))
    assert np.median(apart) < 0.012


@pytest.mark.parametrize("take", ["02_01.c3d", "cmu_02_05.c3d"])
def test_points_agree_with_ezc3d(data_folder, take, tmp_path):
    import ezc3d

    path = data_folder / "cmu/c3d" / take
    content = ezc3d.c3d(str(path))
    ours, theirs = read_points(path), content["data"]["points"][:3].transpose(2, 1, 0)
    assert list(ours.places) == content["parameters"]["POINT"]["LABELS"]["value"]
    assert np.array_equal(np.stack(list(ours.places.values()), axis=1), theirs, equal_nan=True)
    assert (ours.fps, ours.unit, ours.up) == (120, "mm", "z")


def test_real_dec_files_are_read(data_folder, tmp_path):
    original = data_folder / "cmu/c3d/02_01.c3d"
    path = tmp_path / "02_01.c3d"
    path.write_bytes(original.read_bytes())
    assert np.allclose(read_take(as_dec(path)).root, read_take(original).root, atol=1e-9)
