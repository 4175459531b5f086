"""`dmae capture`: detections of several cameras to 3D poses."""

import sys
import time
from collections.abc import Collection
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from dmae.calibration.world import UPRIGHT, Floor, find_floor, place_clip, upright_direction, upright_world
from dmae.commands.config import CaptureCommand
from dmae.commands.data_sets import (
    ClipSet,
    check_apart,
    describe_joints,
    describe_length,
    describe_people,
    describe_sides,
    describe_units,
    finished,
    forecast,
    settings_of,
)
from dmae.completion.methods import find_method
from dmae.data.cameras import camera_label
from dmae.data.clip import Clip
from dmae.data.rng import Stream, generator
from dmae.data.store import load_clip
from dmae.evaluation.report.findings import Groups, JointGroup, Reprojection, added, reprojection, residual_tables
from dmae.files.mapped import by_frames
from dmae.formats.config import clip_range
from dmae.formats.reading import Clips
from dmae.numerics.compiled import compiled_anew
from dmae.numerics.filling import STRANGERS, are_stills, smooth
from dmae.reconstruction.config import ADAPTIVE, CaptureConfig, SubjectConfig
from dmae.reconstruction.diagnosis import explain_capture
from dmae.reconstruction.pipeline import capture, learn_noise
from dmae.registry import source_hash
from dmae.reporting.tables import counted, print_tables

_TRIED = 50  # Greatest number of frames of a clip that a forecast captures
_WORST = 3  # Joints with the largest reprojection errors that are printed
_UPRIGHT_Z = 0.5  # Least z of the unit vector from feet to head of people who stand in a world with z up
_FEW = 0.4  # Share of the detected joints; where people explain fewer, something is wrong
_NONE, _ENOUGH = 0.05, 200  # The same of one camera, with at least so many detected joints, where others are right
interrupted = finished


def run(config: CaptureCommand, out: Path, told: Collection[str] = ()) -> None:
    """Capture each clip, and print the reprojection errors of all; exits with status 1 if no person was found.

    `told`: notes on the recording that were printed before.
    """
    check_apart(out, Path(config.data.path))
    clips = Clips(config.data)
    settings = _settings(config) if clips.data_set else None
    numbers = clip_range(len(clips), config.first, config.clips)
    part = clips[numbers.start : numbers.stop]
    if config.dry_run:
        print(f"{out}: {forecast(config, len(part), lambda number: _begun(config, part[number : number + 1]))}")
        return
    frames, start, persons = 0, time.perf_counter(), 0
    measured: Groups = {}
    completed: Groups = {}
    names = [folder.name for folder in part.folders]
    tasks = ((config, part[index : index + 1]) for index in range(len(part)))
    with ClipSet(out, settings) as made:
        for name, captured, notes in made.fill(_capture, names, tasks, config.workers, "capturing"):
            if captured is None:
                captured = load_clip(out / name)
            else:
                frames += len(captured)
            for note in [*captured.provenance.get("notes", ()), *notes]:
                if note not in told:
                    print(f"{captured.id}: {note}")
            poses = captured.poses
            assert poses is not None
            people = counted(poses.xyz.shape[1], "person", "people")
            print(f"{captured.id}: {describe_length(captured)}, {people}, {describe_joints(poses)}")
            errors = reprojection(captured)
            if are_stills(captured.fps):
                print(f"{captured.id}: {captured.fps:g} frames/s: stills, in which nobody is followed: {STRANGERS}")
            elif poses.source.any():
                print(f"{captured.id}: {describe_people(poses)}; {errors.describe_unused()}")
            if made.alone:
                print(f"{captured.id}: {captured.provenance['noise']['found']}")
                print(f"{captured.id}: {_world(captured, config.level)}")
            persons += poses.xyz.shape[1]
            measured, completed = added(measured, errors.measured), added(completed, errors.completed)
            _print_doubts(captured, config.capture, poses.xyz.shape[1], errors)
    # A person 0 of one clip is not the person 0 of another, so there is no table by person for several clips.
    tables = residual_tables(measured, completed, ("camera", "person") if len(part) == 1 else ("camera",))
    if tables:
        print("Reprojection errors, px, of joints that a camera detected:")
        print_tables(tables)
        print(f"{out}: {_worst_joints(measured['joint'])}")
    if frames:
        # All of the command: reading, capture, floor, tables, writing.
        spent = time.perf_counter() - start
        once = "; it includes compiling functions, once on this machine" if compiled_anew() else ""
        print(f"{out}: {counted(frames, 'frame')} in {spent:.1f} s, {frames / spent:.3g} frames/s{once}")
    # A part of a data set may contain only empty rooms.
    if not persons and len(part) == len(clips):
        sys.exit(1)


def _settings(config: CaptureCommand) -> dict:
    """Return what the captured clips of a data set depend on, code of the user's own included."""
    settings = settings_of("dmae capture", config, Path(config.data.path))
    code = {name: source_hash(name) for name in (config.capture.method, config.fill) if ":" in name}
    return settings | ({"code": code} if code else {})


