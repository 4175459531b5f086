"""Training: D-MAE learns to predict joints that are masked in true or captured poses."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import lightning
import numpy as np
import torch
from lightning.pytorch.callbacks import ModelCheckpoint, Timer
from lightning.pytorch.loggers import TensorBoardLogger

from dmae.completion.completer import Completer
from dmae.completion.network.build import build_network
from dmae.completion.network.paper import DMAE
from dmae.completion.normalisation import rest_pose
from dmae.completion.training.batches import calibration_poses, validation_batches
from dmae.completion.training.callbacks import (
    STEPS,
    AverageWeights,
    ReportSteps,
    ShowProgress,
    StopInTime,
    errors_of_processes,
    quiet_lightning,
    strategy_of,
)
from dmae.completion.training.checkpoints import CHECKPOINT, CheckedCheckpoints, newest_checkpoint
from dmae.completion.training.config import Precision, TrainConfig
from dmae.completion.training.examples import Examples, Recipe
from dmae.completion.training.learner import Learner
from dmae.completion.training.pose_pairs import PosePair
from dmae.completion.training.reading import TrainingSet, read_training_set, split
from dmae.completion.training.time_limit import TimeLimit
from dmae.completion.training.uncertainty_fitting import fit_factors
from dmae.completion.uncertainty import CLASSES
from dmae.completion.weights import OF_PEOPLE, find_shipped, load_model, save_model
from dmae.data.clip import Clip
from dmae.data.resume import claim_folder
from dmae.data.skeleton import BODY25, Skeleton, encode, get_skeleton

_PRECISION = {Precision.single: "32-true", Precision.bf16: "bf16-mixed"}
_QUIET = {"enable_progress_bar": False, "enable_model_summary": False}
_ONES = ((1.0,) * CLASSES,) * 2
"""Factors of uncertainty that change nothing."""


def train(
    config: TrainConfig,
    clips: Iterable[Clip],
    out: Path,
    validation_clips: Iterable[Clip] = (),
    extra_clips: Iterable[Clip] = (),
    *,
    since: float | None = None,
) -> Path:
    """Train a model, or resume where training stopped.

    Writes `weights.safetensors` and `model.json` (see `dmae.completion.weights`), TensorBoard's logs, and a checkpoint
    from which the same command resumes. Without `max_minutes` the result is the same to the bit, on the same machine,
    as if it had never stopped. Sets torch's global seed.

    Args:
        clips: Clips with truth, in any skeleton that `dmae.data.conversion.convert` can turn into the
            wanted one. From those with `poses` a model learns captured poses: with their gaps and errors, and more
            joints masked.
        out: Folder.
        validation_clips: Clips to validate and calibrate on; by default some of `clips` are held back.
        extra_clips: Further clips, those that `examples.replay` is a share of.
        since: When `config.max_minutes` began, by `time.monotonic`; by default now.

    Returns:
        The folder.

    Raises:
        FileNotFoundError: there is no model in the folder `config.init`.
        ValueError: a clip has no truth, there is nothing to learn from, the model of `config.init` is different, two
            clips have one id, or the folder holds a model of another configuration or of other clips, or checkpoints
            that are damaged; or the loss is not finite, or a clip's truth or poses are infinite.
    """
    out, limit = Path(out), TimeLimit(config.max_minutes, since)
    initial = _load_initial(config)
    skeleton = initial[1] if initial else get_skeleton(config.skeleton or BODY25.name)
    lacking = OF_PEOPLE - set(skeleton.parts[0].joints)
    if skeleton.defined and lacking:
        raise ValueError(
            f"skeleton={config.skeleton}: the network places bodies by hips and shoulders; {skeleton.name!r} lacks "
            f"{', '.join(sorted(lacking))}. Methods that need no training fill any skeleton: fill=gaussian_process"
        )
    weight = config.learning.observed_weight
    if weight and len(skeleton.parts) > 1:
        raise ValueError(f"learning.observed_weight={weight}: {skeleton.name!r} has no observed joint to learn")
    found = read_training_set(clips, extra_clips, validation_clips, skeleton, config)
    _claim(out, config, skeleton, initial and initial[2], found.all)
    if (out / "model.json").is_file():
        return out

    found = split(found, config.examples, seed=config.seed)
    torch.manual_seed(config.seed)
    if initial:
        model, _, record = initial
        model.train()
        rest = model.rest.numpy().astype(np.float64)
    else:
        model, record = build_network(config.model, len(skeleton)), {"calibration": None}
        rest = _rest_pose(found, skeleton, config)
        model.rest.copy_(torch.from_numpy(rest))
    recipe = Recipe(config.model, rest, config.examples.masking, config.examples.augment)
    held_back = list(found.validation.values())
    validation = validation_batches(held_back, recipe, seed=config.seed, batch=256)
    _reserve_time(limit, model, skeleton, validation, held_back, recipe)
    timer = Timer(None, interval="step", verbose=False)
    pairs, extra = list(found.pairs.values()), list(found.extra.values())
    learner = Learner(model, config, pairs, extra, recipe, validation, timer, limit)
    steps, scores = _fit(learner, config, out)
    if learner.trainer.is_global_zero:
        stated = Completer(learner.model.eval(), skeleton, factors=_ONES)
        measured = limit.while_left(calibration_poses(held_back, recipe, seed=config.seed))
        facts = {
            "calibration": fit_factors(stated, measured, config.model.fps) or record["calibration"],
            "denoises": weight > 0,
            "init": initial and {"path": config.init, "sha256": record["sha256"]},
            "clips": len(pairs) + len(extra),
            "frames": config.data.frames,
            "validation_clips": list(found.validation),
            "steps": steps,
            **scores,
        }
        save_model(learner.model, skeleton, out, facts)
    return out


def _fit(learner: Learner, config: TrainConfig, out: Path) -> tuple[int, dict[str, float]]:
    """Train the learner, from the checkpoint in the folder if there is one; return its steps and validation scores."""
    learning, checkpoint = config.learning, newest_checkpoint(out)
    with quiet_lightning():
        trainer = lightning.Trainer(
            devices=learning.devices,
            strategy=strategy_of(learning.devices),
            precision=_PRECISION[learning.precision],
            use_distributed_sampler=False,
            max_steps=learning.steps,
            max_epochs=-1,
            gradient_clip_val=learning.max_gradient,
            callbacks=[
                learner.timer,
                StopInTime(learner.limit),
                ModelCheckpoint(out, Path(CHECKPOINT).stem, every_n_epochs=1, enable_version_counter=False),
                AverageWeights(learning.average),
                ShowProgress(),
                ReportSteps(),
            ],
            plugins=[CheckedCheckpoints()],
            logger=TensorBoardLogger(out, name="", version="tensorboard"),
            default_root_dir=out,
            log_every_n_steps=min(10, learning.epoch),
            num_sanity_val_steps=0,
            limit_val_batches=1.0 if learner.validation else 0,
            reload_dataloaders_every_n_epochs=1,
            **_QUIET,
        )
        with errors_of_processes():
            trainer.fit(learner, ckpt_path=checkpoint, weights_only=True)
        steps = int(trainer.callback_metrics[STEPS])
        if learning.devices > 1 or learning.precision != Precision.single:
            # The weights are used by one process, in single precision.
            trainer = lightning.Trainer(devices=1, logger=False, **_QUIET)
        scores = trainer.validate(learner, verbose=False)[0] if learner.validation else {}
    return steps, scores


def _reserve_time(
    limit: TimeLimit,
    model: DMAE,
    skeleton: Skeleton,
    validation: list[Examples],
    held_back: list[PosePair],
    recipe: Recipe,
) -> None:
    """Reserve time for validation, which is done twice after training, and for calibration, by trying both."""
    if not limit.limited or not validation:
        return
    model.eval()
    stated = Completer(model, skeleton, factors=_ONES)
    measured = [poses for poses, _ in calibration_poses(held_back[:1], recipe, seed=0)]
    with torch.inference_mode():
        limit.reserve(
            (lambda: model(*validation[0].windows), 2 * len(validation)),
            (lambda: stated(measured[-1], recipe.model.fps), len(measured) * len(held_back)),
        )
    model.train()


def _rest_pose(found: TrainingSet, skeleton: Skeleton, config: TrainConfig) -> np.ndarray:
    """Return the rest pose (J, 3) of all people to learn from."""
    pairs = (*found.pairs.values(), *found.extra.values())
    bodies = np.concatenate([pair.truth.xyz.reshape(-1, len(skeleton), 3) for pair in pairs])
    source, *target = skeleton.parts
    if np.isnan(bodies[:, : len(source)]).all():
        raise ValueError(
            f"{config.data.path}: truth on {target[0].name!r} alone does not teach what {source.name!r} looks "
            "like; start from a model (init=...), or add simulated clips (extra_data=[...])"
        )
    return rest_pose(bodies, skeleton)


def _load_initial(config: TrainConfig) -> tuple[DMAE, Skeleton, dict] | None:
    """Return the model to start from, its skeleton and its record."""
    if config.init is None:
        return None
    shipped = config.init == "shipped"
    folder = find_shipped(get_skeleton(config.skeleton or BODY25.name)) if shipped else Path(config.init)
    model, skeleton, record = load_model(folder)
    if config.skeleton is not None and get_skeleton(config.skeleton) != skeleton:
        raise ValueError(f"{config.init}: a model of skeleton {skeleton.name!r}, and skeleton={config.skeleton}")
    wanted, found = (_flat(asdict(options), "model.") for options in (config.model, model.config))
    differing = ", ".join(f"{name}={value}" for name, value in found.items() if value != wanted[name])
    if differing:
        raise ValueError(f"{config.init}: a network of other sizes; to start from it, give {differing}")
    return model, skeleton, record


def _flat(options: dict, prefix: str) -> dict:
    """Return nested options by their dotted names."""
    flat = {}
    for name, value in options.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat


def _claim(out: Path, config: TrainConfig, skeleton: Skeleton, init: dict | None, pairs: dict[str, PosePair]) -> None:
    """Write what this folder's model is made of to `training.json`, or compare with what is written there."""
    wanted = json.loads(json.dumps(asdict(config)))
    for name in ("out", "data", "extra_data", "validation_data", "capture"):
        del wanted[name]
    for name in ("workers", "views", "damaged"):
        del wanted["examples"][name]
    wanted["learning"]["lr"] = config.peak_lr
    del wanted["learning"]["devices"]
    if config.learning.precision == Precision.single:
        # As models made before there was a choice.
        del wanted["learning"]["precision"]
    wanted |= {"skeleton": encode(skeleton), "init": init and init["sha256"]}
    wanted["clips"] = {name: _digest(pair) for name, pair in pairs.items()}
    claim_folder(out / "training.json", wanted, "a model")


def _digest(pair: PosePair) -> str:
    arrays = [poses.xyz for poses in (pair.truth, pair.captured) if poses]
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
