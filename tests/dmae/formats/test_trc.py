"""TRC written and read: by ourselves, by a reader that shares nothing with ours, and the authors' own files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BLAZEPOSE33, BODY25, BODY25B, HALPE26, SHELF14, SKELETONS
from dmae.formats.config import LengthUnit
from dmae.formats.poses import person_paths, read_poses
from dmae.formats.trc import marker, opensim_marker, read_trc, write_trc
from dmae.formats.writing import write_poses
from tests.support.animals import DOG, dog
from tests.support.clips import walkers
from tests.support.recordings import recording
from tests.support.trc_files import read_independently


def holed(persons: int = 1) -> Poses3D:
    """Every source there is; one frame without anybody."""
    poses = walkers(persons=persons)
    xyz, source = poses.xyz.copy(), poses.source.copy()
    xyz[2, :, 3:6], source[2, :, 3:6] = np.nan, Source.ABSENT
    xyz[5], source[5] = np.nan, Source.ABSENT
    source[3, :, 4], source[4, :, 7] = Source.COMPLETED, Source.DENOISED
    return Poses3D(BODY25, xyz, source)


def export(poses: Poses3D, path: Path, fps: float = 25.0, unit: LengthUnit = LengthUnit.m, first: int = 0) -> None:
    clip = replace(recording(BODY25, len(poses.xyz)), fps=fps, poses=poses, provenance={"first_frame": first})
    write_poses(clip, path, "trc", unit=unit)


@pytest.mark.parametrize(("unit", "metre"), [(LengthUnit.m, 1), (LengthUnit.mm, 1000)])
def test_an_independent_reader_finds_the_same_y_up(tmp_path, unit, metre):
    poses = holed()
    write_trc(poses, 25.0, tmp_path / "walk.trc", unit)
    names, xyz = read_independently(tmp_path / "walk.trc")
    assert names[:3] == ["Nose", "Neck", "RShoulder"]
    assert names[8] == "CHip"
    assert names[20] == "LSmallToe"
    np.testing.assert_allclose(xyz[..., [2, 0, 1]] / metre, poses.xyz[:, 0], atol=1e-6)
    # They stand upright.
    assert np.nanmean(xyz[:, 0, 1] - xyz[:, 11, 1]) > 1.4 * metre
    lines = (tmp_path / "walk.trc").read_text().splitlines()
    assert lines[2].split("\t")[:5] == ["25", "25", "12", "25", unit]
    assert [line.split("\t")[:2] for line in lines[5:8]] == [["0", "0.000000"], ["1", "0.040000"], ["2", "0.080000"]]


@pytest.mark.parametrize("unit", list(LengthUnit))
def test_read_after_write_is_equal(tmp_path, unit):
    poses = holed()
    export(poses, tmp_path / "walk.trc", 29.97, unit)
    found, fps = read_trc(tmp_path / "walk.trc", BODY25)
    assert fps == 29.97
    np.testing.assert_allclose(found.xyz, poses.xyz, atol=1e-6)
    np.testing.assert_array_equal(found.source, poses.source)


@pytest.mark.parametrize("unit", list(LengthUnit))
def test_covariances_are_kept_in_a_file_beside_it_in_the_axes_of_the_trc(tmp_path, unit):
    poses = holed(2)
    root = np.random.default_rng(0).normal(0, 0.02, (*poses.xyz.shape, 3))
    cov = np.where((poses.source == Source.ABSENT)[..., None, None], np.nan, root @ root.swapaxes(-1, -2))
    export(Poses3D(BODY25, poses.xyz, poses.source, cov), tmp_path / "walk.trc", unit=unit)
    read = read_poses(tmp_path / "walk.trc").poses
    np.testing.assert_allclose(read.cov, cov, rtol=1e-4, atol=1e-9)
    np.testing.assert_array_equal(read.source, poses.source)
    table = (tmp_path / "walk_P1.covariance.csv").read_text().splitlines()
    header, first = (table[i].split(",") for i in (0, 1))
    # The vertical of the file is y: our z.
    metre = {LengthUnit.m: 1, LengthUnit.cm: 100, LengthUnit.mm: 1000}[unit]
    assert float(first[header.index("Nose_yy")]) == pytest.approx(cov[0, 0, 0, 2, 2] * metre**2, rel=1e-4)
    (tmp_path / "walk_P1.covariance.csv").write_text("\n".join(table[:-1]))
    with pytest.raises(ValueError, match="expected 12 frames of 25 markers"):
        read_poses(tmp_path / "walk.trc")


def test_frames_have_the_numbers_of_the_recording_and_times_count_from_the_first(tmp_path):
    export(holed(), tmp_path / "walk.trc", first=100)
    lines = [line.split("\t") for line in (tmp_path / "walk.trc").read_text().splitlines()]
    assert lines[2][6] == "100"
    assert [line[:2] for line in lines[5:7]] == [["100", "0.000000"], ["101", "0.040000"]]
    assert "P1,nose,100,104,0.000000,0.160000,measured" in (tmp_path / "walk.provenance.csv").read_text().splitlines()


def test_markers_are_called_as_in_the_models_for_opensim():
    assert opensim_marker("mid_hip", BODY25) == "CHip" and opensim_marker("mid_hip", HALPE26) == "Hip"
    assert opensim_marker("head_top", BODY25B) == "Head" and opensim_marker("l_big_toe", BODY25) == "LBigToe"
    fingers = ["r_little_finger", "l_index_finger", "l_thumb"]
    assert [opensim_marker(joint, BLAZEPOSE33) for joint in fingers] == ["RPinky", "LIndex", "LThumb"]


def test_how_joints_are_known_is_listed_in_a_table_beside_it(tmp_path):
    """One row per run, on the skeleton of the poses, whatever skeleton the file has; derived joints too."""
    export(holed(), tmp_path / "walk.trc")
    table = (tmp_path / "walk.provenance.csv").read_text()
    lines = table.splitlines()
    assert lines[0] == "person,joint,first_frame,last_frame,first_s,last_s,source"
    assert "P1,r_wrist,3,3,0.120000,0.120000,completed" in lines
    assert "P1,l_wrist,4,4,0.160000,0.160000,measured (smoothed)" in lines
    assert "P1,r_elbow,2,2,0.080000,0.080000,absent" in lines
    assert any(line.startswith("P1,bottom_head") for line in lines)
    clip = replace(recording(BODY25, 12), poses=holed())
    write_poses(clip, tmp_path / "walk.trc", "trc", skeleton="coco17")
    assert (tmp_path / "walk.provenance.csv").read_text() == table
    found, _ = read_trc(tmp_path / "walk.trc", BODY25)
    assert found.source[3, 0, 4] == Source.COMPLETED and found.source[4, 0, 7] == Source.DENOISED
    # A joint that was measured, and rejected, is told apart from one on which fewer than two cameras agree.
    export(replace(holed(), views=np.full(holed().source.shape, 2)), tmp_path / "walk.trc")
    assert "3,3,0.120000,0.120000,completed (rejected)" in (tmp_path / "walk.provenance.csv").read_text()
    assert read_trc(tmp_path / "walk.trc", BODY25)[0].source[3, 0, 4] == Source.COMPLETED
    (tmp_path / "walk.provenance.csv").unlink()
    found, _ = read_trc(tmp_path / "walk.trc")
    assert set(np.unique(found.source)) == {Source.ABSENT, Source.MEASURED}


def test_a_skeleton_of_your_own_is_defined_in_a_file_beside_it(tmp_path):
    rng = np.random.default_rng(0)
    poses = Poses3D(DOG, np.stack([dog(8, rng=rng), dog(8, rng=rng)], 1))
    write_trc(poses, 30.0, tmp_path / "dogs.trc")
    read = read_poses(tmp_path / "dogs.trc")
    assert read.poses.skeleton == DOG
    np.testing.assert_allclose(read.poses.xyz, poses.xyz, atol=1e-6)
    (tmp_path / "dogs_P1.skeleton.yaml").unlink()
    with pytest.raises(KeyError, match=r"dogs_P1\.skeleton\.yaml next to it defines another"):
        read_trc(tmp_path / "dogs_P1.trc")
    with pytest.raises(KeyError, match="skeleton 'body25' has no joints for the markers"):
        read_trc(tmp_path / "dogs_P1.trc", BODY25)
    write_trc(walkers(8, 2), 30.0, tmp_path / "dogs.trc")
    assert read_poses(tmp_path / "dogs.trc").poses.skeleton == BODY25, "of earlier poses nothing is left"


def test_names_of_any_language_are_written_as_they_are(tmp_path):
    skeleton = replace(DOG, joints=("Rücken", *DOG.joints[1:]))
    write_trc(Poses3D(skeleton, dog(2, rng=np.random.default_rng(0))[:, None]), 30.0, tmp_path / "a.trc")
    assert "  Rücken:" in (tmp_path / "a.skeleton.yaml").read_text("utf-8")
    assert read_poses(tmp_path / "a.trc").poses.skeleton == skeleton


def test_several_persons_are_several_files(tmp_path):
    poses = holed(3)
    written = write_trc(poses, 25.0, tmp_path / "walk.trc")
    assert [path.name for path in written] == ["walk_P1.trc", "walk_P2.trc", "walk_P3.trc"]
    assert written == person_paths(tmp_path / "walk.trc", ["P1", "P2", "P3"])
    for person, path in enumerate(written):
        np.testing.assert_allclose(read_trc(path)[0].xyz[:, 0], poses.xyz[:, person], atol=1e-6)


@pytest.mark.parametrize("skeleton", [BODY25, BODY25B, HALPE26, SHELF14], ids=lambda s: s.name)
def test_markers_lead_back_to_their_joints(tmp_path, skeleton):
    write_trc(walkers(2, 1, skeleton), 25.0, tmp_path / "a.trc")
    found, _ = read_trc(tmp_path / "a.trc")
    assert set(skeleton.joints) <= set(found.skeleton.joints)
    assert len({marker(joint) for joint in skeleton.joints}) == len(skeleton)


def trc(rows: list[str], names="Neck\t\t\tNose", second="25\t25\t2\t2\tmm\t25\t1\t2", blank=False) -> str:
    head = [
        "PathFileType\t4\t(X/Y/Z)\tx.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        second,
        f"Frame#\tTime\t{names}\t\t",
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
    ]
    return "\n".join([*head, *[""] * blank, *rows, ""])


@pytest.mark.parametrize("blank", [False, True])
@pytest.mark.parametrize("tail", ["", "\t", "\t\t\t"])
def test_files_as_others_write_them(tmp_path, blank, tail):
    """Millimetres, an empty line after the header, cells missing or added at the end of a line."""
    rows = ["1\t0.0\t1000\t2000\t3000\t\t\t" + tail, "2\t0.04\t10\t20\t30\t40\t50\t60" + tail, "3\t0.08\t1\t2\t3"]
    (tmp_path / "x.trc").write_text(trc(rows, blank=blank))
    found, fps = read_trc(tmp_path / "x.trc", BODY25)
    neck, nose = BODY25.index("neck", "nose")
    assert fps == 25
    np.testing.assert_allclose(found.xyz[:2, 0, neck], [(3, 1, 2), (0.03, 0.01, 0.02)], rtol=1e-6)
    np.testing.assert_allclose(found.xyz[:, 0, nose], [(np.nan,) * 3, (0.06, 0.04, 0.05), (np.nan,) * 3], rtol=1e-6)


@pytest.mark.parametrize(
    ("content", "error", "message"),
    [
        ("", ValueError, "expected a TRC"),
        ("a,b\n" * 9, ValueError, "expected a TRC"),
        (trc(["1\t0\tx"]), ValueError, "line 6: expected numbers"),
        (trc(["1\t0\t1\t2\t3\t4\t5\t6\t7"]), ValueError, "line 6: expected 6 coordinates, found 7"),
        (trc([], second="25\t25\t2\t2\tfeet\t25\t1\t2"), ValueError, "Units of m, cm, mm"),
        (trc([], second="a\t25\t2\t2\tm\t25\t1\t2"), ValueError, "expected a DataRate"),
        (trc([], names="Neck\t\t\tNeck"), ValueError, "different markers"),
        (trc([], names="LKnee\t\t\tleft_knee"), ValueError, "a marker for each joint, found two of one"),
        (trc([], names="Neck\t\t\tTail"), KeyError, r"of no skeleton are \['Tail'\]"),
    ],
)
def test_malformed_files_are_refused_by_name(tmp_path, content, error, message):
    (tmp_path / "bad.trc").write_text(content)
    with pytest.raises(error, match=message) as caught:
        read_trc(tmp_path / "bad.trc")
    assert "bad.trc" in str(caught.value)


@pytest.mark.parametrize("names", ["LKnee\t\t\tNeck", "l_knee\t\t\tneck", "left_knee\t\t\tneck", "L.Knee\t\t\tNECK"])
def test_names_of_joints_are_read_in_every_notation(tmp_path, names):
    (tmp_path / "a.trc").write_text(trc(["1\t0\t1\t2\t3\t4\t5\t6"], names=names))
    found, _ = read_trc(tmp_path / "a.trc")
    np.testing.assert_allclose(
        1000 * found.xyz[0, 0, found.skeleton.index("l_knee", "neck")], [[3, 1, 2], [6, 4, 5]], rtol=1e-6
    )


def test_a_table_of_another_trc_is_refused(tmp_path):
    export(holed(), tmp_path / "a.trc")
    export(walkers(5, 1), tmp_path / "b.trc")
    (tmp_path / "b.provenance.csv").replace(tmp_path / "a.provenance.csv")
    with pytest.raises(ValueError, match=r"a\.provenance\.csv: expected all 12 frames and joints of a\.trc; delete it"):
        read_trc(tmp_path / "a.trc")
    with pytest.raises(FileNotFoundError, match=r"c\.trc: no such file"):
        read_trc(tmp_path / "c.trc")


@pytest.mark.parametrize("skeleton", list(SKELETONS.values()), ids=lambda s: s.name)
def test_opensim_reads_what_is_absent_as_absent(tmp_path, skeleton):
    """Whichever marker is absent, the last on its line too."""
    opensim = pytest.importorskip("opensim")
    poses = walkers(6, 1, skeleton)
    xyz = poses.xyz.copy()
    xyz[1, 0, -1], xyz[2, 0, 0], xyz[3] = np.nan, np.nan, np.nan
    write_trc(Poses3D(skeleton, xyz), 25.0, tmp_path / "a.trc", LengthUnit.mm)
    table = opensim.TimeSeriesTableVec3(str(tmp_path / "a.trc"))
    assert list(table.getColumnLabels()) == [opensim_marker(joint, skeleton) for joint in skeleton.joints]
    found = np.array(
        [
            [
                [cell[axis] for axis in range(3)]
                for cell in (table.getRowAtIndex(frame)[column] for column in range(len(skeleton)))
            ]
            for frame in range(6)
        ]
    )
    np.testing.assert_allclose(found[..., [2, 0, 1]] / 1000, xyz[:, 0], atol=1e-6)


def test_the_files_of_pose2sim_s_authors(data_folder):
    """Upright, in metres, their own numbers where their axes put them."""
    (path,) = (data_folder / "pose2sim").glob("*/*Balancing*/pose-3d/*_0-100.trc")
    found, fps = read_trc(path)
    names, xyz = read_independently(path)
    assert fps == 60
    assert found.skeleton == BODY25B
    assert names == [
        "RHip", "RKnee", "RAnkle", "RBigToe", "RSmallToe", "RHeel", "LHip", "LKnee", "LAnkle", "LBigToe", "LSmallToe",
        "LHeel", "Neck", "Head", "Nose", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist",
    ]  # fmt: skip
    np.testing.assert_allclose(found.xyz[:, 0, BODY25B.index("r_knee")[0]], xyz[:, 1][:, [2, 0, 1]], atol=1e-6)
    height = found.xyz[:, 0, BODY25B.index("head_top")[0], 2] - found.xyz[:, 0, BODY25B.index("l_heel")[0], 2]
    assert 1.4 < np.median(height) < 2.0
    assert np.isnan(found.xyz[:, 0, BODY25B.index("l_eye")[0]]).all()


@pytest.mark.parametrize("persons", [1, 2])
def test_the_name_of_a_file_may_end_like_that_of_a_person(tmp_path, persons):
    poses = holed(persons)
    export(poses, tmp_path / "squat_P2.trc")
    np.testing.assert_array_equal(read_poses(tmp_path / "squat_P2.trc").poses.source, poses.source)
