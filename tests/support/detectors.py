"""Shared by the tests of the simulated detector: presets, three persons, and detections of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf

from dmae.data.cameras import CameraRig
from dmae.data.clip import Poses3D
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.skeleton import get_skeleton
from dmae.data.typed import decode
from synth.detector.config import DetectorConfig
from synth.detector.parts import PartConfig, PartsConfig
from synth.detector.simulated_detector import Detected, detect

FPS = 25.0
SKELETON = get_skeleton("body25+shelf14")
CLEAN = DetectorConfig()
FOLDER = Path(__file__).parents[2] / "configs" / "detector"
PRESETS = sorted(file.stem for file in FOLDER.glob("*.yaml"))


def preset(name: str) -> DetectorConfig:
    return decode(DetectorConfig, OmegaConf.to_container(OmegaConf.load(FOLDER / f"{name}.yaml")), "detector")


def changed(config: DetectorConfig, options: dict) -> DetectorConfig:
    """Return a detector with other options, as `{"misses.person": 0.1}`."""
    for option, value in options.items():
        error, _, name = option.partition(".")
        config = replace(config, **{error: replace(getattr(config, error), **{name: value})})
    return config


def everywhere(part: PartConfig, options: dict | None = None) -> DetectorConfig:
    """Return a clean detector with all kinds of joints like this one, and with these options."""
    return changed(replace(CLEAN, parts=PartsConfig(*[part] * 14)), options or {})


def three_persons() -> Poses3D:
    """Return three scatters of joints 1.7 m high that drift apart for 400 frames."""
    rng = np.random.default_rng(0)
    body = rng.normal(0, 0.15, (3, 1, 39, 3)).transpose(1, 0, 2, 3)
    body[..., 2] = np.linspace(1.75, 0.05, 39)
    place = np.array([[0.1, 0, 0], [0.9, -0.4, 0], [0.4, 0.9, 0]])[None, :, None]
    drift = np.linspace(0, 0.3, 400)[:, None, None, None]
    return Poses3D(SKELETON, body + place * (1 + drift))


def occlusion_of(truth: Poses3D, rig: CameraRig) -> OcclusionLabels:
    """Return labels in which every joint in the image is visible, except left joints of the first two persons.

    Those of the first person are hidden by itself, those of the second by the third person.
    """
    left = [i for i, joint in enumerate(SKELETON.joints) if ".l_" in joint]
    visibility = np.full((400, len(rig), 3, 39), Visibility.VISIBLE, np.uint8)
    occluder = np.full(visibility.shape, -1, np.int16)
    visibility[:, :, 0, left], occluder[:, :, 0, left] = Visibility.HIDDEN_BY_SELF, 0
    visibility[:, :, 1, left], occluder[:, :, 1, left] = Visibility.HIDDEN_BY_PERSON, 2
    outside = ~rig.inside(rig.project(truth.xyz)[0])
    visibility[outside], occluder[outside] = Visibility.OUTSIDE_IMAGE, -1
    return OcclusionLabels(visibility, occluder)


def run(truth, seen, rig, config, seed=0) -> Detected:
    return detect(truth, seen, rig, FPS, config, rng=np.random.default_rng(seed))


def by_person(found: Detected, persons: int = 3):
    """Return detections in the order of the persons, one of each: (F, V, P, 25, 2) px and (F, V, P, 25) scores."""
    detections, person = found.detections, found.labels.person
    frame, view, place = np.nonzero(person >= 0)
    xy = np.full((*detections.xy.shape[:2], persons, 25, 2), np.nan)
    xy[frame, view, person[frame, view, place]] = detections.xy[frame, view, place]
    score = np.full(xy.shape[:-1], np.nan)
    score[frame, view, person[frame, view, place]] = detections.score[frame, view, place]
    return xy, score
