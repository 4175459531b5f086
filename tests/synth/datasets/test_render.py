"""Images of clips that exist: the same as generation makes, added to a set, or rendered through other cameras."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.data.store import load_clip, read_manifest
from synth.datasets.config import GenerateConfig, RenderConfig, RgbFormat, image_kinds
from synth.datasets.generate import generate
from synth.datasets.render import forecast_rendering, render
from synth.datasets.verify import verify
from synth.detector.config import DetectorConfig
from synth.detector.errors_of_joints import Misses
from synth.physics.body_state import FILE, load_state
from synth.rendering.config import ImageQuality, ImagingConfig
from synth.rigs.config import RigConfig, RingConfig
from synth.scene.config import SceneConfig
from tests.support.damages import contents

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:no OpenGL")]

RING = RigConfig(name="small", ring=RingConfig(views=2, focal=90, size=[96, 72]))
OTHER = RigConfig(name="three", ring=RingConfig(views=3, focal=70, size=[80, 64]))


def config(out: Path, **changes) -> GenerateConfig:
    """A clip of two persons and five frames, seen by two small cameras."""
    return GenerateConfig(
        out=str(out), seed=3, clips=1, scene=SceneConfig(persons=[2, 2], seconds=0.2, props=[0, 1]), rig=RING,
        detector=DetectorConfig(misses=Misses(person=0.1)), quality=ImageQuality.draft, **changes,
    )  # fmt: skip


@pytest.fixture(scope="module")
def labels(tmp_path_factory) -> Path:
    """A data set without images."""
    out = tmp_path_factory.mktemp("labels") / "data"
    generate(config(out))
    return out


@pytest.fixture(scope="module")
def painted(tmp_path_factory) -> Path:
    """The same data set, generated with images."""
    out = tmp_path_factory.mktemp("painted") / "data"
    generate(config(out, images=["rgb", "ids"]))
    return out


def arrays(folder: Path) -> bytes:
    return (folder / "000000" / "arrays.safetensors").read_bytes()


def test_images_are_added_to_labels_and_are_those_of_a_set_made_at_once(labels, painted, tmp_path):
    out = Path(shutil.copytree(labels, tmp_path / "data"))
    before = arrays(out)
    generate(config(out, images=["rgb"]))
    assert arrays(out) == before
    assert load_clip(out / "000000").images.kinds == ("rgb",)
    generate(config(out, images=["rgb", "ids"]))
    assert contents(out / "000000") == contents(painted / "000000")
    assert contents(out)["config.json"] == contents(painted)["config.json"]
    assert verify(out)[1] == []
    # Labels of a set with images are completed as well.
    assert len(generate(replace(config(out), clips=2))) == 2
    # What is refused leaves the settings as they are.
    made = contents(out)["config.json"]
    with pytest.raises(ValueError, match=r"quality=draft, not high.*synth render"):
        generate(replace(config(out, images=["rgb", "depth"]), quality=ImageQuality.high))
    with pytest.raises(ValueError, match=r"imaging\.jpeg=0, not 50.*synth render"):
        generate(replace(config(out, images=["rgb", "depth"]), imaging=ImagingConfig(jpeg=50)))
    assert contents(out)["config.json"] == made


def test_settings_are_those_of_the_images_that_are_there(labels, tmp_path):
    out = tmp_path / "data"

    def settings(kinds: list[str], rgb: str, **changes) -> list:
        render(RenderConfig(str(labels), str(out), kinds, ImageQuality.draft, RgbFormat(rgb), **changes))
        stored = json.loads((out / "config.json").read_text())
        return [stored[name] for name in ("images", "rgb")] + [stored["imaging"]["jpeg"]]

    assert settings(["ids"], "h264") == [["ids"], "h264", 0]
    assert settings(["rgb"], "png") == [["rgb", "ids"], "png", 0]
    # Colour images stay as they are when others are added.
    assert settings(["depth"], "h264", imaging=ImagingConfig(jpeg=50)) == [["rgb", "depth", "ids"], "png", 0]
    assert verify(out)[1] == []


def test_rendering_later_makes_the_same_files(labels, painted, tmp_path):
    out = tmp_path / "again"
    lines = render(RenderConfig(str(labels), str(out), ["rgb", "ids"], ImageQuality.draft))
    assert lines == read_manifest(labels) == read_manifest(out)
    assert contents(out / "000000") == contents(painted / "000000")
    assert verify(out)[1] == []
    assert not list(out.glob(".*"))


def test_other_cameras_see_what_generation_with_them_would_have_made(labels, tmp_path):
    made, rendered = tmp_path / "made", tmp_path / "rendered"
    generate(replace(config(made, images=["rgb", "ids"]), rig=OTHER))
    render(RenderConfig(str(labels), str(rendered), ["rgb", "ids"], ImageQuality.draft, rig=OTHER))
    assert contents(rendered / "000000") == contents(made / "000000")
    assert load_clip(rendered / "000000").rig.names == ("ring0", "ring1", "ring2")
    assert verify(rendered)[1] == []


@pytest.mark.parametrize("rgb", [RgbFormat.png, RgbFormat.jpeg])
def test_colour_is_a_file_a_image_on_request(labels, painted, tmp_path, rgb):
    render(RenderConfig(str(labels / "000000"), str(tmp_path / "set"), ["rgb"], ImageQuality.draft, rgb))
    clip, video = load_clip(tmp_path / "set/000000"), load_clip(painted / "000000")
    assert clip.images.path("rgb", "ring0", 3).suffix == {"png": ".png", "jpeg": ".jpg"}[rgb.value]
    still = np.array(list(clip.images.read("rgb", "ring0"))).astype(int)
    assert np.abs(still - np.array(list(video.images.read("rgb", "ring0")))).mean() < 6
    np.testing.assert_array_equal(clip.images.at("rgb", "ring0", 3), still[3])
    assert verify(tmp_path / "set")[1] == []


def test_the_state_of_bodies_is_kept_beside_the_labels(labels):
    clip, state = load_clip(labels / "000000"), load_state(labels / "000000")
    assert state.qpos.dtype == np.float64
    assert state.rotations.shape == (5, 2, 16, 4)
    np.testing.assert_allclose(np.linalg.norm(state.rotations, axis=-1), 1, atol=1e-6)
    hips = clip.truth.xyz[:, :, clip.truth.skeleton.index("body25.mid_hip")[0]]
    assert np.linalg.norm(state.root - hips, axis=-1).max() < 0.15
    names = [name.partition(" ")[0] for name in state.action_names]
    assert {*names} <= {
        "walk",
        "turn",
        "stand",
        "reach",
        "wave",
        "bend",
        "crouch",
        "lift",
        "sit",
        "kick",
        "punch",
        "dance",
    }
    assert state.actions.shape == (5, 2)
    assert state.shapes[0].stature == clip.provenance["spec"]["persons"][0]["body"]["stature"]


def test_people_press_on_the_floor(tmp_path):
    # A force at the pelvis carries people: soles touch the floor in some frames only, and in 0.2 s maybe in none.
    longer = config(tmp_path / "data")
    generate(replace(longer, scene=replace(longer.scene, seconds=1.5)))
    state = load_state(tmp_path / "data/000000")
    floor = state.contact_names.index("floor")
    touching = (state.contact_between == floor).any(1)
    feet = {state.contact_names[i] for i in state.contact_between[touching].ravel()} - {"floor"}
    assert any(name.endswith("foot") for name in feet)
    # The first presses on the second: upwards on what stands on the floor.
    sign = np.where(state.contact_between[touching][:, 0] == floor, 1, -1)
    assert (sign * state.contact_force[touching][:, 2] > 0).all()
    assert (np.abs(state.contact_point[touching][:, 2]) < 0.03).all()


def test_a_state_of_another_version_and_a_missing_one_are_refused(labels, tmp_path):
    folder = tmp_path / "clip"
    folder.mkdir()
    with pytest.raises(FileNotFoundError, match="make this one again"):
        load_state(folder)
    content = (labels / "000000" / FILE).read_bytes()
    (folder / FILE).write_bytes(content.replace(b'\\"format\\": 1', b'\\"format\\": 9'))
    with pytest.raises(ValueError, match="format 1, found format 9"):
        load_state(folder)
    (folder / FILE).write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match=r"state\.safetensors"):
        load_state(folder)


@pytest.mark.parametrize("where", ["data", "data/inside", "data/000000"])
def test_rendering_into_the_clips_themselves_is_refused(labels, where):
    with pytest.raises(ValueError, match="expected another folder than data="):
        render(RenderConfig(str(labels), str(labels.parent / where)))


def test_some_of_the_clips_are_rendered(tmp_path):
    data, out = tmp_path / "data", tmp_path / "out"
    generate(replace(config(data), clips=2))
    rendering = RenderConfig(str(data), str(out), images=["depth"], quality=ImageQuality.draft, first=1)
    assert [line["id"] for line in render(replace(rendering, clips=1))] == ["000001"]
    before = contents(out / "000001")
    assert [line["id"] for line in render(replace(rendering, first=0))] == ["000000", "000001"]
    assert contents(out / "000001") == before and not verify(out).problems
    with pytest.raises(ValueError, match=r"^clips=2: expected from 1 to 1, there are 2 clips"):
        render(replace(rendering, clips=2))


def test_folders_of_something_else_are_refused(tmp_path):
    (tmp_path / "papers").mkdir()
    (tmp_path / "papers" / "thesis.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ValueError, match=r"expected a new or empty folder, or a data set; it holds thesis.txt"):
        generate(config(tmp_path / "papers"))
    with pytest.raises(ValueError, match="expected a folder, found a file"):
        generate(config(tmp_path / "file"))
    assert [path.name for path in (tmp_path / "papers").iterdir()] == ["thesis.txt"]


def test_names_of_clips_begin_with_the_prefix(tmp_path):
    lines = generate(replace(config(tmp_path / "data"), prefix="walk_"))
    assert [line["id"] for line in lines] == ["walk_000000"]
    assert load_clip(tmp_path / "data/walk_000000").id == "walk_000000"
    for prefix in ("../up", "a/b", ".hidden", "a b"):
        with pytest.raises(ValueError, match="prefix"):
            GenerateConfig(prefix=prefix)


def test_kinds_of_images_are_named_one_by_one_or_together():
    assert image_kinds("none") == image_kinds([]) == image_kinds(["none"]) == ()
    assert image_kinds("rgb") == ("rgb",)
    assert image_kinds(["flow", "rgb"]) == ("rgb", "flow")
    assert len(image_kinds(["all"])) == 7
    for wrong in (["heat"], ["none", "rgb"]):
        with pytest.raises(ValueError, match="images: expected none, all, or a list"):
            GenerateConfig(images=wrong)


def test_a_set_made_before_states_were_kept_gets_them_with_its_images(labels, painted, tmp_path):
    out = Path(shutil.copytree(labels, tmp_path / "data"))
    (out / "000000" / FILE).unlink()
    before = arrays(out)
    generate(config(out, images=["rgb"]))
    assert arrays(out) == before
    assert contents(out / "000000/images/rgb") == contents(painted / "000000/images/rgb")


def test_an_interrupted_rendering_leaves_the_labels_and_no_half_images(labels, tmp_path, monkeypatch):
    out = Path(shutil.copytree(labels, tmp_path / "data"))
    before = contents(out / "000000")
    count = 0

    def stop(*arguments, **more):
        nonlocal count
        count += 1
        if count == 4:
            raise KeyboardInterrupt
        return image(*arguments, **more)

    from synth.rendering.renderer import Renderer

    image = Renderer.image
    monkeypatch.setattr(Renderer, "image", stop)
    with pytest.raises(KeyboardInterrupt):
        generate(config(out, images=["rgb"]))
    assert contents(out / "000000") == before
    assert json.loads((out / "manifest.jsonl").read_text())["id"] == "000000"
    monkeypatch.setattr(Renderer, "image", image)
    generate(config(out, images=["rgb"]))
    assert load_clip(out / "000000").images.kinds == ("rgb",)


@pytest.mark.parametrize("rig", [RigConfig(name=""), OTHER])
def test_a_forecast_counts_what_is_left_and_writes_nothing(labels, tmp_path, rig):
    config = RenderConfig(str(labels), str(tmp_path / "out"), quality=ImageQuality.draft, rig=rig)
    found = forecast_rendering(config)
    assert (found.clips, found.frames, found.images) == (1, 5, 15 if rig is OTHER else 10)
    assert found.seconds > 0 and found.megabytes > 0
    assert not list(tmp_path.iterdir())
    render(config)
    assert forecast_rendering(config).clips == 0
    before, more = contents(tmp_path / "out/000000/images"), replace(config, images=["ids"])
    added = forecast_rendering(more)
    assert (added.clips, added.images) == (0, found.images)
    render(more)
    assert load_clip(tmp_path / "out/000000").images.kinds == ("rgb", "ids"), "images that are there are kept"
    assert before.items() <= contents(tmp_path / "out/000000/images").items()
    assert verify(tmp_path / "out").problems == []


def test_a_forecast_is_refused_as_the_rendering_is(labels):
    with pytest.raises(ValueError, match="expected another folder than data="):
        forecast_rendering(RenderConfig(str(labels), str(labels)))
