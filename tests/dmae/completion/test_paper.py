"""The paper's network alone: its inputs, training, resumed training, and the joints that it fills."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from dmae.completion.config import FULL, SMALL, PaperConfig, PaperNetwork, PaperSchedule
from dmae.completion.paper import (
    SKELETON,
    PaperDMAE,
    centre,
    cut,
    dual_masks,
    fine_tune,
    hips_of,
    learning_rate,
    load_paper,
    load_paper_completer,
    make_rows,
    masked_mse,
    pretrain,
    rotate,
)
from dmae.completion.training_data import PosePair
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY21, SHELF14, get_skeleton

_TINY = PaperConfig(
    PaperNetwork(frames=5, dim=32, depth=2, heads=2, head_dim=16, mlp=64, dropout=0.1),
    PaperSchedule(steps=6, tuning_epochs=2, batch=8, lr=3e-3),
)
_JOINTS = len(get_skeleton(SKELETON))


def walkers(frames: int = 40, people: int = 2, seed: int = 0) -> Poses3D:
    """Bodies that glide and swing their limbs."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames)[:, None, None, None] / 25
    rest, phase = rng.normal(0, 0.3, (1, people, len(BODY21), 3)), rng.uniform(0, 6, (1, people, len(BODY21), 1))
    return Poses3D(BODY21, rest + (0, 0, 1) + time * (1, 0, 0) + 0.1 * np.sin(3 * time + phase))


def windows(batch: int = 3) -> tuple[torch.Tensor, torch.Tensor]:
    made = torch.Generator().manual_seed(0)
    return torch.randn(batch, 5, _JOINTS, 3, generator=made), torch.rand(batch, 5, _JOINTS, generator=made) < 0.3


def model(network: PaperNetwork = _TINY.network) -> PaperDMAE:
    torch.manual_seed(0)
    return PaperDMAE(network, _JOINTS).eval()


def test_masked_joints_cannot_influence_the_output():
    net, (x, observed) = model(), windows()
    observed[0] = False
    other = torch.where(observed[..., None], x, torch.randn(x.shape) * 100)
    with torch.no_grad():
        torch.testing.assert_close(net(x, observed), net(other, observed), rtol=0, atol=1e-5)
        assert not torch.allclose(net(x, observed), net(x + observed[..., None] * 0.1, observed))


def test_the_decoder_is_half_as_wide_and_half_as_deep():
    net = model(FULL.network)
    assert len(net.encoder) == 6
    assert len(net.decoder) == 3
    assert net.head.in_features * 2 == net.embed.out_features == 256
    assert 5e6 < sum(each.numel() for each in net.parameters()) < 7.3e6


def test_masks_hide_half_of_the_joints_and_half_of_the_frames():
    masked = dual_masks((400, 15, 21), FULL.schedule, torch.Generator().manual_seed(0))
    assert masked.all(2).float().mean() == pytest.approx(0.5, abs=0.03)
    assert masked.float().mean() == pytest.approx(0.75, abs=0.02)


def test_the_loss_is_of_counted_tokens_alone():
    truth, counted = torch.zeros(2, 5, 3, 3), torch.zeros(2, 5, 3, dtype=torch.bool)
    counted[0, 0, 0] = True
    predicted = truth.clone()
    predicted[0, 0, 0] = torch.tensor([0.3, 0.4, 0.0])
    predicted[1] = 9
    assert float(masked_mse(predicted, truth, counted)) == pytest.approx(0.25)


def test_the_learning_rate_rises_and_falls_as_a_cosine():
    rates = [learning_rate(step, 1000, FULL.schedule) for step in range(1000)]
    assert max(rates) == pytest.approx(1.5e-4)
    assert rates.index(max(rates)) in (39, 40)
    assert rates[-1] == pytest.approx(1e-5, rel=0.05)
    assert rates[520] == pytest.approx(8e-5, rel=0.01)


def test_windows_are_centred_on_the_hips_that_are_observed():
    x, observed = windows()
    observed[0, :, [3, 4]] = False
    observed[1] = False
    middle = centre(x, observed, [3, 4])
    seen = x[2][:, [3, 4]][observed[2][:, [3, 4]]]
    torch.testing.assert_close(middle[2, 0, 0], seen.mean(0))
    torch.testing.assert_close(middle[0, 0, 0], x[0][observed[0]].mean(0))
    assert (middle[1] == 0).all()


def test_windows_do_not_reach_from_one_person_to_the_next():
    xyz = np.broadcast_to(np.arange(2)[None, :, None, None], (7, 2, 3, 3)).astype(float)
    rows = make_rows(xyz, xyz, 5)
    assert rows.starts.tolist() == [0, 1, 2, 7, 8, 9]
    assert {len(set(rows.xyz[start : start + 5].ravel())) for start in rows.starts} == {1}
    assert len(make_rows(xyz[:3], xyz[:3], 5).starts) == 2, "short recordings are padded"


@pytest.fixture(scope="module")
def pretrained(tmp_path_factory):
    torch.set_num_threads(1)
    return pretrain([(walkers(), 25.0)], _TINY, tmp_path_factory.mktemp("paper"))


