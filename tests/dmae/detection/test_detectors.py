"""BlazePose on real images, and models of users' own in ONNX."""

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from dmae.data.conversion import convert_detections
from dmae.data.skeleton import BLAZEPOSE33, BODY25, COCO17
from dmae.detection.detectors.blazepose import PeopleDetector, find_expected
from dmae.detection.detectors.landmarks import Network, Person, find_person, part_of, pyramid_of
from dmae.detection.images import find_cameras
from dmae.detection.pipeline import detect_people, make_detector, to_detections
from dmae.detection.registry import PoseDetectorConfig

VIDEOS = Path(os.environ.get("DMAE_DATA", "nowhere")) / "pose2sim/videos"
real = pytest.mark.skipif(not VIDEOS.is_dir(), reason="DMAE_DATA with pose2sim/videos is not there")


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    (image,) = find_cameras(VIDEOS)[2].read(0, 1)
    return image


@real
@pytest.mark.parametrize("turned", [0, 2], ids=["upright", "upside down"])
def test_the_man_is_found(image, turned):
    detector = make_detector(PoseDetectorConfig(windows=[1.0]))
    xy, score = detector(np.ascontiguousarray(np.rot90(image, turned)))
    assert xy.shape == (1, 33, 2)
    if turned:
        xy = np.array(image.shape[1::-1]) - 1 - xy
    nose, hip, ankle = (xy[0, BLAZEPOSE33.index(joint)[0], 1] for joint in ("nose", "l_hip", "l_ankle"))
    assert nose < hip - 100 and hip < ankle - 100
    assert 0.5 < np.nanmedian(score) <= 1


@real
def test_a_person_is_followed_and_an_empty_image_is_empty(image):
    detector = make_detector(PoseDetectorConfig(windows=[1.0], search_every=100))
    first, _ = detector(image)
    second, _ = detector(image)
    assert np.nanmedian(np.linalg.norm(second - first, axis=-1)) < 10
    assert len(detector(np.zeros_like(image))[0]) == 0


@real
def test_a_person_cut_off_by_the_border_is_found_in_a_photograph(image):
    (person,) = PeopleDetector(PoseDetectorConfig(windows=[1.0]))(image)
    head, shoulder = (person.xy[BLAZEPOSE33.index(joint)[0]].round().astype(int) for joint in ("nose", "l_shoulder"))
    size = 2 * (shoulder[1] - head[1])
    cut = image[head[1] - size : head[1] + size, head[0] - size : head[0] + size]
    assert len(PeopleDetector(PoseDetectorConfig())(cut)) == 0
    detector = PeopleDetector(PoseDetectorConfig(photographs=True))
    for _ in range(2):
        (found,) = detector(cut)
        face = (found.xy + head - size - person.xy)[: BLAZEPOSE33.index("l_shoulder")[0]]
        assert np.hypot(*face.T).max() < 0.05 * person.region.radius
        assert len(detector(np.zeros_like(cut))) == 0


class _SeesLate(PeopleDetector):
    """Searches for nobody in the first two images."""

    def _search(self, *args):
        if self._number >= 2:
            super()._search(*args)


@real
def test_a_person_found_late_is_found_in_the_images_before(image):
    detector = _SeesLate(PoseDetectorConfig(windows=[1.0]), look_back=True)
    empty = np.zeros_like(image)
    assert [detector(each) for each in (empty, image)] == [[], []] and not detector.late
    (person,) = detector(image)
    ((ago, (before,)),) = detector.late
    assert ago == 1 and np.abs(before.xy - person.xy).mean() < 10
    assert len(detector(image)) == 1 and not detector.late


class _SeesAPart(PeopleDetector):
    """Finds a small body with the head of a person in the first image, and does not follow it."""

    def _follow(self, pyramid):
        return [], []

    def _search(self, pyramid, people, windows):
        super()._search(pyramid, people, windows)
        if self._number == 0:
            (found,) = people
            people[0] = replace(found, person=_shrunken(found.person))


