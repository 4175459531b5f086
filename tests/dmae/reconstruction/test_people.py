"""Tracks that are of one person, and their merging."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BODY25
from dmae.online.capture import OnlineCapture
from dmae.reconstruction.association import NONE
from dmae.reconstruction.chance import passing_ghosts, surprise
from dmae.reconstruction.config import CaptureConfig, SubjectConfig
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.noise import DetectionNoise
from dmae.reconstruction.people import coincidental, merge, same_person, too_brief, well_measured
from dmae.reconstruction.pipeline import capture
from dmae.reconstruction.tracking import Tracks
from tests.support.clips import looking_at_origin, looking_inwards
from tests.support.detected_people import FPS, FRAMES, crossing, detected_clip, errors, standing, walk


def test_duplicates_and_re_entries_are_one_person():
    """Track 1 duplicates 0; 3 is a re-entry of 2; 4 re-enters too late; 5 is a child who enters where 2 left."""
    xyz = standing(frames=200, persons=6)
    xyz[:, 1] = xyz[:, 0] + 0.03
    xyz[:, 3] = xyz[:, 4] = xyz[:, 2]
    xyz[:, 5] = standing(frames=200, scale=0.7)[:, 0] + (0, 2, 0)
    for track, (start, end) in enumerate([(0, 200), (50, 90), (0, 40), (60, 80), (180, 200), (82, 120)]):
        xyz[:start, track], xyz[end:, track] = np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, reentry_s=2.0).tolist() == [0, 0, 2, 2, 4, 5]


@pytest.mark.parametrize(("seen_s", "people"), [(0.6, [0, 0]), (1.2, [0, 1])])
def test_lengths_of_brief_tracks_say_less(seen_s, people):
    """Two cameras measure somebody for a moment, with bones 18 % too short."""
    xyz, seen = np.concatenate([standing(frames=100), standing(frames=100, scale=0.82)], 1), round(seen_s * FPS)
    xyz[40:, 0], xyz[:50, 1], xyz[50 + seen :, 1] = np.nan, np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, reentry_s=2.0).tolist() == people


def test_a_person_too_far_from_the_exit_is_another():
    xyz = standing(frames=60, persons=2)
    xyz[20:, 0], xyz[:25, 1] = np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, 2.0).tolist() == [0, 1]
    xyz[:, 1, :, 1] -= 1
    assert same_person(xyz, BODY25, FPS, 2.0).tolist() == [0, 0]


def test_a_track_is_re_entered_once():
    xyz = standing(frames=60, persons=3)
    xyz[:, 1:, :, 1] -= ((0.9,), (2.1,))
    xyz[20:, 0], xyz[:25, 1:] = np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, 2.0).tolist() == [0, 0, 2]


def test_merging_keeps_the_older_track_and_fills_gaps_from_the_younger():
    xyz = standing(frames=4, persons=3)
    assigned = np.broadcast_to(np.arange(3)[:, None, None], (4, 3, 2, 25)).copy()
    assigned[2:, 0], xyz[2:, 0] = NONE, np.nan
    merged = merge(Tracks(assigned, xyz, np.where(np.isnan(xyz[..., 0, 0]), np.inf, 0)), np.array([0, 0, 2]))
    assert merged.assigned[:, :, 0, 0].tolist() == [[0, 2], [0, 2], [1, 2], [1, 2]]
    np.testing.assert_array_equal(merged.xyz[1:3, 0], xyz[[1, 2], [0, 1]])
    np.testing.assert_array_equal(merged.xyz[:, 1], xyz[:, 2])
    assert (merged.chance == 0).all()


def tracks_of(xyz: np.ndarray, assigned: np.ndarray | None = None) -> Tracks:
    """Tracks of which the views agree in all frames."""
    assigned = np.zeros((*xyz.shape[:2], 2, 25), int) if assigned is None else assigned
    return Tracks(assigned, xyz, np.zeros(xyz.shape[:2]))


def test_ghosts_that_come_and_go_agree_in_few_frames_of_a_track():
    """The four tracks last for 40 frames; in so many of them, views agree as well as by chance in a tenth of frames."""
    tracks = tracks_of(standing(persons=4))
    for person, good in enumerate((40, 20, 4, 1)):
        tracks.chance[:, person] = 10.0
        tracks.chance[:: 40 // good, person] = 0.1
    measured, surprises = well_measured(tracks, 4).sum(1)
    assert measured.tolist() == [40] * 4
    assert passing_ghosts(measured, surprises, 40, 0.1).tolist() == [False, False, True, True]
    assert not passing_ghosts(measured, surprises, 40, None).any()


def test_a_long_recording_has_more_ghosts_that_agree():
    """Four frames of a person of whom views agree as well as by chance in a twentieth of frames."""
    measured, surprises = np.array([4.0]), surprise(np.full((4, 1), 0.05), np.ones((4, 1), bool)).sum(0)
    assert not passing_ghosts(measured, surprises, 100, 0.1)[0]
    assert passing_ghosts(measured, surprises, 100_000, 0.1)[0]


def test_the_best_of_all_frames_does_not_decide_alone():
    chance = np.full((12, 1), 5.0)
    chance[3] = 1e-18
    assert passing_ghosts(np.array([12.0]), surprise(chance, np.ones((12, 1), bool)).sum(0), 60, 0.1)[0]


def test_figures_that_agree_now_and_then_are_no_person():
    """Twelve frames in which views agree as well as by chance in 3 % of frames: one after the other, or every sixth."""
    measured = np.zeros((72, 2), bool)
    measured[:12, 0] = measured[::6, 1] = True
    surprises = surprise(np.where(measured, 0.03, np.inf), measured).sum(0)
    assert passing_ghosts(measured.sum(0), surprises, 72, 0.1).tolist() == [False, True]


def test_tracks_measured_for_a_moment_are_too_brief():
    xyz = standing(persons=3)
    xyz[5:, 1] = np.nan
    xyz[:, 2, 3:] = np.nan
    assert too_brief(well_measured(tracks_of(xyz), 4)[0].sum(0), len(xyz), FPS, 0.3).tolist() == [False, True, True]


def test_half_of_a_short_clip_is_long_enough():
    assert not too_brief(well_measured(tracks_of(standing(frames=3)), 4)[0].sum(0), 3, FPS, 0.3).any()


def exactly_seen(xyz: np.ndarray, *cameras: tuple[float, float]) -> Clip:
    """People p (F, P, J, 3) m as detection p of cameras at places x, y, 1.5 m high."""
    rig = looking_inwards(np.array([(*camera, 1.5) for camera in cameras]))
    xy = rig.project(xyz)[0]
    return Clip("people", FPS, rig, Detections2D(BODY25, xy, np.where(np.isnan(xy[..., 0]), np.nan, 0.9)))


def test_views_of_a_coincidence_agree_on_few_joints():
    xyz = standing(persons=3)
    clip = exactly_seen(xyz, (0.0, -5.0), (5.0, 0.0), (0.0, 5.0))
    clip.detections.xy[:, 1, 1, ::2, 1] += 200
    xyz[:, 1, ::2] = np.nan
    xyz[:, 2, :5] = np.nan
    assigned = np.tile(np.arange(3)[:, None, None], (len(xyz), 1, 3, 25))
    assigned[:, :, 2] = NONE
    config, noise = CaptureConfig(), DetectionNoise.prior(CaptureConfig().noise, 3, 25)
    assert coincidental(clip, tracks_of(xyz, assigned), config, noise).tolist() == [False, True, False]
    # A joint that a single view detects is not expected to be found.
    assigned[:, 1, 1, ::2] = NONE
    assert not coincidental(clip, tracks_of(xyz, assigned), config, noise).any()


def test_a_person_whose_joints_are_not_precise_is_no_coincidence():
    """Views agree on joints that are absent because two cameras from one side do not show how far they are."""
    xyz = standing(persons=1)
    clip = exactly_seen(xyz, (0.0, -5.0), (0.8, -5.0))
    config, noise = (
        CaptureConfig(),
        replace(DetectionNoise.prior(CaptureConfig().noise, 2, 25), floor_px=np.full(2, 20)),
    )
    assigned = np.zeros((len(xyz), 1, 2, 25), int)
    joints = Evidence.of(clip, config.th_p, config, noise=noise).triangulate(assigned).xyz
    assert np.isnan(joints).all()
    assert not coincidental(clip, tracks_of(joints, assigned), config, noise).any()


WAYS = {"adult": ((-1.0, -1.0), (1.0, -1.0), 1.0), "child": ((1.0, 1.0), (-1.0, 1.0), 0.65)}


@pytest.fixture(scope="module")
def two():
    """An adult who is there in all frames, and a child in the first 60 of them."""
    people = np.stack([walk(start, end, scale) for start, end, scale in WAYS.values()], 1)
    people[60:, 1] = np.nan
    return detected_clip(people, miss=0.02), people


def found(two, **options) -> list[str]:
    clip, people = two
    poses = capture(clip, CaptureConfig(**options))
    names = []
    for person in range(poses.xyz.shape[1]):
        with np.errstate(invalid="ignore"):
            off = np.linalg.norm(poses.xyz[:, [person]] - people, axis=-1)
        names.append(list(WAYS)[int(np.nanargmin(np.nanmedian(off, (0, 2))))])
    return sorted(names)


def test_without_options_everyone_is_captured(two):
    assert found(two) == ["adult", "child"]


def test_of_one_person_the_one_measured_most_is_kept(two):
    assert found(two, persons=1) == ["adult"]
    assert found(two, persons=2) == ["adult", "child"]
    assert found(two, persons=5) == ["adult", "child"]


def test_people_outside_a_volume_are_left_out_whichever_corner_comes_first(two):
    assert found(two, volume=[-3, 0.3, -1, 3, 3, 3]) == ["child"]
    assert found(two, volume=[3, -0.3, 3, -3, -3, -1]) == ["adult"]


def test_a_person_is_captured_while_inside_a_volume(two):
    clip, people = two
    poses = capture(clip, CaptureConfig(volume=[0, -2, -1, 3, 0, 3]))
    (there,) = poses.measured.any(-1).T
    inside = np.median(people[:, 0, :, 0], -1) > 0
    assert (there == inside).mean() > 0.95


@pytest.mark.parametrize(
    ("subject", "expected"),
    [
        (SubjectConfig(at=[30, -0.4, -1.0]), "adult"),
        (SubjectConfig(at=[30, 0.4, 1.2]), "child"),
        (SubjectConfig(leg_m=[0.7, 1.1]), "adult"),
        (SubjectConfig(leg_m=[0.3, 0.7]), "child"),
    ],
)
def test_a_subject_is_chosen_by_its_place_in_one_frame_or_by_its_legs(two, subject, expected):
    assert found(two, subject=subject) == [expected]


def test_a_subject_is_chosen_by_a_pixel(two):
    clip, people = two
    place = np.nanmean(clip.rig.project(people[20:21, 1])[0][0, 2], 0)
    subject = SubjectConfig(at=[20, *place.tolist()], camera=clip.rig.names[2])
    assert found(two, subject=subject) == ["child"]


def test_a_subject_that_is_not_there_is_answered_with_those_who_are(two):
    clip, _ = two
    with pytest.raises(
        ValueError,
        match=r"found no person within 1 m of it in that frame; people are at (?=.*\(0\.40, 1\.)(?=.*\(-0\.39, -1\.)",
    ):
        capture(clip, CaptureConfig(subject=SubjectConfig(at=[30, 5, 5])))
    with pytest.raises(ValueError, match="expected a frame from 0 to 99, found 200"):
        capture(clip, CaptureConfig(subject=SubjectConfig(at=[200, 0, 0])))
    with pytest.raises(ValueError, match=r"subject\.camera=left: expected one of"):
        capture(clip, CaptureConfig(subject=SubjectConfig(at=[3, 0, 0], camera="left")))


def test_fragments_of_one_person_are_linked_where_fewer_people_are_asked_for():
    """Away for three seconds, a person is two by default."""
    people = walk((-1, 0), (1, 0), frames=3 * FRAMES)[:, None]
    people[FRAMES : 2 * FRAMES] = np.nan
    clip = detected_clip(people, miss=0.02)
    assert capture(clip, CaptureConfig()).xyz.shape[1] == 2
    poses = capture(clip, CaptureConfig(persons=1))
    assert poses.xyz.shape[1] == 1
    assert np.isfinite(errors(poses, people)[2 * FRAMES :]).mean() > 0.9


def test_people_who_are_there_together_are_never_linked():
    clip = detected_clip(crossing(), miss=0.02)
    poses = capture(clip, CaptureConfig(persons=2))
    assert poses.xyz.shape[1] == 2
    off = errors(poses, crossing())
    assert sorted(np.isfinite(off).any((0, 2)).tolist()) == [False, True, True]
    assert np.nanquantile(off, 0.99) < 0.1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"persons": 0}, "persons=0: expected 1 or more"),
        ({"volume": [0, 0, 1, 1]}, "expected six numbers"),
        ({"volume": [0, 0, 0, 1, 0, 1]}, "expected six numbers"),
        ({"persons": 2, "subject": SubjectConfig(at=[0, 0, 0])}, "names one person"),
    ],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        CaptureConfig(**options)


def test_impossible_subjects_are_refused():
    with pytest.raises(ValueError, match=r"expected \[frame, x, y\]"):
        SubjectConfig(at=[0, 0])
    with pytest.raises(ValueError, match=r"expected subject\.at"):
        SubjectConfig(camera="left")
    with pytest.raises(ValueError, match=r"expected \[least, most\]"):
        SubjectConfig(leg_m=[1.0, 0.7])


def test_while_cameras_run_only_a_volume_can_be_asked_for(two):
    rig = looking_at_origin(4)
    for options in ({"persons": 1}, {"subject": SubjectConfig(leg_m=[0.7, 1.0])}):
        with pytest.raises(ValueError, match="decided over a whole recording"):
            OnlineCapture(rig, BODY25, 25, CaptureConfig(**options))
    clip, _ = two
    online = OnlineCapture(rig, BODY25, 25, CaptureConfig(volume=[-3, 0.3, -1, 3, 3, 3]))
    frames = [each for f in range(60) for each in online.push(clip.detections.select(slice(f, f + 1)))]
    assert max(len(frame.people) for frame in frames) == 1
