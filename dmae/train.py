"""Learning to complete: D-MAE pretrained on poses, true or captured, of which a part is hidden."""

import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from datetime import timedelta
from pathlib import Path

import lightning
import numpy as np
import torch
from lightning.pytorch.callbacks import ModelCheckpoint, Timer
from lightning.pytorch.loggers import TensorBoardLogger

from dmae.calibrate import CLASSES, fit_factors
from dmae.callbacks import Average, Bar, quiet
from dmae.capture import capture
from dmae.clip import Clip
from dmae.complete import Completer
from dmae.data import subsets
from dmae.examples import Recipe, Recording, as_measured, record, validation_batches
from dmae.learner import Learner, TrainConfig
from dmae.model import DMAE
from dmae.progress import progress
from dmae.rng import Stream, generator
from dmae.skeleton import BODY25, Skeleton, get_skeleton
from dmae.store import read_json, write_atomic
from dmae.weights import load_model, save_model
from dmae.windows import rest_pose

_TWICE = "two clips are called {!r}; a model's record names what it learned from"
_BY = " by "
"""Between the name of a clip and the cameras that captured it."""


def train(
    config: TrainConfig, clips: Iterable[Clip], out: Path, unseen: Iterable[Clip] = (), also: Iterable[Clip] = ()
) -> Path:
    """Train a model, or carry on where training stopped.

    Leaves `weights.safetensors` and `model.json` (see `dmae.weights`), TensorBoard's logs, and a checkpoint
    from which the same command resumes; with `steps` alone the result is the same to the bit, on the same
    machine, as if it had never stopped. Sets torch's global seed.

    Args:
        clips: Clips with truth, in any skeleton that `dmae.mapping.convert` can turn into the wanted one.
            Those with `poses` are learned from as captured: with their holes and errors, and more holes.
        out: Folder.
        unseen: Clips to validate and calibrate on; by default some of `clips` are held back.
        also: Further clips, those that `config.replay` is of.

    Returns:
        The folder.

    Raises:
        FileNotFoundError: there is no model to begin with in the folder `config.init`.
        ValueError: a clip has no truth, there is nothing to learn from, the model to begin with is another, or the
            folder holds a model that was made, or begun, under another configuration or from other clips, or two
            clips have one id.
    """
    out = Path(out)
    begun_with = _begin(config)
    skeleton = begun_with[1] if begun_with else get_skeleton(config.skeleton or BODY25.name)
    if config.shown_weight and len(skeleton.parts) > 1:
        raise ValueError(f"shown_weight={config.shown_weight}: of {skeleton.name!r} no joint that is shown is taught")
    recordings, replayed, held_back = (_read(found, skeleton, config) for found in (clips, also, unseen))
    twice = sorted(recordings.keys() & replayed.keys())
    if twice:
        raise ValueError(_TWICE.format(twice[0]))
    if not recordings:
        raise ValueError(f"{config.data.path}: nothing to learn from, no clip has a person in it")
    held_back = {f"unseen {name}": found for name, found in held_back.items()}
    _claim(out, config, skeleton, begun_with and begun_with[2], recordings | replayed | held_back)
    if (out / "model.json").is_file():
        return out

    if config.replay is None:
        recordings, replayed = recordings | replayed, {}
    if not held_back:
        whole = recordings if config.replay is None else replayed
        held_back = {name: whole.pop(name) for name in _held_back(list(whole), config)}
    training = list(recordings.values())
    torch.manual_seed(config.seed)
    if begun_with:
        model, _, record = begun_with
        model.train()
        rest = model.rest.numpy().astype(np.float64)
    else:
        model, record = DMAE(config.model, len(skeleton)), {"calibration": None}
        found = (*training, *replayed.values())
        bodies = np.concatenate([recording.truth.xyz.reshape(-1, len(skeleton), 3) for recording in found])
        source, *target = skeleton.parts
        if np.isnan(bodies[:, : len(source)]).all():
            raise ValueError(
                f"{config.data.path}: truth on {target[0].name!r} alone does not teach what {source.name!r} looks "
                "like; begin with a model (init=...), or learn from simulated clips as well (also=[...])"
            )
        rest = rest_pose(bodies, skeleton)
        model.rest.copy_(torch.from_numpy(rest))
    recipe = Recipe(config.model, rest, config.hiding, config.augment)
    validation = validation_batches(list(held_back.values()), recipe, seed=config.seed, batch=256)
    limit = None if config.max_minutes is None else timedelta(minutes=config.max_minutes)
    timer = Timer(limit, interval="step", verbose=False)
    learner = Learner(model, config, training, list(replayed.values()), recipe, validation, timer)
    checkpoint = ModelCheckpoint(out, "checkpoint", every_n_epochs=1, enable_version_counter=False)
    with quiet():
        trainer = lightning.Trainer(
            max_steps=config.steps,
            max_epochs=-1,
            gradient_clip_val=config.clip,
            callbacks=[timer, checkpoint, Average(config.average), Bar()],
            logger=TensorBoardLogger(out, name="", version="tensorboard"),
            default_root_dir=out,
            log_every_n_steps=min(10, config.epoch),
            num_sanity_val_steps=0,
            limit_val_batches=1.0 if validation else 0,
            reload_dataloaders_every_n_epochs=1,
            enable_progress_bar=False,
            enable_model_summary=False,
        )
        begun = out / "checkpoint.ckpt"
        trainer.fit(learner, ckpt_path=begun if begun.is_file() else None, weights_only=True)
        scores = trainer.validate(learner, verbose=False)[0] if validation else {}
    if trainer.is_global_zero:
        stated = Completer(learner.model.eval(), skeleton, learner.device, factors=((1.0,) * CLASSES,) * 2)
        measured = as_measured(list(held_back.values()), recipe, seed=config.seed)
        facts = {
            "calibration": fit_factors(stated, measured, config.model.fps) or record["calibration"],
            "denoises": config.shown_weight > 0,
            "init": begun_with and {"path": config.init, "sha256": record["sha256"]},
            "clips": len(training) + len(replayed),
            "frames": config.data.frames,
            "validation_clips": list(held_back),
            "steps": trainer.global_step,
            **scores,
        }
        save_model(learner.model, skeleton, out, facts)
    return out


