"""The weights that come with the package complete people whom they never saw, whom the generator makes move."""

import numpy as np
import pytest

from dmae.baselines import fill_pchip_body
from dmae.clip import Poses3D
from dmae.complete import load_completer
from dmae.hiding import HidingConfig
from dmae.mapping import convert
from dmae.metrics import GAPS, gap_lengths
from dmae.punch import disturb, punch
from dmae.skeleton import BODY25
from dmae.weights import find_shipped
from synth.interactions import InteractionConfig
from synth.landmarks import SKELETON
from synth.motion.source import MotionConfig, MotionKind
from synth.sample import sample_spec
from synth.simulate import simulate
from synth.spec import SceneConfig
from tests.synth.people import RIG

UNSEEN = ("bvh_cc/005_14", "bvh_cc/005_16", "bvh_daz/salsa_25")
"""Takes of which `make weights` scores, and does not learn."""


@pytest.fixture(scope="module")
def dancers(data_folder, tmp_path_factory) -> list[Poses3D]:
    takes = tmp_path_factory.mktemp("takes")
    for name in UNSEEN:
        take = data_folder / "cmu" / f"{name}.bvh"
        (takes / take.name).symlink_to(take.resolve())
    found = []
    for clip in range(3):
        scene = SceneConfig(seconds=5.0, persons=[4, 4], props=[0, 0])
        motion = MotionConfig(kind=MotionKind.bvh, path=str(takes))
        spec = sample_spec(scene, motion, interaction=InteractionConfig(), seed=7, clip=clip)
        joints = simulate(spec, RIG, painted=False).joints
        found.append(convert(Poses3D(SKELETON, joints), BODY25))
    return found


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("noisy", [False, True])
def test_dancers_are_completed_better_than_by_cubics(dancers, noisy):
    complete = load_completer(find_shipped(BODY25))
    errors = {"cubics": [], "dmae": []}
    lengths = []
    for seed, truth in enumerate(dancers * 3):
        given = punch(truth, 25.0, HidingConfig(), rng=np.random.default_rng(seed))
        given = disturb(given, 25.0, rng=np.random.default_rng(seed)) if noisy else given
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


@pytest.mark.usefixtures("one_thread")
def test_what_was_measured_comes_nearer_the_truth_where_it_is_off_and_stays_where_it_is_exact(dancers):
    complete = load_completer(find_shipped(BODY25), denoise=True)
    before, after, moved = [], [], []
    for seed, truth in enumerate(dancers):
        holes = punch(truth, 25.0, HidingConfig(), rng=np.random.default_rng(seed))
        given = disturb(holes, 25.0, rng=np.random.default_rng(seed))
        done = complete(given, 25.0)
        before.append(np.linalg.norm(given.xyz - truth.xyz, axis=-1)[given.measured])
        after.append(np.linalg.norm(done.xyz - truth.xyz, axis=-1)[given.measured])
        moved.append(np.linalg.norm(complete(holes, 25.0).xyz - truth.xyz, axis=-1)[holes.measured])
    assert np.concatenate(after).mean() < 0.92 * np.concatenate(before).mean()
    assert np.concatenate(moved).mean() < 0.001
