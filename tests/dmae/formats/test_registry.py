"""Requirements that every format meets, and adding a format."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.skeleton import BODY25, PANOPTIC19
from dmae.formats.calibrations import calibration_format
from dmae.formats.config import DataConfig, LengthUnit
from dmae.formats.reading import Clips, recognise
from dmae.formats.registry import pose_writer, reader, recording_writer
from dmae.formats.writing import write_poses, write_recording
from tests.support.clips import full_clip, walkers
from tests.support.commands import run_command
from tests.support.recordings import recording, same_detections
from tests.support.robots import needs_robot

REGISTRIES = {each.decorator: each for each in (reader, pose_writer, recording_writer)}
SCRATCH = '''
"""The Lizard tracker's format."""
import numpy as np
from dmae.data.store import load_clip, save_clip
from dmae.formats.registry import pose_writer, reader, recording_writer


@reader("lizard", signs=[["lizard/clip.json"]])
def read_lizard(path, *, fps=None):
    """Recording of the Lizard tracker."""
    return load_clip(path / "lizard")


@pose_writer("lizard", folder=True)
def write_lizard_poses(poses, clip, path):
    """Poses for the Lizard viewer."""
    path.mkdir(parents=True)
    np.save(path / "poses.npy", poses.xyz)


@recording_writer("lizard", lacks=["fps"])
def write_lizard(clip, path):
    """Recording for the Lizard tracker."""
    save_clip(clip, path / "lizard")
