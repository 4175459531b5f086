"""`dmae complete`: fill what no camera measured, with trained weights."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from dmae.commands.data_sets import Manifest, describe_joints, finished
from dmae.completion.pipeline import completers
from dmae.data.store import clip_folders, load_clip, save_clip
from dmae.evaluation.review.decisions import ReviewVerdict, decided, load_decisions, with_decisions
from dmae.files.checksums import refuse_damaged
from dmae.online.completion import DELAY, complete_online
from dmae.progress import progress

WRITES = "folder"
EXAMPLES = (
    "dmae complete clip=runs/captured out=runs/completed",
    "dmae complete clip=runs/captured weights=runs/model out=runs/completed",
    "dmae complete clip=runs/captured reject=false denoise=false smooth=0 out=runs/filled",
    "dmae complete clip=runs/captured online=true delay=0.2 out=runs/online",
)


@dataclass(frozen=True)
class CompleteCommand:
    """Fill what no camera measured, marked as such."""

    clip: str = "???"
    """Folder of a captured clip, or of a data set of them."""
    weights: str | None = None
    """Folder that `dmae train` wrote; by default the weights that come with the package, for the skeleton of the
    poses."""
    denoise: bool | None = None
    """Let the model move joints measured by fewer than three views too; they are then marked denoised. By default where
    the weights were trained for it."""
    reject: bool = True
    """Drop joints of two views that the frames around contradict (`dmae.completion.rejection`), and complete them as
    well."""
    smooth: float = 0.1
    """s; light smoothing after that (0: none). What it moves is marked denoised."""
    online: bool = False
    """Complete as while cameras run: each frame by what is known `delay` after it."""
    delay: float = DELAY
    """s; delay of `online`."""
    damaged: bool = False
    """Complete even a data set of which files are missing or not as they were written."""
    out: str = "runs/complete"
    """Folder of the completed clip; of a data set a folder for each clip is made in it."""


def run(config: CompleteCommand, out: Path) -> None:
    options = {"denoise": config.denoise, "reject": config.reject, "smooth": config.smooth}
    completer_for = completers(Path(config.weights) if config.weights else None, **options)
    if not config.damaged:
        refuse_damaged(Path(config.clip), "damaged=true")
    folders = clip_folders(Path(config.clip))
    several = folders != [Path(config.clip)]
    with Manifest(out, several) as manifest:
        for folder in progress(folders, "completing"):
            clip = load_clip(folder)
            if clip.poses is None:
                raise ValueError(f"{folder}: has no poses to complete; run dmae capture on it first")
            decisions = load_decisions(folder, clip.poses)
            blanked = decided(clip.poses, decisions, ReviewVerdict.blank)
            clip = with_decisions(clip, folder)
            completer = completer_for(clip.poses.skeleton)
            for note in completer.notes(clip.poses, clip.fps):
                print(f"{clip.id}: {note}")
            if config.online:
                print(f"{clip.id}: each frame by what is known {config.delay:g} s after it")
                poses = complete_online(completer, clip.poses, clip.fps, config.delay)
            else:
                poses = completer(clip.poses, clip.fps)
            poses = poses.without(blanked)
            completed, target = replace(clip, poses=poses), out / folder.name if several else out
            manifest.write(folder.name, partial(save_clip, completed, target))
            print(f"{clip.id}: {describe_joints(poses)}")
    print(out)


def interrupted(config: CompleteCommand, out: Path) -> str:
    return f"{finished(out)}; the same command completes all clips anew"
