"""Plan cameras: search rigs for each number of cameras, and check them on people who were not used in the search."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy import stats

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.rng import Stream, generator
from dmae.metrics.comparison import Comparison
from dmae.metrics.identity import identity_switches, idf1
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.position import percent
from dmae.numerics.filling import fill_world, smooth
from dmae.numerics.paths import linear
from dmae.numerics.statistics import mean_known
from dmae.parallel import in_parallel, process_count, running_on
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from synth.planning.config import PlanConfig
from synth.planning.places import CandidateCameras, aimed_cameras, find_places, given_cameras
from synth.planning.search import JointEvidence, RigPrediction, choose, gather, predict, rehearse, seconds_of_search
from synth.rigs.config import NO_RIG
from synth.rigs.coverage import stage_of
from synth.rigs.rig import make_rig
from synth.rooms.rays import EVERY_GROUP, at_rest, cast_rays
from synth.rooms.room import arena_file, compile_mjcf, load_room

FIGURES = {
    "missing": ("joints not measured", "%"),
    "pcp": ("PCP", "%"),
    "error": ("error", "mm"),
    "switches": ("identities confused", "a minute"),
    "idf1": ("IDF1", "%"),
}
"""Scored figures: heading and unit. PCP and the error are computed after gaps are filled by straight lines and the
paths are smoothed, as in `dmae evaluate methods=[linear]`."""
_SMOOTH = 0.1
_LEVEL = 0.95


@dataclass(frozen=True)
class Expected:
    """The expected value of a figure of a rig, with its 95 % interval over clips."""

    value: float
    low: float
    high: float


def measure(captured: Poses3D, truth: Poses3D, fps: float) -> dict[str, float]:
    """Return the `FIGURES` of one capture against the truth (F, T), on its skeleton. A figure without data is NaN."""
    filled = convert(smooth(fill_world(captured, fps, linear), fps, _SMOOTH), truth.skeleton)
    actors = tuple(np.flatnonzero(np.isfinite(truth.xyz).all(-1).any((0, 2))).tolist())
    compared = Comparison(filled, convert(captured, truth.skeleton), truth, actors, fps=fps)
    correct, known = correct_limbs(compared.matched, truth.xyz, truth.skeleton)
    error = np.linalg.norm(compared.matched - truth.xyz.astype(np.float64), axis=-1)
    minutes = len(truth.xyz) / fps / 60
    return {
        "missing": float(percent(compared.hidden & compared.known, compared.known, None)),
        "pcp": float(mean_known(percent(correct, known, (0, 2))[list(actors)])),
        "error": 1000 * float(mean_known(error, None)),
        "switches": identity_switches(compared.matches) / minutes,
        "idf1": idf1(filled.xyz, truth.xyz),
    }


def check_rigs(
    config: PlanConfig, cameras: CameraRig, rigs: Sequence[Sequence[int]], numbers: Sequence[int]
) -> dict[str, np.ndarray]:
    """Capture N clips with each of R rigs, given by indices of at least two cameras. Return the `FIGURES`, (R, N) each.

    People are simulated once for all rigs. A camera has the same detections in every rig that contains it.

    Raises FailedSimulation if a clip failed with every seed.
    """
    tasks = ((config, cameras, [list(rig) for rig in rigs], number) for number in numbers)
    made = in_parallel(_check_clip, tasks, config.workers)
    clips = list(progress(made, "capturing people not used in planning", len(numbers)))
    return {name: np.array([[found[name] for found in clip] for clip in clips]).T for name in FIGURES}


def _check_clip(config: PlanConfig, cameras: CameraRig, rigs: list[list[int]], number: int) -> list[dict]:
    return capture_all(rehearse(config, number).seen_by(cameras, config.detector), rigs)


def capture_all(clip: Clip, rigs: Sequence[Sequence[int]]) -> list[dict[str, float]]:
    """Return the figures of a clip for each subset of its cameras in `rigs`; of a fused skeleton on its last part."""
    assert clip.truth is not None
    truth = convert(clip.truth, clip.truth.skeleton.parts[-1])
    return [measure(capture(clip.select(views=list(rig)), CaptureConfig()), truth, clip.fps) for rig in rigs]


def expected(figures: np.ndarray, least: float = -np.inf, greatest: float = np.inf) -> Expected:
    """Return the mean of a figure over N clips, with its interval for clips of other people (Student's t).

    Clips without the figure are left out. The interval is cut at the possible range of the figure, and NaN if fewer
    than two clips remain.
    """
    known = figures[np.isfinite(figures)]
    if not len(known):
        return Expected(np.nan, np.nan, np.nan)
    mean = float(known.mean())
    if len(known) < 2:
        return Expected(mean, np.nan, np.nan)
    half = stats.t.ppf((1 + _LEVEL) / 2, len(known) - 1) * known.std(ddof=1) / np.sqrt(len(known))
    return Expected(mean, max(mean - float(half), least), min(mean + float(half), greatest))


# Coverage of the floor: the number of cameras that see a standing person, if only the room hides the person.

_HEIGHTS = np.array([0.1, 0.5, 0.9, 1.3, 1.7])
"""Heights of the tested points of a standing person, m."""
_LEAST_POINTS = 4
"""Number of these points that a camera must see to count as seeing the person."""
_STEP = 0.2
"""Distance between points of the floor, m."""
_CONTACT_GAP = 0.05
"""Distance below which an object in front of a point does not hide it, m."""


@dataclass(frozen=True)
class FloorCoverage:
    """The number of cameras that see a person at each point of a grid."""

    # x, y: (N,) and (M,) coordinates of the grid, m
    x: np.ndarray
    y: np.ndarray
    cameras: np.ndarray  # (N, M) number of cameras; -1 outside the people's area

    def share(self, least: int) -> float:
        """Return the share of the people's area that at least this number of cameras see, %."""
        inside = self.cameras >= 0
        return float(100 * (self.cameras[inside] >= least).mean())


def cover_floor(rig: CameraRig, arena: Path, middle: np.ndarray, radius: float) -> FloorCoverage:
    """Return the number of cameras that see a person at points of the people's area, a circle around `middle` (2,), m.

    Only the room, an MJCF file, hides a person; props and other people are ignored.
    """
    model = compile_mjcf(arena)
    data = at_rest(model)
    steps = np.linspace(-radius, radius, 1 + 2 * max(1, round(radius / _STEP)))
    x, y = middle[0] + steps, middle[1] + steps
    flat = np.stack(np.meshgrid(x, y, indexing="ij"), -1)
    points = np.concatenate([np.tile(flat[:, :, None], (1, 1, len(_HEIGHTS), 1)),
                             np.broadcast_to(_HEIGHTS[:, None], (*flat.shape[:2], len(_HEIGHTS), 1))], -1)  # fmt: skip
    inside = rig.inside(rig.project(points.reshape(1, -1, 3))[0])[0]
    seen = np.zeros((len(rig), points[..., 0].size), bool)
    for view, center in enumerate(rig.centers):
        rays = points.reshape(-1, 3) - center
        reach = np.linalg.norm(rays, axis=1)
        geom, distance, _ = cast_rays(model, data, center, rays / reach[:, None], EVERY_GROUP)
        seen[view] = inside[view] & ((geom < 0) | (distance > reach - _CONTACT_GAP))
    count = (seen.reshape(len(rig), *points.shape[:3]).sum(-1) >= _LEAST_POINTS).sum(0)
    return FloorCoverage(x, y, np.where(np.linalg.norm(flat - middle, axis=-1) <= radius + 1e-9, count, -1))


# Plan cameras: simulate people, choose rigs for them, and check the rigs on other people.


@dataclass(frozen=True)
class PlannedRig(CandidateCameras):
    """The V cameras that a plan proposes for one number of cameras, counter-clockwise around the people."""

    prediction: RigPrediction  # Prediction of the search
    # Figures on people that were not used in the search, by name in `synth.planning.plan.FIGURES`
    figures: dict[str, Expected]
    # (V,) gain from each camera: the figures with it minus the figures without it; empty for two cameras
    worth: tuple[dict[str, Expected], ...]
    floor: FloorCoverage  # Coverage of the floor


@dataclass(frozen=True)
class CameraPlan:
    """The result of a plan."""

    config: PlanConfig  # The configuration
    rigs: tuple[PlannedRig, ...]  # A rig for each number of cameras
    candidates: int  # Number of candidate cameras
    room: tuple[str, ...]  # Descriptions of the missing parts of the room that were filled in, one clause each

    def __getitem__(self, number: int) -> PlannedRig:
        """Return the rig with this number of cameras."""
        return next(each for each in self.rigs if len(each.rig) == number)


@dataclass(frozen=True)
class PlanForecast:
    """The estimated cost of a plan."""

    candidates: int  # Number of cameras to choose from
    clips: int  # Number of clips to simulate
    captures: int  # Number of captures of clips
    seconds: float  # Estimated time, s


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
        chosen = choose(evidence, candidates.place, config.numbers)
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
    """Return the candidate cameras: the cameras of `rig`, or without a rig cameras at all places of `mount`, aimed at
    people. Raises as `make_plan`."""
    scene = config.setting()
    arena, middle = arena_file(scene.arena), np.array(scene.middle, float)
    stage = stage_of(arena, middle, scene.radius)
    if config.rig != NO_RIG:
        found = given_cameras(make_rig(config.rig, rng=generator(config.seed, 0, Stream.CAMERAS), stage=stage))
    else:
        places = find_places(config.mount, arena, middle, scene.radius)
        found = aimed_cameras(places, config.lens, middle, scene.radius, stage, steepest=config.mount.steepest_deg)
    count = len(set(found.place.tolist()))
    if config.views[1] > count:
        raise ValueError(
            f"views={list(config.views)}: there are {count} "
            + ("cameras in the rig" if config.rig != NO_RIG else "places for cameras; raise mount.places")
        )
    return found


def gather_evidence(config: PlanConfig, candidates: CandidateCameras) -> JointEvidence:
    """Simulate the people of the search, and return the evidence of all candidates on them."""
    tasks = ((config, candidates, number) for number in range(config.search.clips))
    made = in_parallel(_gather, tasks, config.workers)
    parts = list(progress(made, "rehearsing", config.search.clips))
    return JointEvidence(*(np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])))


