"""Training as in the paper: pretrained on true poses of one skeleton, then tuned on annotations of another."""

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors

from dmae.completion.paper.config import PaperConfig, PaperNetwork, PaperSchedule
from dmae.completion.paper.network import PaperDMAE, dual_masks, learning_rate, masked_mse
from dmae.completion.paper.windows import PaperRows, centre, cut, hips_of, join_rows, make_rows, rotate
from dmae.completion.training.pose_pairs import PosePair
from dmae.completion.weights import check_finite, pick_device
from dmae.data.clip import Poses3D
from dmae.data.resume import claim_folder
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.files.contents import read_bytes, write_atomic
from dmae.files.structured import read_json
from dmae.numerics.filling import resample
from dmae.progress import progress

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
