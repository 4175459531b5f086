"""Which of two skeletons of 25 joints: decided by whole people, with the margin, or not at all."""

import numpy as np
import pytest

from dmae.data.skeleton import BODY25, BODY25B
from dmae.formats.reading import Clips, DataConfig
from dmae.formats.skeletons import OF_25_JOINTS, guess_skeleton
from tests.support.recordings import recording


def people(skeleton, frames: int = 3) -> np.ndarray:
    found = recording(skeleton, frames).detections
    rows = np.concatenate([found.xy, found.score[..., None]], -1).reshape(-1, len(skeleton), 3)
    return rows[np.isfinite(rows).any((1, 2))]


def real_people(data_folder, name: str) -> tuple[np.ndarray, list[int]]:
    """(D, 25, 3) of all cameras, and the frame of each."""
    path = data_folder / "shelf" if name == "shelf" else next((data_folder / "pose2sim").glob("*/*Balancing*"))
    found = Clips(DataConfig(name, str(path)))[0].detections
    rows = np.concatenate([found.xy, found.score[..., None]], -1)
    seen = found.observed.any(-1)
    return rows[seen], np.nonzero(seen)[0]


@pytest.mark.parametrize("skeleton", OF_25_JOINTS, ids=lambda s: s.name)
def test_few_people_are_enough_and_the_margin_is_stated(skeleton):
    guessed, notes = guess_skeleton("x", people(skeleton))
    assert guessed == skeleton
    if skeleton == BODY25B:
        (note,) = notes
        assert "assumed to be body25b, not body25: its bones are " in note and "data.skeleton overrides" in note
        assert float(note.split("its bones are ")[1].split()[0]) > 1.5


@pytest.mark.parametrize(("name", "skeleton"), [("pose2sim", BODY25B), ("shelf", BODY25)])
def test_any_ten_frames_of_a_real_recording_are_enough(data_folder, name, skeleton):
    rows, frame = real_people(data_folder, name)
    for first in range(0, max(frame) - 9, 10):
        window = rows[(frame >= first) & (frame < first + 10)]
        assert guess_skeleton("x", window)[0] == skeleton


def test_without_necks_it_is_decided_all_the_same():
    """The neck alone decided before: where it is hidden, files of BODY_25B were silently read as BODY_25."""
    without = people(BODY25B)
    without[:, BODY25B.index("neck")] = np.nan
    assert guess_skeleton("x", without)[0] == BODY25B


def test_what_does_not_decide_is_refused():
    faces = people(BODY25)
    faces[:, [i for i, joint in enumerate(BODY25.joints) if "eye" not in joint and "nose" not in joint]] = np.nan
    with pytest.raises(ValueError, match=r"0 show enough joints.*data\.skeleton=body25 or data\.skeleton=body25b"):
        guess_skeleton("x", faces)
    with pytest.raises(ValueError, match="1 show enough joints"):
        guess_skeleton("x", people(BODY25B)[:1])
    both = np.concatenate([people(BODY25), people(BODY25B)])
    with pytest.raises(ValueError, match=r"fit body25 and .* fit body25b"):
        guess_skeleton("x", both)
    assert guess_skeleton("x", np.empty((0, 25, 3))) == (BODY25, ())
