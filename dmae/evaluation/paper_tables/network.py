"""The paper's network in the paper's tables: before fusion, with fusion, tuned in folds; and the ablation of its codes.

The stages are the paper's: pretrained on true poses (the weights `paper` of this package), fusion learned on
simulated people as captured, then tuned on annotations of the recording that is scored.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from dmae.completion.complete import load_completer, uncertain
from dmae.completion.config import CodesConfig, TrainConfig
from dmae.completion.network import DMAE
from dmae.completion.paper import PAPER, PaperRows, PaperWindows, cut, interpolated, paper_rows
from dmae.completion.training import train
from dmae.completion.training_data import mask_scattered, pose_pair
from dmae.completion.weights import PAPER as SHIPPED
from dmae.completion.weights import load_model, weights_folder
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import SHELF14, Skeleton, get_skeleton
from dmae.evaluation.config import TableConfig, TableSize
from dmae.evaluation.paper_tables.clips import NamedClips, captured, halves, load_sets
from dmae.evaluation.paper_tables.layout import MeasuredRow, TableColumn, paper_table
from dmae.evaluation.scores import mean_score
from dmae.formats.reading import camera_subsets
from dmae.metrics.position import PCK_THRESHOLD
from dmae.metrics.table import Score, block_of, tally
from dmae.numerics.paths import linear
from dmae.parallel import one_thread

PRETRAINED = "the paper's network, without fine-tuning"
FUSED = "the paper's network, fusion learned on simulation alone"
TUNED = "the paper's network, final"
KEPT = "the paper's network, final, measured joints kept"
NETWORK = (PRETRAINED, FUSED, TUNED, KEPT)
STAGES = ((TUNED, PRETRAINED), (TUNED, FUSED), (TUNED, "linear"))
"""Rows whose differences say what fusion and tuning gain, over the network before them and over straight lines."""
MISSING = "there are no simulated clips to learn fusion from: give extra_data=[...]"

FOLDS, APART = 4, 10
"""Parts of a recording, each scored by a network that was tuned on the others; and the frames next to a part that are
not learned from."""
STEPS = {TableSize.small: (20, 10, 100), TableSize.full: (500, 100, 2000)}
"""Training steps: to learn fusion, to tune, and for the ablation of codes."""
_FUSION_LR, _TUNING_LR, _REPLAY = 1e-3, 2e-4, 0.5
"""Learning rates of fusion and of tuning, and the share of simulated windows in tuning: without these windows, actors
without annotations get lost."""

NETWORK_NOTE = (
    f"{PAPER.model.encoder.dim} channels and {PAPER.model.encoder.depth} layers in the encoder, where the paper has "
    "256 and 6; without any of this package's methods of completion"
)
TUNED_NOTE = (
    f"{TUNED}: the recording is cut into {FOLDS} parts with equally many annotated frames. Each part is scored by a "
    f"network tuned on the annotations of the others, as captured by all subsets of the cameras, without the {APART} "
    "frames next to it. The paper tunes on Shelf's other frames; this data has no others. "
    f"{KEPT}: joints that were measured, and have the same name in both skeletons, stay as they were unless capture "
    "states an error above 6 cm."
)


def paper_network(config: TableConfig, clip: Clip, out: Path) -> dict[str, Callable[[Poses3D, float], Poses3D]]:
    """Return the paper's network after each of its stages, by the names of their rows, to score a recording.

    `extra_data` are simulated clips, from which fusion is learned; without them there is one row. Models go to `out`.
    """
    methods: dict[str, Callable] = {PRETRAINED: load_completer(weights_folder(SHIPPED))}
    if not config.extra_data:
        return methods
    steps, tuning, _ = STEPS[config.size]
    simulated = [placed_heads(clip) for clip in captured(load_sets(config.extra_data), config.capture)]
    plan = replace(PAPER, init=SHIPPED, seed=config.seed, capture=config.capture)
    fused = train(_stage(plan, steps, _FUSION_LR), simulated, out / "models" / "paper_fused")
    views = [count for count in range(len(clip.rig), len(clip.rig) - 3, -1) if count >= 2]
    examples = replace(PAPER.examples, replay=_REPLAY)
    plan = replace(plan, init=str(fused), extra_data=config.extra_data, examples=examples)
    # Capture knows no annotations, so the whole recording is captured once, and not again without each part.
    seen = (clip.select(views=cameras) for cameras in camera_subsets(clip, views))
    recordings = [replace(each, id=f"{clip.id} by {','.join(each.rig.names)}") for each in seen]
    recordings = list(captured(recordings, config.capture))
    parts, tuned = folds(clip), []
    for number, part in enumerate(parts):
        folder = out / "models" / f"paper_tuned_{number}"
        learned = [piece for each in recordings for piece in others(each, part)]
        tuned.append(load_completer(train(_stage(plan, tuning, _TUNING_LR), learned, folder, extra_clips=simulated)))
    final = remembering(Folded(tuple(tuned), tuple(parts)))
    methods |= {FUSED: load_completer(fused), TUNED: final}
    return methods | {KEPT: lambda poses, fps: kept(final(poses, fps), poses)}


def placed_heads(clip: Clip) -> Clip:
    """Return a simulated clip with the ends of Shelf's heads where `convert` places them.

    The simulated top of the head moves with the head, 0.12 m ahead of the ears; annotators of Shelf put it 0.02 to 0.06
    m ahead, and the formula, which leaves out how far the head is bent, comes nearer to them.
    """
    truth = clip.truth
    if truth is None or SHELF14 not in truth.skeleton.parts[1:]:
        return clip
    ends, xyz = ("bottom_head", "top_head"), truth.xyz.copy()
    derived = convert(convert(truth, truth.skeleton.parts[0]), SHELF14)
    own = truth.skeleton.index(*(f"{SHELF14.name}.{end}" for end in ends))
    xyz[:, :, own] = derived.xyz[:, :, SHELF14.index(*ends)]
    return replace(clip, truth=replace(truth, xyz=xyz))


def _stage(plan: TrainConfig, steps: int, lr: float) -> TrainConfig:
    return replace(plan, learning=replace(plan.learning, steps=steps, epoch=steps, lr=lr))


def folds(clip: Clip) -> list[slice]:
    """Return parts of a recording with equally many annotated frames, which together are all of its frames."""
    assert clip.truth is not None
    annotated = np.flatnonzero((~np.isnan(clip.truth.xyz).any(-1)).any((1, 2)))
    count = min(FOLDS, len(annotated))
    bounds = [0, *(int(annotated[len(annotated) * part // count]) for part in range(1, count)), len(clip)]
    return [slice(start, stop) for start, stop in pairwise(bounds)]


def others(clip: Clip, part: slice) -> Iterator[Clip]:
    """Yield the annotated pieces of a recording that are outside a part and not next to it."""
    for frames in (slice(0, max(part.start - APART, 0)), slice(part.stop + APART, len(clip))):
        piece = clip.select(frames=frames) if frames.start < frames.stop else None
        if piece is not None and piece.truth is not None and not np.isnan(piece.truth.xyz).all():
            yield replace(piece, id=f"{clip.id} frames {frames.start} to {frames.stop - 1}")


_BESIDE = 1.5  # s next to a part that are given with it: half a window, and the second after which nobody is present


@dataclass(frozen=True)
class Folded:
    """A completer of a whole recording, in which each part is completed by another network."""

    completers: tuple[Callable[..., Poses3D], ...]
    parts: tuple[slice, ...]

    def __call__(self, poses: Poses3D, fps: float) -> Poses3D:
        done, beside = [], round(_BESIDE * fps)
        for complete, part in zip(self.completers, self.parts, strict=True):
            first = max(part.start - beside, 0)
            found = complete(poses.select(slice(first, part.stop + beside)), fps)
            done.append(found.select(slice(part.start - first, part.stop - first)))
        arrays = {name: np.concatenate([each.arrays[name] for each in done]) for name in done[0].arrays}
        return Poses3D(done[0].skeleton, **arrays)


def remembering(complete: Callable[[Poses3D, float], Poses3D]) -> Callable[[Poses3D, float], Poses3D]:
    """Return a function that does not complete the same poses twice in succession: two rows are made of them."""
    last: list[Poses3D] = []

    def completed(poses: Poses3D, fps: float) -> Poses3D:
        if not last or last[0] is not poses:
            last[:] = [poses, complete(poses, fps)]
        return last[1]

    return completed


def kept(fused: Poses3D, poses: Poses3D) -> Poses3D:
    """Return fused poses with the measurements of joints that have the same name in both skeletons.

    Joints of the head are left out, because they are other points in each skeleton. So are joints with a stated error
    that is larger than completed joints have, as in the default completion.
    """
    own = convert(poses, fused.skeleton)
    same = np.array([joint in poses.skeleton.joints for joint in fused.skeleton.joints])
    use = own.measured & same & ~uncertain(own)
    xyz = np.where(use[..., None], own.xyz, fused.xyz)
    return replace(fused, xyz=xyz, source=np.where(use, own.source, fused.source))


# Table 5: the codes of joint and time.

BOTH, LONGER = "both codes", "both codes, the shipped weights"
WINDOW, WHOLE = "interpolation inside the window", "interpolation over the whole recording"
VARIANTS = {
    "neither code": CodesConfig(signal_sigma=0.4, no_joint=True, no_time=True),
    "code of time": CodesConfig(signal_sigma=0.4, no_joint=True),
    "code of joints": CodesConfig(signal_sigma=0.4, no_time=True),
    BOTH: CodesConfig(signal_sigma=0.4),
}
_LIMB_FRAMES = 13  # Half a second at the network's rate
_CODE_NOTES = (
    "Trained and scored on simulated people, since BU-Mocap is not available. The four rows of the ablation have "
    f"equally many steps, {{steps}} of 16 windows; {LONGER}: {PAPER.learning.steps}. Codes are "
    "left out of the encoder, as in the released code: without them in the decoder masked tokens of a frame are one.",
    "Masks: half of the frames, and half of the joints of each other frame, as in the paper; half of the joints of "
    "half of the frames, as in the released code; two of four limbs for half a second, which interpolation has to "
    "bridge. Masked joints within 0.2 m (recall), and their mean error. Intervals are about other moments, "
    "not about other trainings.",
)
MASKS = {"": "the paper's masks", "released_": "the released code's", "limbs_": "limbs for half a second"}
_CODE_COLUMNS = tuple(
    TableColumn(f"{kind}{figure}", f"{heading}, {masks}", unit, lead=kind == "")
    for kind, masks in MASKS.items()
    for figure, heading, unit in (("recall", "recall", "%"), ("mpjpe", "MPJPE", "mm"))
)


def codes_table(config: TableConfig, out: Path) -> dict:
    """Return table 5.

    `data` are clips with truth that are scored, `extra_data` clips with other people to learn from; without them the
    first half of `data` is learned from. Raises ValueError if a data set that is halved has a single clip, or a clip
    no truth.
    """
    if config.extra_data:
        learned, scored = load_sets(config.extra_data), load_sets([config.data.path])
    else:
        learned, scored = halves(config.data, [])
    clips = [replace(clip, poses=None) for clip in learned]
    steps = STEPS[config.size][-1]
    models = {}
    for name, codes in VARIANTS.items():
        plan = replace(_stage(PAPER, steps, PAPER.peak_lr), seed=config.seed, model=replace(PAPER.model, codes=codes))
        plan = replace(plan, examples=replace(plan.examples, held_back=0.0))
        models[name] = load_model(train(plan, clips, out / "models" / f"table_5_{name.replace(' ', '_')}"))[0]
    models[LONGER] = load_model(weights_folder(SHIPPED))[0]
    rows = [
        _codes_row(name, _masked_joints(models.get(name, models[BOTH]), name, config, scored))
        for name in (*models, WINDOW, WHOLE)
    ]
    return paper_table(
        config, _CODE_COLUMNS, rows, against=BOTH, comparable=None, recording=f"{len(scored)} simulated clips",
        frames={}, footnotes=[note.format(steps=steps) for note in _CODE_NOTES],
    )  # fmt: skip


def _codes_row(name: str, table: pd.DataFrame) -> MeasuredRow:
    cells: dict[str, Score | float] = {}
    for column in _CODE_COLUMNS:
        part = table[table["figure"] == column.key]
        cells[column.key] = mean_score(part) if column.unit == "%" else mean_score(part, scale=1.0)
    return MeasuredRow(name, cells)


def _masked_joints(model: DMAE, name: str, config: TableConfig, clips: NamedClips) -> pd.DataFrame:
    """Return the score table of masked joints: recall, and error in mm. The masks are the same for every row."""
    skeleton, frames, fps = get_skeleton(str(PAPER.skeleton)), PAPER.model.frames, PAPER.model.fps
    rest, parts = model.rest.numpy().astype(np.float64), []
    for number, clip in enumerate(clips):
        pair = pose_pair(replace(clip, poses=None), skeleton, fps)
        rows = paper_rows([pair], frames)
        length = len(rows.truth) // pair.truth.xyz.shape[1]
        starts = rows.starts[rows.starts % length % frames == 0]
        for kind in MASKS:
            masked = _masks(kind, len(starts), skeleton, generator(config.seed, number, Stream.STRESS))
            examples = cut(rows, starts, masked, skeleton)
            predicted = _predicted(model, name, rows, length, starts, examples.windows, rest)
            error = np.linalg.norm(predicted - examples.truth.numpy(), axis=-1)
            keys = {"block": block_of(starts[:, None] % length + np.arange(frames), fps)[..., None]}
            for figure, value in (("recall", error <= PCK_THRESHOLD), ("mpjpe", 1000 * error)):
                table = tally(value, examples.hidden.numpy(), **keys)
                parts.append(table.assign(figure=f"{kind}{figure}", clip=clip.id, cameras="", person=0))
    return pd.concat(parts)


def _masks(kind: str, count: int, skeleton: Skeleton, rng: np.random.Generator) -> np.ndarray:
    """Return (B, T, J) masks of the first skeleton's joints."""
    source, frames = skeleton.parts[0], PAPER.model.frames
    if kind != "limbs_":
        shape = (frames, count, len(source))
        return mask_scattered(shape, 0.5, 0.5, kind == "released_", rng=rng).swapaxes(0, 1)
    names: list[tuple[str, ...]] = [("l_shoulder", "l_elbow", "l_wrist"), ("r_shoulder", "r_elbow", "r_wrist")]
    names += [("l_knee", "l_ankle", "l_heel", "l_big_toe"), ("r_knee", "r_ankle", "r_heel", "r_big_toe")]
    limbs = np.array([[joint in limb for joint in source.joints] for limb in names])
    two = rng.random((count, len(limbs))).argsort(1)[:, :2]
    inside = np.abs(np.arange(frames) - frames // 2) <= _LIMB_FRAMES // 2
    return inside[:, None] & np.any(limbs[two], 1)[:, None]


def _predicted(
    model: DMAE, name: str, rows: PaperRows, length: int, starts: np.ndarray, windows: PaperWindows, rest: np.ndarray
) -> np.ndarray:
    """Return the joints (B, T, J, 3) that a row of the table has in the windows."""
    if name == WINDOW:
        return interpolated(windows, rest).numpy()
    if name == WHOLE:
        return _over_the_recording(rows, length, starts, windows, rest)
    with torch.inference_mode(), one_thread():
        batches = (tuple(part[first : first + 64] for part in windows[:2]) for first in range(0, len(starts), 64))
        return np.concatenate([model(*batch).xyz.numpy() for batch in batches])


def _over_the_recording(
    rows: PaperRows, length: int, starts: np.ndarray, windows: PaperWindows, rest: np.ndarray
) -> np.ndarray:
    """Return joints by straight lines between what all windows of a person show; a person has `length` rows."""
    frames, joints = windows.observed.shape[1:]
    index = starts[:, None] + np.arange(frames)
    shown = np.full((len(rows.truth), joints, 3), np.nan)
    shown[index] = np.where(windows.observed.numpy()[..., None], rows.truth[index, :joints], np.nan)
    # A window's coordinates are about its middle, which is what observed joints differ by.
    x, observed = windows.x.numpy(), windows.observed.numpy()[..., None]
    middle = np.where(observed, rows.truth[index, :joints] - x, 0).sum((1, 2), keepdims=True)
    middle = middle / np.maximum(observed.sum((1, 2), keepdims=True), 1)
    by_person = shown.reshape(-1, length, joints, 3).swapaxes(0, 1)
    filled = linear(by_person).swapaxes(0, 1).reshape(shown.shape)[index] - middle
    return np.where(np.isnan(filled), rest[:joints] * (0, 0, 1), filled)
