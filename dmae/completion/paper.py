"""D-MAE as its paper has it (Jiang, Chen and Guo, A Dual-Masked Auto-Encoder for Robust Motion Capture, ACM MM 2022).

In the order of the paper: the codes, the encoder of observed tokens, the decoder with its mask token, the two masks,
the loss. Nothing here is shared with the package's own network. A token is one joint at one time. Shapes: B windows,
T frames, J joints, N = T J tokens, n observed tokens, C channels.

What differs from the paper, and why:

- Time and joint are scaled to [0, 1] before they are coded, with standard deviations of their own. With integers and
  a standard deviation of 1, as in the released code, neighbouring frames have unrelated codes.
- The matrices of the codes are saved with the weights. The released code draws them again from a seed.
- The decoder has half of the channels and half of the layers, as the paper says. The released one has as many layers.
- Windows are centred on the mean of the observed hips, else of all observed joints. The paper's mid hip may be
  missing.
- Windows in which nothing is observed predict nothing.
- The learning rate is that of the released code, 1.5e-4 with a warm-up to 1e-5; the paper states 1e-5.
"""

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor, nn

from dmae.completion import fusion
from dmae.completion.config import PaperConfig, PaperNetwork, PaperSchedule
from dmae.completion.training_data import PosePair
from dmae.completion.weights import check_finite, pick_device
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.resume import claim_folder
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.data.store import write_atomic
from dmae.files.contents import read_bytes
from dmae.files.structured import read_json
from dmae.numerics.filling import present, resample
from dmae.progress import progress


class PaperRows(NamedTuple):
    """People one after another; windows do not reach from one to the next."""

    xyz: np.ndarray
    """(S, J, 3) m, world, NaN where unknown: what the encoder may look at, of all joints of the network."""
    truth: np.ndarray
    """(S, J, 3) m, world, NaN where unknown."""
    starts: np.ndarray
    """(W,) first rows of the windows."""


def make_rows(xyz: np.ndarray, truth: np.ndarray, frames: int) -> PaperRows:
    """Return the rows of one recording, (F, P, J, 3) each; windows without a known joint are left out."""
    count, people = xyz.shape[:2]
    if count < frames:
        pad = ((0, frames - count), (0, 0), (0, 0), (0, 0))
        xyz, truth = (np.pad(part, pad, constant_values=np.nan) for part in (xyz, truth))
        count = frames
    xyz, truth = (part.swapaxes(0, 1).reshape(people * count, *part.shape[2:]) for part in (xyz, truth))
    known = (~np.isnan(xyz).any(-1)).any(-1) & (~np.isnan(truth).any(-1)).any(-1)
    first = np.arange(count - frames + 1)
    starts = (np.arange(people)[:, None] * count + first).ravel()
    holds = np.concatenate([[0], np.cumsum(known)])
    return PaperRows(xyz.astype(np.float32), truth.astype(np.float32), starts[holds[starts + frames] > holds[starts]])


def join_rows(parts: list[PaperRows]) -> PaperRows:
    """Return the rows of several recordings."""
    offsets = np.cumsum([0, *(len(part.xyz) for part in parts[:-1])])
    starts = [part.starts + offset for part, offset in zip(parts, offsets, strict=True)]
    xyz, truth = (np.concatenate([getattr(part, name) for part in parts]) for name in ("xyz", "truth"))
    return PaperRows(xyz, truth, np.concatenate(starts))


def cut(rows: PaperRows, starts: np.ndarray, frames: int) -> tuple[Tensor, Tensor]:
    """Return what may be observed and the truth in windows, (B, T, J, 3) m each, NaN where unknown."""
    index = starts[:, None] + np.arange(frames)
    return torch.from_numpy(rows.xyz[index]), torch.from_numpy(rows.truth[index])


def centre(x: Tensor, observed: Tensor, hips: list[int]) -> Tensor:
    """Return the middle of each window's person, (B, 1, 1, 3) m: the mean of observed hips, else of observed joints.

    Args:
        x: (B, T, J, 3) m; not read where `observed` (B, T, J) is False.
        hips: Indices of the hips.
    """
    places, counts = torch.where(observed[..., None], x, 0), observed[..., None].float()

    def mean(joints: slice | list[int]) -> tuple[Tensor, Tensor]:
        count = counts[:, :, joints].sum((1, 2), keepdim=True)
        return places[:, :, joints].sum((1, 2), keepdim=True) / count.clamp(min=1), count

    (middle, known), (everything, _) = mean(hips), mean(slice(None))
    return torch.where(known > 0, middle, everything)


