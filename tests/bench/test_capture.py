"""Speed of capture, and the share of it that reading and triangulation take."""

import cv2
import numpy as np
import pytest

from dmae.formats.shelf import read_shelf
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from dmae.reconstruction.triangulation import triangulate
from tests.bench import costs
from tests.support.clips import looking_at_origin, looking_inwards
from tests.support.detected_people import detected_clip, walk
from tests.support.timing import seconds

pytestmark = pytest.mark.bench


def test_capture_of_shelf(data_folder):
    folder = data_folder / "shelf"
    clip = read_shelf(folder)
    reading = seconds(lambda: read_shelf(folder))
    total = reading + seconds(lambda: capture(clip, CaptureConfig()))
    print(f"\nShelf, 5 views: {len(clip) / total:.0f} frames/s, of the time {reading / total:.0%} reading and assembly")


def test_capture_of_a_crowd_in_a_dome():
    """Eight people who cross each other's paths, some joints missed, noise of 3 px."""
    index = np.arange(31)
    height, angle = 0.5 + 4.5 * index / 30, index * np.pi * (3 - 5**0.5)
    centres = np.stack([6 * np.cos(angle), 6 * np.sin(angle), height], -1)
    starts = 1.5 * np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], -1)
    people = np.stack([walk(start, 0.4 * start[::-1] - start, 0.9 + 0.03 * i, i) for i, start in enumerate(starts)], 1)
    clip = detected_clip(people, rig=looking_inwards(centres))
    poses = capture(clip, CaptureConfig())
    assert poses.xyz.shape[1] == 8
    whole = seconds(lambda: capture(clip, CaptureConfig()), 1)
    print(f"\nDome, 31 views, 8 people: {len(clip) / whole:.0f} frames/s")


def test_costs():
    """By cameras, people, ghosts and rate, and frame by frame; see `tests.bench.costs`."""
    found = costs.measure()
    assert [row["people"] for row in found["people"]] == list(costs.PEOPLE)
    for name, table in costs.tables(found).items():
        print(f"\n{name}: {' | '.join(table['columns'])}")
        for row in table["rows"]:
            print("  " + " | ".join(row))


def test_triangulation_beside_opencv():
    """Five views, robust, with covariance, against OpenCV's linear solution from two."""
    rng = np.random.default_rng(0)
    rig = looking_at_origin(5)
    xyz = rng.normal(0, 0.5, (20_000, 3)) + (0, 0, 1)
    xy = rig.project(xyz)[0] + rng.normal(0, 1, (20_000, 5, 2))
    ours = seconds(lambda: triangulate(rig, xy, np.ones((20_000, 5))))
    first, second = xy[:, 0].T.copy(), xy[:, 1].T.copy()
    theirs = seconds(lambda: cv2.triangulatePoints(*rig.projections[:2], first, second))
    print(
        f"\n5 views, robust: {ours * 1e6 / 20_000:.1f} us a point, {ours / theirs:.1f} x OpenCV's linear one of 2 views"
    )
