"""Clips generated from npz and C3D recordings."""

import numpy as np
import pytest

from dmae.data.store import load_clip, read_manifest
from synth.datasets.config import GenerateConfig
from synth.datasets.generate import generate
from synth.motion.config import MotionConfig, ProceduralConfig
from synth.motion.procedural.gait import make_motion
from synth.scene.config import SceneConfig
from synth.scene.sampling import load_motions, sample_scene
from tests.support.smpl_files import write_smpl


@pytest.fixture(params=["npz", "c3d"])
def motion(request, tmp_path) -> MotionConfig:
    """A folder with two takes of a format."""
    folder = tmp_path / "takes"
    folder.mkdir()
    if request.param == "c3d":
        recordings = request.getfixturevalue("data_folder") / "cmu/c3d"
        return MotionConfig("c3d", path=str(recordings))
    for seed in range(2):
        walk = make_motion(ProceduralConfig(standing=0), seconds=3, fps=60, rng=np.random.default_rng(seed))
        write_smpl(folder / f"walk_{seed}.npz", walk)
    return MotionConfig(request.param, path=str(folder))


def test_clips_are_made_and_pass_their_checks(motion, tmp_path):
    config = GenerateConfig(
        out=str(tmp_path / "set"), clips=1, seed=5, scene=SceneConfig(seconds=1.0, persons=[2, 2]), motion=motion
    )
    generate(config)
    (line,) = read_manifest(tmp_path / "set")
    assert line["status"] == "ok"
    assert line["quality"]["foot_slide"] <= 0.01
    clip = load_clip(tmp_path / "set/000000")
    # The lowest joint is near the floor, the highest at the height of a head.
    heights = clip.truth.xyz[..., 2]
    assert 0 < np.nanmin(heights) < 0.12
    assert 1.4 < np.nanmax(heights) < 2.2


def test_a_scene_from_json_has_the_same_motions(motion):
    spec = sample_scene(SceneConfig(seconds=1.0, persons=[3, 3]), motion, seed=1, clip=4).spec
    again = type(spec).from_json(spec.to_json())
    assert again == spec
    for one, other in zip(load_motions(spec), load_motions(again), strict=True):
        assert np.array_equal(one.root, other.root)
        assert one.root[:, 2].min() > 0.5