def test_training_that_resumes_gives_the_same_bytes(pretrained, tmp_path, monkeypatch):
    monkeypatch.setattr("dmae.completion.paper._SAVED", 2)
    calls = []

    def stop(step, *args):
        calls.append(step)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return learning_rate(step, *args)

    with monkeypatch.context() as patch:
        patch.setattr("dmae.completion.paper.learning_rate", stop)
        with pytest.raises(KeyboardInterrupt):
            pretrain([(walkers(), 25.0)], _TINY, tmp_path)
    assert not (tmp_path / "paper.json").exists()
    pretrain([(walkers(), 25.0)], _TINY, tmp_path)
    assert (tmp_path / "weights.safetensors").read_bytes() == (pretrained / "weights.safetensors").read_bytes()
    with pytest.raises(ValueError, match=r"another configuration: training\.json differs in seed"):
        pretrain([(walkers(), 25.0)], replace(_TINY, seed=1), tmp_path)


def test_completion_fills_what_a_window_sees_and_nothing_else(pretrained):
    poses = walkers(40, 1)
    lost = np.zeros(poses.xyz.shape[:3], bool)
    lost[5:9, :, 3] = lost[12:32] = True
    given = poses.without(lost)
    done = load_paper_completer(pretrained, "cpu")(given, 25.0)
    assert done.skeleton == BODY21
    assert (done.source[5:9, 0, 3] == Source.COMPLETED).all()
    assert np.isfinite(done.xyz[5:9, 0, 3]).all()
    assert np.array_equal(done.xyz[given.measured], given.xyz[given.measured])
    far = slice(15, 29)
    assert (done.source[far] == Source.ABSENT).all(), "windows of 5 frames there hold no measurement"
    assert (done.source[12:14] == Source.COMPLETED).all()


def test_other_rates_are_resampled(pretrained):
    poses = walkers(30, 1).without(np.arange(21) == 4)
    done = load_paper_completer(pretrained, "cpu")(poses, 12.5)
    assert done.xyz.shape == poses.xyz.shape
    assert (done.source[..., 4] == Source.COMPLETED).all()


def test_fine_tuning_adds_the_joints_of_the_second_skeleton(pretrained, tmp_path):
    source, target = walkers(), get_skeleton(SKELETON).parts[1]
    added = source.xyz[:, :, : len(target)] + 0.05
    truth = Poses3D(get_skeleton(SKELETON), np.concatenate([np.full_like(source.xyz, np.nan), added], 2))
    folder = fine_tune(pretrained, [PosePair(truth, source)], _TINY, tmp_path)
    record = load_paper(folder)[1]
    assert record["stage"] == "tuned"
    done = load_paper_completer(folder, "cpu")(source, 25.0)
    assert done.skeleton == SHELF14
    assert (done.source != Source.MEASURED).all()
    assert np.isfinite(done.xyz).all()
    with pytest.raises(ValueError, match="has none: capture it first"):
        fine_tune(pretrained, [PosePair(truth)], _TINY, tmp_path / "other")


def test_a_batch_can_be_overfitted():
    torch.set_num_threads(1)
    torch.manual_seed(0)
    net, (x, observed) = model().train(), windows(2)
    net = PaperDMAE(replace(_TINY.network, dropout=0.0), _JOINTS)
    optimizer = torch.optim.AdamW(net.parameters(), 3e-3)
    first = None
    for _ in range(400):
        loss = masked_mse(net(x * 0.3, observed), x * 0.3, ~observed)
        first = first or loss.item()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss.item() < 0.2 * first


def test_damaged_weights_are_refused(pretrained, tmp_path):
    for name in ("paper.json", "weights.safetensors"):
        (tmp_path / name).write_bytes((pretrained / name).read_bytes())
    (tmp_path / "weights.safetensors").write_bytes(b"x" * 100)
    with pytest.raises(ValueError, match="does not match the checksum"):
        load_paper(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"expected paper\.json"):
        load_paper(tmp_path / "none")


@pytest.mark.slow
def test_the_full_size_learns_two_windows_by_heart():
    """In 30 steps the loss on masked joints falls to a fifth of that of the middle of the body, measured 0.11 of it."""
    torch.set_num_threads(1)
    poses, made = walkers(60, 2).xyz, torch.Generator().manual_seed(0)
    rows = make_rows(poses, poses, FULL.network.frames)
    xyz = cut(rows, rows.starts[[0, -1]], FULL.network.frames)[0]
    observed = ~dual_masks(xyz.shape[:3], FULL.schedule, made)
    x = rotate(xyz - centre(xyz, observed, hips_of(BODY21)), made)
    torch.manual_seed(0)
    net = PaperDMAE(replace(FULL.network, dropout=0.0), len(BODY21)).train()
    optimizer = torch.optim.AdamW(net.parameters(), 5e-4, betas=(0.9, 0.95))
    for _ in range(30):
        loss = masked_mse(net(x, observed), x, ~observed)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimizer.step()
    middle = (x * observed[..., None]).sum((1, 2), keepdim=True) / observed.sum((1, 2))[:, None, None, None]
    assert loss.item() < 0.2 * masked_mse(middle.expand_as(x), x, ~observed).item()


def test_sizes_have_the_shape_of_the_paper():
    assert (FULL.schedule.epochs, FULL.schedule.tuning_epochs, FULL.schedule.batch) == (1000, 500, 32)
    assert (FULL.network.frames, FULL.network.dropout) == (15, 0.1)
    assert SMALL.network.dim < FULL.network.dim
