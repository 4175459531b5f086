"""What the tests of the simulated detector share: three persons in the Shelf rig, and detections of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf

from dmae.cameras import CameraRig
from dmae.clip import Poses3D, Visibility
from dmae.skeleton import get_skeleton
from synth.detect import Detected, detect
from synth.mistakes import DetectorConfig, PartConfig, PartsConfig

FPS = 25.0
SKELETON = get_skeleton("body25+shelf14")
CLEAN = DetectorConfig()
FOLDER = Path(__file__).parents[2] / "configs" / "detector"
PRESETS = sorted(file.stem for file in FOLDER.glob("*.yaml"))


def preset(name: str) -> DetectorConfig:
    fields = OmegaConf.to_container(OmegaConf.load(FOLDER / f"{name}.yaml"))
    parts = {kind: PartConfig(**part) for kind, part in fields.pop("parts", {}).items()}
    return DetectorConfig(**fields, parts=PartsConfig(**parts))


def everywhere(part: PartConfig, **fields) -> DetectorConfig:
    """The clean detector, but for all joints like this and for the fields."""
    return replace(CLEAN, parts=PartsConfig(*[part] * 14), **fields)


def three_persons() -> Poses3D:
    """Each a scatter of joints 1.7 m high; they drift apart for 400 frames."""
    rng = np.random.default_rng(0)
    body = rng.normal(0, 0.15, (3, 1, 39, 3)).transpose(1, 0, 2, 3)
    body[..., 2] = np.linspace(1.75, 0.05, 39)
    place = np.array([[0.1, 0, 0], [0.9, -0.4, 0], [0.4, 0.9, 0]])[None, :, None]
    drift = np.linspace(0, 0.3, 400)[:, None, None, None]
    return Poses3D(SKELETON, body + place * (1 + drift))


def what_is_seen(truth: Poses3D, rig: CameraRig) -> tuple[np.ndarray, np.ndarray]:
    """Visibility and what hides: all is visible that is in the image, save for left joints of the first two persons.

    The first person's are hidden by itself, the second's by the third person.
    """
    left = [i for i, joint in enumerate(SKELETON.joints) if ".l_" in joint]
    visibility = np.full((400, len(rig), 3, 39), Visibility.VISIBLE, np.uint8)
    hidden_by = np.full(visibility.shape, -1, np.int16)
    visibility[:, :, 0, left], hidden_by[:, :, 0, left] = Visibility.HIDDEN_BY_SELF, 0
    visibility[:, :, 1, left], hidden_by[:, :, 1, left] = Visibility.HIDDEN_BY_PERSON, 2
    outside = ~rig.inside(rig.project(truth.xyz)[0])
    visibility[outside], hidden_by[outside] = Visibility.OUTSIDE_IMAGE, -1
    return visibility, hidden_by


def run(truth, seen, rig, config, seed=0) -> Detected:
    return detect(truth, *seen, rig, FPS, config, rng=np.random.default_rng(seed))


def by_person(found: Detected, persons: int = 3):
    """Detections put back in the order of the persons, one of each: (F, V, P, 25, 2) and (F, V, P, 25)."""
    detections, person = found.detections, found.detected_person
    frame, view, place = np.nonzero(person >= 0)
    xy = np.full((*detections.xy.shape[:2], persons, 25, 2), np.nan)
    xy[frame, view, person[frame, view, place]] = detections.xy[frame, view, place]
    score = np.full(xy.shape[:-1], np.nan)
    score[frame, view, person[frame, view, place]] = detections.score[frame, view, place]
    return xy, score
