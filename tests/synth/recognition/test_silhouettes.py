"""Statistics of silhouettes, of drawn figures whose widths are known."""

import numpy as np
import pytest

from synth.recognition.silhouettes import comparison, silhouette

GREY, SKIN = (120, 120, 120), (205, 150, 120)


def figure(stripes: bool = False, shift: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A head 20 px wide and 40 px high of skin on a body 60 px wide and 160 px high, before a white wall."""
    pixels, mask = np.full((256, 256, 3), 255, np.uint8), np.zeros((256, 256), bool)
    top, middle = 20 + shift, 128
    for rows, half, colour in ((slice(top, top + 40), 10, SKIN), (slice(top + 40, top + 200), 30, GREY)):
        mask[rows, middle - half : middle + half] = True
        pixels[rows, middle - half : middle + half] = colour
    if stripes:
        pixels[top + 40 : top + 200 : 8, 98:158] = pixels[top + 41 : top + 200 : 8, 98:158] = 20
    return pixels, mask


def test_widths_skin_and_edges_of_a_figure():
    found = silhouette(*figure())
    assert found["width at the head"] == pytest.approx(20 / 200)
    assert found["width at the hips"] == found["width at the knees"] == pytest.approx(60 / 200)
    assert found["area, of height squared"] == pytest.approx((20 * 40 + 60 * 160) / 200**2)
    assert found["skin, share of the area"] == pytest.approx(800 / 10400)
    assert found["edges, share around"] < 0.03
    assert found["difference from around"] == pytest.approx(255 - found["brightness, 0 to 255"])
    striped = silhouette(*figure(stripes=True))
    assert striped["edges, share of the area within"] > 0.1 > 5 * found["edges, share of the area within"]
    assert striped["width at the hips"] == found["width at the hips"]


def test_what_the_border_cuts_off_does_not_count():
    assert silhouette(*figure(shift=36)) is None
    assert silhouette(figure()[0], np.zeros((256, 256), bool)) is None


def test_intervals_come_from_cameras_and_tell_two_kinds_of_people_apart():
    rng = np.random.default_rng(0)

    def cameras(mean: float) -> list[list[dict[str, float]]]:
        return [[{"width": mean + offset}] * 20 for offset in 0.01 * rng.standard_normal(12)]

    (row,) = comparison(cameras(0.3), cameras(0.4)).rows
    assert row[0] == "width" and row[1].startswith("0.3") and row[3] == "apart"
    (row,) = comparison(cameras(0.3), [*cameras(0.3), []]).rows
    assert row[3] == ""
    with pytest.raises(ValueError, match="in no real image is a person whole"):
        comparison(cameras(0.3), [[], []])
