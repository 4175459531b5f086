"""Pose fusion: joints of a second skeleton, learned from those of the first, and their sources."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.completion.complete import CLASSES, Completer, Factors, load_completer
from dmae.completion.config import (
    AugmentConfig,
    MaskingConfig,
    TrainConfig,
)
from dmae.completion.fusion import derive, true_pair
from dmae.completion.gaussian_process import fill_gaussian_process
from dmae.completion.network import DMAE
from dmae.completion.training import train
from dmae.completion.training_data import Recipe, cut_examples, mask_bursts, masked_rows, pose_pair
from dmae.completion.windows import make_rows, rest_pose
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY21, BODY25, COCO17, HALPE26, SHELF14, get_skeleton
from dmae.formats.reading import DataConfig
from dmae.numerics.body import body_heading, rotate_z
from dmae.numerics.filling import present
from tests.support.circling_people import circling_people, clip_of
from tests.support.training import SMALL_NETWORK, changed

FPS = 25.0
FUSED = get_skeleton("body21+shelf14")
LEARNING = changed(
    TrainConfig(),
    model=SMALL_NETWORK,
    masking=MaskingConfig(longest=20, scattered=0.0, bursts=1.0),
    augment=AugmentConfig(speed=0.0, scale=0.03),
    skeleton=FUSED.name,
    steps=80,
    lr=3e-3,
    held_back=0.0,
)


def annotated(poses: Poses3D, lower: float = 0.06) -> Poses3D:
    """Return the people as an annotator with other habits sees them: hips lower, the head's top further back."""
    target = convert(poses, SHELF14).xyz.astype(np.float64)
    target[:, :, SHELF14.index("l_hip", "r_hip"), 2] -= lower
    heading = body_heading(poses.xyz, BODY25)
    target[:, :, SHELF14.index("top_head")[0]] += rotate_z(np.broadcast_to([-0.08, 0, 0], (*heading.shape, 3)), heading)
    return Poses3D(SHELF14, target)


def pair(poses: Poses3D, lower: float = 0.06) -> Poses3D:
    xyz = np.concatenate([poses.xyz, annotated(poses, lower).xyz], 2)
    return Poses3D(get_skeleton("body25+shelf14"), xyz)


def walk(seed: int, frames: int = 60, persons: int = 3) -> Poses3D:
    return circling_people(frames, persons, rng=np.random.default_rng(seed))


def with_holes(poses: Poses3D, seed: int, config: MaskingConfig | None = None) -> Poses3D:
    rng = np.random.default_rng(seed)
    hidden = mask_bursts(*poses.source.shape[:2], poses.skeleton, FPS, config or MaskingConfig(longest=20), rng=rng)
    return Poses3D(poses.skeleton, np.where(hidden[..., None], np.nan, poses.xyz))


def simulated(seed: int) -> Clip:
    """Return a clip with truth on both skeletons, and captured poses on the first."""
    poses = walk(seed)
    return replace(clip_of(pair(poses), f"sim{seed}"), poses=with_holes(poses, seed))


def recorded(seed: int, name: str, frames: int = 60) -> Clip:
    """Return a clip annotated on the second skeleton alone, by another annotator, in every other frame."""
    poses = walk(seed, frames)
    truth = annotated(poses, lower=0.12).xyz.copy()
    truth[1::2] = np.nan
    return replace(clip_of(Poses3D(SHELF14, truth), name), poses=with_holes(poses, seed))


def errors(poses: Poses3D, truth: Poses3D) -> float:
    """Return the mean distance in m of joints that both have."""
    return float(np.nanmean(np.linalg.norm(poses.xyz.astype(np.float64) - truth.xyz, axis=-1)))


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    return train(LEARNING, [simulated(seed) for seed in range(4)], tmp_path_factory.mktemp("fusion"))


def untrained(factors: Factors | None = None) -> Completer:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = DMAE(SMALL_NETWORK, len(FUSED)).eval()
        torch.nn.init.normal_(model.head.weight, std=0.01)
    model.rest.copy_(torch.from_numpy(rest_pose(true_pair(pair(walk(9)), FUSED).xyz, FUSED)))
    return Completer(model, FUSED, factors=factors)


