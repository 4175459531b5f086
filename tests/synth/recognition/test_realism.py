"""The meter on images whose pixels say where joints are, and how people appear."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from dmae.data.clip import Clip
from dmae.data.images import Images, write_image
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.data.store import save_clip
from dmae.detection.registry import PoseDetectorConfig
from synth.recognition.realism import crops, described, draw_sheet, found_in, judge, rates, sightings, worst
from tests.support.clips import full_clip, looking_at_origin, t_pose

PEOPLE = 2


class Decoder:
    """Finds the joints of whom it sees by the colours of their pixels; one of them 20 px beside its place."""

    skeleton = BODY25

    def __init__(self, wrong: str = "r_knee"):
        self.wrong = BODY25.index(wrong)[0]

    def __call__(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = np.full((PEOPLE, len(BODY25), 2), np.nan)
        for person in range(PEOPLE):
            for joint in range(len(BODY25)):
                y, x = np.nonzero((image == colour(person, joint)).all(-1))
                if len(x):
                    found[person, joint] = x[0], y[0]
        found[:, self.wrong, 0] += 20
        found = found[~np.isnan(found).all((1, 2))]
        return found, np.where(np.isnan(found[..., 0]), np.nan, 0.9)


def decoder(config: PoseDetectorConfig) -> Decoder:
    return Decoder()


def colour(person: int, joint: int) -> tuple[int, int, int]:
    return (100 + person, 5 + 9 * joint, 30)


@pytest.fixture
def clip(tmp_path: Path) -> Clip:
    """Two people, a pixel for each joint; all is visible, but for the second person in the second view."""
    clip = full_clip(frames=2, views=2)
    xy, _ = clip.rig.project(clip.truth.xyz)
    visibility = np.full(clip.occlusion.visibility.shape, Visibility.VISIBLE)
    visibility[:, 1, 1] = Visibility.HIDDEN_BY_OBJECT
    for view, name in enumerate(clip.rig.names):
        for frame in range(2):
            image = np.full((600, 960, 3), 220, np.uint8)
            for person in range(PEOPLE):
                for joint, (x, y) in enumerate(xy[frame, view, person].round().astype(int)):
                    image[y, x] = colour(person, joint)
            write_image("rgb", tmp_path / "rgb" / name / f"{frame:06d}.png", image)
    images = Images(tmp_path, clip.rig.names, (0, 1), ("rgb",), rgb="png")
    clip = replace(
        clip, true_rig=None, images=images, occlusion=replace(clip.occlusion, visibility=visibility), provenance={}
    )
    save_clip(clip, tmp_path)
    return clip


def test_people_in_plain_sight_are_found_and_a_wrong_joint_counts(clip):
    seen = sightings(clip)
    found = list(crops(clip, seen, Decoder()))
    assert [(each.frame, each.view, each.person) for each in found] == [
        (frame, view, person) for frame in (0, 1) for view, person in ((0, 0), (0, 1), (1, 0))
    ]
    for each in found:
        assert each.found
        assert each.counted.all()
        # 20 px are more than 5 % of a body 230 px high.
        assert each.near == len(BODY25) - 1
        place = (each.frame, each.view, each.person)
        np.testing.assert_allclose(each.error[BODY25.index("r_knee")], 20 / seen.height[place], rtol=0.1)
        right = np.arange(25) != BODY25.index("r_knee")
        np.testing.assert_allclose(each.xy[right], seen.xy[place][right], atol=0.51)


def test_a_detector_without_people_finds_none(clip):
    class Blind(Decoder):
        def __call__(self, image):
            return np.empty((0, 25, 2)), np.empty((0, 25))

    assert [each.found for each in crops(clip, sightings(clip), Blind())] == [False] * 6


def test_a_person_is_not_found_by_the_joints_of_the_person_at_its_side(clip):
    seen = sightings(clip)
    xy, aside = seen.xy.copy(), (round(0.1 * seen.height[0, 0, 0]), 0)
    xy[:, :, 0] = xy[:, :, 0].round()
    xy[:, :, 1] = xy[:, :, 0] + aside
    image = np.full((600, 960, 3), 220, np.uint8)
    for joint, (x, y) in enumerate(xy[0, 0, 1].astype(int)):
        image[y, x] = colour(1, joint)
    first, second = (found_in(image, replace(seen, xy=xy), (0, 0, person), Decoder()) for person in (0, 1))
    assert (first.found, first.taken, first.near) == (False, True, 0)
    assert (second.found, second.taken, second.near) == (True, False, len(BODY25) - 1)


def test_a_model_of_a_user_is_told_where_each_person_is(clip):
    class Told(Decoder):
        def in_boxes(self, image, boxes):
            ((x, y, side),) = boxes
            found, score = Decoder.__call__(self, image)
            assert (np.abs(found - (x, y)) < side / 2).all((1, 2)).any(), "all joints of one person are in the box"
            return found, score

        def __call__(self, image):
            raise AssertionError("it is not asked to search")

    assert [each.found for each in crops(clip, sightings(clip), Told())] == [True] * 6


def test_rates_and_image(clip, tmp_path):
    judged = judge([tmp_path], PoseDetectorConfig(name=f"{__name__}:decoder"))
    rows = {(row.heading, row.group): row for row in rates(judged)}
    whole = rows["all", ""]
    assert (whole.people, whole.found, whole.joints) == (6, 1.0, 150)
    assert whole.near == pytest.approx(24 / 25)
    assert rows["joint", "knee"].near == pytest.approx(0.5)
    assert rows["joint", "wrist"].near == 1
    assert rows["direction", "facing"].people == 4
    assert rows["direction", "away"].people == 2
    assert described(whole)[:3] == ("all", "6", "100.0")
    sheet = draw_sheet(worst(judged, 4), columns=2)
    assert sheet.shape == (2 * 216, 400, 3)
    assert np.unique(sheet.reshape(-1, 3), axis=0).shape[0] > 5


def test_clips_without_images_or_truth_are_refused(clip):
    with pytest.raises(ValueError, match="images=rgb"):
        next(crops(replace(clip, images=None), sightings(clip), Decoder()))
    with pytest.raises(ValueError, match="expected truth and labels of visibility"):
        sightings(replace(clip, occlusion=None))


def test_how_people_appear():
    clip = full_clip(frames=4, views=2)
    body = t_pose()
    bent, seated = body.copy(), body.copy()
    upper = body[:, 2] > body[BODY25.index("mid_hip")[0], 2] + 0.01
    hip = body[BODY25.index("mid_hip")[0]]
    bent[upper] = hip + (body[upper] - hip)[:, [2, 1, 0]] * (1, 1, -1)
    knees = BODY25.index("l_knee", "r_knee")
    thigh = hip[2] - body[knees[0], 2]
    seated[body[:, 2] > body[knees[0], 2] + 0.01, 2] -= thigh
    below = body[:, 2] < body[knees[0], 2] + 0.01
    seated[below, 0] += thigh
    poses = np.stack([body, bent, seated, body * (-1, -1, 1)])[:, None]
    clip = replace(
        clip,
        truth=replace(clip.truth, xyz=poses, cov=None, source=None, views=None, rays=None),
        true_rig=None,
        rig=looking_at_origin(2),
        occlusion=replace(
            clip.occlusion,
            visibility=np.zeros((4, 2, 1, 25)),
            occluder=np.full((4, 2, 1, 25), -1),
            depth_margin=np.full((4, 2, 1, 25), np.nan),
            visible_pixels=None,
            amodal_pixels=None,
        ),
    )
    seen = sightings(clip)
    # The first camera is at +x, which the body faces until it turns in the last frame.
    assert seen.direction[:, 0, 0].tolist() == ["facing", "facing", "facing", "away"]
    assert seen.direction[:, 1, 0].tolist() == ["away", "away", "away", "facing"]
    assert seen.posture[:, 0].tolist() == ["upright", "bent", "seated", "upright"]
    np.testing.assert_allclose(seen.distance[0, 0, 0], np.hypot(6, 2 - hip[2]), rtol=0.01)
    np.testing.assert_allclose(seen.height[0, 0, 0], 1.7 * 800 / 6, rtol=0.1)
    assert np.isinf(seen.crowding).all()


def test_what_is_cut_out_beyond_the_image_is_black():
    from synth.recognition.realism import cut

    image = np.full((10, 20, 3), 200, np.uint8)
    square = cut(image, (-4, 2), 12)
    assert (square[:8, 4:] == 200).all()
    assert not square[:, :4].any() and not square[8:].any()
    assert cv2.countNonZero(square[..., 0]) == 8 * 8
