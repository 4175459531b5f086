"""Data sets: the same clip wherever it is made, nothing half-made, nothing lost, nothing silent."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.data.clip import Clip
from dmae.data.images import KINDS
from dmae.data.labels import Visibility
from dmae.data.resources import resource_folder
from dmae.data.store import CHECKSUMS, load_clip, read_manifest
from dmae.files.checksums import begin_data_set, seal
from synth.datasets import clip as module
from synth.datasets import generate as dataset
from synth.datasets.clip import attempt_seed, generate_clip
from synth.datasets.config import GenerateConfig
from synth.datasets.generate import CONFIG, generate
from synth.datasets.verify import verify
from synth.detector.config import DetectorConfig
from synth.detector.errors_of_joints import Misses
from synth.detector.errors_of_persons import Ghosts
from synth.errors import FailedSimulation
from synth.motion.config import MotionConfig
from synth.people.body import SEGMENTS
from synth.rendering.config import ImageQuality
from synth.rigs.config import CameraConfig, JitterConfig, MiscalibrationConfig, RigConfig, RingConfig
from synth.scene.config import SceneConfig
from synth.scene.spec import SceneSpec
from tests.support.damages import contents
from tests.support.rigs import LEFT, PRESETS
from tests.support.rigs import config as rig_config

pytestmark = pytest.mark.slow


def three_clips(out: Path) -> GenerateConfig:
    """Three clips of two persons and ten frames, seen by two small cameras."""
    return GenerateConfig(
        out=str(out),
        seed=3,
        clips=3,
        scene=SceneConfig(persons=[2, 2], seconds=0.4, props=[0, 1]),
        rig=RigConfig(ring=RingConfig(views=2, focal=90, size=[96, 72])),
        detector=DetectorConfig(ghosts=Ghosts(0.3), misses=Misses(person=0.1)),
    )


@pytest.fixture
def config(tmp_path) -> GenerateConfig:
    return three_clips(tmp_path / "data")


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[Path, list[dict]]:
    """The data set of this configuration, and the lines that `generate` returned."""
    out = tmp_path_factory.mktemp("whole") / "data"
    return out, generate(three_clips(out))


@pytest.fixture
def made(monkeypatch) -> list[tuple[int, int]]:
    """(index, attempt) of each clip that is made, in order."""
    calls, attempt = [], module._attempt

    def note(config, index, number):
        calls.append((index, number))
        return attempt(config, index, number)

    monkeypatch.setattr(module, "_attempt", note)
    return calls


def failing(monkeypatch, fails) -> None:
    """Let the simulations of specs fail for which `fails` is True."""
    simulate = module.simulate

    def sometimes(spec, *more, **how):
        if fails(spec):
            raise FailedSimulation(f"clip {spec.clip} fell over")
        return simulate(spec, *more, **how)

    monkeypatch.setattr(module, "simulate", sometimes)


def labels(config: GenerateConfig) -> list[bytes]:
    return [path.read_bytes() for path in sorted(Path(config.out).glob("*/arrays.safetensors"))]


def test_clips_are_consistent(whole):
    out, lines = whole
    assert [line["id"] for line in lines] == ["000000", "000001", "000002"]
    assert lines == read_manifest(out)
    for line in lines:
        clip = load_clip(out / line["id"])
        assert (line["status"], line["frames"], line["persons"]) == ("ok", 10, 2)
        assert clip.provenance["manifest"] == line
        assert clip.truth.xyz.shape == (10, 2, 39, 3)
        assert clip.occlusion.visibility.shape == clip.occlusion.occluder.shape == (10, 2, 2, 39)
        assert abs(sum(line["occlusion"][code.name.lower()] for code in Visibility) - 1) < 1e-3
        visible = (clip.occlusion.visibility[..., :25] == Visibility.VISIBLE).mean()
        assert abs(line["occlusion"]["visible"] - visible) < 1e-4
        assert 0 < visible < 1
        by_object = clip.occlusion.occluder[clip.occlusion.visibility == Visibility.HIDDEN_BY_OBJECT]
        assert (by_object < len(clip.occlusion.objects)).all()
        # A detection of a person is about where the person is.
        frame, view, place = np.nonzero(clip.detection_labels.person >= 0)
        person = clip.detection_labels.person[frame, view, place]
        expected = clip.rig.project(clip.truth.xyz[:, :, :25])[0][frame, view, person]
        found = clip.detections.xy[frame, view, place]
        assert len(frame) > 10
        assert np.nanmax(np.abs(found - expected)) < 1e-2


def test_the_provenance_reproduces_the_clip(whole):
    clip = load_clip(whole[0] / "000000")
    spec = SceneSpec.from_json(json.dumps(clip.provenance["spec"]))
    again = module.simulate(spec, clip.rig)
    np.testing.assert_array_equal(again.joints.astype(np.float32), clip.truth.xyz)
    assert {"dmae-synth", "mujoco", "numpy"} <= set(clip.provenance["versions"])


def test_a_clip_has_the_same_bytes_alone_in_a_range_and_among_workers(config, whole):
    generate(replace(config, workers=2))
    assert labels(config) == labels(three_clips(whole[0]))
    alone = generate_clip(config, 2)
    same(alone, load_clip(whole[0] / "000002"))
    other = generate_clip(replace(config, seed=4), 2)
    assert other.truth.xyz.shape != alone.truth.xyz.shape or not np.allclose(other.truth.xyz, alone.truth.xyz)


def same(one: Clip, other: Clip) -> None:
    np.testing.assert_array_equal(one.occlusion.visibility, other.occlusion.visibility)
    np.testing.assert_array_equal(one.occlusion.occluder, other.occlusion.occluder)
    np.testing.assert_array_equal(one.detection_labels.person, other.detection_labels.person)
    np.testing.assert_array_equal(one.truth.xyz, other.truth.xyz)
    np.testing.assert_array_equal(one.detections.xy, other.detections.xy)


def test_an_interrupted_run_resumes(config, whole, made):
    # A clip damaged, one unfinished by a killed process.
    out = Path(shutil.copytree(whole[0], config.out))
    before = labels(config)
    (out / "000000" / "clip.json").unlink()
    shutil.rmtree(out / "000002")
    (out / "manifest.jsonl").unlink()
    (out / ".000002.partial").mkdir()
    (out / ".000002.partial" / "clip.json").write_text("half")
    lines = generate(config)
    assert made == [(0, 0), (2, 0)]
    assert [line["status"] for line in lines] == ["ok"] * 3
    assert labels(config) == before
    assert not list(out.glob(".*"))
    made.clear()
    assert generate(config) == lines
    assert made == []


def test_a_damaged_clip_is_made_again(config, whole, made):
    shutil.copytree(whole[0], config.out)
    before = labels(config)
    (Path(config.out) / "000000" / "arrays.safetensors").write_bytes(before[0][:-8])
    generate(config)
    assert made == [(0, 0)]
    assert labels(config) == before


def test_a_data_set_is_not_resumed_with_another_configuration(config):
    generate(replace(config, clips=1))
    before = labels(config)
    changed = replace(config, scene=replace(config.scene, fps=50.0), retries=1)
    with pytest.raises(ValueError, match=r"another configuration: config\.json differs in retries, scene\.fps\."):
        generate(changed)
    assert labels(config) == before
    # More clips, other workers or another place are no other configuration.
    assert len(generate(replace(config, clips=2, workers=2))) == 2


def test_a_failed_clip_is_tried_again_with_another_seed(config, monkeypatch):
    failing(monkeypatch, lambda spec: spec.clip == 1 and spec.seed == config.seed)
    lines = generate(config)
    assert [line["attempts"] for line in lines] == [1, 2, 1]
    assert [line["seed"] for line in lines] == [3, attempt_seed(3, 1), 3]
    assert lines[1]["status"] == "ok"
    assert load_clip(Path(config.out) / "000001").provenance["spec"]["seed"] == attempt_seed(3, 1)


def test_clips_that_fail_with_every_seed_are_recorded_and_the_others_made(config, monkeypatch):
    failing(monkeypatch, lambda spec: spec.clip == 1)
    lines = generate(replace(config, retries=2))
    assert [line["status"] for line in lines] == ["ok", "failed", "ok"]
    assert lines[1]["reason"] == "clip 1 fell over"
    assert lines[1]["attempts"] == 3
    assert not (Path(config.out) / "000001").exists()


def test_a_run_without_any_clip_fails(config, monkeypatch):
    failing(monkeypatch, lambda spec: True)
    with pytest.raises(FailedSimulation, match="all 3 clips failed, the first because of this: clip 0 fell over"):
        generate(replace(config, retries=0))
    assert [line["status"] for line in read_manifest(config.out)] == ["failed"] * 3


def test_a_crash_leaves_no_half_clip_and_loses_no_whole_one(config, monkeypatch):
    save = dataset.save_clip

    def crash(clip, folder):
        save(clip, folder)
        if clip.id == "000001":
            raise OSError("disk full")

    monkeypatch.setattr(dataset, "save_clip", crash)
    with pytest.raises(OSError, match="disk full"):
        generate(config)
    out = Path(config.out)
    assert sorted(path.name for path in out.iterdir()) == ["000000", CHECKSUMS, CONFIG, "manifest.jsonl"]
    assert [line["id"] for line in read_manifest(out)] == ["000000"]


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"motion": MotionConfig(kind="bvh", path="nowhere")}, FileNotFoundError),
        ({"scene": SceneConfig(arena="moon")}, ValueError),
        ({"rig": RigConfig(path="nowhere.toml")}, FileNotFoundError),
    ],
)
def test_impossible_configurations_are_refused_before_anything_is_written(config, change, error):
    with pytest.raises(error):
        generate(replace(config, **change))
    assert not Path(config.out).exists()


@pytest.mark.parametrize("change", [{"clips": 0}, {"retries": -1}, {"workers": 0}, {"seed": -1}])
def test_numbers_out_of_range_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        GenerateConfig(**change)


@pytest.mark.filterwarnings("ignore:no OpenGL")
@pytest.mark.parametrize("kinds", [("rgb",), KINDS])
def test_images_are_stored_beside_the_labels_and_agree_with_them(config, kinds):
    generate(replace(config, clips=1, images=list(kinds), quality=ImageQuality.draft))
    clip = load_clip(Path(config.out) / "000000")
    assert clip.images.kinds == kinds
    for view in clip.rig.names:
        rgb = list(clip.images.read("rgb", view))
        assert np.shape(rgb) == (10, 72, 96, 3)
        assert np.std(rgb) > 5
    if "ids" not in kinds:
        assert clip.images.parts == ()
        return
    assert clip.images.parts == SEGMENTS
    seen = np.array([list(clip.images.read("ids", view)) for view in clip.rig.names]).swapaxes(0, 1)
    for person in range(2):
        shown = (seen == 1 + person).any((2, 3))
        visible = (clip.occlusion.visibility[:, :, person] == Visibility.VISIBLE).sum(-1)
        assert shown[visible > 5].all()
        assert (visible[~shown] < 5).all()


def test_the_seed_of_an_attempt_is_its_own():
    seeds = {attempt_seed(seed, attempt) for seed in range(5) for attempt in range(5)}
    assert len(seeds) == 25
    assert attempt_seed(0, 0) == 0


# Clips with the cameras of rigs: every rig in every room, and calibrations with errors.

ARENAS = sorted(path.stem for path in resource_folder("synth", "scenes").glob("*.xml"))
SCENE = SceneConfig(persons=[1, 1], seconds=0.16, props=[0, 0])
RING = RingConfig(views=3, focal=90, size=[96, 72])
ERROR = MiscalibrationConfig(focal=0.02, principal_point=1, distortion=0.01, rotation=0.01, translation=0.03)


@pytest.mark.parametrize("arena", ARENAS)
@pytest.mark.parametrize("rig", PRESETS)
def test_every_rig_works_in_every_arena(rig, arena):
    clip = generate_clip(GenerateConfig(rig=rig_config(rig), scene=replace(SCENE, arena=arena)), 0)
    assert clip.occlusion.visibility.shape[:2] == (4, len(clip.rig))
    assert (clip.occlusion.visibility == Visibility.VISIBLE).any()
    assert clip.true_rig is None


def test_labels_and_detections_belong_to_the_true_cameras_and_the_manifest_states_the_calibration_error(tmp_path):
    exact = GenerateConfig(str(tmp_path / "a"), seed=3, clips=2, scene=SCENE, rig=RigConfig(ring=RING))
    off = replace(exact, out=str(tmp_path / "b"), rig=replace(exact.rig, error=ERROR))
    lines = [generate(exact), generate(off)]
    for index in range(2):
        known, erroneous = (load_clip(Path(config.out) / f"{index:06d}") for config in (exact, off))
        assert known.true_rig is None
        np.testing.assert_array_equal(known.rig.cam_from_world, erroneous.true_rig.cam_from_world)
        np.testing.assert_array_equal(known.rig.K, erroneous.true_rig.K)
        assert not np.isclose(erroneous.rig.K, erroneous.true_rig.K).all()
        same(known, erroneous)
        assert "calibration_error" not in lines[0][index]
        found = lines[1][index]["calibration_error"]
        assert len(found) == 3
        assert all(0.05 < error < 20 for error in found)
        # What the line says is how far off the people are.
        people = erroneous.truth.xyz[:, 0].astype(float)
        apart = erroneous.rig.project(people)[0] - erroneous.true_rig.project(people)[0]
        assert np.nanmax(np.linalg.norm(apart, axis=-1)) < 4 * max(found)
    assert read_manifest(off.out) == lines[1]
    errors = [load_clip(Path(off.out) / f"{index:06d}") for index in range(2)]
    shifts = [clip.rig.K[:, 0, 0] / clip.true_rig.K[:, 0, 0] for clip in errors]
    assert not np.allclose(*shifts), "drawn anew for each clip"


@pytest.mark.filterwarnings("ignore:no OpenGL")
def test_images_are_rendered_by_the_true_cameras(tmp_path):
    exact = GenerateConfig(
        str(tmp_path / "a"), clips=1, scene=SCENE, rig=RigConfig(ring=RING), images=["all"],
        quality=ImageQuality.draft,
    )  # fmt: skip
    off = replace(exact, out=str(tmp_path / "b"), rig=replace(exact.rig, error=ERROR))
    generate(exact), generate(off)
    known, erroneous = (load_clip(Path(config.out) / "000000").images for config in (exact, off))
    for view in known.views:
        np.testing.assert_array_equal(list(known.read("ids", view)), list(erroneous.read("ids", view)))


def test_jitter_differs_by_clip_and_leaves_people_unchanged():
    still = GenerateConfig(scene=SCENE, rig=RigConfig(ring=RING), detector=DetectorConfig())
    held = replace(still, rig=replace(still.rig, jitter=JitterConfig(0.03, 0.01)))
    clips = [[generate_clip(config, index) for index in range(2)] for config in (still, held)]
    for before, after in zip(*clips, strict=True):
        shift = np.linalg.norm(before.rig.centers - after.rig.centers, axis=1)
        assert ((shift > 0) & (shift < 0.2)).all()
        np.testing.assert_array_equal(before.truth.xyz, after.truth.xyz)
        assert after.true_rig is None
    shifts = [after.rig.centers - before.rig.centers for before, after in zip(*clips, strict=True)]
    assert not np.allclose(*shifts)


SEES_NOBODY = replace(CameraConfig(**LEFT), cam_from_world=[], position=[3.0, 0, 1], target=[9.0, 0, 1])


@pytest.mark.parametrize(
    ("rig", "complaint"),
    [
        (RigConfig(cameras=[SEES_NOBODY]), "'left'.*sees no people"),
        (
            RigConfig(cameras=[replace(SEES_NOBODY, position=[0.618, -0.484, 0.28], target=[0.0] * 3)]),
            "'left'.*'shelf'",
        ),
        (RigConfig(cameras=[CameraConfig(**LEFT | {"dist": [-5.0, 0, 0, 0, 0]})]), "'left'.*cannot be rendered"),
        (RigConfig(cameras=[CameraConfig(**LEFT | {"K": [50, 3, 32, 0, 50, 24, 0, 0, 1]})]), "'left'.*no skew"),
        (RigConfig(path="nowhere.toml"), r"nowhere\.toml"),
    ],
)
def test_impossible_cameras_are_refused_before_anything_is_written(rig, complaint, tmp_path):
    out = tmp_path / "data"
    with pytest.raises((ValueError, FileNotFoundError), match=complaint):
        generate(GenerateConfig(str(out), clips=1, rig=rig, scene=replace(SCENE, arena="office")))
    assert not out.exists()


def test_machines_fill_one_folder_with_their_own_clips(config, whole):
    """In any order, and while another is still at work, it is byte for byte the data set of one machine."""
    generate(replace(config, clips=1, first=2))
    generate(replace(config, clips=2))
    assert contents(Path(config.out)) == contents(whole[0])


def test_a_machine_that_ends_keeps_what_others_have_noted_meanwhile(config):
    out = Path(config.out)
    first = generate(replace(config, clips=1))
    before = begin_data_set(out)
    generate(replace(config, first=1, clips=1))
    seal(out, first, (CONFIG,), before)
    assert [line["id"] for line in read_manifest(out)] == ["000000", "000001"]
    assert verify(out).problems == []