def test_true_pair_has_both_skeletons_where_both_are_annotated():
    poses = walk(0)
    both, one = true_pair(pair(poses), FUSED), true_pair(annotated(poses), FUSED)
    np.testing.assert_array_equal(both.xyz[:, :, :21], convert(poses, BODY21).xyz)
    assert np.isnan(one.xyz[:, :, :21]).all()
    for truth in (both, one):
        np.testing.assert_array_equal(truth.xyz[:, :, 21:], annotated(poses).xyz)


def test_joints_derived_from_others_are_not_accepted_as_truth(tmp_path):
    with pytest.raises(ValueError, match=r"from truth on 'shelf14'.*found truth on 'body25'"):
        train(LEARNING, [clip_of(walk(0), "clip")], tmp_path)


def test_only_the_target_is_learned_and_none_of_it_is_observed():
    recipe = Recipe(SMALL_NETWORK, rest_pose(true_pair(pair(walk(9)), FUSED).xyz, FUSED))
    poses, found = walk(1), []
    for lower in (0.0, 0.5):
        clip = replace(clip_of(pair(poses, lower), "clip"), poses=poses)
        recording = pose_pair(clip, FUSED, FPS)
        rows = masked_rows(recording, recipe, rng=np.random.default_rng(0))
        found.append(cut_examples(rows, rows.starts, SMALL_NETWORK))
    first, second = found
    assert not first.observed.any() and not first.hidden[..., :21].any() and first.hidden[..., 21:].all()
    assert not first.windows.observed[..., 21:].any() and first.windows.observed[..., :21].any()
    assert not torch.equal(first.truth, second.truth)
    for a, b in zip(first.windows, second.windows, strict=True):
        assert torch.equal(a, b)


def test_the_target_starts_where_it_is_derived_with_the_gaps_of_its_source():
    poses = convert(walk(2), BODY21)
    xyz = poses.xyz.copy()
    xyz[20:30, 0, BODY21.index("l_wrist")[0]] = np.nan
    rest = rest_pose(true_pair(pair(walk(9)), FUSED).xyz, FUSED)
    given = Poses3D(BODY21, xyz)
    rows = make_rows(given, FPS, rest, 5, target=SHELF14)
    wrist = SHELF14.index("l_wrist")[0]
    want = convert(fill_gaussian_process(given, FPS), SHELF14)
    np.testing.assert_allclose(rows.base[:, 21:].reshape(3, 60, 14, 3).swapaxes(0, 1), want.xyz, atol=1e-6)
    gap = rows.gap[:, 21:].reshape(3, 60, 14, 2)
    np.testing.assert_array_equal(gap[0, 20:30, wrist], np.stack([np.arange(1, 11), np.arange(10, 0, -1)], -1))
    gap[0, 20:30, wrist] = 0
    assert not gap.any()


def test_joints_that_no_rule_derives_are_placed_by_the_rest_pose():
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
def test_joints_of_the_target_are_denoised_or_completed_never_measured(seed):
    poses = with_holes(walk(seed), seed, MaskingConfig(bursts=4.0, longest=60, absence=40))
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


