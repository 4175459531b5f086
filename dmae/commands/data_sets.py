"""What commands share that turn clips into clips: a data set at both ends, or a single clip."""

import hashlib
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from dmae.command_line import interruption
from dmae.commands.config import CaptureCommand, CompleteCommand
from dmae.data.cameras import camera_label
from dmae.data.clip import Clip, Poses3D, Source, person_name
from dmae.data.resume import claim_folder
from dmae.data.store import CHECKSUMS, MANIFEST, all_failed, clip_folders, save_clip
from dmae.evaluation.review import DECISIONS
from dmae.files.checksums import begin_data_set, checksum, find_damage, seal, write_checksums
from dmae.files.contents import whole_folder
from dmae.files.mapped import by_frames
from dmae.formats.reading import Clips, DataConfig
from dmae.parallel import in_parallel, process_count
from dmae.progress import duration, progress
from dmae.reconstruction.sides import exchanged_detections
from dmae.reporting.tables import counted

_OUTSIDE = 0.1  # Share of detected joints outside an image above which its size is doubted
_FEW_EXCHANGES = 0.02  # Share of frames with exchanged sides below which a camera is not named
SETTINGS = "settings.json"
"""In the folder of a data set that `dmae` made: what its clips depend on."""
_WITHOUT_EFFECT = ("clip", "out", "first", "clips", "damaged", "workers", "backend", "dry_run")
"""Options that the content of a clip does not depend on."""


