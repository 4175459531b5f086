"""Clips in blocks of frames: the poses of the whole, to the bit, in memory that does not grow with the frames."""

import gc
import tracemalloc
from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest

from dmae.calibration import world
from dmae.calibration.world import find_floor
from dmae.data.clip import Clip, Poses3D
from dmae.data.store import load_clip, save_clip
from dmae.files import arrays, mapped
from dmae.formats.writing import write_poses
from dmae.numerics.filling import smooth
from dmae.reconstruction import evidence, pipeline
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from dmae.reconstruction.sides import exchanged_detections
from tests.support.detected_people import crossing, detected_clip, walk

MOST_BYTES = 2000
"""A frame of one person may take in memory beside what lies in files; it took 20,000."""


@pytest.fixture
def in_blocks(monkeypatch):
    """Return a function that has blocks of about so many frames, and arrays of some kilobytes in files."""

    def set_blocks(frames: int) -> None:
        monkeypatch.setattr(mapped, "LARGE", 4000)
        monkeypatch.setattr(arrays, "LARGE", 4000)
        monkeypatch.setattr(mapped, "_BLOCK", 60_000)
        monkeypatch.setattr(evidence, "_BLOCK", 1)
        monkeypatch.setattr(evidence, "_FEWEST", frames)

    return set_blocks


def assert_equal(one: Poses3D, other: Poses3D) -> None:
    for name in (field.name for field in fields(Poses3D)[1:]):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)


def moved_camera(clip: Clip) -> Clip:
    """A clip of which one camera stands 8 cm from where its calibration has it."""
    pose = clip.rig.cam_from_world.copy()
    pose[0, :3, 3] += (0.08, 0, 0)
    return replace(clip, rig=replace(clip.rig, cam_from_world=pose))


CLIPS = {
    "crossing": (lambda: detected_clip(crossing(), miss=0.3), CaptureConfig()),
    "two of three in a volume": (
        lambda: detected_clip(crossing(), miss=0.1),
        CaptureConfig(persons=2, volume=[-1.2, -1.2, 0, 1.2, 1.2, 2]),
    ),
    "cameras that disagree": (lambda: moved_camera(detected_clip(crossing(), views=5)), CaptureConfig()),
    "nobody": (lambda: detected_clip(np.full((90, 1, 25, 3), np.nan)), CaptureConfig()),
}


@pytest.mark.parametrize("name", CLIPS)
def test_blocks_give_the_poses_of_the_whole(name, in_blocks):
    make, config = CLIPS[name]
    clip = make()
    whole = capture(clip, config)
    floor, sides, smoothed = (
        find_floor(whole, clip.fps),
        exchanged_detections(clip, whole),
        smooth(whole, clip.fps, 0.1),
    )
    in_blocks(23)
    found = capture(clip, config)
    assert_equal(found, whole)
    assert find_floor(found, clip.fps) == floor
    assert np.array_equal(exchanged_detections(clip, found), sides)
    assert_equal(smooth(found, clip.fps, 0.1), smoothed)


@pytest.mark.parametrize("format", ["trc", "npz", "bvh", "coco", "c3d"])
def test_exports_of_blocks_are_the_files_of_the_whole(format, in_blocks, tmp_path):
    clip = detected_clip(crossing()[:, :1])
    clip = replace(clip, poses=capture(clip, CaptureConfig()))
    if format == "c3d":
        pytest.importorskip("ezc3d")
    file = f"poses.{'json' if format == 'coco' else format}"
    write_poses(clip, tmp_path / "whole" / file, format)
    save_clip(clip, tmp_path / "clip")
    in_blocks(23)
    write_poses(load_clip(tmp_path / "clip"), tmp_path / "blocks" / file, format)
    whole, blocks = (
        {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("whole", "blocks")
    )
    assert whole == blocks and whole


def peak_bytes(clip: Clip, folder) -> dict[str, int]:
    """The most memory of arrays that each step holds."""
    save_clip(clip, folder / "clip")
    found, done = {}, {}
    steps = {
        "load": lambda: load_clip(folder / "clip"),
        "capture": lambda: capture(done["load"], CaptureConfig()),
        "sides": lambda: exchanged_detections(done["load"], done["capture"]),
        "floor": lambda: find_floor(done["capture"], clip.fps),
        "save": lambda: save_clip(replace(done["load"], poses=done["capture"]), folder / "clip"),
        **{
            format: partial(
                lambda format: write_poses(load_clip(folder / "clip"), folder / f"poses.{format}", format), format
            )
            for format in ("trc", "npz")
        },
    }
    for name, step in steps.items():
        gc.collect()
        tracemalloc.start()
        done[name] = step()
        found[name] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return found


def test_memory_does_not_grow_with_frames(in_blocks, tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "_EXPECTED_IN_CLIPS", 1.0)
    monkeypatch.setattr(world, "_FRAMES", 64)
    there = walk((-1.5, 0), (1.5, 0.2), frames=100)
    lap = np.concatenate([there, there[::-1]])
    in_blocks(32)
    clips = (detected_clip(np.resize(lap, (frames, *lap.shape[1:]))[:, None]) for frames in (40, 110, 210))
    # What is read once in a process, as which formats there are, is read the first time.
    _, short, long = (peak_bytes(clip, tmp_path) for clip in clips)
    grown = {name: (long[name] - short[name]) / 100 for name in short}
    assert max(grown.values()) < MOST_BYTES, grown