def _shrunken(person: Person, size: float = 0.4) -> Person:
    """Return a person and its region, made smaller around the head."""
    head = person.xy[BLAZEPOSE33.index("l_ear", "r_ear", "nose")].mean(0)
    centre = head + 0.5 + size * (person.region.centre - head - 0.5)
    region = replace(person.region, centre=centre, side=size * person.region.side)
    return replace(person, xy=head + size * (person.xy - head), region=region)


@real
def test_a_person_found_late_replaces_a_part_of_it_in_the_image_before(image):
    detector = _SeesAPart(PoseDetectorConfig(windows=[1.0]), look_back=True)
    (part,) = detector(image)
    (person,) = detector(image)
    assert part.torso_size < 0.5 * person.torso_size
    ((ago, (before,)),) = detector.late
    assert ago == 1 and np.abs(before.xy - person.xy).mean() < 10


@real
def test_a_body_too_small_for_its_head_becomes_a_larger_one(image):
    detector, pyramid = PeopleDetector(PoseDetectorConfig(windows=[1.0])), pyramid_of(image)
    (person,) = detector(image)
    region = _shrunken(person).region
    alone = find_person(Network("pose_landmark_full"), pyramid, region)
    larger = detector._person(pyramid, region)
    assert part_of(alone, larger) and larger.torso_size > 2 * alone.torso_size


@real
class TestSearchAtExpectedPlaces:
    @pytest.fixture
    def person(self, image) -> Person:
        (person,) = PeopleDetector(PoseDetectorConfig(windows=[1.0]))(image)
        return person

    def find(self, image, expected: np.ndarray, known=()) -> Person | None:
        return find_expected(Network("pose_landmark_full"), pyramid_of(image), expected, known)

    def test_a_person_is_found_near_where_it_is_expected(self, image, person):
        expected = person.xy + 0.04 * 2 * person.region.radius
        expected[BLAZEPOSE33.index("nose")] = np.nan
        found = self.find(image, expected)
        assert np.median(np.linalg.norm(found.xy - person.xy, axis=-1)) < 0.04 * person.region.radius

    def test_nothing_is_found_elsewhere(self, image, person):
        assert self.find(image, person.xy + [0.5 * person.region.radius, 0]) is None
        assert self.find(np.zeros_like(image), person.xy) is None

    def test_a_known_person_is_not_found_again(self, image, person):
        assert self.find(image, person.xy, [person.xy]) is None

    def test_places_of_one_point_are_no_person(self, image):
        assert self.find(image, np.zeros((33, 2))) is None


