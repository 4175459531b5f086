"""Speed of reading windows, compared with the speed at which training uses them: `python -m tests.endurance.loaders`.

All in processor time of one thread, in the same run. Training takes the batches of `dmae train`, with its default
network: forward, backward and a step of the optimiser.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from dmae.completion.config import AugmentConfig, TrainConfig
from dmae.completion.network import DMAE
from dmae.completion.training_data import PosePair, Recipe, TrainingBatches
from dmae.data.store import save_clip, write_manifest
from dmae.datasets import WindowDataset
from tests.support.stressed_clips import strollers

_CLIPS, _FRAMES, _STEPS = 24, 200, 30


def rates(folder: Path) -> dict[str, float]:
    """Return windows a second of processor time: read from disk, made into batches, and taken by training."""
    torch.set_num_threads(1)
    config, clip = TrainConfig(), strollers(_FRAMES, persons=2)
    for number in range(_CLIPS):
        save_clip(clip, folder / f"{number:06d}")
    write_manifest(folder, [{"id": f"{number:06d}", "status": "ok"} for number in range(_CLIPS)])
    windows = WindowDataset(folder, frames=config.model.frames, every=config.model.frames // 2)
    order = np.random.default_rng(0).permutation(len(windows))[: 16 * _STEPS].tolist()
    read = len(order) / _seconds(lambda: [windows[index] for index in order])

    network, batch = DMAE(config.model, len(clip.truth.skeleton)), config.learning.batch
    recipe = Recipe(config.model, network.rest.numpy().astype(float), config.examples.masking, AugmentConfig())
    made: list = []

    def make() -> None:
        options = {"seed": 0, "epoch": 0, "steps": _STEPS, "batch": batch}
        batches = TrainingBatches([(1.0, [PosePair(clip.truth)])], recipe, **options)
        made.extend(batches[step] for step in range(_STEPS))

    batched = batch * _STEPS / _seconds(make)
    optimizer = torch.optim.AdamW(network.parameters(), 1e-3)

    def take() -> None:
        for examples in made[:_STEPS]:
            predicted = network(*examples.windows)
            loss = (predicted.xyz - examples.truth).square().mean() + predicted.log_scale.square().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()

    return {"read": read, "made": batched, "taken": batch * _STEPS / _seconds(take)}


def _seconds(function: Callable[[], object]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="JSON file of the figures")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = rates(Path(folder))
    found |= {"read_to_taken": found["read"] / found["taken"], "made_to_taken": found["made"] / found["taken"]}
    print(found)
    if asked.out:
        made = {"command": "python -m tests.endurance.loaders", "found": found}
        Path(asked.out).write_text(json.dumps(made, indent=1) + "\n")


if __name__ == "__main__":
    main()