def _gather(config: PlanConfig, candidates: CandidateCameras, number: int) -> JointEvidence:
    return gather(rehearse(config, number), candidates, config.detector, config.search.frames)


def check_numbers(config: PlanConfig) -> range:
    """Return the numbers of the clips that rigs are checked on. The search uses none of these clips."""
    return range(config.search.clips, config.search.clips + config.search.check_clips)


def with_one_less(cameras: Sequence[int]) -> list[list[int]]:
    """Return a rig, then it without its first camera, without its second, ...; of two cameras only itself."""
    less = combinations(cameras, len(cameras) - 1) if len(cameras) > 2 else ()
    # `combinations` leaves out the last camera first.
    return [list(cameras), *(list(rig) for rig in reversed(list(less)))]


def _around(candidates: CandidateCameras, cameras: list[int], config: PlanConfig) -> list[int]:
    """Return cameras sorted counter-clockwise around the people. Existing cameras keep the order of their rig."""
    if config.rig != NO_RIG:
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
    if config.rig == NO_RIG:
        rig = replace(rig, names=tuple(f"camera{number + 1}" for number in range(len(rig))))
    most = {name: 100.0 if unit == "%" else np.inf for name, (_, unit) in FIGURES.items()}
    whole = {name: expected(values[0], 0.0, most[name]) for name, values in figures.items()}
    worth = tuple(
        {name: expected(values[0] - values[1 + lacking]) for name, values in figures.items()}
        for lacking in range(len(figures["pcp"]) - 1)
    )
    return PlannedRig(
        rig,
        candidates.place[cameras],
        candidates.kind[cameras],
        candidates.view_deg[cameras],
        predict(evidence, cameras),
        whole,
        worth,
        cover_floor(rig, arena_file(scene.arena), np.array(scene.middle, float), scene.radius),
    )


def forecast_plan(config: PlanConfig) -> PlanForecast:
    """Estimate the time of a plan from one short clip, simulated, detected and captured. Raises as `make_plan`."""
    candidates = find_candidates(config)
    scene = config.setting()
    short = replace(config, scene=replace(config.scene, seconds=min(scene.seconds, 1.0)))
    start = time.perf_counter()
    rehearsal = rehearse(short, 0)
    frames = len(rehearsal.simulation.qpos)
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
    seconds += check * scene.frames * (rigs * captured + 2.5 * config.views[1] * seen)
    seconds /= process_count(config.workers)
    rows = search.clips * search.frames * len(evidence.probability) // 2
    seconds += seconds_of_search(evidence, rows, len(candidates), config.numbers)
    return PlanForecast(len(candidates), search.clips + check, check * rigs, seconds)
