"""Images on disk: written images are read back, and errors name missing ones."""

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.data.images import KINDS, Images, write_image, write_video


@pytest.fixture
def folder(tmp_path):
    """Six frames of one view, 64 x 48: a bright square that moves to the right, 2 m before a wall that has no depth."""
    rgb = np.zeros((6, 48, 64, 3), np.uint8)
    depth = np.full((6, 48, 64), np.nan, np.float32)
    ids, parts = np.zeros((6, 48, 64), np.uint16), np.zeros((6, 48, 64), np.uint8)
    for frame in range(6):
        square = np.s_[frame, 16:32, 8 * frame : 8 * frame + 16]
        rgb[square], depth[square], ids[square], parts[square] = (250, 200, 40), 2.0 + 0.0015 * frame, 300, 2
        write_image("depth", tmp_path / "depth" / "left" / f"{frame:06d}.png", depth[frame])
        write_image("ids", tmp_path / "ids" / "left" / f"{frame:06d}.png", ids[frame])
        write_image("parts", tmp_path / "parts" / "left" / f"{frame:06d}.png", parts[frame])
    write_video(tmp_path / "rgb" / "left.mp4", rgb, 25)
    return Images(tmp_path, ("left",), tuple(range(6)), parts=("arm", "leg")), rgb, depth, ids


def test_written_images_are_read_back(folder):
    images, rgb, depth, ids = folder
    np.testing.assert_array_equal(list(images.read("ids", "left")), ids)
    parts = np.array(list(images.read("parts", "left")))
    assert parts.dtype == np.uint8
    assert (images.parts[parts[ids == 300].min() - 1], parts[ids == 0].max()) == ("leg", 0)
    # Depth is kept in whole millimetres.
    np.testing.assert_allclose(list(images.read("depth", "left")), depth, atol=0.00051)
    found = np.array(list(images.read("rgb", "left")))
    assert found.shape == rgb.shape
    assert found.dtype == np.uint8
    # Colour is compressed, and its hue at half the resolution.
    assert np.abs(found.astype(int) - rgb)[:, 20:28].mean() < 12


def test_some_frames_are_read_alone(folder):
    images, _, _, ids = folder
    some = images.select([1, 4], ("left",))
    assert some.frames == (1, 4)
    assert some.parts == images.parts
    np.testing.assert_array_equal(list(some.read("ids", "left")), ids[[1, 4]])
    whole, part = list(images.read("rgb", "left")), list(some.read("rgb", "left"))
    np.testing.assert_array_equal(part, [whole[1], whole[4]])
    # A selection of a selection counts from the first.
    assert some.select([1], ("left",)).frames == (4,)


@pytest.mark.parametrize("frames", [[4, 1], [2, 2], []])
def test_frames_are_read_in_the_order_in_which_they_were_chosen(folder, frames):
    """A still is captured from its frame shown twice."""
    images, some = folder[0], folder[0].select(frames, ("left",))
    for kind in ("ids", "rgb"):
        whole = list(images.read(kind, "left"))
        for found, frame in zip(some.read(kind, "left"), frames, strict=True):
            np.testing.assert_array_equal(found, whole[frame])


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """Forty frames of one view, with several keyframes."""
    folder = tmp_path_factory.mktemp("long")
    noise = np.random.default_rng(0).integers(0, 255, (40, 6, 8, 3), np.uint8)
    write_video(folder / "rgb" / "left.mp4", noise.repeat(8, 1).repeat(8, 2), 10)
    return Images(folder, ("left",), tuple(range(40)), ("rgb",))


@given(st.lists(st.integers(0, 39), min_size=1, max_size=12))
@settings(max_examples=30)
def test_frames_in_any_order_are_those_read_in_a_row(long, order):
    whole = list(long.read("rgb", "left"))
    for index in order:
        np.testing.assert_array_equal(long.at("rgb", "left", index), whole[index])


def test_one_frame_of_each_kind(folder):
    images, _, depth, ids = folder
    some = images.select([1, 4], ("left",))
    np.testing.assert_array_equal(some.at("ids", "left", 1), ids[4])
    np.testing.assert_allclose(some.at("depth", "left", 0), depth[1], atol=0.00051)
    np.testing.assert_array_equal(some.at("rgb", "left", -1), list(images.read("rgb", "left"))[4])
    with pytest.raises(KeyError, match="no heat images"):
        some.at("heat", "left", 0)
    with pytest.raises(IndexError, match="no frame 2 of images; there are 2, from 0"):
        some.at("ids", "left", 2)
    longer = Images(images.folder, ("left",), tuple(range(9)))
    with pytest.raises(FileNotFoundError, match=r"left\.mp4: expected 9 frames or more, found 6"):
        longer.at("rgb", "left", 8)
    with pytest.raises(FileNotFoundError, match=r"right\.mp4: no such file"):
        Images(images.folder, ("right",), (0,)).at("rgb", "right", 0)


def test_few_frames_are_decoded_for_one(long):
    with av.open(str(long.folder / "rgb/left.mp4")) as container:
        keyframes = [
            n for n, packet in enumerate(container.demux(video=0)) if packet.pts is not None and packet.is_keyframe
        ]
    assert max(np.diff([*keyframes, 40])) <= 10


def test_a_video_has_the_codec_that_browsers_play(folder):
    images = folder[0]
    with av.open(str(images.folder / "rgb" / "left.mp4")) as container:
        (stream,) = container.streams.video
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert stream.average_rate == 25