'''


@pytest.fixture
def lizard(tmp_path, monkeypatch):
    """A scratch module that adds a format of each kind."""
    for each in REGISTRIES.values():
        monkeypatch.setattr(each, "_added", {})
    (tmp_path / "lizard_format.py").write_text(SCRATCH)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "lizard_format", raising=False)
    import lizard_format

    yield lizard_format
    sys.modules.pop("lizard_format", None)


@pytest.fixture
def captured() -> Clip:
    """Poses with joints of every source."""
    poses = walkers()
    xyz, source = poses.xyz.copy(), poses.source.copy()
    xyz[2, 1, 3:6], source[2, 1, 3:6] = np.nan, Source.ABSENT
    source[:, 0, BODY25.index("l_wrist")] = Source.COMPLETED
    return replace(full_clip(), poses=Poses3D(BODY25, xyz, source))


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, entry.name) for kind, each in REGISTRIES.items() for entry in each.values()]
)
def test_every_format_has_one_line_of_help_and_the_declared_function(kind, name):
    entry = REGISTRIES[kind].find(name)
    assert entry.help.endswith(".") and len(entry.help) <= 120
    assert entry.home == f"{entry.function.__module__}:{entry.function.__name__}"
    assert REGISTRIES[kind]._imported[entry.home] == entry


@pytest.mark.parametrize("name", [name for name in recording_writer if name in reader])
def test_recordings_survive_being_written_and_read(name, tmp_path):
    """Absent joints stay absent; the fields that a format lacks are named by its writer."""
    clip = replace(recording(BODY25), provenance={"first_frame": 7})
    lacking = write_recording(clip, tmp_path / "a", name)
    lacking = dict(option.removeprefix("data.").split("=") for option in lacking.split())
    options = {key: float(value) if key == "fps" else value for key, value in lacking.items()}
    assert recognise(tmp_path / "a") == name
    (found,) = Clips(DataConfig(path=str(tmp_path / "a"), **options))
    same_detections(found.detections, clip.detections)
    np.testing.assert_allclose(found.rig.projections, clip.rig.projections, atol=1e-6)
    assert (found.rig.names, found.fps) == (clip.rig.names, clip.fps)
    assert found.provenance["first_frame"] == 7


@pytest.mark.parametrize("name", pose_writer)
def test_poses_are_written_as_declared_and_twice_alike(name, captured, tmp_path):
    if "robot" in pose_writer.find(name).options:
        needs_robot()
    written = [write_poses(captured, tmp_path / each, name).poses for each in ("a", "b")]
    np.testing.assert_array_equal(written[0].xyz, written[1].xyz)
    assert written[0].skeleton == (PANOPTIC19 if name == "panoptic" else BODY25)
    folder = pose_writer.find(name).folder
    files = {each: [path for path in sorted(tmp_path.glob(f"{each}*")) if path.is_dir() == folder] for each in "ab"}
    assert files["a"] and len(files["a"]) == len(files["b"])
    for first, second in zip(files["a"], files["b"], strict=True):
        for path in sorted(first.rglob("*")) if folder else [first]:
            twin = second / path.relative_to(first) if folder else second
            assert path.is_dir() or path.read_bytes().replace(b"a_P", b"b_P") == twin.read_bytes()


@pytest.mark.parametrize("name", pose_writer)
def test_options_that_a_pose_writer_does_not_take_are_refused(name, captured, tmp_path):
    if "unit" in pose_writer.find(name).options and name != "g1":  # it has no dialect in mm, and says so
        write_poses(captured, tmp_path / "a", name, unit=LengthUnit.mm)
        return
    with pytest.raises(ValueError, match=f"unit=mm: format={name} is"):
        write_poses(captured, tmp_path / "a", name, unit=LengthUnit.mm)


@pytest.mark.parametrize("name", [name for name in pose_writer if pose_writer.find(name).folder])
def test_folders_with_files_are_not_written_into(name, captured, tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "note.txt").touch()
    with pytest.raises(ValueError, match="expected no such folder yet, or an empty one"):
        write_poses(captured, tmp_path / "a", name)


@pytest.mark.parametrize(("kind", "wrong", "right"), [("reader", "shlef", "shelf"), ("pose_writer", "tcr", "trc")])
def test_a_mistyped_format_is_answered_with_the_nearest(kind, wrong, right):
    said = rf"no {kind.replace('_', ' ')} '{wrong}'; did you mean {right}\? There are .*coco, .*:function names another"
    with pytest.raises(ValueError, match=said):
        REGISTRIES[kind].find(wrong)


def test_listing_formats_imports_none_of_them():
    code = (
        "from dmae.formats.registry import reader, pose_writer; print([entry.help for entry in reader.values()]); "
        "import sys; print([name for name in sys.modules if name.startswith(('numpy', 'cv2', 'scipy', 'dmae.data'))])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.splitlines()[-1] == "[]"


@pytest.mark.usefixtures("lizard")
def test_a_format_is_one_file(captured, tmp_path):
    write_recording(captured, tmp_path / "a", "lizard")
    assert recognise(tmp_path / "a") == "lizard"
    (found,) = Clips(DataConfig(path=str(tmp_path / "a")))
    assert len(found) == len(captured)
    with pytest.raises(ValueError, match=r"data=lizard says that itself; leave out data\.unit"):
        Clips(DataConfig("lizard", str(tmp_path / "a"), unit=LengthUnit.mm))[0]
    write_poses(captured, tmp_path / "poses", "lizard")
    assert np.load(tmp_path / "poses" / "poses.npy").shape == captured.poses.xyz.shape
    with pytest.raises(ValueError, match="reader 'lizard': there is one already"):
        reader("lizard")(lambda path: None)


@pytest.mark.usefixtures("lizard")
def test_commands_take_a_new_format(captured, tmp_path):
    write_recording(captured, tmp_path / "a", "clip")

    def run(*arguments: str) -> str:
        done = run_command(tmp_path, "dmae", *arguments)
        assert done.returncode == 0, done
        return done.stdout

    said = run("convert", "data=a", "format=lizard", "out=b")
    assert "b: 12 frames" in said
    assert "read it with data.fps=25, which its files do not state" in said
    run("convert", "data=lizard", "data.path=b", "out=c")
    run("convert", "data=lizard_format:read_lizard", "data.path=b", "out=d")
    assert "data=lizard " in run("convert", "--help", "data")
    run("export", "clip=a", "format=lizard_format:write_lizard_poses", "out=poses")
    assert (tmp_path / "poses" / "poses.npy").is_file()


def test_a_function_of_another_package_is_looked_for_and_explained(tmp_path):
    with pytest.raises(ValueError, match="data=nowhere:read: cannot import nowhere"):
        reader.find("nowhere:read")
    with pytest.raises(ValueError, match=r"json:read: json has no function 'read'; it has .*loads"):
        reader.find("json:read")
    with pytest.raises(ValueError, match=r"numpy:lodtxt: .*; it has \['loadtxt', .*'\.\.\.'\]$") as error:
        reader.find("numpy:lodtxt")
    assert len(str(error.value)) < 500


def test_a_calibration_format_is_one_file(monkeypatch, tmp_path):
    from dmae.formats.calibrations import read_calibration

    pose2sim = calibration_format["pose2sim"]
    monkeypatch.setattr(calibration_format, "_added", {})
    register = calibration_format(
        "lizard", syntax="toml", matches=lambda content: "lizard" in content, files=("*.lizard",)
    )

    @register
    def read_lizard(path, size):
        """TOML with a table [lizard]."""
        return pose2sim.function(path, size)

    rig = replace(full_clip().rig, names=("lizard", "b", "c", "d"))
    pose2sim.write(rig, tmp_path / "rig.lizard")
    assert read_calibration(tmp_path).names == rig.names
    with pytest.raises(ValueError, match="'lizard': there is one already"):
        register(lambda path, size: None)


def test_frames_named_as_by_pose2sim_are_recognised(tmp_path):
    for camera in ("left", "right"):
        (tmp_path / camera).mkdir()
        (tmp_path / camera / "trial.0001.json").write_text('{"people": []}')
    assert recognise(tmp_path) == "openpose"
