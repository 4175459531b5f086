"""The paper's network alone: its masks, its windows, training, and the joints that it fills or turns into others."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

import dmae
from dmae.cli import DMAE as PROGRAM
from dmae.cli import compose
from dmae.completion.complete import load_completer
from dmae.completion.config import DecoderConfig, EncoderConfig, MaskingConfig, TrainConfig
from dmae.completion.fusion import namesakes, true_pair
from dmae.completion.methods import find_method
from dmae.completion.network import DMAE
from dmae.completion.paper import (
    PAPER,
    PaperBatches,
    PaperCompleter,
    centre,
    cut,
    interpolated,
    paper_rows,
    paper_validation,
)
from dmae.completion.training import train
from dmae.completion.training_data import PosePair, Recipe, mask_captured, mask_scattered
from dmae.completion.weights import load_model, weights_folder
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY21, BODY25, HALPE26, SHELF14, get_skeleton
from tests.dmae.completion.test_fusion import FPS, pair, walk, with_holes
from tests.support.circling_people import clip_of

SKELETON = get_skeleton("body21+shelf14")
TINY = replace(
    PAPER,
    model=replace(
        PAPER.model,
        encoder=EncoderConfig(dim=32, depth=2, heads=2, head_dim=16, mlp=64),
        decoder=DecoderConfig(dim=16, depth=1),
    ),
    examples=replace(PAPER.examples, held_back=0.0),
    learning=replace(PAPER.learning, steps=60, epoch=30, lr=5e-3),
)
RECIPE = Recipe(TINY.model, np.zeros((len(SKELETON), 3)), PAPER.examples.masking, PAPER.examples.augment)


def two(seed: int, frames: int = 40) -> Poses3D:
    """Return people on both skeletons."""
    return true_pair(pair(walk(seed, frames)), SKELETON)


def true_clip(seed: int) -> Clip:
    return clip_of(pair(walk(seed)), f"true{seed}")


def captured_clip(seed: int) -> Clip:
    return replace(true_clip(seed), id=f"captured{seed}", poses=with_holes(convert(walk(seed), BODY21), seed))


@pytest.fixture(scope="module")
def pretrained(tmp_path_factory):
    return train(TINY, [true_clip(seed) for seed in range(3)], tmp_path_factory.mktemp("paper"))


def test_the_preset_is_what_python_has():
    found = compose(PROGRAM.commands["train"], ["data=clip", "data.path=-", "model=paper"])
    assert isinstance(found, TrainConfig)
    for name in ("skeleton", "model", "examples", "learning"):
        assert getattr(found, name) == getattr(PAPER, name), name


def test_masks_hide_exact_numbers_of_frames_and_of_joints():
    masked = mask_scattered((15, 50, 21), 0.5, 0.5, rng=np.random.default_rng(0))
    whole = masked.all(2)
    assert (whole.sum(0) == 8).all()
    assert (masked.sum(2)[~whole] == 11).all()
    released = mask_scattered((15, 50, 21), 0.5, 0.5, True, rng=np.random.default_rng(0))
    assert ((released.sum(2) == 11).sum(0) == 8).all()
    assert (released.sum((0, 2)) == 88).all()
    assert len(np.unique(masked.reshape(-1, 21), axis=0)) > 100


def test_captured_windows_keep_many_joints_or_few():
    masked = mask_captured((15, 400, 35), MaskingConfig(), rng=np.random.default_rng(0))
    share = masked.mean((0, 2))
    assert share.min() < 0.1
    assert share.max() > 0.6
    assert masked.all(0).any(), "some joints are masked in all frames"


def test_windows_are_centred_on_the_hips_that_are_observed():
    rng = np.random.default_rng(0)
    x, observed = rng.normal(size=(3, 5, 8, 3)), rng.random((3, 5, 8)) < 0.4
    observed[0, :, [3, 4]], observed[1], observed[2, 0, 3] = False, False, True
    middle = centre(x, observed, [3, 4])
    np.testing.assert_allclose(middle[2, 0, 0], x[2][:, [3, 4]][observed[2][:, [3, 4]]].mean(0))
    np.testing.assert_allclose(middle[0, 0, 0], x[0][observed[0]].mean(0))
    assert (middle[1] == 0).all()


def test_windows_do_not_reach_from_one_person_to_the_next():
    poses = two(0, 20)
    xyz = np.broadcast_to(np.arange(3)[None, :, None, None], poses.xyz.shape)
    rows = paper_rows([PosePair(replace(poses, xyz=xyz))], 15)
    assert rows.starts.tolist() == [start + 20 * person for person in range(3) for start in range(6)]
    assert {len(np.unique(rows.truth[start : start + 15])) for start in rows.starts} == {1}
    short = paper_rows([PosePair(two(0, 9))], 15)
    assert len(short.starts) == 3
    assert np.isnan(short.truth[9:15]).all(), "short recordings are padded"


def test_a_window_is_turned_and_moved_and_hides_what_is_masked():
    rows = paper_rows([PosePair(two(0))], 15)
    masked = mask_scattered((15, 4, 21), 0.5, 0.5, rng=np.random.default_rng(1)).swapaxes(0, 1)
    starts, angle = rows.starts[:4], np.array([0.0, 1.0, 2.0, 3.0])
    made = cut(rows, starts, masked, SKELETON, angle=angle)
    x, observed = made.windows[:2]
    assert torch.equal(observed, torch.from_numpy(~masked))
    assert torch.equal(x[observed], made.truth[observed])
    assert (x[~observed] == 0).all()
    assert torch.equal(made.hidden, ~observed)
    plain = cut(rows, starts, masked, SKELETON).truth
    norms = (torch.linalg.norm(part[..., :2], dim=-1) for part in (plain, made.truth))
    torch.testing.assert_close(*norms, rtol=0, atol=1e-5)
    assert not torch.allclose(plain[1:], made.truth[1:], atol=0.05)


def batches(*pools) -> PaperBatches:
    made = [(share, paper_rows(pairs, 15)) for share, pairs in pools]
    return PaperBatches(made, SKELETON, RECIPE, seed=1, epoch=0, steps=40, batch=16)


def captured_pair(seed: int) -> PosePair:
    return PosePair(two(seed), with_holes(convert(walk(seed, 40), BODY21), seed))


def test_batches_of_true_poses_hide_joints_of_the_source_and_need_no_padding():
    made = batches((1.0, [PosePair(two(0))]))
    for step in range(9):
        observed = made[step].windows.observed
        assert observed.shape == (16, 15, 21)
        assert (observed.sum((1, 2)) == observed[0].sum()).all()
        assert torch.equal(made[step].hidden, ~observed)


def test_of_captured_poses_the_target_alone_is_learned_and_none_of_it_is_shown():
    made = batches((1.0, [captured_pair(0), captured_pair(1)]))
    for step in range(9):
        batch, again = made[step], made[step]
        assert not batch.windows.observed[..., 21:].any() and batch.windows.observed[..., :21].any()
        assert batch.hidden[..., 21:].all() and not batch.hidden[..., :21].any()
        assert not batch.observed.any()
        assert all(torch.equal(*parts) for parts in zip(batch[1:], again[1:], strict=True))


def test_captured_poses_and_true_ones_alone_are_not_mixed():
    with pytest.raises(ValueError, match="expected captured poses in all, or in none: capture the others first"):
        batches((0.5, [captured_pair(0)]), (0.5, [PosePair(two(1))]))


def test_a_share_of_the_windows_is_replayed():
    far = [PosePair(replace(two(0), xyz=2 * two(0).xyz), convert(two(0), BODY21))]
    made = batches((0.25, [captured_pair(0)]), (0.75, far))
    heights = np.concatenate([made[step].truth[..., 21:, 2].flatten(1).std(1).numpy() for step in range(40)])
    assert abs((heights > 0.6).mean() - 0.75) < 0.1, "people of the replayed recording are twice as tall"
    assert batches((0.5, [captured_pair(0)]), (0.5, []))[0].truth.shape[0] == 16


def test_a_joint_of_the_target_has_the_code_of_its_namesake():
    net = DMAE(TINY.model, len(SKELETON), namesakes(SKELETON))
    for context in (net.encoder_context, net.decoder_context):
        code = context(len(SKELETON)).view(15, len(SKELETON), -1)
        for joint in ("l_wrist", "r_hip"):
            own, other = BODY21.index(joint)[0], 21 + SHELF14.index(joint)[0]
            assert torch.equal(code[:, own], code[:, other])
        assert len(code[0].unique(dim=0)) == 21, "the ends of the head have those of the neck and the nose"
    assert namesakes(BODY21) is None
    assert namesakes(get_skeleton("coco17+halpe26"))[17 + HALPE26.index("neck")[0]] == 17 + HALPE26.index("neck")[0]


def test_what_pretraining_learned_holds_for_the_target_before_fusion_is_learned():
    model, skeleton, _ = load_model(weights_folder("paper"))
    given, truth = with_holes(walk(5), 5), pair(walk(5)).xyz[:, :, 25:]
    fused = PaperCompleter(model, skeleton, fuse=True)(given, FPS)
    same = [number for number, joint in enumerate(SHELF14.joints) if joint in BODY21.joints]
    assert np.nanmean(np.linalg.norm(fused.xyz - truth, axis=-1)[:, :, same]) < 0.05


def test_stills_are_completed_each_by_itself():
    model, skeleton, _ = load_model(weights_folder("paper"))
    complete, given = PaperCompleter(model, skeleton), convert(with_holes(walk(4), 4), BODY21).select(slice(0, 9, 3))
    done, alone = complete(given, 0.5), complete(given.select(slice(1, 2)), 0.5)
    assert (done.source == Source.COMPLETED).any()
    np.testing.assert_allclose(done.xyz[1:2], alone.xyz, atol=1e-5)
    np.testing.assert_array_equal(complete(given, 0.5, slice(1, 2)).xyz, alone.xyz)
    assert complete.notes(given, 0.5) == ["0.5 frames/s: stills, each completed by itself"]


def test_interpolation_inside_a_window_knows_nothing_outside_it():
    (made,) = paper_validation([PosePair(two(0, 30))], SKELETON, RECIPE, np.full((35, 3), 0.7), seed=0, batch=1000)
    observed = made.windows.observed
    assert torch.equal(made.windows.base[observed], made.windows.x[observed])
    never = ~observed.any(1)
    if never.any():
        window, joint = np.argwhere(never.numpy())[0]
        np.testing.assert_allclose(made.windows.base[window, :, joint], [(0, 0, 0.7)] * 15, rtol=1e-6)
    moved = made.windows._replace(x=made.windows.x + 9 * ~observed[..., None])
    assert torch.equal(interpolated(moved, np.full((35, 3), 0.7)), made.windows.base)


def test_training_learns_resumes_and_says_what_it_does(pretrained, tmp_path, capsys):
    model, skeleton, record = load_model(pretrained)
    assert skeleton == SKELETON
    assert record["fuses"] is False
    validation = paper_validation([PosePair(two(7))], SKELETON, RECIPE, model.rest.numpy(), seed=0, batch=64)
    start = DMAE(TINY.model, len(SKELETON)).eval()
    start.rest.copy_(model.rest)
    with torch.no_grad():
        before, after = (
            float(torch.linalg.norm(net(*validation[0].windows).xyz - validation[0].truth, dim=-1).mean())
            for net in (start, model)
        )
    assert after < 0.6 * before
    clips = [true_clip(seed) for seed in range(3)]
    plan = replace(TINY, learning=replace(TINY.learning, epoch=30, steps=30))
    validated = train(plan, clips, tmp_path / "validated", validation_clips=[true_clip(8)])
    assert "step 30: loss" in capsys.readouterr().err
    again = train(plan, clips, tmp_path / "again", validation_clips=[true_clip(8)])
    assert (validated / "weights.safetensors").read_bytes() == (again / "weights.safetensors").read_bytes()


def test_fusion_starts_from_pretraining_and_fills_the_second_skeleton(pretrained, tmp_path):
    plan = replace(TINY, init=str(pretrained), learning=replace(TINY.learning, steps=30, lr=2e-3))
    folder = train(plan, [captured_clip(seed) for seed in range(3)], tmp_path)
    assert load_model(folder)[2]["fuses"] is True
    given, truth = with_holes(walk(5), 5), pair(walk(5)).xyz[:, :, 25:]
    fused = load_completer(folder)(given, FPS)
    assert fused.skeleton == SHELF14
    assert not (fused.source == Source.MEASURED).any()
    assert set(np.unique(fused.source)) <= {Source.DENOISED, Source.COMPLETED, Source.ABSENT}
    error = np.nanmean(np.linalg.norm(fused.xyz - truth, axis=-1))
    assert error < 0.35


def test_measured_joints_stay_and_hidden_ones_move_with_the_person(pretrained):
    complete, given = load_completer(pretrained), convert(with_holes(walk(4), 4), BODY21)
    assert isinstance(complete, PaperCompleter)
    done = complete(given, FPS)
    np.testing.assert_array_equal(done.xyz[given.measured], given.xyz[given.measured])
    assert (done.source[given.measured] == Source.MEASURED).all()
    filled = done.source == Source.COMPLETED
    assert filled.any()
    assert np.isnan(done.cov[filled]).all()
    moved = complete(replace(given, xyz=given.xyz + np.float32((3, -2, 0))), FPS)
    np.testing.assert_allclose(moved.xyz - (3, -2, 0), done.xyz, atol=2e-3)
    np.testing.assert_array_equal(complete(given, FPS, slice(10, 20)).xyz, done.xyz[10:20])


def test_users_keep_the_joints_that_the_network_does_not_know():
    given = with_holes(walk(4), 4)
    assert given.skeleton == BODY25
    done = dmae.complete(given, FPS, weights="paper", smooth=0)
    alone = load_completer(weights_folder("paper"))(given, FPS)
    assert done.skeleton == given.skeleton and alone.skeleton == BODY21
    np.testing.assert_array_equal(done.xyz[given.measured], given.xyz[given.measured])
    others = [number for number, joint in enumerate(BODY25.joints) if joint not in BODY21.joints]
    assert given.measured[..., others].any()
    np.testing.assert_array_equal(done.source[..., others], given.source[..., others])
    np.testing.assert_array_equal(convert(done, BODY21).xyz, alone.xyz)
    (note,) = dmae.completer("body25", weights="paper").notes(given, FPS)
    assert note.endswith("completed with weights for body21; not completed: l_small_toe, l_heel, r_small_toe, r_heel")
    scored = find_method("dmae").load(weights_folder("paper"))(given, FPS)
    np.testing.assert_array_equal(scored.xyz, alone.xyz)


def test_people_at_other_rates_short_recordings_and_nobody(pretrained):
    complete, given = load_completer(pretrained), with_holes(walk(3, 30), 3)
    assert (complete(given, 50.0).source == Source.COMPLETED).any()
    assert len(complete(given.select(slice(0, 3)), FPS).xyz) == 3
    nobody = Poses3D(given.skeleton, np.zeros((5, 0, len(given.skeleton), 3)))
    assert complete(nobody, FPS).xyz.shape == (5, 0, 21, 3)
    unseen = replace(given, xyz=np.full_like(given.xyz, np.nan), source=np.full_like(given.source, Source.ABSENT))
    assert np.isnan(complete(unseen, FPS).xyz).all()


def test_poses_in_millimetres_are_refused():
    poses = walk(3, 30)
    with pytest.raises(ValueError, match=r"expected coordinates in m, found bones of .* m; divide those in mm by 1000"):
        dmae.complete(replace(poses, xyz=1000 * poses.xyz), FPS, weights="paper")


def test_weights_of_other_sizes_are_refused(pretrained, tmp_path):
    with pytest.raises(ValueError, match=r"a network of other sizes; to start from it, give model\.encoder\.dim=32"):
        train(replace(PAPER, init=str(pretrained)), [captured_clip(0)], tmp_path)
    with pytest.raises(ValueError, match="has no truth to learn from"):
        train(replace(TINY, init=str(pretrained)), [replace(captured_clip(0), truth=None)], tmp_path / "none")


def test_the_shipped_weights_are_of_the_paper_s_network():
    model, skeleton, record = load_model(weights_folder("paper"))
    assert skeleton == SKELETON
    assert asdict(model.config) == asdict(PAPER.model)
    assert record["steps"] == PAPER.learning.steps
    validation = paper_validation([PosePair(two(7))], SKELETON, RECIPE, model.rest.numpy(), seed=0, batch=64)
    with torch.no_grad():
        predicted = model(*validation[0].windows).xyz
    error = torch.linalg.norm(predicted - validation[0].truth, dim=-1)[validation[0].hidden]
    assert float(error.mean()) < 0.08