def test_depth_out_of_range_is_absent(tmp_path):
    write_image("depth", tmp_path / "depth" / "a" / "000000.png", np.array([[1.0, 65.6, np.inf, np.nan, 0.0004]]))
    (depth,) = Images(tmp_path, ("a",), (0,)).read("depth", "a")
    np.testing.assert_array_equal(depth, np.float32([[1.0, np.nan, np.nan, np.nan, np.nan]]))


@pytest.mark.parametrize(("kind", "view"), [("heat", "left"), ("rgb", "right")])
def test_unknown_kinds_and_views_are_answered_with_those_there_are(folder, kind, view):
    with pytest.raises(KeyError, match=rf"no {kind} images of view '{view}'; there are .*{KINDS[2]}.*left"):
        next(folder[0].read(kind, view))


def test_missing_frames_are_named(folder):
    images = folder[0]
    (images.folder / "ids" / "left" / "000003.png").unlink()
    with pytest.raises(FileNotFoundError, match=r"000003\.png: no such file"):
        list(images.read("ids", "left"))
    longer = Images(images.folder, ("left",), (0, 9))
    with pytest.raises(FileNotFoundError, match=r"left\.mp4: expected 10 frames or more, found 6"):
        list(longer.read("rgb", "left"))


def test_a_video_damaged_in_the_middle_is_named(tmp_path):
    path = tmp_path / "rgb/left.mp4"
    write_video(path, np.random.default_rng(0).integers(0, 255, (20, 64, 96, 3), np.uint8), 25)
    data = bytearray(path.read_bytes())
    data[len(data) // 3 : len(data) // 2] = bytes(len(data) // 2 - len(data) // 3)
    path.write_bytes(data)
    images = Images(tmp_path, ("left",), tuple(range(20)), ("rgb",))
    for read in (lambda: list(images.read("rgb", "left")), lambda: images.at("rgb", "left", 12)):
        with pytest.raises(ValueError, match=r"left\.mp4: this video is damaged"):
            read()


def test_a_video_without_frames_or_of_odd_size_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no frames to write"):
        write_video(tmp_path / "none.mp4", [], 25)
    with pytest.raises(ValueError, match="even width and height, found 63 x 48"):
        write_video(tmp_path / "odd.mp4", [np.zeros((48, 63, 3), np.uint8)], 25)


def test_normals_flow_and_whole_persons_are_read_back(tmp_path):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(48, 64, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[:4] = np.nan
    flow = rng.uniform(-500, 500, (48, 64, 2)).astype(np.float32)
    flow[3:6], flow[7, 7] = np.nan, (600, 0)
    few, many = (rng.integers(0, 2**bits, (48, 64)).astype(np.uint32) for bits in (5, 30))
    write_image("normals", tmp_path / "normals/a/000000.png", normals)
    write_image("flow", tmp_path / "flow/a/000000.png", flow)
    for frame, amodal in enumerate((few, many)):
        write_image("amodal", tmp_path / f"amodal/a/{frame:06d}.png", amodal)
    images = Images(tmp_path, ("a",), (0, 1), ("normals", "flow", "amodal"))
    found = images.at("normals", "a", 0)
    assert np.isnan(found[:4]).all()
    np.testing.assert_allclose(np.linalg.norm(found[4:], axis=-1), 1, atol=1e-6)
    assert np.degrees(np.arccos(np.clip((found[4:] * normals[4:]).sum(-1), -1, 1))).max() < 0.5
    flow[7, 7] = np.nan
    np.testing.assert_allclose(images.at("flow", "a", 0), flow, atol=0.008)
    for frame, amodal in enumerate((few, many)):
        found = images.at("amodal", "a", frame)
        assert found.dtype == np.uint32
        np.testing.assert_array_equal(found, amodal)


@pytest.mark.parametrize("rgb", ["h264", "png", "jpeg"])
def test_any_image_is_read_alone(tmp_path, rgb):
    ramp = np.linspace(0, 255, 64).astype(np.uint8)
    colours = [np.full((48, 64, 3), (20 * frame, 255 - 10 * frame, 0), np.uint8) for frame in range(12)]
    colours = [np.where(np.arange(48)[:, None, None] < 24, image, ramp[:, None]) for image in colours]
    images = Images(tmp_path, ("a",), tuple(range(12)), ("rgb",), rgb=rgb)
    if rgb == "h264":
        write_video(images.path("rgb", "a"), colours, 5)
    else:
        for frame, image in enumerate(colours):
            write_image("rgb", images.path("rgb", "a", frame), image)
    whole = list(images.read("rgb", "a"))
    for frame in (11, 0, 5, 4, 7):
        np.testing.assert_array_equal(images.at("rgb", "a", frame), whole[frame])
        assert np.abs(whole[frame].astype(int) - colours[frame]).mean() < (1 if rgb == "png" else 6)
    np.testing.assert_array_equal(images.select([3, 9], ("a",)).at("rgb", "a", 1), whole[9])
    with pytest.raises(IndexError):
        images.at("rgb", "a", 12)


def test_a_video_of_the_same_images_is_the_same(tmp_path):
    """The width is no multiple of 16: x264 by itself reads memory beyond it."""
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 40, (776, 1032, 3), np.uint8)
    images = [np.roll(noise, 3 * frame, 1) + np.uint8(10 * frame) for frame in range(6)]
    written = set()
    for number in range(4):
        litter = [rng.integers(0, 256, 1_000_000 + 999 * number, np.uint8) for _ in range(20)]
        del litter[::2]
        write_video(tmp_path / "a.mp4", iter(images), 25)
        written.add((tmp_path / "a.mp4").read_bytes())
    assert len(written) == 1
