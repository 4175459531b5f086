"""Pose fusion: what is learned of a second skeleton, from what, and how its joints are handed on."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.baselines import fill_recall, present
from dmae.bodyframe import turn
from dmae.calibrate import CLASSES, Factors
from dmae.clip import Clip, Poses3D, Source
from dmae.complete import Completer, load_completer
from dmae.data import DataConfig
from dmae.examples import AugmentConfig, Recipe, examples, hidden_rows, record
from dmae.fusion import derive, true_pair
from dmae.hiding import HidingConfig, hide_bursts
from dmae.learner import TrainConfig
from dmae.mapping import convert
from dmae.model import DMAE, ModelConfig
from dmae.skeleton import BODY21, BODY25, COCO17, HALPE26, SHELF14, get_skeleton
from dmae.train import train
from dmae.windows import body_front, make_rows, rest_pose

from .strollers import clip_of, strollers

pytestmark = pytest.mark.usefixtures("one_thread")

FPS = 25.0
FUSED = get_skeleton("body21+shelf14")
SMALL = ModelConfig(frames=5, dim=32, depth=1, heads=2, head_dim=16, mlp=64, decoder_dim=32, signal_codes=16)
LEARNING = TrainConfig(
    model=SMALL,
    hiding=HidingConfig(longest=20, scattered=0.0, bursts=1.0),
    augment=AugmentConfig(speed=0.0, scale=0.03),
    skeleton=FUSED.name,
    steps=150,
    lr=3e-3,
    validation=0.0,
)


def annotated(poses: Poses3D, lower: float = 0.06) -> Poses3D:
    """How an annotator of her own mind sees these people: hips lower, the head's top further back."""
    target = convert(poses, SHELF14).xyz.astype(np.float64)
    target[:, :, SHELF14.index("l_hip", "r_hip"), 2] -= lower
    front = body_front(poses.xyz, BODY25)
    target[:, :, SHELF14.index("top_head")[0]] += turn(np.broadcast_to([-0.08, 0, 0], (*front.shape, 3)), front)
    return Poses3D(SHELF14, target)


def pair(poses: Poses3D, lower: float = 0.06) -> Poses3D:
    xyz = np.concatenate([poses.xyz, annotated(poses, lower).xyz], 2)
    return Poses3D(get_skeleton("body25+shelf14"), xyz)


def walk(seed: int, frames: int = 60, persons: int = 3) -> Poses3D:
    return strollers(frames, persons, rng=np.random.default_rng(seed))


def with_holes(poses: Poses3D, seed: int, config: HidingConfig | None = None) -> Poses3D:
    rng = np.random.default_rng(seed)
    hidden = hide_bursts(*poses.source.shape[:2], poses.skeleton, FPS, config or HidingConfig(longest=20), rng=rng)
    return Poses3D(poses.skeleton, np.where(hidden[..., None], np.nan, poses.xyz))


def simulated(seed: int) -> Clip:
    """Truth on both skeletons, and what cameras measured of the first."""
    poses = walk(seed)
    return replace(clip_of(pair(poses), f"sim{seed}"), poses=with_holes(poses, seed))


def recorded(seed: int, name: str, frames: int = 60) -> Clip:
    """Annotated on the second skeleton alone, by another annotator, every other frame."""
    poses = walk(seed, frames)
    truth = annotated(poses, lower=0.12).xyz.copy()
    truth[1::2] = np.nan
    return replace(clip_of(Poses3D(SHELF14, truth), name), poses=with_holes(poses, seed))


def errors(poses: Poses3D, truth: Poses3D) -> float:
    """Mean distance in m of what both have."""
    return float(np.nanmean(np.linalg.norm(poses.xyz.astype(np.float64) - truth.xyz, axis=-1)))


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    return train(LEARNING, [simulated(seed) for seed in range(4)], tmp_path_factory.mktemp("fusion"))


def untrained(factors: Factors | None = None) -> Completer:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = DMAE(SMALL, len(FUSED)).eval()
        torch.nn.init.normal_(model.head.weight, std=0.01)
    model.rest.copy_(torch.from_numpy(rest_pose(true_pair(pair(walk(9)), FUSED).xyz, FUSED)))
    return Completer(model, FUSED, torch.device("cpu"), factors=factors)


def test_truth_of_both_is_known_where_both_are_annotated():
    poses = walk(0)
    both, one = true_pair(pair(poses), FUSED), true_pair(annotated(poses), FUSED)
    np.testing.assert_array_equal(both.xyz[:, :, :21], convert(poses, BODY21).xyz)
    assert np.isnan(one.xyz[:, :, :21]).all()
    for truth in (both, one):
        np.testing.assert_array_equal(truth.xyz[:, :, 21:], annotated(poses).xyz)


