"""`dmae train-paper`: the network of the paper alone, by its own recipe."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from dmae.completion.config import SIZES, PaperSize
from dmae.formats.reading import DataConfig, load
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig

WRITES = "folder"
EXAMPLES = (
    "dmae train-paper data=runs/clips out=runs/paper",
    "dmae train-paper data=runs/annotated init=runs/paper views=[5,4,3] out=runs/paper_tuned",
    "dmae train-paper data=runs/clips size=full out=runs/paper_full",
)


@dataclass(frozen=True)
class TrainPaperCommand:
    """Train the paper's network with the paper's training: on true poses, or from `init` on annotations.

    None of this package's own predictors, features or blending is used."""

    data: DataConfig = field(default_factory=DataConfig)
    extra_data: list[str] = field(default_factory=list)
    """Folders of further data sets to pretrain on."""
    init: str | None = None
    """Folder of a pretrained network, to fine-tune it on annotations of Shelf's joints."""
    views: list[int] = field(default_factory=list)
    """In fine-tuning, the clip is captured by all subsets with these numbers of cameras; by default by all cameras."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    size: PaperSize = PaperSize.small
    """Small enough for a CPU, or as in the paper, for a GPU."""
    steps: int = 0
    """Batches of pretraining; 0: those of the size."""
    tuning_epochs: int = 0
    """Passes over the windows in fine-tuning; 0: those of the size."""
    batch: int = 32
    """Windows in a batch."""
    lr: float | None = None
    """Greatest learning rate; by default that of the size."""
    seed: int = 0
    """Seed of weights, masks and batches."""
    out: str = "runs/paper"
    """Folder of the network and its checkpoint."""


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