def forecast(config: CaptureCommand | CompleteCommand, clips: int, begin: Callable[[int], tuple[int, Clip]]) -> str:
    """Return the time and disk space that clips take, by the first, middle and last of them.

    `begin` makes a piece of a clip, given its number, and returns the frames of the whole clip, and the piece.
    """
    start, size, frames, lengths = time.perf_counter(), 0, 0, []
    for length, clip in map(begin, sorted({0, clips // 2, clips - 1})):
        with TemporaryDirectory() as folder:
            save_clip(clip, Path(folder))
            size += sum(path.stat().st_size for path in Path(folder).iterdir())
        frames += len(clip)
        lengths.append(length)
    seconds, total = time.perf_counter() - start, clips * sum(lengths) / len(lengths)
    took = seconds / max(frames, 1) * total / min(process_count(config.workers), clips)
    megabytes = size / max(frames, 1) * total / 1e6
    return f"{counted(clips, 'clip')}, {total:.0f} frames: about {duration(took)}, {megabytes:.0f} MB"


def each_clip(data: DataConfig, out: Path, doing: str) -> Iterator[tuple[Clip, str, Path]]:
    """Each clip that `data=` names, the name of its folder, and the folder in `out` that its result goes to."""
    clips = Clips(data)
    for clip, folder in progress(zip(clips, clips.folders, strict=True), doing, len(clips)):
        yield clip, folder.name, out / folder.name if clips.data_set else out


def check_apart(out: Path, data: Path) -> None:
    """Raise ValueError if the clips that are read are to be overwritten: the command, given twice, would act twice; or
    if the output is in a data set with checksums, which other files would damage."""
    for around in out.resolve().parents:
        if (around / MANIFEST).is_file() and (around / CHECKSUMS).is_file():
            raise ValueError(f"out={out}: is in the data set {around}; choose a folder beside it, as out={around}_2")
    if out.resolve() == data.resolve():
        raise ValueError(
            f"out={out}: expected another folder than {data}, whose clips are not overwritten; "
            f"for example out={data.resolve()}_2"
        )


BAD_CLIP = (ValueError, FileNotFoundError)
"""Errors of a clip that cannot be read, or not be processed with these options. Others end the run: they are faults of
ours, as TypeError, or concern all clips, as KeyError an option and OSError a full disk."""


class ClipSet:
    """Where a command writes: one clip; or a data set of clip folders, with `settings.json`, manifest and checksums.

    Each clip of a data set gets its final name when it is whole, and a whole clip is never made again, so the same
    command continues an interrupted run, and several machines can fill one folder with `first=` and `clips=`. Manifest
    and checksums are written on leaving, after errors as well: what is whole is a data set.

    A clip of a data set that cannot be made is `failed` in the manifest, with the reason, and the others are made; on
    leaving, ValueError is raised if all failed. Only `BAD_CLIP` counts as failure: any other error ends the run.

    Clips depend on settings (`settings_of`); None for a single clip. Raises ValueError if the folder holds clips of
    other settings or of another command, or a data set where a single clip is to be written.
    """

    def __init__(self, out: Path, settings: dict | None):
        self.out, self.alone = Path(out), settings is None
        self.names: Sequence[str] = ()  # Of the clips to make
        self.whole: set[str] = set()  # Names of the clips that are done
        self.failed: dict[str, str] = {}  # Reasons, by name
        if settings is None:
            if (self.out / MANIFEST).is_file():
                raise ValueError(f"out={out}: expected a folder for one clip, found a data set; choose another folder")
            return
        if (self.out / "clip.json").is_file():
            raise ValueError(f"out={out}: expected a folder for a data set, found a clip; choose another folder")
        if not (self.out / SETTINGS).is_file() and any(self.out.glob("*/clip.json")):
            raise ValueError(f"out={out}: holds clips of another command; choose another folder")
        sealed = sorted(path.parent for path in self.out.glob(f"[!.]*/{CHECKSUMS}"))
        try:
            claim_folder(self.out / SETTINGS, settings, "clips")
        except ValueError:
            if sealed or not (self.out / MANIFEST).is_file():
                raise
            # All clips failed, which other settings may mend.
            for name in (SETTINGS, MANIFEST):
                (self.out / name).unlink()
            claim_folder(self.out / SETTINGS, settings, "clips")
        self.whole = {folder.name for folder in sealed if not find_damage(folder)}

    def __enter__(self) -> "ClipSet":
        if not self.alone:
            self.before = begin_data_set(self.out)
        return self

    def fill(
        self,
        make: Callable[..., tuple[Clip, list[str]]],
        names: Sequence[str],
        tasks: Iterable[tuple],
        workers: int,
        doing: str,
    ) -> Iterator[tuple[str, Clip | None, list[str]]]:
        """Make and write the clips that are not done yet, and yield each name, in order, with the clip and notes on it.

        `tasks`: arguments of `make` for each name. For a clip that was done before, None is yielded; for one that
        fails, nothing.
        """
        left = self.left(names)
        todo = (task for name, task in zip(names, tasks, strict=True) if name in left)
        made = in_parallel(make if self.alone else partial(_attempt, make), todo, workers)
        for name in progress(names, doing):
            if name not in left:
                yield name, None, []
                continue
            result = next(made)
            if isinstance(result, Exception):
                self.fail(name, result)
                continue
            clip, notes = result
            self.write(clip, name)
            yield name, clip, notes

    def left(self, names: Sequence[str]) -> list[str]:
        """Return the names, of the clips to make, that are not done yet, and say how many are done."""
        self.names = names
        if done := self.whole.intersection(names):
            print(f"{self.out}: {len(done)} of {len(names)} clips are done already")
        return [name for name in names if name not in done]

    def fail(self, name: str, error: Exception) -> None:
        """Note that a clip failed, and why; of a single clip, raise it."""
        if self.alone:
            raise error
        shutil.rmtree(self.out / name, ignore_errors=True)
        self.failed[name] = str(error)
        print(f"{name}: failed: {error}")

    def write(self, clip: Clip, name: str) -> None:
        """Write a clip."""
        if self.alone:
            if (self.out / "clip.json").is_file():
                print(f"{self.out}: the clip that was there is replaced")
            save_clip(clip, self.out)
            return
        folder = self.out / name
        shutil.rmtree(folder, ignore_errors=True)
        with whole_folder(folder) as partial:
            save_clip(clip, partial)
            write_checksums(partial)
        self.whole.add(name)
        if interruption.running:
            interruption.running.check()

    def __exit__(self, kind, *_) -> None:
        if self.alone:
            return
        # A command that was killed, or another machine, may have written clips that no manifest lists yet.
        whole = [{"id": path.parent.name, "status": "ok"} for path in self.out.glob(f"[!.]*/{CHECKSUMS}")]
        failed = [{"id": name, "status": "failed", "reason": reason} for name, reason in self.failed.items()]
        if whole or failed or (self.out / MANIFEST).is_file():
            seal(self.out, [*failed, *whole], (SETTINGS,), self.before)
        else:
            (self.out / SETTINGS).unlink(missing_ok=True)
            with suppress(OSError):
                self.out.rmdir()
        if not failed or kind is not None:
            return
        if not self.whole.intersection(self.names):
            raise ValueError(f"{self.out}: {all_failed(failed)}")
        print(f"{self.out}: {len(failed)} of {len(self.names)} clips failed; {MANIFEST} says why")


def _attempt(make: Callable[..., tuple[Clip, list[str]]], *task) -> tuple[Clip, list[str]] | Exception:
    try:
        return make(*task)
    except BAD_CLIP as error:
        return error


def settings_of(command: str, config, data: Path) -> dict:
    """Return all that a command's ("dmae capture") clips depend on: its options, and the content of their data set.

    The content is known by the `clip.json` of each clip, which holds a checksum of the arrays. Raises ValueError if
    there is no clip.
    """
    folders = clip_folders(data)
    files = (folder / name for folder in folders for name in ("clip.json", DECISIONS))
    content = hashlib.sha256(b"".join(file.read_bytes() for file in files if file.is_file())).hexdigest()
    options = {name: value for name, value in asdict(config).items() if name not in _WITHOUT_EFFECT}
    if "data" in options:
        # Machines may have the data set, and another calibration of it, in different places.
        options["data"] = options["data"] | {"path": None}
        if (calibration := options["data"]["calibration"]) is not None:
            options["data"] |= {"calibration": [checksum(file).sha256 for file in _files(Path(calibration))]}
    return {"command": command, "options": options, "data": content}


def _files(path: Path) -> list[Path]:
    return sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else [path]


def finished(config, out: Path) -> str:
    """Say which clips of a data set an interrupted command has written."""
    whole = len(list(Path(out).glob(f"[!.]*/{CHECKSUMS}")))
    done = f"{out}: {counted(whole, 'whole clip')}, which can be used" if whole else "nothing was written"
    return f"{done}; the same command continues"


def describe_sides(clip: Clip, poses: Poses3D, corrected: str) -> list[str]:
    """Say in which cameras the detector exchanged left and right, by poses captured from the clip, and that this is
    `corrected`; and which cameras disagree without a majority."""
    if poses.skeleton != clip.detections.skeleton:
        return []
    exchanged, disagreeing = exchanged_detections(clip, poses)
    least = max(_FEW_EXCHANGES * len(clip), 2)
    notes = [
        f"{camera_label(name)}: its detections have left and right exchanged in {count} of {len(clip)} frames, "
        f"{corrected}"
        for name, count in zip(clip.rig.names, exchanged.sum(0), strict=True)
        if count >= least
    ]
    frames, often = disagreeing.any(1).sum(), disagreeing.sum(0) >= least
    if often.any():
        names = ", ".join(name for name, here in zip(clip.rig.names, often, strict=True) if here)
        notes.append(
            f"cameras {names} disagree on left and right of a person in {frames} of {len(clip)} frames in which no "
            "majority decides, as two cameras show it: sides can be wrong there"
        )
    return notes


def describe_units(clip: Clip, th_p: float) -> list[str]:
    """Say which cameras seem to have an image size of height and width, and whether confidences seem to be percents."""
    rigs = clip.rig, replace(clip.rig, size=clip.rig.size[:, ::-1])

    def counted_by_view(xy: np.ndarray, score: np.ndarray) -> np.ndarray:
        inside = [rig.inside(xy).sum((2, 3)) for rig in rigs]
        high = [(score > most).sum((2, 3)) for most in (1, 100)]
        return np.stack([np.isfinite(score).sum((2, 3)), *high, *inside], -1)

    counts = by_frames(counted_by_view, clip.detections.xy, clip.detections.score).sum(0)
    notes = []
    for name, (width, height), (known, *_, inside, turned) in zip(clip.rig.names, clip.rig.size, counts, strict=True):
        if known - inside > _OUTSIDE * known and known - turned < _OUTSIDE * (known - inside):
            notes.append(
                f"{camera_label(name)}: {1 - inside / known:.0%} of its detected joints are outside its image of "
                f"{width} x {height} px, which one of {height} x {width} px would hold: sizes are width, height"
            )
    known, above, far_above = counts[:, :3].sum(0)
    if far_above > known / 2:
        notes.append("most confidences are above 100: are x, y and the confidence of each joint in this order?")
    elif above > known / 2:
        notes.append(
            f"most confidences are above 1, as percents are: capture.th_p={th_p:g}, for confidences up to 1, leaves "
            "out hardly any joint"
        )
    return notes


def describe_length(clip: Clip) -> str:
    """Say how many frames there are, and at which rate: it can be wrong, or found in a file that nobody named."""
    return f"{counted(len(clip), 'frame')} at {clip.fps:g} frames/s"


def describe_joints(poses: Poses3D) -> str:
    """How much of the joints was measured and completed, and how many person-frames have no known joint.

    Joints that were measured and then smoothed count as measured. Shares of joints are of the person-frames with a
    known joint.
    """
    present = (poses.source != Source.ABSENT).any(-1)
    if not present.any():
        return "no person captured"
    known = poses.source[present]
    completed, absent = (known == Source.COMPLETED).mean(), (known == Source.ABSENT).mean()
    measured, smoothed = 1 - completed - absent, (known == Source.DENOISED).mean()
    some = f"{smoothed:.1%} of all " if (known == Source.MEASURED).any() else ""
    moved = f" ({some}smoothed)" if smoothed else ""
    rejected = poses.rejected[present].mean()
    replaced = f" ({rejected:.1%} rejected and replaced, {completed - rejected:.1%} not measured)" if rejected else ""
    shares = f"joints {measured:.1%} measured{moved}, {completed:.1%} completed{replaced}, {absent:.1%} absent"
    away = int((~present).sum())
    if not away:
        return shares
    return (
        f"{shares}; not counting {away} of {present.size} person-frames ({away / present.size:.1%}) in which no "
        f"joint of the person is known: with them {(poses.source == Source.ABSENT).mean():.1%} of all joints are NaN"
    )


def describe_people(poses: Poses3D) -> str:
    """In which share of the frames each person is captured, and in which only completed."""
    captured, completed = (
        [f"{person_name(person)} {there.mean():.1%}" for person, there in enumerate(frames.T) if there.any() or always]
        for frames, always in ((poses.captured, True), (poses.only_completed, False))
    )
    more = f"; only completed in {', '.join(completed)}" if completed else ""
    return f"captured in {', '.join(captured)} of {counted(len(poses.xyz), 'frame')}{more}"
