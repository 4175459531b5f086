"""Occlusion reached for requested levels, and the extra time compared with clips without a requested level."""

import time

import numpy as np
import pytest

from synth.datasets.clip import generate_clip
from synth.datasets.config import GenerateConfig, OcclusionConfig
from synth.errors import FailedSimulation
from synth.scene.config import SceneConfig

pytestmark = pytest.mark.bench

CLIPS = 8


def made(occlusion: OcclusionConfig) -> tuple[list[dict], float]:
    """Manifest lines of the clips that could be made, and the seconds that each took."""
    config = GenerateConfig(scene=SceneConfig(persons=[2, 4], seconds=3.0), occlusion=occlusion)
    lines, start = [], time.perf_counter()
    for clip in range(CLIPS):
        try:
            lines.append(generate_clip(config, clip).provenance["manifest"])
        except FailedSimulation as failure:
            print(f"  clip {clip}: {failure}")
    return lines, (time.perf_counter() - start) / CLIPS


@pytest.mark.parametrize(("views", "by_self"), [(3, True), (2, False)])
def test_requested_levels(views, by_self):
    whom = "by anything" if by_self else "by others or things"
    print(f"\njoints hidden {whom} in at least {views} of 5 cameras, {CLIPS} clips each; then in 0, 1, ... 5 cameras")
    made(OcclusionConfig(views=views, by_self=by_self))
    usual = None
    for target in ([], [0.05, 0.15], [0.2, 0.3], [0.4, 0.5]):
        lines, seconds = made(OcclusionConfig(target=target, views=views, by_self=by_self))
        usual = usual or seconds
        found = [line["occlusion"] for line in lines]
        hidden = np.array([o["hidden_in" if by_self else "hidden_in_by_others"] for o in found])
        shares = hidden[:, views:].sum(1)
        level = f"{target[0]:.2f} to {target[1]:.2f}" if target else "as it comes "
        print(
            f"  {level}: {len(lines)} of {CLIPS} made, {shares.min():.3f} to {shares.max():.3f}, "
            f"mean {shares.mean():.3f}; {' '.join(f'{100 * h:4.1f}' for h in hidden.mean(0))} %; "
            f"{np.mean([line['attempts'] for line in lines]):.1f} attempts, {seconds / usual:.1f} x the time of a clip"
        )
