"""`dmae complete`: fill joints on which fewer than two cameras agree, with trained weights."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from dmae.commands.config import CompleteCommand
from dmae.commands.data_sets import (
    ClipSet,
    check_apart,
    describe_joints,
    describe_people,
    finished,
    forecast,
    settings_of,
)
from dmae.completion.complete import completers, keep_smoothed
from dmae.completion.weights import weights_checksum
from dmae.data.clip import Clip, Source
from dmae.data.skeleton import Skeleton
from dmae.data.store import clip_folders, load_clip
from dmae.evaluation.review import ReviewVerdict, decided, load_decisions
from dmae.files.checksums import refuse_damaged
from dmae.numerics.filling import are_stills, keep_rejected
from dmae.online.completion import complete_online
from dmae.reporting.tables import counted

_TRIED = 200  # Frames of a clip that a forecast completes
interrupted = finished


def run(config: CompleteCommand, out: Path) -> None:
    check_apart(out, Path(config.clip))
    _completers(config)
    if not config.damaged:
        refuse_damaged(Path(config.clip), "damaged=true")
    folders = clip_folders(Path(config.clip))
    settings = _settings(config) if folders != [Path(config.clip)] else None
    if config.dry_run:
        print(f"{out}: {forecast(config, len(folders), lambda number: _begun(config, folders[number]))}")
        return
    names, tasks = [folder.name for folder in folders], ((config, folder) for folder in folders)
    with ClipSet(out, settings) as made:
        for _, completed, notes in made.fill(_complete, names, tasks, config.workers, "completing"):
            if completed is None:
                continue
            for note in notes:
                print(f"{completed.id}: {note}")
            assert completed.poses is not None
            print(f"{completed.id}: {describe_joints(completed.poses)}")
            if completed.poses.source.any() and not are_stills(completed.fps):
                print(f"{completed.id}: {describe_people(completed.poses)}")
    print(out)


def _settings(config: CompleteCommand) -> dict:
    settings = settings_of("dmae complete", config, Path(config.clip))
    return settings | {"options": settings["options"] | {"weights": weights_checksum(config.weights)}}


def _begun(config: CompleteCommand, folder: Path) -> tuple[int, Clip]:
    """Return the number of frames of a clip, and a completed piece of it."""
    return len(load_clip(folder)), _complete(config, folder, _TRIED)[0]


def _complete(config: CompleteCommand, folder: Path, frames: int | None = None) -> tuple[Clip, list[str]]:
    """Return the clip of a folder, or its first frames, completed, and notes."""
    clip = load_clip(folder)
    if clip.poses is None:
        raise ValueError(f"{folder}: has no poses to complete; run dmae capture on it first")
    decisions = load_decisions(folder, clip.poses)
    blanked, handed_back, accepted = (
        decided(clip.poses, decisions, verdict)
        for verdict in (ReviewVerdict.blank, ReviewVerdict.hand_back, ReviewVerdict.accept)
    )
    captured, given = clip.poses, clip.poses.without(blanked | handed_back)
    if frames is not None:
        clip, captured = clip.select(frames=range(min(frames, len(clip)))), captured.select(slice(frames))
        given, blanked, accepted = given.select(slice(frames)), blanked[:frames], accepted[:frames]
    completer = _completers(config)(given.skeleton)
    notes = completer.notes(given, clip.fps)
    if (given.source == Source.DENOISED).any():
        notes.append(
            "smoothed and completed before: these joints stay as they are; other options need the captured clip"
        )
    if config.online:
        notes.append(f"each frame is completed from the frames until {config.delay:g} s after it")
        poses = complete_online(completer, given, clip.fps, config.delay)
    else:
        poses = completer(given, clip.fps)
    poses = keep_smoothed(poses, given)
    if poses.skeleton == given.skeleton:
        poses = keep_rejected(poses, captured)
        if decisions:
            poses = poses.taking(accepted, given).without(blanked)
        if replaced := int((given.measured & (poses.source == Source.COMPLETED)).sum()):
            notes.append(
                f"{counted(replaced, 'measured joint')} ({replaced / given.measured.sum():.1%}) contradicted the "
                "frames around or stated a larger error than completed ones; completed instead (reject=false keeps "
                "them)"
            )
    return replace(clip, poses=poses), notes


def _completers(config: CompleteCommand) -> Callable[[Skeleton], Any]:
    return completers(config.weights, denoise=config.denoise, reject=config.reject, smooth=config.smooth)
