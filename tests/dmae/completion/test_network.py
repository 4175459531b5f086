"""The networks: hidden joints have no influence, fixed matrices are saved, and a batch can be overfitted."""

from dataclasses import replace

import pytest
import torch
import torch.nn.functional as F
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.completion.config import FEATURES, CodesConfig, DecoderConfig, EncoderConfig, ModelConfig
from dmae.completion.network import DMAE, Attention
from dmae.completion.windows import Windows

SMALL = ModelConfig(
    frames=4,
    encoder=EncoderConfig(dim=32, depth=2, heads=2, head_dim=16, mlp=64),
    decoder=DecoderConfig(dim=16, depth=1),
    codes=CodesConfig(signal=16),
)
PAPER = replace(SMALL, residual=False, align_heading=False)
JOINTS = 6


@pytest.mark.parametrize(
    "name, value, expected",
    [
        ("frames", 15.5, "ModelConfig.frames: expected a whole number, found 15.5"),
        ("frames", True, "ModelConfig.frames: expected a whole number, found True"),
        ("frames", "15", "ModelConfig.frames: expected a whole number, found '15'"),
        ("frames", 0, "model.frames: expected a number from 1 to 1000, found 0"),
        ("dropout", float("nan"), "model.dropout: expected a number from 0 to 0.999, found nan"),
        ("fps", "25", "ModelConfig.fps: expected a number, found '25'"),
    ],
)
def test_impossible_sizes_and_rates_are_refused(name, value, expected):
    with pytest.raises(ValueError, match=f"^{expected}"):
        replace(SMALL, **{name: value})