class _Late:
    """Finds a person at (0, 0) in each image, and one in the image before that was there."""

    skeleton = COCO17

    def __init__(self, config: PoseDetectorConfig):
        self.images = 0

    def __call__(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.images += 1
        return np.zeros((1, 17, 2)), np.ones((1, 17))

    def found_late(self) -> list[tuple[int, np.ndarray, np.ndarray]]:
        both = np.stack([np.zeros((17, 2)), np.full((17, 2), self.images)])
        return [(1, both, np.ones((2, 17)))] if self.images > 1 else []


def late_detector(config: PoseDetectorConfig) -> _Late:
    return _Late(config)


def test_people_found_late_are_added_to_the_image_that_they_are_in(tmp_path: Path):
    images = tmp_path / "videos/cam"
    images.mkdir(parents=True)
    for number in range(4):
        cv2.imwrite(str(images / f"{number}.png"), np.zeros((8, 8, 3), np.uint8))
    (images / "2.png").write_bytes(b"unreadable")
    (camera,) = find_cameras(tmp_path / "videos")
    found = detect_people([camera], PoseDetectorConfig(name=f"{__name__}:late_detector"), tmp_path / "pieces")
    people = found["cam"]
    assert people[2] is None
    assert [each[:, 0, 0].tolist() for each in people if each is not None] == [[0, 2], [0, 3], [0]]


@real
def test_pieces_are_kept_and_not_done_again(tmp_path: Path):
    cameras = [find_cameras(VIDEOS)[2]]
    short = [type(cameras[0])(**{**vars(cameras[0]), "times": cameras[0].times[:2]})]
    config = PoseDetectorConfig(windows=[1.0])
    found = detect_people(short, config, tmp_path)
    (piece,) = tmp_path.iterdir()
    before = piece.stat().st_mtime_ns
    again = detect_people(short, config, tmp_path)
    assert piece.stat().st_mtime_ns == before
    np.testing.assert_array_equal(found["cam03"][1], again["cam03"][1])
    detections = to_detections([found["cam03"]], [np.array([0, 2])], 3, BLAZEPOSE33)
    assert detections.xy.shape[:3] == (3, 1, 1) and not detections.observed[1].any()
    converted = convert_detections(detections, BODY25)
    neck = converted.xy[0, 0, 0, BODY25.index("neck")[0]]
    shoulders = detections.xy[0, 0, 0, BLAZEPOSE33.index("l_shoulder", "r_shoulder")]
    np.testing.assert_allclose(neck, shoulders.mean(0))
    assert np.isnan(converted.score[..., BODY25.index("l_small_toe")[0]]).all()


def heat_map_model(path: Path, simcc: bool) -> None:
    """A model that finds all 17 joints where the image is brightest."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    make, kind = onnx.helper, onnx.TensorProto.FLOAT
    nodes = [make.make_node("ReduceMean", ["image"], ["grey"], axes=[1], keepdims=1)]
    ones = make.make_tensor("ones", kind, (1, 17, 1, 1), [1.0] * 17)
    nodes.append(make.make_node("Mul", ["grey", "ones"], ["maps"]))
    outputs = [make.make_tensor_value_info("maps", kind, (1, 17, 64, 48))]
    if simcc:
        nodes.append(make.make_node("ReduceMax", ["maps"], ["x"], axes=[2], keepdims=0))
        nodes.append(make.make_node("ReduceMax", ["maps"], ["y"], axes=[3], keepdims=0))
        sizes = {"x": (1, 17, 48), "y": (1, 17, 64)}
        outputs = [make.make_tensor_value_info(name, kind, size) for name, size in sizes.items()]
    given = [make.make_tensor_value_info("image", kind, (1, 3, 64, 48))]
    graph = make.make_graph(nodes, "brightest", given, outputs, [ones])
    onnx.save(make.make_model(graph, opset_imports=[make.make_opsetid("", 13)], ir_version=8), str(path))


@real
@pytest.mark.parametrize("simcc", [False, True], ids=["heat maps", "SimCC"])
def test_a_model_in_onnx(image, tmp_path: Path, simcc: bool):
    heat_map_model(tmp_path / "model.onnx", simcc)
    detector = make_detector(PoseDetectorConfig(name="onnx", path=str(tmp_path / "model.onnx"), windows=[1.0]))
    assert detector.skeleton is COCO17
    dark = image // 8
    (xy,), _ = make_detector(PoseDetectorConfig(windows=[1.0]))(dark)
    hip = xy[BLAZEPOSE33.index("l_hip", "r_hip")].mean(0)
    x, y = (hip + (40, -60)).round().astype(int)
    dark[y - 15 : y + 16, x - 15 : x + 16] = 255
    found, score = detector(dark)
    assert found.shape == (1, 17, 2) and (score <= 1).all()
    assert np.abs(found[0] - (x, y)).max() < 30


def test_a_file_that_is_no_model(tmp_path: Path):
    pytest.importorskip("onnxruntime")
    (tmp_path / "model.onnx").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="expected an ONNX model"):
        make_detector(PoseDetectorConfig(name="onnx", path=str(tmp_path / "model.onnx")))
    with pytest.raises(FileNotFoundError):
        make_detector(PoseDetectorConfig(name="onnx", path=str(tmp_path / "none.onnx")))
