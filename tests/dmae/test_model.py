"""The network: what is hidden cannot be seen, what is fixed is saved, and it can learn."""

from dataclasses import replace

import pytest
import torch
import torch.nn.functional as F
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.model import _TELLS, DMAE, Attention, ModelConfig

SMALL = ModelConfig(
    frames=4, dim=32, depth=2, heads=2, head_dim=16, mlp=64, decoder_dim=16, decoder_depth=1, signal_codes=16
)
PAPER = replace(SMALL, residual=False, turn_to_front=False)
JOINTS = 6


def model(config: ModelConfig, seed: int = 0) -> DMAE:
    """A model with nothing at zero, as after some training, in evaluation mode."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        made = DMAE(config, JOINTS).eval()
        torch.nn.init.normal_(made.head.weight, std=0.1)
    return made


def windows(batch: int, seed: int = 0, share: float = 0.6) -> tuple[torch.Tensor, ...]:
    """What `dmae.windows.Windows` holds, of random joints of which a share is observed."""
    made = torch.Generator().manual_seed(seed)
    base = torch.randn(batch, SMALL.frames, JOINTS, 3, generator=made)
    observed = torch.rand(base.shape[:-1], generator=made) < share
    gap = torch.randint(0, 40, (*observed.shape, 2), generator=made).float()
    ray = F.normalize(torch.randn(base.shape, generator=made), dim=-1) * ~observed[..., None]
    leads = torch.randn(*observed.shape, 6, 3, generator=made)
    rough = torch.randn(*observed.shape, 6, generator=made)
    return base * observed[..., None], observed, base, gap, ray, leads, rough


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000), st.floats(0, 1), st.booleans())
def test_hidden_joints_cannot_influence_the_output(seed, share, residual):
    net = model(SMALL if residual else PAPER)
    x, observed, base, *hints = windows(3, seed, share)
    disturbed = torch.where(observed[..., None], x, 1e3 * torch.randn(x.shape))
    with torch.no_grad():
        first, second = net(x, observed, base, *hints).xyz, net(disturbed, observed, base, *hints).xyz
    assert torch.isfinite(first).all()
    torch.testing.assert_close(first, second, rtol=0, atol=1e-5)


def test_the_paper_s_model_looks_neither_at_interpolation_nor_at_gaps():
    net = model(PAPER)
    x, observed, base, *hints = windows(2)
    with torch.no_grad():
        torch.testing.assert_close(
            net(x, observed, base, *hints).xyz,
            net(x, observed, base + 1, *(hint + 1 for hint in hints)).xyz,
            rtol=0,
            atol=0,
        )


@pytest.mark.parametrize("name", list(_TELLS))
def test_what_a_network_is_blind_to_it_is_not_told_and_all_else_it_is(name):
    net, told = model(replace(SMALL, blind=[name])), model(SMALL)
    for module in (net, told):
        torch.nn.init.normal_(module.amount[-1].weight)
    first = windows(2)
    for other, (tensor, part) in _TELLS.items():
        second = list(first)
        index = ("x", "observed", "base", "gap", "ray", "leads", "rough").index(tensor)
        second[index] = first[index].clone()
        second[index][:, :, :, part] += 1
        with torch.no_grad():
            assert torch.equal(net(*first).xyz, net(*second).xyz) == (other == name)
            assert not torch.equal(told(*first).xyz, told(*second).xyz)


def test_blind_to_what_does_not_exist():
    with pytest.raises(ValueError, match=r"model\.blind: expected some of \['gap', .*found \['colour'\]"):
        replace(SMALL, blind=["gap", "colour"])


def test_an_observed_joint_does_influence_the_others():
    net = model(SMALL)
    x, observed, base, *hints = windows(1)
    frame, joint = (int(i) for i in observed[0].nonzero()[0])
    moved = x.clone()
    moved[0, frame, joint] += 1
    with torch.no_grad():
        change = (net(moved, observed, base, *hints).xyz - net(x, observed, base, *hints).xyz).abs().sum(-1)[0]
    assert (change > 1e-6).all()


def test_windows_do_not_depend_on_their_neighbours_in_the_batch():
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
    x, observed, base, *hints = windows(2)
    observed[0] = False
    net(x * observed[..., None], observed, base, *hints).xyz.square().mean().backward()
    assert all(torch.isfinite(parameter.grad).all() for parameter in net.parameters() if parameter.grad is not None)


def test_a_residual_model_starts_from_the_interpolation():
    x, observed, base, *hints = windows(2)
    assert torch.equal(DMAE(SMALL, JOINTS)(x, observed, base, *hints).xyz, base)


def test_the_fourier_matrices_are_saved_and_are_not_learned():
    net, other = model(SMALL, seed=1), model(SMALL, seed=2)
    matrices = {name for name in net.state_dict() if name.endswith(".B")}
    assert len(matrices) == 5  # signal; joint and time, in the encoder and again in the decoder
    assert not matrices & {name for name, _ in net.named_parameters()}
    batch = windows(2)
    assert not torch.equal(net(*batch).xyz, other(*batch).xyz)
    other.load_state_dict(net.state_dict())
    assert torch.equal(net(*batch).xyz, other(*batch).xyz)


@pytest.mark.parametrize("ablation", ["no_joint_code", "no_time_code"])
def test_ablated_codes_make_tokens_interchangeable(ablation):
    """Without the code of an axis, the paper's network cannot tell the places along it apart."""
    x, observed, base, *hints = windows(2)
    observed[:] = True
    observed[:, 1, 2] = observed[:, 3, 4] = False
    axis = 2 if ablation == "no_joint_code" else 1
    for config, same in ((PAPER, False), (replace(PAPER, **{ablation: True}), True)):
        net = model(config)
        with torch.no_grad():
            flipped = net(x.flip(axis), observed.flip(axis), base, *hints).xyz.flip(axis)
            assert torch.allclose(flipped, net(x, observed, base, *hints).xyz, atol=1e-5) == same


