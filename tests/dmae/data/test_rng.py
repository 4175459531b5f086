import pytest

from dmae.data.rng import Stream, generator


def draw(seed=7, clip=3, stream=Stream.MOTION):
    return generator(seed, clip, stream).integers(0, 2**63, 4).tolist()


def test_a_stream_is_the_same_whatever_is_drawn_around_it():
    alone = draw()
    for clip in range(10):
        for stream in Stream:
            generator(7, clip, stream).normal(size=100)
    assert draw() == alone


def test_every_seed_clip_and_stream_is_different():
    seen = {tuple(draw(seed, clip, stream)) for seed in (0, 1, 7) for clip in range(20) for stream in Stream}
    assert len(seen) == 3 * 20 * len(Stream)


def test_numbers_of_streams_never_change():
    """They are part of every data set that was made with them: add to this list, never edit it."""
    assert {stream.name: int(stream) for stream in Stream} == {
        "SCENE": 0,
        "MOTION": 1,
        "CAMERAS": 2,
        "DETECTOR": 3,
        "STRESS": 4,
        "WINDOWS": 5,
        "MASKING": 6,
        "VALIDATION": 7,
        "LAYOUT": 8,
        "CALIBRATION": 9,
        "INTERACTION": 10,
        "SENSOR": 11,
    }


def test_draws_are_those_of_the_first_release():
    assert generator(0, 0, Stream.SCENE).integers(0, 1000, 5).tolist() == [17, 565, 909, 935, 902]


def test_seeds_are_not_negative():
    with pytest.raises(ValueError, match="non-negative"):
        generator(-1, 0, Stream.SCENE)
