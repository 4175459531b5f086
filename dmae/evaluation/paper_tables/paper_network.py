"""The paper's own network in tables 1 and 2: pretrained on simulated people, then tuned on annotations."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from dmae.completion.paper.completion import load_paper_completer
from dmae.completion.paper.config import SIZES, PaperConfig
from dmae.completion.paper.training import SKELETON, fine_tune, pretrain
from dmae.completion.training.pose_pairs import pose_pair
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import get_skeleton
from dmae.evaluation.paper_tables.config import TableConfig, TableSize
from dmae.evaluation.paper_tables.data_sets import load_sets
from dmae.formats.recordings.selection import camera_subsets
from dmae.reconstruction.pipeline import capture

PRETRAINED, TUNED = "the paper's network, without fine-tuning", "the paper's network, final"
MISSING = "there are no simulated clips to train on: give extra_data=[...]"
TUNED_FRAMES, APART = 40, 10
"""Frames at the beginning of the recording that are learned from, and those after them that are not scored."""
_FEW = (150, 10)
"""Steps of pretraining and passes of tuning for a table of the small size."""


def paper_network(config: TableConfig, tuning: Clip, out: Path) -> dict[str, Callable[[Poses3D, float], Poses3D]]:
    """Return the paper's network before and after fine-tuning, by the names of their rows.

    Args:
        config: `extra_data` are simulated clips, and the network learns from their truth; `paper` is the size.
        tuning: Annotated frames that are scored in no row.
        out: Folder for the two models.
    """
    wanted = SIZES[config.paper]
    if config.size is TableSize.small:
        wanted = replace(wanted, schedule=replace(wanted.schedule, steps=_FEW[0], tuning_epochs=_FEW[1]))
    wanted = replace(wanted, seed=config.seed)
    source = get_skeleton(SKELETON).parts[0]
    truths = [(convert(clip.truth, source), clip.fps) for clip in load_sets(config.extra_data)]
    first = pretrain(truths, wanted, out / "models" / "paper_pretrained")
    second = fine_tune(first, _captured(config, tuning, wanted), wanted, out / "models" / "paper_tuned")
    return {PRETRAINED: load_paper_completer(first), TUNED: load_paper_completer(second)}


def note(config: TableConfig) -> dict[str, str]:
    """Return what has to be known about the rows."""
    size = SIZES[config.paper].network
    return {
        "note": f"{config.paper} size: {size.dim} channels and {size.depth} layers in the encoder, where the paper has "
        "256 and 6; without any of this package's methods"
    }


def _captured(config: TableConfig, clip: Clip, wanted: PaperConfig):
    """Yield pairs of captured and annotated poses, by all subsets of the cameras that table 2 has."""
    cameras = len(clip.rig)
    for chosen in camera_subsets(clip, [count for count in range(cameras, cameras - 3, -1) if count >= 2]):
        part = clip.select(views=chosen)
        part = replace(part, poses=capture(part, config.capture))
        yield pose_pair(part, get_skeleton(SKELETON), wanted.network.fps)
