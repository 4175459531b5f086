"""A cell of the stress matrix: corrupt a clip, capture it, complete it with each contender, and score the results."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from dmae.completion.blending import noisiness, smooth_by_noise
from dmae.completion.methods.registry import completion_method, find_method
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.evaluation.corruption.corrupt import corrupt
from dmae.evaluation.corruption.people import people_of
from dmae.evaluation.reference import measured_by_all, scored_actors, truth_of
from dmae.evaluation.scores import score
from dmae.evaluation.stress.contenders import Contender
from dmae.evaluation.stress.plan import Cell
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

SMOOTHING = 0.1
"""s; smoothing after every method, except methods that smooth by themselves, as in `dmae evaluate`."""
KEPT = ("pcp", "pck", "mpjpe", "shares", "hidden", "idf1", "blocks")
"""Names of the scores that are stored."""


@dataclass(frozen=True)
class Subject:
    """A clip that is to be corrupted.

    Attributes:
        clip: The clip. Its truth is the reference of the results, on the skeleton of the comparison.
        people: The people of the clip, see `dmae.evaluation.corruption.people`.
        actors: Persons of the truth over which PCP is averaged; None for all.
    """

    clip: Clip
    people: Poses3D
    actors: tuple[int, ...] | None


def subject_of(clip: Clip, config: CaptureConfig) -> Subject:
    """Return a clip prepared to be corrupted and scored.

    The reference is its truth; of a fused skeleton, the second part. Without truth, the reference is the captured
    joints that three views or more measured, with all cameras.

    Raises:
        ValueError: the clip has neither truth nor joints that three views measured.
    """
    people = people_of(clip, config)
    clip = replace(clip, images=None, poses=None, occlusion=None, detection_labels=None)
    if clip.truth is not None:
        truth = truth_of(clip)
        return Subject(replace(clip, truth=convert(truth, truth.skeleton.parts[-1])), people, scored_actors(clip))
    reference = measured_by_all(clip, config)
    if np.isnan(reference.xyz).all():
        raise ValueError(
            f"clip {clip.id!r} has no truth, and its {len(clip.rig)} cameras measure no joint in three views or more, "
            "which results would be compared with; expected truth, or more cameras"
        )
    return Subject(replace(clip, truth=reference), people, None)


def run_cell(subject: Subject, cell: Cell, contenders: Sequence[Contender]) -> dict[str, dict]:
    """Return the scores of contenders in a cell, by name. Contenders with the same capture share its result.

    Raises:
        ValueError: a method returned poses of another shape.
    """
    clip = corrupt(subject.clip, dict(cell.levels), seed=cell.seed, people=subject.people)
    captured: dict[CaptureConfig, Poses3D] = {}
    scores = {}
    for contender in contenders:
        if contender.capture not in captured:
            captured[contender.capture] = capture(clip, contender.capture)
        given = captured[contender.capture]
        with _one_thread():
            filled = contender.fill(given, clip.fps)
        if filled.xyz.shape[:2] != given.xyz.shape[:2]:
            raise ValueError(
                f"method {contender.name}: expected poses of {given.xyz.shape[1]} persons in {len(given.xyz)} frames "
                f"back, found {filled.xyz.shape[1]} in {len(filled.xyz)}"
            )
        if not (contender.method in completion_method and find_method(contender.method).smooths):
            filled = smooth_by_noise(filled, noisiness(given), clip.fps, SMOOTHING)
        filled = convert(filled, clip.truth.skeleton)
        found = score(filled, given, clip.truth, subject.actors, fps=clip.fps)
        scores[contender.name] = {name: found[name] for name in KEPT}
    return scores


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit torch, if it is loaded, to one thread, so that sums do not depend on the number of workers."""
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
