"""`dmae capture`: detections of several cameras to 3D poses."""

import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from dmae.commands.data_sets import Manifest, describe_joints, each_clip, finished
from dmae.completion.methods.registry import METHODS, completion_method
from dmae.data.clip import Clip, Poses3D
from dmae.data.rng import Stream, generator
from dmae.data.store import save_clip
from dmae.formats.reading import DataConfig, is_data_set
from dmae.numerics.filling import smooth
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from dmae.reconstruction.sides import exchanged_detections

WRITES = "folder"
EXAMPLES = (
    "dmae capture data=runs/data out=runs/captured",
    "dmae capture data=shelf data.path=$DMAE_DATA/shelf out=runs/shelf",
    "dmae capture data=openpose data.path=session data.fps=60 fill=linear smooth=0.1 out=runs/session",
)
_FEW_EXCHANGES = 0.02
"""Share of frames with exchanged sides below which a camera is not named."""
_FILLS = ("none", *(name for name, method in completion_method.items() if not method.learned and name != "measured"))


@dataclass(frozen=True)
class CaptureCommand:
    """Turn the detections of several cameras into 3D poses."""

    data: DataConfig = field(default_factory=DataConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    fill: str = field(default="none", metadata={"choices": _FILLS})
    """How joints that no camera measured are filled, or module:function of your own; they are marked completed in
    `source`."""
    smooth: float = 0.0
    """s; light smoothing after that (0.1 suits people; 0: none). What it moves is marked denoised."""
    draw: list[int] = field(default_factory=list)
    """Capture each clip of a data set with cameras drawn at random, as many as one of these, and keep no others: to
    learn what few cameras measure."""
    seed: int = 0
    """Seed of the cameras that are drawn."""
    out: str = "runs/capture"
    """Folder of the captured clip; of a data set a folder for each clip is made in it."""

    def __post_init__(self):
        if not self.smooth >= 0:
            raise ValueError(f"smooth={self.smooth:g}: expected seconds, 0 (no smoothing) or more")


def run(config: CaptureCommand, out: Path) -> None:
    frames, spent = 0, 0.0
    with Manifest(out, is_data_set(config.data)) as manifest:
        for number, (clip, name, folder) in enumerate(each_clip(config.data, out, "capturing")):
            if config.draw:
                clip = clip.select(views=_drawn(config, len(clip.rig), number))
            for note in clip.provenance.get("notes", ()):
                print(f"{clip.id}: {note}")
            start = time.perf_counter()
            poses = measured = capture(clip, config.capture)
            spent += time.perf_counter() - start
            frames += len(clip)
            if config.fill != "none":
                poses = METHODS[config.fill](poses, clip.fps)
            poses = smooth(poses, clip.fps, config.smooth)
            for note in _exchanged_sides(clip, measured):
                print(f"{clip.id}: {note}")
            captured = replace(clip, poses=poses)
            manifest.write(name, partial(save_clip, captured, folder), persons=poses.xyz.shape[1])
            print(f"{clip.id}: {len(clip)} frames, {poses.xyz.shape[1]} persons, {describe_joints(poses)}")
    print(f"{out}: {frames / spent:.0f} frames/s")


def _exchanged_sides(clip: Clip, poses: Poses3D) -> list[str]:
    """Say in which cameras the detector exchanged left and right, which capture has put right."""
    counts = exchanged_detections(clip, poses).sum(0)
    least = max(_FEW_EXCHANGES * len(clip), 2)
    return [
        f"{name}: left and right exchanged in {count} of {len(clip)} frames, put right by the other cameras"
        for name, count in zip(clip.rig.names, counts, strict=True)
        if count >= least
    ]


def interrupted(config: CaptureCommand, out: Path) -> str:
    return f"{finished(out)}; the same command captures all clips anew"


def _drawn(config: CaptureCommand, views: int, number: int) -> list[int]:
    """The cameras of the clip of that number in its data set."""
    if not all(2 <= count <= views for count in config.draw):
        raise ValueError(f"draw={config.draw}: expected numbers from 2 to {views}, the cameras there are")
    rng = generator(config.seed, number, Stream.CAMERAS)
    return sorted(rng.choice(views, rng.choice(config.draw), replace=False).tolist())
