"""`dmae complete`: fill what no camera measured, with trained weights."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from dmae.commands.config import CompleteCommand
from dmae.commands.data_sets import ClipSet, describe_joints, finished, forecast, save_alone, settings_of
from dmae.completion.complete import Completer, completers
from dmae.completion.weights import weights_folder
from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton
from dmae.data.store import clip_folders, load_clip
from dmae.evaluation.review import ReviewVerdict, decided, load_decisions, with_decisions
from dmae.files.checksums import checksum, refuse_damaged
from dmae.online.completion import complete_online
from dmae.parallel import Backend, in_parallel, running_on
from dmae.progress import progress

_TRIED = 200  # Frames of a clip that a forecast completes
CompleterFor = Callable[[Skeleton], Completer]
"""The completer of poses of a skeleton."""


def run(config: CompleteCommand, out: Path) -> None:
    completer_for = _completers(config)
    if not config.damaged:
        refuse_damaged(Path(config.clip), "damaged=true")
    folders = clip_folders(Path(config.clip))
    several = folders != [Path(config.clip)]
    if config.dry_run:
        some = [folders[number] for number in sorted({0, len(folders) // 2, len(folders) - 1})]
        tried = ((len(load_clip(folder)), _complete(config, folder, completer_for, _TRIED)[0]) for folder in some)
        print(f"{out}: {forecast(config, len(folders), tried)}")
        return
    alone = config.workers == 1 and config.backend == Backend.loky
    made = ClipSet(out, _settings(config)) if several else None
    whole = made.whole if made else set()
    if several and (done_before := sum(folder.name in whole for folder in folders)):
        print(f"{out}: {done_before} of {len(folders)} clips are done already")
    tasks = ((config, folder, completer_for if alone else None) for folder in folders if folder.name not in whole)
    with running_on(config.backend), made or nullcontext():
        done = in_parallel(_complete, tasks, config.workers)
        for folder in progress([each for each in folders if each.name not in whole], "completing"):
            completed, notes = next(done)
            for note in notes:
                print(f"{completed.id}: {note}")
            if made is None:
                save_alone(completed, out)
            else:
                made.write(completed, folder.name)
            print(f"{completed.id}: {describe_joints(completed.poses)}")
    print(out)


def _settings(config: CompleteCommand) -> dict:
    """Return all that completed clips depend on: with the options and the clips, the weights."""
    settings = settings_of("dmae complete", config, Path(config.clip))
    model = None if config.weights is None else checksum(weights_folder(config.weights) / "model.json").sha256
    return settings | {"options": settings["options"] | {"weights": model}}


def _complete(
    config: CompleteCommand, folder: Path, completer_for: CompleterFor | None, frames: int | None = None
) -> tuple[Clip, list[str]]:
    """Return the clip of a folder, or its first frames, completed, and notes; weights are loaded once a process."""
    clip = load_clip(folder)
    if clip.poses is None:
        raise ValueError(f"{folder}: has no poses to complete; run dmae capture on it first")
    decisions = load_decisions(folder, clip.poses)
    blanked = decided(clip.poses, decisions, ReviewVerdict.blank)
    clip = with_decisions(clip, folder)
    if frames is not None:
        frames = min(frames, len(clip))
        clip, blanked = clip.select(frames=range(frames)), blanked[:frames]
    completer = (completer_for or _loaded(config))(clip.poses.skeleton)
    notes = completer.notes(clip.poses, clip.fps)
    if config.online:
        notes.append(f"each frame is completed from the frames until {config.delay:g} s after it")
        poses = complete_online(completer, clip.poses, clip.fps, config.delay)
    else:
        poses = completer(clip.poses, clip.fps)
    return replace(clip, poses=poses.without(blanked)), notes


def _completers(config: CompleteCommand) -> CompleterFor:
    options = {"denoise": config.denoise, "reject": config.reject, "smooth": config.smooth}
    return completers(Path(config.weights) if config.weights else None, **options)


_in_this_process: dict[tuple, CompleterFor] = {}  # The completers that a worker has loaded


def _loaded(config: CompleteCommand) -> CompleterFor:
    key = config.weights, config.denoise, config.reject, config.smooth
    if key not in _in_this_process:
        _in_this_process.clear()
        _in_this_process[key] = _completers(config)
    return _in_this_process[key]


def interrupted(config: CompleteCommand, out: Path) -> str:
    return finished(out)