def test_what_is_derived_from_other_joints_is_no_truth(tmp_path):
    with pytest.raises(ValueError, match=r"from truth on 'shelf14'.*found truth on 'body25'"):
        train(LEARNING, [clip_of(walk(0), "clip")], tmp_path)


def test_only_the_target_is_learned_and_none_of_it_is_shown():
    recipe = Recipe(SMALL, rest_pose(true_pair(pair(walk(9)), FUSED).xyz, FUSED))
    poses, found = walk(1), []
    for lower in (0.0, 0.5):
        clip = replace(clip_of(pair(poses, lower), "clip"), poses=poses)
        recording = record(clip, FUSED, FPS)
        rows = hidden_rows(recording, recipe, rng=np.random.default_rng(0))
        found.append(examples(rows, rows.starts, SMALL))
    first, second = found
    assert not first.shown.any() and not first.hidden[..., :21].any() and first.hidden[..., 21:].all()
    assert not first.windows.observed[..., 21:].any() and first.windows.observed[..., :21].any()
    assert not torch.equal(first.truth, second.truth)
    for a, b in zip(first.windows, second.windows, strict=True):
        assert torch.equal(a, b)


def test_the_target_starts_where_geometry_puts_it_and_is_as_far_from_sight_as_what_it_is_made_of():
    poses = convert(walk(2), BODY21)
    xyz = poses.xyz.copy()
    xyz[20:30, 0, BODY21.index("l_wrist")[0]] = np.nan
    rest = rest_pose(true_pair(pair(walk(9)), FUSED).xyz, FUSED)
    given = Poses3D(BODY21, xyz)
    rows = make_rows(given, FPS, rest, 5, target=SHELF14)
    wrist = SHELF14.index("l_wrist")[0]
    want = convert(fill_recall(given, FPS), SHELF14)
    np.testing.assert_allclose(rows.base[:, 21:].reshape(3, 60, 14, 3).swapaxes(0, 1), want.xyz, atol=1e-6)
    gap = rows.gap[:, 21:].reshape(3, 60, 14, 2)
    np.testing.assert_array_equal(gap[0, 20:30, wrist], np.stack([np.arange(1, 11), np.arange(10, 0, -1)], -1))
    gap[0, 20:30, wrist] = 0
    assert not gap.any()


def test_joints_that_no_rule_makes_hang_as_they_do_in_the_truth():
    skeleton = get_skeleton("coco17+halpe26")
    poses = walk(3)
    halpe = convert(poses, HALPE26).xyz.copy()
    top = HALPE26.index("head_top")[0]
    halpe[:, :, top] = halpe[:, :, HALPE26.index("nose")[0]] + [0, 0, 0.2]
    truth = np.concatenate([convert(poses, COCO17).xyz, halpe], 2)
    rows = make_rows(convert(poses, COCO17), FPS, rest_pose(truth, skeleton), 5, target=HALPE26)
    found = rows.base[:, 17 + top].reshape(3, 60, 3).swapaxes(0, 1)
    assert np.linalg.norm(found - halpe[:, :, top], axis=-1).max() < 0.2
    assert (rows.gap[:, 17 + top] == 1000).all()


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000))
def test_no_joint_of_the_target_is_measured_and_each_says_what_it_rests_on(seed):
    poses = with_holes(walk(seed), seed, HidingConfig(bursts=4.0, longest=60, absence=40))
    done = untrained(((1.0,) * CLASSES,) * 2)(poses, FPS)
    assert done.skeleton == SHELF14 and done.xyz.shape == (60, 3, 14, 3)
    there = np.broadcast_to(present(poses, FPS)[..., None], done.source.shape)
    rests_on = derive(poses, SHELF14)
    np.testing.assert_array_equal(done.source == Source.DENOISED, there & rests_on.measured)
    np.testing.assert_array_equal(done.source == Source.COMPLETED, there & ~rests_on.measured)
    np.testing.assert_array_equal(done.source == Source.ABSENT, ~there)
    np.testing.assert_array_equal(done.views, rests_on.views)
    # The middle of a long absence no window reaches.
    assert np.isfinite(done.cov[done.measured]).all()


