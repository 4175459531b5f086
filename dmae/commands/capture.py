"""`dmae capture`: detections of several cameras to 3D poses."""

import sys
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from dmae.commands.data_sets import Manifest, describe_joints, each_clip, finished
from dmae.completion.methods.registry import METHODS, completion_method
from dmae.data.clip import Clip
from dmae.data.rng import Stream, generator
from dmae.data.store import save_clip
from dmae.evaluation.report.pooled import pooled_groups
from dmae.evaluation.report.reprojection import Reprojection, reprojection
from dmae.evaluation.report.residual_tables import BREAKDOWNS, residual_tables
from dmae.formats.reading import DataConfig, is_data_set
from dmae.numerics.filling import smooth
from dmae.reconstruction.config import CaptureConfig, SubjectConfig
from dmae.reconstruction.people.diagnosis import explain_capture
from dmae.reconstruction.pipeline import capture
from dmae.reporting.tables import print_tables

WRITES = "folder"
EXAMPLES = (
    "dmae capture data=runs/data out=runs/captured",
    "dmae capture data=shelf data.path=$DMAE_DATA/shelf out=runs/shelf",
    "dmae capture data=openpose data.path=session data.fps=60 fill=linear smooth=0.1 out=runs/session",
)
_FEW = 0.4
"""Share of the detected joints; where people explain fewer, something is wrong."""
_FILLS = ("none", *(name for name, method in completion_method.items() if not method.learned and name != "measured"))


@dataclass(frozen=True)
class CaptureCommand:
    """Turn the detections of several cameras into 3D poses, and print how far they reproject from the detections.

    Exits with status 1 where no person is found, and prints what is left after each step and what to change.
    """

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
    """Capture each clip, and print the reprojection errors of all; exits with status 1 if no person was found."""
    frames, spent, persons = 0, 0.0, 0
    errors: list[Reprojection] = []
    with Manifest(out, is_data_set(config.data)) as manifest:
        for number, (clip, name, folder) in enumerate(each_clip(config.data, out, "capturing")):
            if config.draw:
                clip = clip.select(views=_drawn(config, len(clip.rig), number))
            for note in clip.provenance.get("notes", ()):
                print(f"{clip.id}: {note}")
            start = time.perf_counter()
            poses = capture(clip, config.capture)
            spent += time.perf_counter() - start
            frames += len(clip)
            if config.fill != "none":
                poses = METHODS[config.fill](poses, clip.fps)
            poses = smooth(poses, clip.fps, config.smooth)
            captured = replace(clip, poses=poses)
            persons += poses.xyz.shape[1]
            manifest.write(name, partial(save_clip, captured, folder), persons=poses.xyz.shape[1])
            print(f"{clip.id}: {len(clip)} frames, {poses.xyz.shape[1]} persons, {describe_joints(poses)}")
            errors.append(reprojection(captured))
            _print_doubts(clip, config.capture, poses.xyz.shape[1], errors[-1])
    _print_errors(errors)
    print(f"{out}: {frames / spent:.0f} frames/s")
    if not persons:
        sys.exit(1)


def _print_doubts(clip: Clip, config: CaptureConfig, persons: int, errors: Reprojection) -> None:
    """Print why there is no person, or what is wrong where the people explain few of the detections."""
    if not persons:
        print(f"{clip.id}: no person was captured; {explain_capture(clip, config)}")
        return
    if (config.persons, config.volume, config.subject) != (None, None, SubjectConfig()):
        return  # others were left out on purpose
    detected = int((clip.detections.score >= config.th_p).sum())
    explained = errors.measured["all"]["all"].compared / max(detected, 1)
    if explained < _FEW:
        print(f"{clip.id}: only {explained:.0%} of the detected joints are of captured people")
        for remedy in explain_capture(clip, config).remedies:
            print(f"  remedy: {remedy}")


def _print_errors(errors: list[Reprojection]) -> None:
    """Print reprojection errors by camera, person and joint; of several clips without people, as they are others."""
    measured, completed = pooled_groups(errors, "measured"), pooled_groups(errors, "completed")
    names = BREAKDOWNS if len(errors) == 1 else [name for name in BREAKDOWNS if name != "person"]
    tables = residual_tables(measured, completed, names)
    if tables:
        print("Reprojection errors, px, of joints that a camera detected:")
        print_tables(tables)


def interrupted(config: CaptureCommand, out: Path) -> str:
    return f"{finished(out)}; the same command captures all clips anew"


def _drawn(config: CaptureCommand, views: int, number: int) -> list[int]:
    """The cameras of the clip of that number in its data set."""
    if not all(2 <= count <= views for count in config.draw):
        raise ValueError(f"draw={config.draw}: expected numbers from 2 to {views}, the cameras there are")
    rng = generator(config.seed, number, Stream.CAMERAS)
    return sorted(rng.choice(views, rng.choice(config.draw), replace=False).tolist())
