"""Cameras compared: parts of people are removed, and people that one camera missed are searched."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D
from dmae.data.images import Images
from dmae.data.skeleton import BODY25
from dmae.detection.images import Alignment, CameraImages, Recording, find_cameras
from dmae.detection.pipeline import CameraPeople, compare_views
from dmae.detection.recording import detect_clip, detect_recording
from dmae.detection.registry import PoseDetectorConfig
from dmae.formats.footage import Fitting
from tests.support.detected_people import FPS, detected_clip, standing, with_body

MISSED = range(10, 20)
FRAMES = 30


class _Looks:
    """Finds every person that it is asked to look for, one pixel to the right."""

    skeleton = BODY25

    def __call__(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        raise AssertionError("the first pass is over")

    def find_at(self, image: np.ndarray, expected: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert len(known) == 1
        return expected + [1, 0], np.full(expected.shape[:2], 0.8)


def looks(config: PoseDetectorConfig) -> _Looks:
    return _Looks()


def looks_elsewhere(config: PoseDetectorConfig) -> _Looks:
    detector = _Looks()
    detector.find_at = lambda image, expected, known: (expected + [0, 200], np.ones(expected.shape[:2]))
    return detector


def looks_anywhere(config: PoseDetectorConfig) -> _Looks:
    detector = _Looks()
    detector.find_at = lambda image, expected, known: (expected + [1, 0], np.full(expected.shape[:2], 0.8))
    return detector


def does_not_look(config: PoseDetectorConfig) -> object:
    return type("Plain", (), {"skeleton": BODY25, "__call__": _Looks.__call__})()


CONFIG = PoseDetectorConfig(name=f"{__name__}:looks")


@pytest.fixture
def clip() -> Clip:
    """Two people in four views; in some frames the first view misses the first person."""
    clip = detected_clip(standing(FRAMES, persons=2), miss=0, noise=1)
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    projected, _ = clip.rig.project(clip.truth.xyz)
    for frame in MISSED:
        gone = np.nanmedian(np.linalg.norm(xy[frame, 0] - projected[frame, 0, 0], axis=-1), -1) < 10
        assert gone.sum() == 1
        xy[frame, 0, gone] = score[frame, 0, gone] = np.nan
    return replace(clip, detections=Detections2D(BODY25, xy, score))


@pytest.fixture
def cameras(tmp_path: Path, clip: Clip) -> list[CameraImages]:
    for name in clip.rig.names:
        (tmp_path / "videos" / name).mkdir(parents=True)
        for number in range(FRAMES):
            cv2.imwrite(str(tmp_path / "videos" / name / f"{number:03d}.png"), np.zeros((8, 8, 3), np.uint8))
    return list(find_cameras(tmp_path / "videos"))


def found_in(clip: Clip) -> list[CameraPeople]:
    rows = np.concatenate([clip.detections.xy, clip.detections.score[..., None]], -1)
    return [[each[np.isfinite(each).any((-1, -2))] for each in rows[:, view]] for view in range(len(clip.rig))]


def recording(rig: CameraRig, cameras, fittings=None) -> Recording:
    frames, fittings = (np.arange(FRAMES),) * len(rig), tuple(fittings or [Fitting()] * len(rig))
    return Recording(tuple(cameras), Alignment(FPS, frames, FRAMES, ()), rig, fittings, ())


def search(clip: Clip, cameras, pieces: Path, config: PoseDetectorConfig = CONFIG, **options) -> list[CameraPeople]:
    given = recording(clip.rig, cameras, options.get("fittings"))
    found = [
        [np.concatenate([fitting.from_calibration(each[..., :2]), each[..., 2:]], -1) for each in people]
        for people, fitting in zip(found_in(clip), given.fittings, strict=True)
    ]
    return compare_views(found, given, config, pieces, options.get("workers", 1))


def with_part(clip: Clip) -> Clip:
    """Return the clip with a small body on the head and shoulders of the second person, in all frames of a view."""
    projected, _ = clip.rig.project(clip.truth.xyz)
    body = projected[:, 1, 1]
    small = body[:, BODY25.index("neck")] + 0.2 * (body - body[:, BODY25.index("mid_hip")])
    return replace(clip, detections=with_body(clip.detections, 1, small))


@pytest.mark.parametrize("config", [CONFIG, PoseDetectorConfig(name=f"{__name__}:does_not_look")])
def test_parts_of_people_are_removed(clip, cameras, tmp_path, config):
    assert [len(people) for people in found_in(with_part(clip))[1]] == [3] * FRAMES
    found = search(with_part(clip), cameras, tmp_path / "pieces", config)
    for before, after in zip(found_in(clip)[1:], found[1:], strict=True):
        np.testing.assert_array_equal(np.stack(before), np.stack(after))


def test_without_the_option_parts_stay(clip, cameras, tmp_path):
    found = search(with_part(clip), cameras, tmp_path / "pieces", replace(CONFIG, across_views=False))
    assert [len(people) for people in found[1]] == [3] * FRAMES


def test_two_processes_find_what_one_finds(clip, cameras, tmp_path):
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    xy[MISSED, 2, 1] = score[MISSED, 2, 1] = np.nan
    clip = replace(clip, detections=Detections2D(BODY25, xy, score))
    one, two = (search(clip, cameras, tmp_path / str(workers), workers=workers) for workers in (1, 2))
    assert len(list((tmp_path / "2").iterdir())) == 2
    for first, second in zip(one, two, strict=True):
        for a, b in zip(first, second, strict=True):
            np.testing.assert_array_equal(a, b)


def test_what_the_detector_finds_there_is_added(clip, cameras, tmp_path):
    found = search(clip, cameras, tmp_path / "pieces")
    assert [len(people) for people in found[0]] == [2] * FRAMES
    projected, _ = clip.rig.project(clip.truth.xyz)
    added = found[0][MISSED[0]][-1]
    np.testing.assert_allclose(added[:, :2], projected[MISSED[0], 0, 0] + [1, 0], atol=8)
    assert (added[:, 2] == np.float32(0.8)).all()
    for before, after in zip(found_in(clip)[1:], found[1:], strict=True):
        np.testing.assert_array_equal(np.stack(before), np.stack(after))


@pytest.mark.parametrize("across, said", [(True, 0), (False, 1)])
def test_a_camera_in_which_only_the_search_found_people_is_not_called_empty(clip, cameras, tmp_path, monkeypatch,
                                                                            across, said):  # fmt: skip
    blind = [np.full_like(part, np.nan) for part in (clip.detections.xy, clip.detections.score)]
    blind[0][:, 1:], blind[1][:, 1:] = clip.detections.xy[:, 1:], clip.detections.score[:, 1:]
    first = dict(zip(clip.rig.names, found_in(replace(clip, detections=Detections2D(BODY25, *blind))), strict=True))
    monkeypatch.setattr("dmae.detection.recording.detect_people", lambda *_: first)
    detections, notes = detect_recording(
        recording(clip.rig, cameras),
        PoseDetectorConfig(name=f"{__name__}:looks_anywhere", across_views=across),
        tmp_path / "pieces",
    )
    assert detections.observed[:, 0].any() == across
    assert list(notes) == said * [f"{clip.rig.names[0]}: no people detected"]


def test_a_note_on_the_detections_before_is_not_kept(clip, cameras, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "dmae.detection.recording.detect_people", lambda *_: dict(zip(clip.rig.names, found_in(clip), strict=True))
    )
    name, late = clip.rig.names[0], "cameras end at different frames"
    before = replace(
        clip,
        images=Images(tmp_path / "videos", clip.rig.names, tuple(range(FRAMES)), rgb="png", files=clip.rig.names),
        provenance={"notes": [late, f"{name}: no people detected"]},
    )
    assert detect_clip(before, CONFIG, tmp_path / "pieces").provenance["notes"] == [late]


def test_places_are_in_the_pixels_of_the_image(clip, cameras, tmp_path):
    half = [Fitting(0.5)] * len(clip.rig)
    found = search(clip, cameras, tmp_path / "pieces", fittings=half)
    whole = search(clip, cameras, tmp_path / "others")
    small, large = (each[0][MISSED[0]][-1, :, :2] - [1, 0] for each in (found, whole))
    np.testing.assert_allclose(half[0].to_calibration(small), large, atol=1e-3)


def test_people_elsewhere_are_not_added(clip, cameras, tmp_path):
    found = search(clip, cameras, tmp_path / "pieces", PoseDetectorConfig(name=f"{__name__}:looks_elsewhere"))
    assert [len(people) for people in found[0]].count(1) == len(MISSED)


def test_pieces_of_another_calibration_are_not_taken(clip, cameras, tmp_path):
    first = search(clip, cameras, tmp_path / "pieces")
    moved = clip.rig.cam_from_world.copy()
    moved[0, 0, 3] += 0.1
    other = search(replace(clip, rig=replace(clip.rig, cam_from_world=moved)), cameras, tmp_path / "pieces")
    before, after = (each[0][MISSED[0]][-1, :, 0] for each in (first, other))
    assert abs(before - after).min() > 5


def test_finished_pieces_are_not_searched_again(clip, cameras, tmp_path):
    first = search(clip, cameras, tmp_path / "pieces")
    (piece,) = (tmp_path / "pieces").iterdir()
    before = piece.stat().st_mtime_ns
    again = search(clip, cameras, tmp_path / "pieces")
    assert piece.stat().st_mtime_ns == before
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(np.stack(one[:10]), np.stack(other[:10]))


@pytest.mark.parametrize(
    "config", [replace(CONFIG, across_views=False), PoseDetectorConfig(name=f"{__name__}:does_not_look")]
)
def test_without_the_option_or_the_method_nothing_is_searched(clip, cameras, tmp_path, config):
    found = search(clip, cameras, tmp_path / "pieces", config)
    assert [len(people) for people in found[0]].count(1) == len(MISSED)
    assert not (tmp_path / "pieces").exists()


def test_one_view_captures_nobody_and_misses_nobody(clip):
    assert compare_views(found_in(clip)[:1], recording(clip.rig[[0]], []), CONFIG, Path())[0]