def _worst_joints(by_joint: dict[str, JointGroup]) -> str:
    worst = sorted((each.mean, joint) for joint, each in by_joint.items() if each.mean is not None)[: -_WORST - 1 : -1]
    return f"largest: {', '.join(f'{joint} {mean:.1f} px' for mean, joint in worst)}; dmae report lists all joints"


def _print_doubts(clip: Clip, config: CaptureConfig, persons: int, errors: Reprojection) -> None:
    """Print why no person was found, or the likely fault if the people explain few of the detections."""
    if not persons:
        ours = ""
        if config.method != ADAPTIVE:
            ours = f" by capture.method={config.method}; here are the steps of capture.method={ADAPTIVE}"
        print(f"{clip.id}: no person was captured{ours}; {explain_capture(clip, config)}")
        return
    assert clip.poses is not None
    people = clip.poses.xyz.reshape(-1, *clip.poses.xyz.shape[2:])
    standing = None if clip.poses.skeleton.defined else upright_direction(people, clip.poses.skeleton)
    if standing is not None and standing[1] >= UPRIGHT and standing[0][2] < _UPRIGHT_Z:
        axis = ", ".join(f"{x:.2f}" for x in standing[0])
        print(
            f"{clip.id}: people lie along ({axis}) all the time, or another axis than z is up: dmae doctor, with the "
            "same data=..., names the value for data.up (of dmae run: world.up)"
        )
    if (config.persons, config.volume, config.subject) != (None, None, SubjectConfig()):
        return  # people were left out on purpose
    detected = (clip.detections.score >= config.th_p).sum((0, 2, 3))
    explained = errors.measured["all"]["all"].compared / max(detected.sum(), 1)
    if explained < _FEW:
        print(f"{clip.id}: only {explained:.0%} of the detected joints are of captured people")
        for suggestion in explain_capture(clip, config).suggestions:
            print(f"  suggestion: {suggestion}")
        return
    for name, number in zip(clip.rig.names, detected.tolist(), strict=True):
        share = errors.measured["camera"][name].compared / max(number, 1)
        if number >= _ENOUGH and share < _NONE:
            print(
                f"{clip.id}: {camera_label(name)}: {share:.0%} of {number:,} detected joints are of captured people, "
                f"{explained:.0%} in all; dmae doctor, with the same data=..., compares it with the others"
            )


def _capture(config: CaptureCommand, clips: Clips, frames: int | None = None) -> tuple[Clip, list[str]]:
    """Return the one clip, or its first frames, captured; and notes on exchanged sides and blind cameras."""
    (clip,), (number,) = clips, clips.numbers
    if frames is not None:
        clip = clip.select(frames=range(min(frames, len(clip))))
    if config.draw:
        clip = clip.select(views=_drawn(config, len(clip.rig), number))
    noise = learn_noise(clip, config.capture)
    poses = measured = capture(clip, config.capture, noise)
    if config.fill != "none":
        poses = find_method(config.fill).load()(poses, clip.fps)
    notes = describe_units(clip, config.capture.th_p)
    notes += describe_sides(clip, measured, "put right by the other cameras")
    seeing = np.any(by_frames(lambda score: np.isfinite(score).any((2, 3)), clip.detections.score), 0)
    if seeing.any() and not seeing.all():
        blind = ", ".join(name for name, sees in zip(clip.rig.names, seeing, strict=True) if not sees)
        notes.append(f"no detections of {blind}: the files hold no people, or only joints of confidence 0")
    floor = find_floor(measured, clip.fps)
    clip = replace(clip, poses=smooth(poses, clip.fps, config.smooth))
    world = upright_world(floor) if config.level else None
    if world is not None:
        clip = place_clip(clip, world)
    found = {"noise": noise.summary(clip.rig.names), "floor": asdict(floor) | {"levelled": world is not None}}
    return replace(clip, provenance=clip.provenance | found), notes


def _world(clip: Clip, level: bool) -> str:
    """Return the known facts about the floor and the vertical, and what `level` changed."""
    facts = dict(clip.provenance["floor"])
    facts.pop("levelled")
    floor = Floor(**facts)
    done = {
        (True, True): "made level, with its floor at z = 0; before, ",
        (True, False): "turned upright; its floor stays where it was. Before, ",
        (False, True): "floor moved to z = 0; the world is not turned. Before, ",
        (False, False): "the world stays as it is: ",
    }[floor.up is not None, floor.height_m is not None]
    return f"{done if level else ''}{floor.describe()}"


def _begun(config: CaptureCommand, clips: Clips) -> tuple[int, Clip]:
    """Return the number of frames of the one clip, and a captured piece of it."""
    frames = len(clips[0])
    return frames, _capture(config, clips, min(_TRIED, 10 + frames // 5))[0]


def _drawn(config: CaptureCommand, views: int, number: int) -> list[int]:
    """The cameras of the clip of that number in its data set."""
    if not all(2 <= count <= views for count in config.draw):
        raise ValueError(f"draw={config.draw}: expected numbers from 2 to {views}, the cameras there are")
    rng = generator(config.seed, number, Stream.CAMERAS)
    return sorted(rng.choice(views, rng.choice(config.draw), replace=False).tolist())
