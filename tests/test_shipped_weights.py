"""The shipped weights complete simulated people with motion that they were not trained on."""

import numpy as np
import pytest

from dmae.completion.complete import load_completer
from dmae.completion.fillings import fill_pchip_body
from dmae.completion.weights import find_shipped
from dmae.data.clip import Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25
from dmae.evaluation.synthetic_gaps import cut_gaps, perturb
from dmae.metrics.position import GAPS
from dmae.numerics.paths import gap_lengths
from synth.interactions.registry import InteractionConfig
from synth.motion.config import MotionConfig
from synth.people.body import SKELETON
from synth.physics.simulation import simulate
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_scene
from tests.support.scenes import RIG

SCORED_TAKES = ("bvh_cc/005_14", "bvh_cc/005_16")
"""Takes of a subject that `make weights` does not train on."""


@pytest.fixture(scope="module")
def dancers(data_folder, tmp_path_factory) -> list[Poses3D]:
    takes = tmp_path_factory.mktemp("takes")
    for name in SCORED_TAKES:
        take = data_folder / "cmu" / f"{name}.bvh"
        (takes / take.name).symlink_to(take.resolve())
    found = []
    for clip in range(3):
        scene = SceneConfig(seconds=5.0, persons=[4, 4], props=[0, 0])
        motion = MotionConfig(kind="bvh", path=str(takes))
        spec = sample_scene(scene, motion, interaction=InteractionConfig(), seed=7, clip=clip).spec
        joints = simulate(spec, RIG, painted=False).joints
        found.append(convert(Poses3D(SKELETON, joints), BODY25))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("noisy", [False, True])
def test_dancers_are_completed_better_than_by_pchip_body(dancers, noisy):
    complete = load_completer(find_shipped(BODY25))
    errors = {"cubics": [], "dmae": []}
    lengths = []
    for seed, truth in enumerate(dancers * 3):
        given = cut_gaps(truth, 25.0, rng=np.random.default_rng(seed))
        given = perturb(given, 25.0, rng=np.random.default_rng(seed)) if noisy else given
        filled = {"cubics": fill_pchip_body(given, 25.0), "dmae": complete(given, 25.0)}
        off = {name: np.linalg.norm(poses.xyz - truth.xyz, axis=-1) for name, poses in filled.items()}
        hidden = ~given.measured & np.isfinite(off["cubics"]) & np.isfinite(off["dmae"])
        lengths.append(gap_lengths(given.measured)[hidden])
        for name, errs in off.items():
            errors[name].append(errs[hidden])
    length, cubics, dmae = (np.concatenate(parts) for parts in (lengths, errors["cubics"], errors["dmae"]))
    shares = [
        dmae[inside].mean() / cubics[inside].mean()
        for low, high in GAPS
        for inside in [(length >= low) & (length <= (high or np.inf))]
    ]
    assert max(shares) < 1
    assert shares[2] < 0.85


@pytest.mark.slow
def test_denoising_improves_perturbed_joints_and_keeps_exact_ones(dancers):
    complete = load_completer(find_shipped(BODY25), denoise=True)
    before, after, moved = [], [], []
    for seed, truth in enumerate(dancers):
        holes = cut_gaps(truth, 25.0, rng=np.random.default_rng(seed))
        given = perturb(holes, 25.0, rng=np.random.default_rng(seed))
        done = complete(given, 25.0)
        before.append(np.linalg.norm(given.xyz - truth.xyz, axis=-1)[given.measured])
        after.append(np.linalg.norm(done.xyz - truth.xyz, axis=-1)[given.measured])
        moved.append(np.linalg.norm(complete(holes, 25.0).xyz - truth.xyz, axis=-1)[holes.measured])
    assert np.concatenate(after).mean() < 0.92 * np.concatenate(before).mean()
    assert np.concatenate(moved).mean() < 0.001
