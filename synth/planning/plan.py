"""Plan cameras: simulate people, choose rigs for them, and check the rigs on other people."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.rng import Stream, generator
from dmae.parallel import in_parallel, process_count, running_on
from dmae.progress import progress
from synth.planning.candidates import CandidateCameras, aimed_cameras, given_cameras
from synth.planning.check import FIGURES, Expected, capture_all, check_rigs, expected
from synth.planning.config import PlanConfig
from synth.planning.evidence import JointEvidence, gather
from synth.planning.floor import FloorCoverage, cover_floor
from synth.planning.mounts import find_places, stage_of
from synth.planning.rehearsal import rehearse
from synth.planning.search import RigPrediction, choose, predict, seconds_of_search
from synth.rigs.rig import RigConfig, make_rig
from synth.rooms.catalogue import arena_file
from synth.rooms.room import load_room

_NO_RIG = RigConfig(name="")


@dataclass(frozen=True)
class PlannedRig:
    """The cameras that a plan proposes for one number of cameras.

    Attributes:
        rig: V cameras, counter-clockwise around the people.
        kind: (V,) "wall", "ceiling", "tripod" or "given".
        view_deg, pan_deg, tilt_deg: (V,) as in `synth.planning.candidates.CandidateCameras`.
        prediction: Prediction of the search.
        figures: Figures on people that were not used in the search, by name in `synth.planning.check.FIGURES`.
        worth: (V,) gain from each camera: the figures with it minus the figures without it; empty for two cameras.
        floor: Coverage of the floor.
    """

    rig: CameraRig
    kind: np.ndarray
    view_deg: np.ndarray
    pan_deg: np.ndarray
    tilt_deg: np.ndarray
    prediction: RigPrediction
    figures: dict[str, Expected]
    worth: tuple[dict[str, Expected], ...]
    floor: FloorCoverage


@dataclass(frozen=True)
class CameraPlan:
    """The result of a plan.

    Attributes:
        config: The configuration.
        rigs: A rig for each number of cameras.
        candidates: Number of candidate cameras.
        room: Descriptions of the missing parts of the room that were filled in, one clause each.
    """

    config: PlanConfig
    rigs: tuple[PlannedRig, ...]
    candidates: int
    room: tuple[str, ...]

    def __getitem__(self, number: int) -> PlannedRig:
        """Return the rig with this number of cameras."""
        return next(each for each in self.rigs if len(each.rig) == number)


@dataclass(frozen=True)
class PlanForecast:
    """The estimated cost of a plan.

    Attributes:
        candidates: Number of cameras to choose from.
        clips: Number of clips to simulate.
        captures: Number of captures of clips.
        seconds: Estimated time, s.
    """

    candidates: int
    clips: int
    captures: int
    seconds: float


def make_plan(config: PlanConfig) -> CameraPlan:
    """Plan cameras.

    Raises:
        ValueError: the room has no walls although they are needed, heights are outside the room, or there are fewer
            places than cameras.
        FailedSimulation: people could not be simulated, or an existing camera is at an impossible place.
    """
    candidates = find_candidates(config)
    with running_on(config.backend):
        evidence = gather_evidence(config, candidates)
        chosen = choose(evidence, candidates.place, config.numbers, config.search.exchanges)
        ordered = {number: _around(candidates, cameras, config) for number, cameras in chosen.items()}
        rigs = [rig for cameras in ordered.values() for rig in with_one_less(cameras)]
        cameras = sorted({camera for rig in rigs for camera in rig})
        rank = {camera: number for number, camera in enumerate(cameras)}
        figures = check_rigs(
            config, candidates.rig[cameras], [[rank[camera] for camera in rig] for rig in rigs], check_numbers(config)
        )
    planned, first = [], 0
    for cameras in ordered.values():
        count = len(with_one_less(cameras))
        of_rig = {name: values[first : first + count] for name, values in figures.items()}
        planned.append(_planned(config, candidates, cameras, evidence, of_rig))
        first += count
    room = load_room(config.setting().arena).filled
    return CameraPlan(config, tuple(planned), len(candidates), room)


def find_candidates(config: PlanConfig) -> CandidateCameras:
    """Return the candidate cameras: those of `rig`, or, without a rig, aimed cameras at all places of `mount`.

    Raises:
        ValueError, FailedSimulation: the same cases as in `make_plan`.
    """
    scene = config.setting()
    arena, middle = arena_file(scene.arena), np.array(scene.middle, float)
    stage = stage_of(arena, middle, scene.radius)
    if config.rig != _NO_RIG:
        found = given_cameras(make_rig(config.rig, rng=generator(config.seed, 0, Stream.CAMERAS), stage=stage))
    else:
        places = find_places(config.mount, arena, middle, scene.radius)
        found = aimed_cameras(places, config.lens, middle, scene.radius, stage, steepest=config.mount.steepest_deg)
    places = len(set(found.place.tolist()))
    if config.cameras[1] > places:
        raise ValueError(
            f"cameras={list(config.cameras)}: there are {places} "
            + ("cameras in the rig" if config.rig != _NO_RIG else "places for cameras; raise mount.places")
        )
    return found


def gather_evidence(config: PlanConfig, candidates: CandidateCameras) -> JointEvidence:
    """Simulate the people of the search, and return the evidence of all candidates on them."""
    tasks = ((config, candidates, number) for number in range(config.search.clips))
    made = in_parallel(_gather, tasks, config.workers)
    return JointEvidence.joined(list(progress(made, "rehearsing", config.search.clips)))


def _gather(config: PlanConfig, candidates: CandidateCameras, number: int) -> JointEvidence:
    return gather(rehearse(config, number), candidates, config.detector, config.search.frames)


def check_numbers(config: PlanConfig) -> range:
    """Return the numbers of the clips that rigs are checked on. The search uses none of these clips."""
    return range(config.search.clips, config.search.clips + config.search.check_clips)


def with_one_less(cameras: Sequence[int]) -> list[list[int]]:
    """Return a rig, then the same rig without its first camera, without its second, ...

    For a rig of two cameras, only the rig itself is returned.
    """
    less = combinations(cameras, len(cameras) - 1) if len(cameras) > 2 else ()
    # `combinations` leaves out the last camera first.
    return [list(cameras), *(list(rig) for rig in reversed(list(less)))]


def _around(candidates: CandidateCameras, cameras: list[int], config: PlanConfig) -> list[int]:
    """Return cameras sorted counter-clockwise around the people. Existing cameras keep the order of their rig."""
    if config.rig != _NO_RIG:
        return sorted(cameras)
    x, y = (candidates.rig.centers[cameras, :2] - config.setting().middle).T
    return [cameras[index] for index in np.argsort(np.arctan2(y, x) % (2 * np.pi))]


def _planned(
    config: PlanConfig,
    candidates: CandidateCameras,
    cameras: list[int],
    evidence: JointEvidence,
    figures: dict[str, np.ndarray],
) -> PlannedRig:
    scene = config.setting()
    rig = candidates.rig[cameras]
    if config.rig == _NO_RIG:
        rig = replace(rig, names=tuple(f"camera{number + 1}" for number in range(len(rig))))
    most = {name: 100.0 if unit == "%" else np.inf for name, (_, unit) in FIGURES.items()}
    whole = {name: expected(values[0], 0.0, most[name]) for name, values in figures.items()}
    worth = tuple(
        {name: expected(values[0] - values[1 + lacking]) for name, values in figures.items()}
        for lacking in range(len(figures["pcp"]) - 1)
    )
    return PlannedRig(
        rig,
        candidates.kind[cameras],
        candidates.view_deg[cameras],
        candidates.pan_deg[cameras],
        candidates.tilt_deg[cameras],
        predict(evidence, cameras),
        whole,
        worth,
        cover_floor(rig, arena_file(scene.arena), np.array(scene.middle, float), scene.radius),
    )


def forecast_plan(config: PlanConfig) -> PlanForecast:
    """Estimate the time of a plan from one short clip, which is simulated, detected and captured.

    Raises:
        ValueError, FailedSimulation: the same cases as in `make_plan`.
    """
    candidates = find_candidates(config)
    scene = config.setting()
    short = replace(config, scene=replace(config.scene, seconds=min(scene.seconds, 1.0)))
    start = time.perf_counter()
    rehearsal = rehearse(short, 0)
    frames = len(rehearsal.qpos)
    simulated = (time.perf_counter() - start) / frames
    few = list(range(0, len(candidates), max(1, len(candidates) // 12)))[:12]
    some = CandidateCameras(candidates.rig[few], candidates.place[few], candidates.kind[few], candidates.view_deg[few])
    start = time.perf_counter()
    evidence = gather(rehearsal, some, config.detector, 2)
    seen = (time.perf_counter() - start) / (2 * len(few))
    clip = rehearsal.seen_by(candidates.rig[few[:4]], config.detector)
    # The first capture loads compiled code, so it is not timed.
    capture_all(clip, [range(len(clip.rig))])
    start = time.perf_counter()
    capture_all(clip, [range(len(clip.rig))])
    captured = (time.perf_counter() - start) / frames
    search, check = config.search, config.search.check_clips
    rigs = sum(1 + (number if number > 2 else 0) for number in config.numbers)
    seconds = (search.clips + check) * scene.frames * simulated
    seconds += search.clips * min(search.frames, scene.frames) * len(candidates) * seen
    seconds += check * scene.frames * (rigs * captured + 2.5 * config.cameras[1] * seen)
    seconds /= process_count(config.workers)
    rows = search.clips * search.frames * len(evidence.probability) // 2
    seconds += seconds_of_search(evidence, rows, len(candidates), config.numbers)
    return PlanForecast(len(candidates), search.clips + check, check * rigs, seconds)
