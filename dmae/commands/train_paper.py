"""`dmae train-paper`: the network of the paper alone, by its own recipe."""

from dataclasses import replace
from pathlib import Path

from dmae.commands.config import TrainPaperCommand
from dmae.completion.config import SIZES
from dmae.formats.reading import DataConfig, load
from dmae.progress import progress


def run(config: TrainPaperCommand, out: Path) -> None:
    # Torch is loaded for training only, not to list options.
    from dmae.completion.paper import SKELETON, fine_tune, pretrain
    from dmae.completion.training_data import pose_pair
    from dmae.data.conversion import convert
    from dmae.data.skeleton import get_skeleton
    from dmae.formats.reading import camera_subsets
    from dmae.reconstruction.pipeline import capture

    size, skeleton = SIZES[config.size], get_skeleton(SKELETON)
    given = {"steps": config.steps, "tuning_epochs": config.tuning_epochs, "batch": config.batch, "lr": config.lr}
    schedule = replace(size.schedule, **{name: value for name, value in given.items() if value})
    wanted = replace(size, schedule=schedule, seed=config.seed)
    clips = list(load(config.data))
    clips += [clip for path in config.extra_data for clip in load(DataConfig(path=path))]
    for clip in clips:
        if clip.truth is None:
            raise ValueError(f"clip {clip.id!r} has no truth to learn from")
    if config.init is None:
        truths = ((convert(clip.truth, skeleton.parts[0]), clip.fps) for clip in progress(clips, "reading"))
        print(pretrain(truths, wanted, out))
        return
    parts = [clip.select(views=chosen) for clip in clips for chosen in camera_subsets(clip, config.views)]
    pairs = (
        pose_pair(
            part if part.poses else replace(part, poses=capture(part, config.capture)), skeleton, wanted.network.fps
        )
        for part in progress(parts, "capturing")
    )
    print(fine_tune(Path(config.init), pairs, wanted, out))


def interrupted(config: TrainPaperCommand, out: Path) -> str:
    return f"the same command continues from the checkpoint in {out}, which is written every 500 steps"