def test_completed_joints_are_no_evidence():
    poses = with_holes(walk(4), 4)
    filled = fill_gaussian_process(poses, FPS)
    first, second = (untrained()(given, FPS) for given in (poses, filled))
    for name in ("xyz", "source", "views"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.mark.parametrize("shape", [(0, 2), (5, 0), (5, 2)])
def test_poses_without_people_stay_so_on_the_target(shape):
    done = untrained()(Poses3D(BODY25, np.full((*shape, 25, 3), np.nan)), FPS)
    assert done.skeleton == SHELF14 and done.source.shape == (*shape, 14) and not done.source.any()


def test_poses_that_lack_joints_of_the_source_are_refused():
    with pytest.raises(ValueError, match=r"turn 'body21' into 'shelf14', the poses are 'coco17'; convert"):
        untrained()(convert(walk(0), COCO17), FPS)


@pytest.mark.slow
@pytest.mark.parametrize("fps", [FPS, 60.0])
def test_fusion_learns_where_annotators_put_joints(trained, fps):
    poses = circling_people(int(60 * fps / FPS), 3, rng=np.random.default_rng(50), fps=fps)
    given, truth = with_holes(poses, 50), annotated(poses)
    by_hand = convert(fill_gaussian_process(given, fps), SHELF14)
    assert errors(load_completer(trained)(given, fps), truth) < 0.7 * errors(by_hand, truth)


def test_the_paper_s_network_fuses_too(tmp_path):
    network = replace(SMALL_NETWORK, residual=False, align_heading=False)
    folder = train(changed(LEARNING, model=network, steps=2), [simulated(0)], tmp_path)
    done = load_completer(folder)(walk(1), FPS)
    assert done.skeleton == SHELF14 and (done.source == Source.DENOISED).all()


@pytest.mark.slow
def test_a_few_frames_of_another_annotator_adapt_the_model_to_both(trained, tmp_path):
    config = changed(LEARNING, init=str(trained), skeleton=None, steps=40, lr=1e-3, replay=0.25, extra_data=["sim"])
    tuned = train(config, [recorded(20, "real")], tmp_path, extra_clips=[simulated(seed) for seed in range(4)])
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


def test_annotations_of_the_target_alone_need_an_initial_model(tmp_path):
    with pytest.raises(ValueError, match=r"'shelf14' alone does not teach what 'body21' looks like; start from"):
        train(LEARNING, [recorded(20, "real")], tmp_path)


@pytest.mark.slow
def test_options_that_do_not_fit_the_initial_model_are_named(trained, tmp_path):
    clips = [simulated(0)]
    with pytest.raises(ValueError, match=r"model of skeleton 'body21\+shelf14', and skeleton=body25"):
        train(changed(LEARNING, init=str(trained), skeleton="body25"), clips, tmp_path)
    with pytest.raises(ValueError, match=r"of other sizes; to start from it, give model\.encoder\.dim=32"):
        train(
            changed(
                LEARNING,
                init=str(trained),
                model=replace(SMALL_NETWORK, encoder=replace(SMALL_NETWORK.encoder, dim=64)),
            ),
            clips,
            tmp_path,
        )
    with pytest.raises(FileNotFoundError, match="dmae train"):
        train(changed(LEARNING, init=str(tmp_path)), clips, tmp_path)
    with pytest.raises(ValueError, match=r"observed_weight=0\.3"):
        train(changed(LEARNING, observed_weight=0.3), clips, tmp_path)
    with pytest.raises(ValueError, match="leave out denoise"):
        load_completer(trained, denoise=True)
    for wrong, message in (
        ({"replay": 0.5}, r"replay=0\.5: expected extra_data"),
        ({"replay": 1.0, "extra_data": ["sim"]}, r"replay=1\.0: expected a share"),
    ):
        with pytest.raises(ValueError, match=message):
            changed(LEARNING, **wrong)


@pytest.mark.slow
def test_another_initial_model_is_another_training(trained, tmp_path):
    short = changed(LEARNING, steps=2, init=str(trained))
    train(short, [simulated(0)], tmp_path / "model")
    other = train(changed(LEARNING, steps=2), [simulated(0)], tmp_path / "other")
    with pytest.raises(ValueError, match=r"another configuration: training\.json differs in init\."):
        train(changed(short, init=str(other)), [simulated(0)], tmp_path / "model")


@pytest.mark.slow
def test_shelf_is_captured_with_all_and_with_fewer_cameras_to_learn_from(data_folder, trained, tmp_path):
    from dmae.commands import train as command

    config = changed(
        LEARNING,
        data=DataConfig(name="shelf", path=str(data_folder / "shelf"), frames=[0, 20]),
        init=str(trained),
        skeleton=None,
        views=[5, 4],
        steps=2,
    )
    command.run(config, tmp_path)
    made = json.loads((tmp_path / "model.json").read_text())
    assert made["clips"] == 6 and made["frames"] == [0, 20] and made["validation_clips"] == []
    names = json.loads((tmp_path / "training.json").read_text())["clips"]
    assert "shelf by [0, 1, 2, 3, 4]" in names and len(set(names.values())) == 6