def _begin(config: TrainConfig) -> tuple[DMAE, Skeleton, dict] | None:
    """The model to begin with, its skeleton and its record."""
    if config.init is None:
        return None
    model, skeleton, record = load_model(Path(config.init))
    if config.skeleton not in (None, skeleton.name):
        raise ValueError(f"{config.init}: a model of skeleton {skeleton.name!r}, and skeleton={config.skeleton}")
    wanted, found = asdict(config.model), asdict(model.config)
    differing = ", ".join(f"model.{key}={found[key]}" for key in found if found[key] != wanted[key])
    if differing:
        raise ValueError(f"{config.init}: a network of another build; to begin with it, give {differing}")
    return model, skeleton, record


def _read(clips: Iterable[Clip], skeleton: Skeleton, config: TrainConfig) -> dict[str, Recording]:
    """What there is to learn from, by the names of the clips; those without people are left out."""
    found = {}
    for clip in progress(_captured(clips, skeleton, config), "reading"):
        if clip.id in found:
            raise ValueError(_TWICE.format(clip.id))
        found[clip.id] = record(clip, skeleton, config.model.fps)
    return {name: recording for name, recording in found.items() if not np.isnan(recording.truth.xyz).all()}


def _captured(clips: Iterable[Clip], skeleton: Skeleton, config: TrainConfig) -> Iterator[Clip]:
    """The clips, those without poses captured if that is asked for, or their truth alone is not enough."""
    for clip in clips:
        lacking = clip.truth is not None and clip.truth.skeleton in skeleton.parts[1:]
        if clip.poses is not None or not (config.views or lacking):
            yield clip
            continue
        for cameras in subsets(clip, config.views):
            part = clip.select(views=cameras)
            yield replace(part, id=f"{clip.id}{_BY}{cameras}", poses=capture(part, config.capture))


def _held_back(names: list[str], config: TrainConfig) -> list[str]:
    """The clips to validate on: whole clips, through all their cameras, so that no motion is on both sides."""
    clips = sorted({name.partition(_BY)[0] for name in names})
    if len(clips) < 2 or config.validation == 0:
        return []
    count = min(max(1, round(config.validation * len(clips))), len(clips) - 1)
    chosen = generator(config.seed, len(clips), Stream.VALIDATION).choice(clips, count, replace=False).tolist()
    return sorted(name for name in names if name.partition(_BY)[0] in chosen)


def _claim(
    out: Path, config: TrainConfig, skeleton: Skeleton, init: dict | None, recordings: dict[str, Recording]
) -> None:
    """Write down what this folder's model is made of, or compare with what is written there."""
    wanted = json.loads(json.dumps(asdict(config)))
    for name in ("out", "data", "also", "unseen", "workers", "views", "capture"):
        del wanted[name]
    wanted |= {"skeleton": skeleton.name, "lr": config.peak, "init": init and init["sha256"]}
    wanted["clips"] = {name: _digest(found) for name, found in recordings.items()}
    path = out / "training.json"
    if not path.is_file():
        write_atomic(path, json.dumps(wanted, indent=1))
        return
    found = read_json(path)
    differing = sorted(key for key in wanted | found if wanted.get(key) != found.get(key))
    if differing:
        raise ValueError(
            f"{out}: holds a model trained, or begun, otherwise: {path.name} differs in {', '.join(differing)}. "
            "Choose another folder, or remove this one"
        )


def _digest(recording: Recording) -> str:
    arrays = [poses.xyz for poses in (recording.truth, recording.captured) if poses]
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