def rotate(x: Tensor, generator: torch.Generator) -> Tensor:
    """Return windows (B, T, J, 3), each rotated about the vertical by a random angle."""
    angle = 2 * torch.pi * torch.rand(len(x), generator=generator)
    cosine, sine, zero = angle.cos(), angle.sin(), torch.zeros_like(angle)
    turn = torch.stack([cosine, -sine, zero, sine, cosine, zero, zero, zero, zero + 1], -1).view(-1, 3, 3)
    return torch.einsum("bij,btkj->btki", turn, x)


def hips_of(skeleton: Skeleton) -> list[int]:
    """Return the indices of the hips of the first of two skeletons."""
    source = skeleton.parts[0]
    return [i for i, joint in enumerate(source.joints) if joint in ("mid_hip", "l_hip", "r_hip")]


def measured_coordinates(poses: Poses3D) -> np.ndarray:
    """Return coordinates of measured joints, NaN elsewhere."""
    return np.where((poses.measured & np.isfinite(poses.xyz).all(-1))[..., None], poses.xyz, np.nan)


# The network.


class GaussianFourierCode(nn.Module):
    """γ(x) = [cos 2πBx, sin 2πBx] of x (..., D), with a fixed Gaussian matrix B (C / 2, D)."""

    def __init__(self, inputs: int, channels: int, sigma: float):
        super().__init__()
        self.register_buffer("B", torch.randn(channels // 2, inputs) * sigma)

    def forward(self, x: Tensor) -> Tensor:
        phase = 2 * math.pi * x @ self.B.T
        return torch.cat([phase.cos(), phase.sin()], -1)


class JointTimeCode(nn.Module):
    """γc(j) + γc(t), the context code of each token, (N, C)."""

    def __init__(self, network: PaperNetwork, joints: int, channels: int):
        super().__init__()
        self.joint = GaussianFourierCode(1, channels, network.joint_sigma)
        self.time = GaussianFourierCode(1, channels, network.time_sigma)
        times, numbers = torch.linspace(0, 1, network.frames), torch.linspace(0, 1, joints)
        self.register_buffer("t", times.repeat_interleave(joints)[:, None], persistent=False)
        self.register_buffer("j", numbers.repeat(network.frames)[:, None], persistent=False)

    def forward(self) -> Tensor:
        return self.joint(self.j) + self.time(self.t)


class Layer(nn.Module):
    """A transformer layer: attention over tokens, then a perceptron, both after a norm and added."""

    def __init__(self, dim: int, heads: int, head_dim: int, mlp: int, dropout: float):
        super().__init__()
        self.heads, self.dropout = heads, nn.Dropout(dropout)
        self.first, self.second = nn.LayerNorm(dim), nn.LayerNorm(dim)
        self.qkv = nn.Linear(dim, 3 * heads * head_dim, bias=False)
        self.out = nn.Linear(heads * head_dim, dim)
        self.mlp = nn.Sequential(nn.Linear(dim, mlp), nn.GELU(), nn.Dropout(dropout), nn.Linear(mlp, dim))

    def forward(self, x: Tensor, keys: Tensor | None = None) -> Tensor:
        """x (B, n, C); `keys` (B, n) True for the tokens that are attended to, None for all."""
        batch, count, _ = x.shape
        q, k, v = self.qkv(self.first(x)).view(batch, count, 3, self.heads, -1).permute(2, 0, 3, 1, 4)
        mask = None if keys is None else keys[:, None, None, :]
        attended = F.scaled_dot_product_attention(q, k, v, attn_mask=mask).transpose(1, 2).reshape(batch, count, -1)
        x = x + self.dropout(self.out(attended))
        return x + self.dropout(self.mlp(self.second(x)))


class PaperDMAE(nn.Module):
    """Predicts the coordinates of all joints in a window from those observed.

    Args:
        network: Sizes.
        joints: Of the source and the target skeleton together, so that a pretrained network has codes for joints that
            fine-tuning adds.
    """

    def __init__(self, network: PaperNetwork, joints: int):
        super().__init__()
        self.network, self.joints = network, joints
        dim, half = network.dim, network.dim // 2
        self.signal = GaussianFourierCode(3, dim, network.signal_sigma)
        self.embed = nn.Linear(dim, dim)
        self.encoder_context = JointTimeCode(network, joints, dim)
        self.encoder = nn.ModuleList(
            Layer(dim, network.heads, network.head_dim, network.mlp, network.dropout) for _ in range(network.depth)
        )
        self.encoder_norm = nn.LayerNorm(dim)
        self.narrow = nn.Linear(dim, half)
        self.mask_token = nn.Parameter(torch.randn(half) * 0.02)
        self.decoder_context = JointTimeCode(network, joints, half)
        self.decoder = nn.ModuleList(
            Layer(half, network.heads, network.head_dim // 2, network.mlp // 2, network.dropout)
            for _ in range(network.depth // 2)
        )
        self.decoder_norm = nn.LayerNorm(half)
        self.head = nn.Linear(half, 3)

    def forward(self, x: Tensor, observed: Tensor, asked: int | None = None) -> Tensor:
        """Return the coordinates of every joint, (B, T, J, 3) m.

        Args:
            x: (B, T, J, 3) m; not read where `observed` is False.
            observed: (B, T, J) True where the encoder may look.
            asked: Number of joints, from the first, that have tokens in the decoder, as in pretraining; None for all.
        """
        shape, seen = observed.shape, observed.flatten(1)
        # Only observed tokens are encoded: they are gathered, to the largest number in the batch.
        most = max(1, int(seen.sum(1).max()))
        index = torch.argsort(seen.byte(), dim=1, descending=True, stable=True)[:, :most]
        valid = seen.gather(1, index)
        keys = None if bool(valid.all()) else valid | ~valid.any(1, keepdim=True)
        places = x.flatten(1, 2).gather(1, index[..., None].expand(-1, -1, 3))
        tokens = self.embed(self.signal(torch.where(valid[..., None], places, 0))) + self.encoder_context()[index]
        for layer in self.encoder:
            tokens = layer(tokens, keys)
        tokens = torch.where(valid[..., None], self.narrow(self.encoder_norm(tokens)), 0)
        # The decoder has all tokens: encoded ones where joints are observed, the mask token elsewhere.
        encoded = tokens.new_zeros(*seen.shape, tokens.shape[-1])
        encoded = encoded.scatter_add(1, index[..., None].expand_as(tokens), tokens)
        tokens = torch.where(seen[..., None], encoded, self.mask_token) + self.decoder_context()
        if asked is not None:
            tokens = tokens.unflatten(1, shape[1:])[:, :, :asked].flatten(1, 2)
        for layer in self.decoder:
            tokens = layer(tokens)
        return self.head(self.decoder_norm(tokens)).unflatten(1, (shape[1], -1))


def dual_masks(shape: tuple[int, int, int], schedule: PaperSchedule, generator: torch.Generator) -> Tensor:
    """Return (B, T, J) True where a token is masked: a share of the joints, and all joints of a share of the frames."""
    joints = torch.rand(shape, generator=generator) < schedule.mask_joints
    return joints | (torch.rand((*shape[:2], 1), generator=generator) < schedule.mask_frames)


def masked_mse(predicted: Tensor, truth: Tensor, counted: Tensor) -> Tensor:
    """Return the mean squared error of the counted tokens, m^2; (B, T, J, 3) and (B, T, J)."""
    squared = (predicted - truth).square().sum(-1)
    return (squared * counted).sum() / counted.sum().clamp(min=1)


def learning_rate(step: int, steps: int, schedule: PaperSchedule) -> float:
    """Return the learning rate of a step: a linear rise, then a cosine to `least_lr`."""
    rise = max(1, round(schedule.warmup * steps))
    if step < rise:
        return schedule.lr * (step + 1) / rise
    done = (step - rise) / max(1, steps - rise)
    return schedule.least_lr + (schedule.lr - schedule.least_lr) * 0.5 * (1 + math.cos(math.pi * min(done, 1)))


# Training as in the paper: pretrained on true poses of one skeleton, then tuned on annotations of another.

SKELETON = "body21+shelf14"
"""The skeleton for pretraining, and the one with the joints that fine-tuning adds."""
FORMAT = 1
FILE = "paper.json"
"""Description of the network, in the folder of its `weights.safetensors`."""
_SAVED = 500
"""Steps between two checkpoints."""


def pretrain(truths: Iterable[tuple[Poses3D, float]], config: PaperConfig, out: Path) -> Path:
    """Pretrain the network on true poses, or resume; masked joints of the first skeleton are predicted.

    Args:
        truths: Poses on the first skeleton of `SKELETON`, and their frames per second.
        config: Sizes and schedule.
        out: Folder of `paper.json`, `weights.safetensors` and a checkpoint.

    Returns:
        The folder.

    Raises:
        ValueError: there are no windows, the folder holds another training, or the loss is not finite.
    """
    skeleton, network = get_skeleton(SKELETON), config.network
    parts = []
    for poses, fps in truths:
        xyz = resample(poses, fps, network.fps).xyz
        added = np.full((*xyz.shape[:2], len(skeleton.parts[1]), 3), np.nan)
        both = np.concatenate([xyz, added], 2)
        parts.append(make_rows(both, both, network.frames))
    rows = _joined(parts)
    steps = config.schedule.steps or config.schedule.epochs * _batches(rows, config.schedule)
    model = _new(config, skeleton)
    record = {"stage": "pretrained", "windows": len(rows.starts), "steps": steps}
    return _learn(model, rows, config, steps, out, record, skeleton, tuning=False)


def fine_tune(init: Path, pairs: Iterable[PosePair], config: PaperConfig, out: Path) -> Path:
    """Tune a pretrained network: the second skeleton's joints are predicted from part of the first's, or resume.

    All joints of the second skeleton are masked, and part of those of the first; only the second is supervised, where
    it is annotated.

    Args:
        init: Folder that `pretrain` wrote.
        pairs: At the network's rate: true poses on both skeletons, captured ones on the first.
        config: Its schedule; the sizes are those of `init`.
        out: Folder, as in `pretrain`.

    Raises:
        FileNotFoundError: there is no model in `init`.
        ValueError: as in `pretrain`, or a pair has no captured poses.
    """
    model, record = load_paper(init)
    skeleton = get_skeleton(SKELETON)
    parts = []
    for pair in pairs:
        if pair.captured is None:
            raise ValueError("fine-tuning learns from captured poses; this clip has none: capture it first")
        hidden = np.full((*pair.captured.xyz.shape[:2], len(skeleton.parts[1]), 3), np.nan)
        parts.append(make_rows(np.concatenate([pair.captured.xyz, hidden], 2), pair.truth.xyz, model.network.frames))
    rows = _joined(parts)
    steps = config.schedule.tuning_epochs * _batches(rows, config.schedule)
    about = {"stage": "tuned", "windows": len(rows.starts), "steps": steps, "init": record["sha256"]}
    return _learn(model, rows, config, steps, out, about, skeleton, tuning=True)


def load_paper(folder: Path) -> tuple[PaperDMAE, dict]:
    """Return a network in evaluation mode on the CPU, and the contents of `paper.json`.

    Raises:
        FileNotFoundError: there is none in the folder.
        ValueError: its files are malformed, damaged, or of another version.
    """
    described, path = Path(folder) / FILE, Path(folder) / "weights.safetensors"
    if not described.is_file() or not path.is_file():
        raise FileNotFoundError(f"{folder}: expected {FILE} and weights.safetensors, as dmae train-paper writes them")
    record, data = read_json(described), read_bytes(path)
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise ValueError(f"{described}: expected a model of format {FORMAT}; train it again")
    if hashlib.sha256(data).hexdigest() != record.get("sha256"):
        raise ValueError(f"{path}: does not match the checksum in {FILE}; the weights are damaged, train again")
    try:
        network, tensors = PaperNetwork(**record["network"]), load_tensors(data)
        with torch.device("meta"):
            wanted = PaperDMAE(network, len(get_skeleton(record["skeleton"]))).state_dict()
        if {name: each.shape for name, each in wanted.items()} != {name: each.shape for name, each in tensors.items()}:
            raise ValueError("the weights are of other sizes than the network")
        model = PaperDMAE(network, len(get_skeleton(record["skeleton"])))
        model.load_state_dict(tensors)
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError, OverflowError, SafetensorError) as error:
        raise ValueError(f"{folder}: not a model of this version of dmae: {error}") from None
    check_finite(tensors, f"{path} is of no use, train again")
    return model.eval(), record


def _new(config: PaperConfig, skeleton: Skeleton) -> PaperDMAE:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        return PaperDMAE(config.network, len(skeleton))


def _joined(parts: list[PaperRows]) -> PaperRows:
    if not sum(len(part.starts) for part in parts):
        raise ValueError("nothing to learn from: no clip has a person with known joints")
    return join_rows(parts)


def _batches(rows: PaperRows, schedule: PaperSchedule) -> int:
    return max(1, len(rows.starts) // schedule.batch)


def _learn(
    model: PaperDMAE,
    rows: PaperRows,
    config: PaperConfig,
    steps: int,
    out: Path,
    record: dict,
    skeleton: Skeleton,
    *,
    tuning: bool,
) -> Path:
    """Train and save. Each step's batch and masks follow from the seed and its number, so that a run can resume."""
    out, device = Path(out), pick_device("auto")
    digest = hashlib.sha256(rows.xyz.tobytes() + rows.truth.tobytes()).hexdigest()
    claim_folder(out / "training.json", asdict(config) | record | {"windows_sha256": digest}, "a model")
    if (out / FILE).is_file():
        return out
    model = model.to(device).train()
    optimizer = torch.optim.AdamW(
        model.parameters(), config.schedule.lr, betas=(0.9, 0.95), weight_decay=config.schedule.weight_decay
    )
    first, reached = _resume(out, model, optimizer), float("nan")
    for step in progress(range(first, steps), f"{record['stage'].removesuffix('ed')}ing", steps - first):
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(step, steps, config.schedule)
        loss = _loss(model, rows, config, step, skeleton, tuning=tuning)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        reached = float(loss.detach())
        if not math.isfinite(reached):
            raise ValueError(f"step {step}: the loss is {reached}; give a smaller learning rate, in another folder")
        if (step + 1) % _SAVED == 0:
            _save_checkpoint(out, model, optimizer, step + 1)
    state = {name: tensor.contiguous().cpu() for name, tensor in model.state_dict().items()}
    check_finite(state, "nothing was saved")
    data = save_tensors(state)
    about = {
        "format": FORMAT, "skeleton": skeleton.name, "network": asdict(model.network), **record,
        "last_loss_mm": None if math.isnan(reached) else round(1000 * reached**0.5, 1),
        "sha256": hashlib.sha256(data).hexdigest(),
    }  # fmt: skip
    write_atomic(out / "weights.safetensors", data)
    write_atomic(out / FILE, json.dumps(about, indent=1))
    return out


def _loss(
    model: PaperDMAE, rows: PaperRows, config: PaperConfig, step: int, skeleton: Skeleton, *, tuning: bool
) -> torch.Tensor:
    """Return the loss of the batch of a step."""
    device = next(model.parameters()).device
    rng = generator(config.seed, step, Stream.WINDOWS)
    chance = torch.Generator().manual_seed(int(rng.integers(2**62)))
    torch.manual_seed(int(rng.integers(2**62)))  # dropout
    source = len(skeleton.parts[0])
    xyz, truth = cut(rows, rng.choice(rows.starts, config.schedule.batch), model.network.frames)
    known, masked = ~torch.isnan(xyz).any(-1), dual_masks(xyz.shape[:3], config.schedule, chance)
    masked |= torch.arange(xyz.shape[2]) >= source
    observed = known & ~masked
    middle = centre(xyz, observed, hips_of(skeleton))
    both = rotate(torch.cat([xyz, truth], 1) - middle, chance).nan_to_num()
    x, target = both.split(xyz.shape[1], 1)
    counted = ~torch.isnan(truth).any(-1) & ~observed
    if tuning:
        counted[:, :, :source] = False
    x, target, observed, counted = (part.to(device) for part in (x, target, observed, counted))
    asked = None if tuning else source
    return masked_mse(model(x, observed, asked), target[:, :, :asked], counted[:, :, :asked])


def _save_checkpoint(out: Path, model: PaperDMAE, optimizer: torch.optim.Optimizer, step: int) -> None:
    partial = out / "checkpoint.partial"
    torch.save({"step": step, "model": model.state_dict(), "optimizer": optimizer.state_dict()}, partial)
    partial.replace(out / "checkpoint.pt")


def _resume(out: Path, model: PaperDMAE, optimizer: torch.optim.Optimizer) -> int:
    """Load the checkpoint, if there is one; return the step to go on from."""
    path = out / "checkpoint.pt"
    if not path.is_file():
        return 0
    state = torch.load(path, weights_only=True, map_location="cpu")
    model.load_state_dict(state["model"])
    optimizer.load_state_dict(state["optimizer"])
    return state["step"]


# Completion by this network alone: no interpolation, no features, no blending of windows, no fallback.

_BATCH = 64


@dataclass(frozen=True)
class PaperCompleter:
    """A callable of poses (F, P, J) and their frames per second that returns completed poses.

    Each frame is predicted once, from the window with this frame in the middle; at the ends of a recording from the
    first or the last window. A frame is completed if its person is present (`dmae.numerics.filling.present`) and its
    window contains a measurement. A pretrained network returns poses on its own skeleton, with measured joints as they
    were; a tuned one returns the skeleton that it was tuned on, with no measured joint. Covariances are unknown.

    Raises (when called):
        KeyError: the skeleton cannot be converted to that of the network.
    """

    model: PaperDMAE
    tuned: bool

    @property
    def source(self) -> Skeleton:
        """The skeleton of poses that are completed; others are converted."""
        return get_skeleton(SKELETON).parts[0]

    def __call__(self, poses: Poses3D, fps: float) -> Poses3D:
        poses = convert(poses.without(poses.source == Source.COMPLETED), self.source)
        rate = self.model.network.fps
        slow = poses if abs(rate / fps - 1) < 0.01 else resample(poses, fps, rate)
        predicted = self._predict(measured_coordinates(slow))
        if slow is not poses:
            predicted = _at_times(predicted, np.arange(len(poses.xyz)) * rate / fps)
        there = present(poses, fps) & ~np.isnan(predicted).any((2, 3))
        if self.tuned:
            target = get_skeleton(SKELETON).parts[1]
            return fusion.fused(poses, target, predicted[:, :, len(self.source) :], there)
        filled = (poses.source == Source.ABSENT) & there[..., None]
        xyz = np.where(filled[..., None], predicted[:, :, : len(self.source)], poses.xyz)
        return replace(poses, xyz=xyz, source=np.where(filled, Source.COMPLETED, poses.source))

    def _predict(self, xyz: np.ndarray) -> np.ndarray:
        """Return every joint (F, P, J, 3) m, world, NaN where a window holds no measurement; xyz has the source's."""
        network, joints = self.model.network, self.model.joints
        frames, people = xyz.shape[:2]
        length = max(frames, network.frames)
        padded = np.full((length, people, joints, 3), np.nan, np.float32)
        padded[:frames, :, : len(self.source)] = xyz
        first = np.clip(np.arange(frames) - network.frames // 2, 0, length - network.frames)
        places = [(person, frame) for person in range(people) for frame in range(frames)]
        found = np.full((frames, people, joints, 3), np.nan)
        asked = None if self.tuned else len(self.source)
        device = next(self.model.parameters()).device
        for begin in range(0, len(places), _BATCH):
            person, frame = np.array(places[begin : begin + _BATCH]).T
            index = first[frame][:, None] + np.arange(network.frames)
            x = torch.from_numpy(padded[index, person[:, None]])
            observed = ~torch.isnan(x).any(-1)
            middle = centre(x, observed, hips_of(get_skeleton(SKELETON)))
            with torch.inference_mode():
                done = self.model((x - middle).nan_to_num().to(device), observed.to(device), asked).cpu() + middle
            done = done[torch.arange(len(frame)), torch.from_numpy(frame - first[frame])].numpy()
            seen = observed.any(2).any(1).numpy()
            found[frame[seen], person[seen], : done.shape[1]] = done[seen]
        if asked is not None:
            # Joints of the second skeleton are not asked for; NaN would hide the others.
            found[:, :, asked:] = np.where(np.isnan(found[:, :, :1]), np.nan, 0)
        return found


def _at_times(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return (F, ...) at other times, in frames, by straight lines."""
    first = np.minimum(time.astype(int), len(values) - 1)
    second = np.minimum(first + 1, len(values) - 1)
    share = (time - first).clip(0, 1).reshape(-1, *[1] * (values.ndim - 1))
    return np.where(share > 0, values[first] * (1 - share) + values[second] * share, values[first])


def load_paper_completer(folder: Path, device: str = "auto") -> PaperCompleter:
    """Return the completer of a folder that `dmae train-paper` wrote; errors as in `load_paper`."""
    model, record = load_paper(folder)
    return PaperCompleter(model.to(pick_device(device)), record["stage"] == "tuned")
