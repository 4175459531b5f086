"""What each sub-command of `dmae` does: its configuration, and a function of that and of an output path."""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

from dmae.baselines import METHODS, smooth
from dmae.capture import CaptureConfig, capture
from dmae.clip import Clip, Poses3D, Source
from dmae.data import Clips, DataConfig, is_data_set, load
from dmae.evaluate import EvaluateConfig, evaluate
from dmae.progress import progress
from dmae.rng import Stream, generator
from dmae.store import clip_folders, load_clip, read_json, save_clip, write_atomic, write_manifest
from dmae.stream import DELAY, replayed
from dmae.tables import print_tables, tables

Fill = StrEnum("Fill", ["none", *(name for name in METHODS if name != "measured")])
"""How holes are filled after capture."""


@dataclass(frozen=True)
class CaptureCommand:
    """`dmae capture`."""

    data: DataConfig = field(default_factory=DataConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    fill: Fill = Fill.none
    """What is filled is marked completed in `source`."""
    smooth: float = 0.0
    """Light smoothing after that, s (0.1 suits people); what it moves is marked denoised."""
    draw: list[int] = field(default_factory=list)
    """Capture each clip of a data set with cameras drawn at random, as many as one of these, and keep no others: to
    learn what few cameras measure."""
    seed: int = 0
    """Of which cameras are drawn."""
    out: str = "runs/capture"


def run_capture(config: CaptureCommand, out: Path) -> None:
    clips, several = load(config.data), is_data_set(config.data)
    frames, spent, manifest = 0, 0.0, []
    numbered = enumerate(zip(clips, clips.folders, strict=True))
    for number, (clip, folder) in progress(numbered, "capturing", len(clips)):
        if config.draw:
            clip = clip.select(views=_drawn(config, len(clip.rig), number))
        for note in clip.provenance.get("notes", ()):
            print(f"{clip.id}: {note}")
        start = time.perf_counter()
        poses = capture(clip, config.capture)
        spent += time.perf_counter() - start
        frames += len(clip)
        if config.fill != Fill.none:
            poses = METHODS[config.fill](poses, clip.fps)
        poses = smooth(poses, clip.fps, config.smooth)
        save_clip(replace(clip, poses=poses), out / folder.name if several else out)
        manifest.append({"id": folder.name, "status": "ok", "persons": poses.xyz.shape[1]})
        print(f"{clip.id}: {len(clip)} frames, {poses.xyz.shape[1]} persons, {_shares(poses)}")
    if several:
        write_manifest(out, manifest)
    print(f"{frames / spent:.0f} frames/s")


def _drawn(config: CaptureCommand, views: int, number: int) -> list[int]:
    """The cameras of the clip of that number in its data set."""
    if not all(2 <= count <= views for count in config.draw):
        raise ValueError(f"draw={config.draw}: expected numbers from 2 to {views}, the cameras there are")
    rng = generator(config.seed, number, Stream.CAMERAS)
    return sorted(rng.choice(views, rng.choice(config.draw), replace=False).tolist())


def _shares(poses: Poses3D) -> str:
    """How much of the persons' joints, while a person is there at all, was measured and how much invented."""
    known = poses.source[(poses.source != Source.ABSENT).any(-1)]
    if not known.size:
        return "nobody captured"
    completed, absent = (known == Source.COMPLETED).mean(), (known == Source.ABSENT).mean()
    return f"joints {1 - completed - absent:.1%} measured, {completed:.1%} completed, {absent:.1%} absent"


@dataclass(frozen=True)
class CompleteCommand:
    """`dmae complete`."""

    clip: str = "???"
    """A captured clip, or a folder of them."""
    weights: str | None = None
    """What `dmae train` wrote; by default the weights that come with the package, for the skeleton of the poses."""
    denoise: bool = False
    """Let the model move joints measured by fewer than three views too; they are then marked denoised."""
    reject: bool = False
    """Drop joints of two views that the frames around contradict (`dmae.rejection`), and complete them as well."""
    online: bool = False
    """As while cameras run: each frame by what is known `delay` after it."""
    delay: float = DELAY
    """s"""
    out: str = "runs/complete"


def run_complete(config: CompleteCommand, out: Path) -> None:
    from dmae.complete import completers

    completer_for = completers(
        Path(config.weights) if config.weights else None, denoise=config.denoise, reject=config.reject
    )
    folders = clip_folders(Path(config.clip))
    several = folders != [Path(config.clip)]
    for folder in progress(folders, "completing"):
        clip = load_clip(folder)
        if clip.poses is None:
            raise ValueError(f"{folder}: has no poses to complete; run dmae capture on it first")
        completer = completer_for(clip.poses.skeleton)
        for note in completer.notes(clip.poses, clip.fps):
            print(f"{clip.id}: {note}")
        if config.online:
            print(f"{clip.id}: each frame by what is known {config.delay:g} s after it")
            poses = replayed(completer, clip.poses, clip.fps, config.delay)
        else:
            poses = completer(clip.poses, clip.fps)
        save_clip(replace(clip, poses=poses), out / folder.name if several else out)
        print(f"{clip.id}: {_shares(poses)}")
    if several:
        write_manifest(out, [{"id": folder.name, "status": "ok"} for folder in folders])


def run_train(config, out: Path) -> None:
    from dmae.train import train

    also, unseen = ([load(DataConfig(path=path)) for path in paths] for paths in (config.also, config.unseen))
    print(train(config, _named([load(config.data)]), out, _named(unseen), _named(also, first=1)))


def _named(sets: list[Clips], first: int = 0) -> Iterator[Clip]:
    """Clips called as their folders are, but for set 0 with the set's folder: each counts from 0."""
    for number, clips in enumerate(sets, first):
        for clip, folder in zip(clips, clips.folders, strict=True):
            yield replace(clip, id=f"{folder.parent.name}/{folder.name}" if number else folder.name)


@dataclass(frozen=True)
class CardCommand:
    """`dmae card`."""

    weights: str = "???"
    """What `dmae train` wrote; the card is written there."""
    scores: list[str] = field(default_factory=list)
    """Folders that `dmae evaluate` wrote with these weights."""
    command: str = "???"
    """What makes these weights, data included."""


def run_card(config: CardCommand, _: None) -> None:
    from dmae.card import model_card

    folder = Path(config.weights)
    path = folder / "MODEL_CARD.md"
    write_atomic(path, model_card(folder, [Path(scores) for scores in config.scores], config.command))
    print(path)


def run_evaluate(config: EvaluateConfig, out: Path) -> None:
    scores = evaluate(config)
    write_atomic(out / "scores.json", json.dumps(scores, indent=1))
    print_tables(tables(scores))


@dataclass(frozen=True)
class ReportCommand:
    """`dmae report`."""

    title: str = "Occluded multi-view motion, captured and completed"
    scores: list[str] = field(default_factory=list)
    """Folders that `dmae evaluate` wrote."""
    clip: str | None = None
    """A captured or completed clip to draw, or a folder of them."""
    out: str = "runs/report.html"


def run_report(config: ReportCommand, out: Path) -> None:
    from dmae.report import scores_section, views_section, write_report

    sections = [scores_section(read_json(Path(folder) / "scores.json")) for folder in config.scores]
    if config.clip:
        sections += [views_section(load_clip(folder)) for folder in clip_folders(Path(config.clip))]
    if not sections:
        raise ValueError("nothing to report: name scores=[folder,...] or clip=folder, or both")
    write_report(out, config.title, sections)
    print(out)
