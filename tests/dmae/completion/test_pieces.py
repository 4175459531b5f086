"""Long recordings in pieces: each frame is completed once, with 20 s on both sides, at any rate."""

from dataclasses import fields

import numpy as np
import pytest

from dmae.completion import pieces
from dmae.completion.pieces import in_pieces
from dmae.data.clip import Poses3D
from dmae.data.skeleton import SHELF14
from dmae.numerics.filling import fill_world
from dmae.numerics.paths import pchip


def recording(frames: int, persons: int = 2) -> Poses3D:
    """Smooth paths with gaps."""
    rng = np.random.default_rng(0)
    time = np.arange(frames)[:, None, None, None] / 25
    xyz = np.sin(time * rng.uniform(0.5, 2, (persons, 14, 3)) + rng.uniform(0, 6, (persons, 14, 3)))
    xyz[rng.random(xyz.shape[:-1]) < 0.3] = np.nan
    return Poses3D(SHELF14, xyz)


@pytest.mark.parametrize(("frames", "fps"), [(4001, 25.0), (9000, 29.97), (13_000, 120.0), (5000, 1.0), (6000, 0.05)])
def test_pieces_cover_all_frames_with_their_surroundings(frames, fps):
    given, covered = [], []
    for inner, around in pieces._parts(frames, fps, range(frames)):
        given.append(around.stop - around.start)
        covered += range(inner.start, inner.stop)
        assert around.start in (0, *range(inner.start - round(20 * fps) + 1)) and around.start >= 0
        assert around.stop == frames or around.stop >= inner.stop + 20 * fps
    assert covered == list(range(frames))
    assert max(given) <= max(pieces.WHOLE, 61 * fps)


def test_short_recordings_are_completed_whole():
    poses, calls = recording(300), []
    in_pieces(lambda *given: calls.append(given) or poses, poses, 25.0, slice(10, 20))
    assert calls == [(poses, slice(10, 20))]


@pytest.mark.parametrize("asked", [slice(None), slice(700, 1900), slice(120, 130)])
def test_pieces_give_what_the_whole_gives(asked, monkeypatch):
    """Of a method that looks no farther than 20 s."""
    poses = recording(2200)
    whole = fill_world(poses, 25.0, pchip).select(asked)
    monkeypatch.setattr(pieces, "WHOLE", 1000)
    monkeypatch.setattr(pieces, "_PIECE", 1250)
    sizes = []

    def complete(given: Poses3D, frames: slice) -> Poses3D:
        sizes.append(given.source.shape[:2])
        return fill_world(given, 25.0, pchip).select(frames)

    found = in_pieces(complete, poses, 25.0, asked)
    for name in (field.name for field in fields(Poses3D)[1:]):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name), name)
    assert {persons for _, persons in sizes} == {1} and max(count for count, _ in sizes) < len(poses.xyz)


def test_nobody(monkeypatch):
    monkeypatch.setattr(pieces, "WHOLE", 10)
    poses = recording(5000, persons=0)
    assert in_pieces(lambda given, frames: given.select(frames), poses, 25.0).xyz.shape == (5000, 0, 14, 3)
