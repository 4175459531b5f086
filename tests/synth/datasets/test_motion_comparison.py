"""Recorded and generated motion side by side."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from dmae.data.store import save_clip, write_manifest
from synth.commands import compare as command
from synth.commands.config import CompareBy, CompareCommand
from synth.datasets.motion_comparison import Sample, Track, clip_tracks, compare, measure, take_tracks
from synth.motion.config import ProceduralConfig, ReadingConfig
from synth.motion.kinematics import QUANTITIES
from synth.motion.procedural.gait import make_motion
from synth.people.body import SEGMENTS
from synth.physics.body_state import reference_joints
from tests.support.commands import synth
from tests.support.motion_files import amc, bvh
from tests.support.scenes import BODY, RIG, gliding

pytestmark = pytest.mark.slow


def walk(seed: int, seconds: float = 3.0, fps: float = 25.0) -> np.ndarray:
    """(F, 39, 3) joints of a walking person."""
    config = ProceduralConfig(standing=0)
    motion = make_motion(config, seconds=seconds, fps=fps, rng=np.random.default_rng(seed))
    return reference_joints(BODY, motion.root, motion.rotations)


def write_clips(folder: Path, *clips: np.ndarray, fps: float = 25.0, **fields) -> Path:
    """A data set of a clip for each array of one person's joints (F, 39, 3), or of BODY_25's (F, 25, 3)."""
    for number, xyz in enumerate(clips):
        poses = Poses3D(BODY25, xyz[:, None, :25])
        nothing = Detections2D(BODY25, *(np.full((len(xyz), len(RIG), 0, 25, *end), np.nan) for end in ((2,), ())))
        clip = Clip(str(number), fps, RIG, nothing, **(fields or {"truth": poses}))
        save_clip(clip, folder / f"{number:06}")
    write_manifest(folder, [{"id": f"{number:06}", "status": "ok"} for number in range(len(clips))])
    return folder


def sample(values: np.ndarray) -> Sample:
    return Sample("made", 10.0, {quantity.name: values for quantity in QUANTITIES})


def half_away(rng, count: int = 8) -> list[Sample]:
    return [sample(rng.normal(0, 1, 500)) for _ in range(count)]


def test_distances_equal_the_shift_of_values():
    rng = np.random.default_rng(0)
    real = half_away(rng)
    moved = [sample(each.values["knee flexion"] + 5) for each in real]
    for same, other in zip(compare(real, real, rng=rng), compare(real, moved, rng=rng), strict=True):
        assert same.wasserstein == same.ks == same.ratio == 0
        assert other.wasserstein == pytest.approx(5)
        assert other.ks > 0.95
        assert 0 < other.halves_wasserstein < 0.2
        assert other.ratio > 25
        assert other.sim == pytest.approx(np.array(other.real) + 5)


def test_a_single_take_is_compared_with_itself_over_time():
    drifting = sample(np.concatenate([np.zeros(100), np.ones(100)]))
    (first, *_) = compare([drifting], [drifting], rng=np.random.default_rng(0))
    assert (first.wasserstein, first.halves_wasserstein, first.halves_ks) == (0, 1, 1)


def test_what_never_changes_and_is_the_same_does_not_differ():
    """As joints that a recorded skeleton does not have; they were named as the largest differences."""
    still = [sample(np.zeros(100)) for _ in range(2)]
    found = compare(still, still, rng=np.random.default_rng(0))
    assert {each.ratio for each in found} == {0}
    moved = compare(still, [sample(np.ones(100))], rng=np.random.default_rng(0))
    assert {each.ratio for each in moved} == {np.inf}


def test_tracks_count_up_to_the_longest_duration():
    long, short = Track("long", 25.0, walk(0, 20)[:, :25]), Track("short", 25.0, walk(1, 2)[:, :25])
    measured = measure([long, short], longest=4.0)
    assert [each.seconds for each in measured] == [4.0, 2.0]
    assert [len(each.values["knee flexion"]) for each in measured] == [200, 100]
    whole = measure([long], longest=100.0)[0].values["knee flexion"]
    assert np.quantile(measured[0].values["knee flexion"], (0.1, 0.5, 0.9)) == pytest.approx(
        np.quantile(whole, (0.1, 0.5, 0.9)), abs=3
    )


def bending(folder: Path, name: str = "take.bvh", frames: int = 240, fps: float = 60.0) -> tuple[Path, np.ndarray]:
    """A take whose left knee bends by 90 degrees and back every four seconds, and by how much, degrees."""
    bend = 45 * (1 - np.cos(2 * np.pi * np.arange(frames) / fps / 4))
    folder.mkdir(exist_ok=True)
    return bvh(folder / name, [{"lShin": (0, angle, 0)} for angle in bend], fps=fps), bend


def test_a_take_and_a_clip_of_the_same_movement_are_measured_alike(tmp_path):
    path, _ = bending(tmp_path)
    motion = gliding(BODY, 100, (0, 0), (1e-9, 0))
    shin = [SEGMENTS.index(part) for part in ("l_shin", "l_foot")]
    bend = Rotation.from_euler("y", 45 * (1 - np.cos(2 * np.pi * np.arange(100) / 100))[:, None], degrees=True)
    motion.rotations[:, shin] = bend.as_matrix()[:, None]
    clips = write_clips(tmp_path / "set", reference_joints(BODY, motion.root, motion.rotations))
    takes, again = take_tracks(path, 25.0)
    differences = compare(
        measure(takes, 10), measure(clip_tracks(clips, captured=False), 10), rng=np.random.default_rng(0)
    )
    found = {each.quantity.name: each for each in differences}
    assert again == []
    assert found["knee flexion"].real[-1] == pytest.approx(87, abs=4)
    assert found["knee flexion"].wasserstein < 3
    assert found["knee flexion, speed"].wasserstein < 2
    assert found["knee flexion, acceleration"].wasserstein < 10


def test_a_take_in_several_formats_counts_once(tmp_path):
    for folder in ("amc", "bvh"):
        (tmp_path / folder).mkdir()
    amc(tmp_path / "amc" / "02_01.amc", [{}] * 60)
    bending(tmp_path / "bvh", "002_01_walk.bvh")
    bending(tmp_path / "bvh", "mine.bvh")
    tracks, again = take_tracks(tmp_path, 25.0)
    assert [track.name.split()[0] for track in tracks] == ["02_01", "mine"]
    assert again == ["bvh/002_01_walk.bvh is amc/02_01.amc"]
    assert [track.name.split()[0] for track in take_tracks(tmp_path, 25.0, ["0*"])[0]] == ["02_01"]
    slower = take_tracks(tmp_path, 25.0, ["mine"], ReadingConfig(fps=30.0))[0][0]
    assert slower.seconds == pytest.approx(8, abs=0.3)


def test_page_figure_and_numbers_are_written(tmp_path, capsys):
    clips = write_clips(tmp_path / "set", walk(0), walk(1), walk(2)[:9])
    command.run(
        CompareCommand(by=CompareBy.motion, real=str(bending(tmp_path / "real")[0]), sim=str(clips)), tmp_path / "out"
    )
    printed = capsys.readouterr().out
    assert "distances are more than 2 times those of halves" in printed
    assert "left out: 000002, P1, of 0.36 s" in printed
    assert (tmp_path / "out/motion.html").stat().st_size > 100_000
    assert (tmp_path / "out/motion.png").read_bytes()[:4] == b"\x89PNG"
    numbers = json.loads((tmp_path / "out/motion.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert [each["name"] for each in numbers["sim"]] == ["000000, P1", "000001, P1"]
    assert {each["quantity"] for each in numbers["differences"]} == {quantity.name for quantity in QUANTITIES}
    assert all(each["wasserstein"] >= 0 and 0 <= each["ks"] <= 1 for each in numbers["differences"])


def test_captured_clips_serve_as_recordings(tmp_path, capsys):
    """Captured poses are preferred to the truth; joints that were not measured do not count."""
    seen, hidden = walk(0)[:, :25], [BODY25.index(f"{side}_{part}")[0] for side in "lr" for part in ("big_toe", "heel")]
    seen[:, hidden] = np.nan
    seen[:20, BODY25.index("l_wrist")] = np.nan
    fields = {"truth": Poses3D(BODY25, np.zeros((75, 1, 25, 3))), "poses": Poses3D(BODY25, seen[:, None])}
    captured = write_clips(tmp_path / "captured", seen, **fields)
    command.run(
        CompareCommand(by=CompareBy.motion, real=str(captured), sim=str(write_clips(tmp_path / "set", walk(0)))),
        tmp_path / "out",
    )
    found = {each["quantity"]: each for each in json.loads((tmp_path / "out/motion.json").read_text())["differences"]}
    assert "ankle flexion" not in found
    assert "foot slide" not in found
    assert found["knee flexion"]["wasserstein"] < 1e-3
    assert found["elbow flexion"]["wasserstein"] < 2


def damaged(kind: str, folder: Path) -> dict[str, str]:
    """What to override so that `kind` is wrong."""
    (folder / "empty").mkdir()
    (folder / "text").mkdir()
    (folder / "text" / "take.bvh").write_text("not motion")
    return {
        "no such folder": {"real": folder / "nowhere"},
        "no takes": {"real": folder / "empty"},
        "no motion": {"real": folder / "text"},
        "no such name": {"takes": ["99_*"]},
        "no clips": {"sim": folder / "empty"},
        "no truth": {"sim": write_clips(folder / "blind", walk(0), truth=None)},
        "too few frames": {"sim": write_clips(folder / "short", walk(0)[:5])},
        "nothing in the set": {"sim": write_clips(folder / "deserted")},
        "no people": {"sim": write_clips(folder / "nobody", walk(0), truth=Poses3D(BODY25, np.zeros((75, 0, 25, 3))))},
        "two rates": {"real": write_clips(folder / "fast", walk(0, fps=50.0), fps=50.0)},
    }[kind]


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("no such folder", "nowhere: no such file or folder"),
        ("no takes", r"empty: expected takes \(.amc, .bvh, .npz, .c3d\) or clips, found neither"),
        ("no motion", "take.bvh"),
        ("no such name", r"no take is called 99_\*; there are take"),
        ("no clips", "empty: expected a clip .* found neither"),
        ("no truth", "000000: expected a truth, as in simulated clips, found none"),
        ("too few frames", r"expected a track of 0.4 s or more, found 000000, P1 0.20 s"),
        ("nothing in the set", "deserted: no clip of this data set is ok"),
        ("no people", "found 1 clips without people"),
        ("two rates", r"found 50 a second in .*fast and 25 in .*set; simulate with scene.fps=50"),
    ],
)
def test_bad_input_is_refused(tmp_path, kind, said):
    good = {"real": bending(tmp_path / "real")[0].parent, "sim": write_clips(tmp_path / "set", walk(0))}
    given = {key: value if key == "takes" else str(value) for key, value in (good | damaged(kind, tmp_path)).items()}
    with pytest.raises((ValueError, FileNotFoundError), match=said):
        command.run(CompareCommand(by=CompareBy.motion, **given), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_command_as_it_is_typed(tmp_path):
    bending(tmp_path / "real")
    write_clips(tmp_path / "set", walk(0))
    done = synth(tmp_path, "compare", "by=motion", "real=real", "sim=set", "takes=[take]", "longest=2", "out=page")
    assert done.returncode == 0, done.stderr
    assert "page/motion.html" in done.stdout
    assert "longest: 2" in (tmp_path / "page/config.yaml").read_text()
    with pytest.raises(ValueError, match=r"longest=0.1: expected 0.4 s or more"):
        CompareCommand(longest=0.1)


def test_recorded_walks_resemble_each_other_and_not_balancing(data_folder):
    tracks, again = take_tracks(data_folder / "cmu", 25.0, ["*02_01", "007_*", "cmu_12_*", "49_*"])
    assert (len(tracks), len(again)) == (9, 2)
    walks, balancing = (
        measure([track for track in tracks if track.name.startswith(names)], 10)
        for names in (("02", "007", "cmu_12"), "49")
    )
    assert (len(walks), len(balancing)) == (6, 3)
    found = {each.quantity.name: each for each in compare(walks, balancing, rng=np.random.default_rng(0))}
    assert found["hips along floor, speed"].ratio > 2
    assert found["foot over floor"].ratio > 5
    # What textbooks say of walking: Perry and Burnfield, Gait Analysis (2nd ed., 2010).
    assert found["knee flexion"].real == pytest.approx((5, 25, 65), abs=8)
    assert found["hips along floor, speed"].real[1] == pytest.approx(1.3, abs=0.3)