def test_what_was_completed_before_is_no_evidence():
    poses = with_holes(walk(4), 4)
    filled = fill_recall(poses, FPS)
    first, second = (untrained()(given, FPS) for given in (poses, filled))
    for name in ("xyz", "source", "views"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.mark.parametrize("shape", [(0, 2), (5, 0), (5, 2)])
def test_nobody_is_nobody_on_the_target_too(shape):
    done = untrained()(Poses3D(BODY25, np.full((*shape, 25, 3), np.nan)), FPS)
    assert done.skeleton == SHELF14 and done.source.shape == (*shape, 14) and not done.source.any()


def test_poses_that_lack_joints_of_the_source_are_refused():
    with pytest.raises(ValueError, match=r"turn 'body21' into 'shelf14', the poses are 'coco17'; convert"):
        untrained()(convert(walk(0), COCO17), FPS)


@pytest.mark.parametrize("fps", [FPS, 60.0])
def test_it_learns_where_annotators_put_joints(trained, fps):
    poses = strollers(int(60 * fps / FPS), 3, rng=np.random.default_rng(50), fps=fps)
    given, truth = with_holes(poses, 50), annotated(poses)
    by_hand = convert(fill_recall(given, fps), SHELF14)
    assert errors(load_completer(trained)(given, fps), truth) < 0.7 * errors(by_hand, truth)


def test_the_paper_s_network_fuses_too(tmp_path):
    network = replace(SMALL, residual=False, turn_to_front=False)
    folder = train(replace(LEARNING, model=network, steps=2), [simulated(0)], tmp_path)
    done = load_completer(folder)(walk(1), FPS)
    assert done.skeleton == SHELF14 and (done.source == Source.DENOISED).all()


def test_few_annotated_frames_teach_another_annotator_s_mind_without_forgetting_the_first_s(trained, tmp_path):
    config = replace(LEARNING, init=str(trained), skeleton=None, steps=60, lr=1e-3, replay=0.25, also=["sim"])
    tuned = train(config, [recorded(20, "real")], tmp_path, also=[simulated(seed) for seed in range(4)])
    poses = walk(60)
    theirs, ours = annotated(poses, lower=0.12), annotated(poses)
    before, after = (load_completer(folder)(poses, FPS) for folder in (trained, tuned))
    hips = SHELF14.index("l_hip", "r_hip")

    def height(done: Poses3D) -> float:
        return float((done.xyz - ours.xyz)[:, :, hips, 2].mean())

    assert height(after) < height(before) - 0.01
    assert errors(after, theirs) < 0.85 * errors(before, theirs)
    begun, made = (json.loads((folder / "model.json").read_text()) for folder in (trained, tuned))
    assert made["init"] == {"path": str(trained), "sha256": begun["sha256"]} and begun["init"] is None
    assert made["skeleton"] == FUSED.name and made["clips"] == 5


def test_annotations_of_the_target_alone_need_a_model_to_begin_with(tmp_path):
    with pytest.raises(ValueError, match=r"'shelf14' alone does not teach what 'body21' looks like; begin with"):
        train(LEARNING, [recorded(20, "real")], tmp_path)


def test_what_does_not_fit_the_model_to_begin_with_is_named(trained, tmp_path):
    clips = [simulated(0)]
    with pytest.raises(ValueError, match=r"model of skeleton 'body21\+shelf14', and skeleton=body25"):
        train(replace(LEARNING, init=str(trained), skeleton="body25"), clips, tmp_path)
    with pytest.raises(ValueError, match=r"another build; to begin with it, give model\.dim=32"):
        train(replace(LEARNING, init=str(trained), model=replace(SMALL, dim=64)), clips, tmp_path)
    with pytest.raises(FileNotFoundError, match="dmae train"):
        train(replace(LEARNING, init=str(tmp_path)), clips, tmp_path)
    with pytest.raises(ValueError, match=r"shown_weight=0\.3"):
        train(replace(LEARNING, shown_weight=0.3), clips, tmp_path)
    with pytest.raises(ValueError, match="leave out denoise"):
        load_completer(trained, denoise=True)
    for wrong in ({"replay": 0.5}, {"replay": 1.0, "also": ["sim"]}):
        with pytest.raises(ValueError, match=r"replay=.*also"):
            replace(LEARNING, **wrong)


def test_the_same_from_another_model_is_another_training(trained, tmp_path):
    short = replace(LEARNING, steps=2, init=str(trained))
    train(short, [simulated(0)], tmp_path / "model")
    other = train(replace(LEARNING, steps=2), [simulated(0)], tmp_path / "other")
    with pytest.raises(ValueError, match=r"training\.json differs in init"):
        train(replace(short, init=str(other)), [simulated(0)], tmp_path / "model")


def test_shelf_is_learned_from_as_all_its_cameras_and_fewer_capture_it(data_folder, trained, tmp_path):
    from dmae.commands import run_train

    config = replace(
        LEARNING,
        data=DataConfig(name="shelf", path=str(data_folder / "shelf"), frames=[0, 20]),
        init=str(trained),
        skeleton=None,
        views=[5, 4],
        steps=2,
    )
    run_train(config, tmp_path)
    made = json.loads((tmp_path / "model.json").read_text())
    assert made["clips"] == 6 and made["frames"] == [0, 20] and made["validation_clips"] == []
    names = json.loads((tmp_path / "training.json").read_text())["clips"]
    assert "shelf by [0, 1, 2, 3, 4]" in names and len(set(names.values())) == 6