@pytest.mark.parametrize("config", [SMALL, PAPER], ids=["residual", "paper"])
def test_one_batch_is_overfitted(config):
    torch.manual_seed(0)
    net = DMAE(config, JOINTS)
    x, observed, base, *hints = windows(4)
    target = base + 0.1 * torch.randn(base.shape)
    optimizer = torch.optim.Adam(net.parameters(), 5e-3)
    errors = []
    for _ in range(300):
        loss = (net(x, observed, base, *hints).xyz - target).square().sum(-1)[~observed].mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append(float(loss.detach()))
    assert errors[-1] < 0.01 * errors[0]


@pytest.mark.parametrize("wrong", [{"depth": 0}, {"dim": 31}, {"heads": -1}])
def test_impossible_networks_are_refused(wrong):
    with pytest.raises(ValueError, match=f"model.{next(iter(wrong))}"):
        replace(SMALL, **wrong)


def test_attention_starts_with_tokens_like_oneself():
    """Keys of the same token as the query score highest."""
    x = torch.nn.functional.layer_norm(torch.randn(1, 20, 64, generator=torch.Generator().manual_seed(0)), (64,))
    for alike, same in ((1.7, True), (0.0, False)):
        with torch.random.fork_rng():
            torch.manual_seed(0)
            attention = Attention(64, 2, 16, alike)
        q, k, _ = attention.qkv(x).view(20, 3, 2, 16).unbind(1)
        best = torch.einsum("ihc,jhc->hij", q, k).argmax(-1)
        assert bool((best == torch.arange(20)).float().mean() > 0.9) == same


def test_learning_the_scale_moves_nothing_else():
    net = model(SMALL)
    x, observed, base, *hints = windows(2)
    net(x, observed, base, *hints).log_scale.square().mean().backward()
    assert all((p.grad is not None) == name.startswith("scale_head") for name, p in net.named_parameters())
