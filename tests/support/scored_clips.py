"""Clips to score methods on."""

import numpy as np

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25, SHELF14, get_skeleton
from dmae.evaluation.config import EvaluateConfig
from dmae.formats.reading import DataConfig
from tests.support.circling_people import circling_people
from tests.support.clips import looking_at_origin, walkers


def seen(persons: int = 2, frames: int = 20, name: str = "seen") -> Clip:
    """Return walkers seen without error by four cameras, except that one wrist is hidden for some time.

    The truth is on two skeletons.
    """
    poses, rig = walkers(frames, persons), looking_at_origin()
    xy, _ = rig.project(poses.xyz)
    score_ = np.full(xy.shape[:-1], 0.9)
    wrist = BODY25.index("l_wrist")[0]
    xy[8:12, :, 0, wrist], score_[8:12, :, 0, wrist] = np.nan, np.nan
    fused = np.concatenate([poses.xyz, walkers(frames, persons, SHELF14).xyz], 2)
    truth = Poses3D(get_skeleton("body25+shelf14"), fused)
    return Clip(name, 25.0, rig, Detections2D(BODY25, xy, score_), truth=truth)


def circling(name: str = "circling", seed: int = 0, frames: int = 250, fps: float = 25.0) -> Clip:
    """Return a clip of four people who stroll, without detections."""
    truth = circling_people(frames, 4, rng=np.random.default_rng(seed), fps=fps)
    nothing = np.full((frames, 3, 0, 25, 2), np.nan)
    return Clip(name, fps, looking_at_origin(3), Detections2D(BODY25, nothing, nothing[..., 0]), truth=truth)


def config(path, **changes) -> EvaluateConfig:
    return EvaluateConfig(data=DataConfig(path=str(path)), **changes)


def by_method(scores: dict) -> dict[tuple[str, int], dict]:
    return {(result["method"], result["views"]): result for result in scores["results"]}
