"""Time of simulated detections, compared with all other steps that make a clip's labels."""

import time
from dataclasses import replace

import numpy as np
import pytest

from synth.datasets.clip import generate_clip
from synth.datasets.config import GenerateConfig
from synth.detector.simulated_detector import detect
from synth.scene.config import SceneConfig
from tests.support.detectors import PRESETS, preset
from tests.support.timing import seconds

pytestmark = pytest.mark.bench


def test_detections_of_four_people_in_five_views():
    """At most a quarter of the time of all labels, detections among them."""
    config = GenerateConfig(scene=SceneConfig(persons=[4, 4], seconds=6.0), detector=preset("shelf_openpose"))
    generate_clip(replace(config, scene=SceneConfig(persons=[1, 1], seconds=0.2)), 0)
    start = time.perf_counter()
    clip = generate_clip(config, 0)
    whole = time.perf_counter() - start
    print(f"\n4 people, 5 views, {len(clip)} frames: labels in {whole:.2f} s")
    for name in PRESETS:
        detector = preset(name)
        of_detections = seconds(
            lambda detector=detector: detect(
                clip.truth, clip.occlusion, clip.rig, clip.fps, detector, rng=np.random.default_rng(0)
            )
        )
        print(f"  {name}: {of_detections:.2f} s, {of_detections / whole:.0%} of that")
        assert of_detections < whole / 4