def model(config: ModelConfig, seed: int = 0) -> DMAE:
    """Return a model in evaluation mode, with a head that is not zero, as after some training."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        made = DMAE(config, JOINTS).eval()
        torch.nn.init.normal_(made.head.weight, std=0.1)
    return made


def windows(batch: int, seed: int = 0, share: float = 0.6) -> tuple[torch.Tensor, ...]:
    """Return the fields of `dmae.completion.windows.Windows` for random joints, a share of them observed."""
    made = torch.Generator().manual_seed(seed)
    base = torch.randn(batch, SMALL.frames, JOINTS, 3, generator=made)
    observed = torch.rand(base.shape[:-1], generator=made) < share
    gap = torch.randint(0, 40, (*observed.shape, 2), generator=made).float()
    ray = F.normalize(torch.randn(base.shape, generator=made), dim=-1) * ~observed[..., None]
    offset = torch.randn(*observed.shape, 6, 3, generator=made)
    noise = torch.randn(*observed.shape, 6, generator=made)
    return base * observed[..., None], observed, base, gap, ray, offset, noise


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000), st.floats(0, 1), st.booleans())
def test_hidden_joints_cannot_influence_the_output(seed, share, residual):
    net = model(SMALL if residual else PAPER)
    x, observed, base, *features = windows(3, seed, share)

    def predicted(x: torch.Tensor):
        with torch.no_grad():
            return net(x, observed, base, *features)

    assert torch.isfinite((first := predicted(x)).xyz).all()
    for other in (1e3 * torch.randn(x.shape), torch.nan):
        second = predicted(torch.where(observed[..., None], x, other))
        assert all(map(torch.equal, first, second))


@pytest.mark.parametrize("depth", [1, 2])
@pytest.mark.parametrize("residual", [True, False])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_wanted_joints_are_predicted_as_with_all_others(residual, depth, share):
    net = model(replace(SMALL if residual else PAPER, decoder=DecoderConfig(dim=16, depth=depth)))
    parts = windows(3)
    wanted = torch.rand(parts[1].shape, generator=torch.Generator().manual_seed(1)) < share
    wanted[0] = False
    with torch.no_grad():
        whole, some = net(*parts), net(*parts, wanted=wanted)
    for expected, found in zip(whole, some, strict=True):
        torch.testing.assert_close(found[wanted], expected[wanted], rtol=0, atol=1e-5)
        assert not found[~wanted].any()


def test_the_paper_s_network_uses_neither_interpolation_nor_features():
    net = model(PAPER)
    x, observed, base, *features = windows(2)
    with torch.no_grad():
        torch.testing.assert_close(
            net(x, observed, base, *features).xyz,
            net(x, observed, base + 1, *(feature + 1 for feature in features)).xyz,
            rtol=0,
            atol=0,
        )


@pytest.mark.parametrize("name", list(FEATURES))
def test_an_ablated_feature_has_no_influence_and_every_other_has(name):
    ablated, whole = model(replace(SMALL, ablate=[name])), model(SMALL)
    for network in (ablated, whole):
        torch.nn.init.normal_(network.residual_scale[-1].weight)
    first = windows(2)
    for other, (field, part) in FEATURES.items():
        second = list(first)
        index = Windows._fields.index(field)
        second[index] = first[index].clone()
        second[index][:, :, :, part] += 1
        with torch.no_grad():
            assert torch.equal(ablated(*first).xyz, ablated(*second).xyz) == (other == name)
            assert not torch.equal(whole(*first).xyz, whole(*second).xyz)


def test_windows_that_do_not_fit_are_refused():
    network, (x, observed, *_) = model(PAPER), windows(2)
    for wrong in (x[:, :3], torch.cat([x, x[:, :1]], 1), x.repeat(1, 1, 2, 1)):
        with pytest.raises(ValueError, match=r"^expected x \(B, 4, J, 3\) and observed \(B, 4, J\) with J up to 6;"):
            network(wrong, torch.ones(wrong.shape[:3], dtype=torch.bool))
    with pytest.raises(ValueError, match=r"found \(2, 4, 6, 3\) and \(2, 4, 5\)$"):
        network(x, observed[:, :, 1:])
    with pytest.raises(ValueError, match="expected base, gap, ray, candidate_offset and noise_level"):
        model(SMALL)(x, observed)


def test_an_unknown_feature_cannot_be_ablated():
    with pytest.raises(ValueError, match=r"model\.ablate: expected some of \['gap', .*found \['colour'\]"):
        replace(SMALL, ablate=["gap", "colour"])


def test_an_observed_joint_does_influence_the_others():
    net = model(SMALL)
    x, observed, base, *features = windows(1)
    frame, joint = (int(i) for i in observed[0].nonzero()[0])
    moved = x.clone()
    moved[0, frame, joint] += 1
    with torch.no_grad():
        change = (net(moved, observed, base, *features).xyz - net(x, observed, base, *features).xyz).abs().sum(-1)[0]
    assert (change > 1e-6).all()


def test_windows_do_not_depend_on_others_in_the_batch():
    net = model(SMALL)
    batch = windows(5)
    order = [3, 0, 4, 2, 1]
    with torch.no_grad():
        together, shuffled = net(*batch).xyz, net(*(part[order] for part in batch)).xyz
        alone = torch.cat([net(*(part[i : i + 1] for part in batch)).xyz for i in range(5)])
    torch.testing.assert_close(shuffled, together[order], rtol=0, atol=1e-5)
    torch.testing.assert_close(alone, together, rtol=0, atol=1e-5)


def test_a_window_without_any_observed_joint_is_finite_and_trains():
    net = DMAE(SMALL, JOINTS)
    x, observed, base, *features = windows(2)
    observed[0] = False
    net(x * observed[..., None], observed, base, *features).xyz.square().mean().backward()
    assert all(torch.isfinite(parameter.grad).all() for parameter in net.parameters() if parameter.grad is not None)


def test_a_residual_model_starts_from_the_interpolation():
    x, observed, base, *features = windows(2)
    assert torch.equal(DMAE(SMALL, JOINTS)(x, observed, base, *features).xyz, base)


def test_fourier_matrices_are_saved_and_not_learned():
    net, other = model(SMALL, seed=1), model(SMALL, seed=2)
    matrices = {name for name in net.state_dict() if name.endswith(".B")}
    assert len(matrices) == 5  # signal; joint and time, in the encoder and again in the decoder
    assert not matrices & {name for name, _ in net.named_parameters()}
    batch = windows(2)
    assert not torch.equal(net(*batch).xyz, other(*batch).xyz)
    other.load_state_dict(net.state_dict())
    assert torch.equal(net(*batch).xyz, other(*batch).xyz)


@pytest.mark.parametrize("ablation", ["no_joint", "no_time"])
def test_ablated_codes_make_tokens_interchangeable_in_the_encoder(ablation):
    """Without the code of an axis, the encoder cannot tell the places along it apart; the decoder still can."""
    x, observed, *_ = windows(2)
    observed[:] = True
    observed[:, 1, 2] = observed[:, 3, 4] = False
    axis = 2 if ablation == "no_joint" else 1
    for config, same in ((PAPER, False), (replace(PAPER, codes=replace(PAPER.codes, **{ablation: True})), True)):
        net = model(config)

        def encoded(x: torch.Tensor, observed: torch.Tensor, net: DMAE = net) -> torch.Tensor:
            return net.encode(net.signal(x.flatten(1, 2)), observed).unflatten(1, x.shape[1:3])

        with torch.no_grad():
            flipped = encoded(x.flip(axis), observed.flip(axis)).flip(axis)
            assert torch.allclose(flipped, encoded(x, observed), atol=1e-5) == same
            whole = net(x.flip(axis), observed.flip(axis)).xyz.flip(axis)
            assert not torch.allclose(whole, net(x, observed).xyz, atol=1e-5)


def test_fewer_joints_have_the_codes_of_the_first():
    net = model(PAPER)
    x, observed, *_ = windows(2)
    observed[:, :, 4:] = False
    with torch.no_grad():
        fewer = net.encode(net.signal(x[:, :, :4].flatten(1, 2)), observed[:, :, :4]).unflatten(1, (SMALL.frames, 4))
        whole = net.encode(net.signal(x.flatten(1, 2)), observed).unflatten(1, (SMALL.frames, JOINTS))
    torch.testing.assert_close(fewer, whole[:, :, :4], rtol=0, atol=1e-6)


@pytest.mark.parametrize("config", [SMALL, PAPER], ids=["residual", "paper"])
def test_one_batch_is_overfitted(config):
    torch.manual_seed(0)
    net = DMAE(config, JOINTS)
    x, observed, base, *features = windows(4)
    target = base + 0.1 * torch.randn(base.shape)
    optimizer = torch.optim.Adam(net.parameters(), 5e-3)
    errors = []
    for _ in range(300):
        loss = (net(x, observed, base, *features).xyz - target).square().sum(-1)[~observed].mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append(float(loss.detach()))
    assert errors[-1] < 0.01 * errors[0]


@pytest.mark.parametrize(
    ("part", "wrong"), [("encoder", {"depth": 0}), ("decoder", {"dim": 31}), ("encoder", {"heads": -1})]
)
def test_impossible_networks_are_refused(part, wrong):
    with pytest.raises(ValueError, match=f"model.{part}.{next(iter(wrong))}"):
        replace(SMALL, **{part: replace(getattr(SMALL, part), **wrong)})


def test_attention_starts_with_similar_tokens():
    """Each query scores highest with the key of its own token."""
    x = torch.nn.functional.layer_norm(torch.randn(1, 20, 64, generator=torch.Generator().manual_seed(0)), (64,))
    for key_init, same in ((1.7, True), (0.0, False)):
        with torch.random.fork_rng():
            torch.manual_seed(0)
            attention = Attention(64, 2, 16, key_init)
        q, k, _ = attention.qkv(x).view(20, 3, 2, 16).unbind(1)
        best = torch.einsum("ihc,jhc->hij", q, k).argmax(-1)
        assert bool((best == torch.arange(20)).float().mean() > 0.9) == same


def test_learning_the_error_scale_changes_no_other_layer():
    net = model(SMALL)
    x, observed, base, *features = windows(2)
    net(x, observed, base, *features).log_scale.square().mean().backward()
    assert all((p.grad is not None) == name.startswith("scale_head") for name, p in net.named_parameters())
