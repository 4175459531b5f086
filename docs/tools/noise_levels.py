"""Capture with noise learned from the recording, beside an oracle that knows it: `docs/results/noise_levels.json`.

    python docs/tools/noise_levels.py               # all tables: a quarter of an hour of one core
    python docs/tools/noise_levels.py rooms ghosts  # these tables; the others are kept

Detections are true joints in the image, where a camera sees them, with errors that are drawn here: Gaussian noise that
grows with the person in the image and with doubt, 2 % of joints that are somewhere else altogether, and joints that are
missed. They are then rounded to a grid, and their confidences are spoilt. The oracle is the same capture, told the
noise of each camera, joint and confidence. Generated clips are kept in `runs/noise_levels`.
"""

import json
import sys
import warnings
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from planted_recordings import ROOT, planted, write_tables
from scipy.optimize import linear_sum_assignment

import dmae
import synth
from dmae.calibration.faults import Fault
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.conversion import convert
from dmae.data.json_values import json_text
from dmae.data.skeleton import BODY25
from dmae.metrics.comparison import match, take_matched
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.noise import DetectionNoise
from dmae.reconstruction.pipeline import capture
from dmae.regression.solvers import dlt

sys.path.insert(0, str(ROOT))
from tests.support.ghosts import haunted_clip, two_people

KEPT = ROOT / "runs/noise_levels"
CONFIG = CaptureConfig()
SIGMAS_PX = 0.5, 1, 2, 4, 8, 15
CONFIDENCES = "good", "constant", "inverted", "squared", "missing"
CAMERAS = {2: [0, 3], 3: [0, 3, 5], 5: [0, 1, 3, 5, 6], 8: list(range(8))}
"""Of the ring of eight."""
ZOOMS = {"320 x 241": 0.31, "640 x 481": 0.62, "1032 x 776": 1.0, "1920 x 1444": 1.86, "3840 x 2887": 3.72}
GRIDS_PX = 1, 2, 4, 8
SEEDS = range(2)
OUTLIERS = 0.02
"""Share of joints that are detected somewhere else: 0.3 of the person's height away, in each direction."""
DOUBT = 2.2, 1.7
"""Noise relative to that of a usual joint, by confidence c: 2.2 - 1.7 c."""
NEAR_M = 0.2
"""m; a joint at a larger distance from the truth is not found."""
QUANTILE = 6.2514
"""90 % quantile of the squared distance of three Gaussian variables."""
LIMBS = (
    "l_shoulder l_elbow", "l_elbow l_wrist", "r_shoulder r_elbow", "r_elbow r_wrist", "l_hip l_knee", "l_knee l_ankle",
    "r_hip r_knee", "r_knee r_ankle", "neck mid_hip", "neck nose",
)  # fmt: skip


@lru_cache(2)
def true_clip(seed: int) -> Clip:
    """Return three or four people who walk and talk, seen exactly by a ring of eight cameras."""
    ring = synth.RigConfig(name="ring", ring=synth.RingConfig(views=8))
    return _exact(f"walk{seed}", clips=1, seconds=2.4, persons=[3, 4], rig=ring, seed=201 + seed)


def _kept(name: str, **options) -> Clip:
    """Return a generated clip, which is kept for the next time."""
    if not (KEPT / name / "clip.json").is_file():
        dmae.save(next(iter(synth.generate(**options))), KEPT / name)
    return dmae.load(KEPT / name)


def _exact(name: str, **options) -> Clip:
    """Return a generated clip with exact detections, of person p at index p."""
    clip = _kept(name, detector="clean", **options)
    frame, view, detection = np.nonzero(clip.detection_labels.person >= 0)
    person = clip.detection_labels.person[frame, view, detection]
    shape = *clip.detections.score.shape[:2], clip.truth.xyz.shape[1], len(BODY25)
    xy, score = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    xy[frame, view, person] = clip.detections.xy[frame, view, detection]
    score[frame, view, person] = clip.detections.score[frame, view, detection]
    return replace(clip, detections=Detections2D(BODY25, xy, score), detection_labels=None)


def detected(
    clip: Clip, views: list[int], zoom: float, sigma_px: float, grid_px: float, confidences: str, seed: int
) -> tuple[Clip, Clip, DetectionNoise]:
    """Return a clip as a detector with known noise sees it, and what the oracle is given: the clip with its true
    confidences, and the noise.

    Args:
        clip: With exact detections, see `true_clip`.
        views: Indices of its cameras.
        zoom: Factor of the size of the images.
        sigma_px: Standard deviation along one axis of a usual joint of a person at the median distance, px.
        grid_px: px to which detections are rounded; 0 for none.
        confidences: One of `CONFIDENCES`.
        seed: Of the noise.
    """
    rng = np.random.default_rng(seed)
    clip = clip.select(views=views)
    rig = clip.rig
    K = rig.K * np.array([zoom, zoom, 1.0])[:, None]
    rig = CameraRig(rig.names, K, rig.dist, rig.cam_from_world, np.round(rig.size * zoom).astype(int))
    exact, score = clip.detections.xy * zoom, clip.detections.score
    seen = np.isfinite(score)
    scale = rig.focal[:, None, None] / _depths(rig, convert(clip.truth, BODY25).xyz)
    spread_m = sigma_px / np.median(scale[seen])
    sure = np.clip(rng.beta(5, 1.7, seen.shape), 0.05, 0.99)
    doubt = DOUBT[0] - DOUBT[1] * sure
    xy = exact + (spread_m * scale * doubt)[..., None] * rng.normal(size=exact.shape)
    height = np.fmax.reduce(exact[..., 1], -1) - np.fmin.reduce(exact[..., 1], -1)
    off = rng.uniform(size=seen.shape) < OUTLIERS
    xy += off[..., None] * 0.3 * height[..., None, None] * rng.normal(size=exact.shape)
    if grid_px:
        xy = np.round(xy / grid_px) * grid_px
    known = seen & (rng.uniform(size=seen.shape) > 0.03 + 0.25 * (1 - sure) ** 2)
    given = {
        "good": sure, "constant": np.full_like(sure, 0.5), "missing": np.ones_like(sure), "inverted": 1 - sure,
        "squared": sure**2,
    }[confidences]  # fmt: skip
    blind = confidences in ("constant", "missing")

    def with_scores(scores: np.ndarray) -> Clip:
        found = Detections2D(BODY25, np.where(known[..., None], xy, np.nan), np.where(known, scores, np.nan))
        return Clip(clip.id, clip.fps, rig, found, truth=clip.truth)

    # The noise model is linear in the confidence, as the doubt is, so the oracle's is exact.
    model = CONFIG.noise
    usual = float(model.sigma(np.array(0.73)))
    ends = (model.sigma_unsure_m - usual * (DOUBT[0] - DOUBT[1] * np.array([0.0, 1.0]))) / (
        model.sigma_unsure_m - model.sigma_sure_m
    )
    views_, joints = len(rig), len(BODY25)
    oracle = replace(
        DetectionNoise.prior(model, views_, joints),
        floor_px=np.full(views_, np.hypot(grid_px / np.sqrt(12), 0.2)),
        spread_m=np.full(joints, spread_m * (np.sqrt((doubt[known] ** 2).mean()) if blind else 1)),
        knots=np.array([0.0, 1.0]),
        confidences=ends,
        constant=np.full(views_, blind),
        count=1,
        usual_m=spread_m,
    )
    sigma = np.hypot(oracle.spread_m[0] * (1 if blind else doubt), oracle.floor_px[0] / scale)
    oracle = replace(oracle, usual_m=float(np.median(sigma[known])))
    return with_scores(given), with_scores(sure), oracle


def _depths(rig: CameraRig, xyz: np.ndarray) -> np.ndarray:
    """Return the depths (F, V, P, J), m, of joints (F, P, J, 3)."""
    R, t = rig.cam_from_world[:, 2, :3], rig.cam_from_world[:, 2, 3]
    return np.maximum(np.einsum("vk,fpjk->fvpj", R, xyz) + t[:, None, None], 0.1)


def scores(clip: Clip, poses: Poses3D, seen: np.ndarray) -> dict[str, float]:
    """Return recall, PCP and joints within 10 cm in %, mean error in mm, % of joints in their 90 % regions, and people
    per person.

    Args:
        clip: With the truth.
        poses: Captured from it.
        seen: (F, P, J) True for the joints that two cameras or more detected; the others do not count.
    """
    truth, found = convert(clip.truth, BODY25).xyz.astype(np.float64), poses.xyz.astype(np.float64)
    matched, cov = np.full(truth.shape, np.nan), np.full((*truth.shape, 3), np.nan)
    for frame, people in enumerate(truth):
        distance = np.linalg.norm(people[:, None] - found[frame][None], axis=-1)
        distance = np.ma.median(np.ma.masked_invalid(distance), -1).filled(9.0)
        for person, track in zip(*linear_sum_assignment(distance), strict=True):
            if distance[person, track] < 0.5:
                matched[frame, person] = found[frame, track]
                cov[frame, person] = np.nan if poses.cov is None else poses.cov[frame, track]
    error = np.linalg.norm(matched - truth, axis=-1)
    near = error < NEAR_M
    start, end = np.array([BODY25.index(*limb.split()) for limb in LIMBS]).T
    half = np.linalg.norm(truth[:, :, start] - truth[:, :, end], axis=-1) / 2
    correct = (error[..., start] <= half) & (error[..., end] <= half)
    known = near & seen & np.isfinite(cov).all((-1, -2))
    off = (matched - truth)[known]
    distance2 = np.einsum("ni,nij,nj->n", off, np.linalg.inv(cov[known]), off)
    return {
        "recall": 100 * near[seen].mean(),
        "pcp": 100 * correct[seen[..., start] & seen[..., end]].mean(),
        "within 10 cm": 100 * (error < 0.1)[seen].mean(),
        "mm": 1000 * error[seen & near].mean(),
        "inside": 100 * (distance2 < QUANTILE).mean() if known.any() else np.nan,
        "people": np.isfinite(found[..., 0]).any(-1).sum(1).mean() / truth.shape[1],
    }


def with_true_identities(clip: Clip) -> Poses3D:
    """Return the people of a clip with detection p of person p, by linear triangulation of all detections."""
    rig, (frames, views, people, joints) = clip.rig, clip.detections.score.shape
    xy, confidence = (np.moveaxis(array, 1, 3).reshape(-1, views, *array.shape[4:])
                      for array in (clip.detections.xy, clip.detections.score))  # fmt: skip
    xyz = dlt(
        **{key: getattr(rig, key) for key in ("K", "dist", "cam_from_world", "size")}, xy=xy, confidence=confidence
    )
    return Poses3D(BODY25, xyz.reshape(frames, people, joints, 3))


def measured(clip: Clip, views: list[int], zoom=1.0, sigma_px=4.0, grid_px=0.0, confidences="good", seed=0) -> dict:
    """Return the scores of capture, of the oracle, and of true identities; see `detected`."""
    given, told, noise = detected(clip, views, zoom, sigma_px, grid_px, confidences, seed)
    seen = np.isfinite(given.detections.score).sum(1) >= 2
    return {
        "learned": scores(given, capture(given, CONFIG), seen),
        "oracle": scores(told, capture(told, CONFIG, noise), seen),
        "dlt": scores(given, with_true_identities(given), seen),
    }


def mean_scores(clips: list[Clip], views: list[int], **options) -> dict:
    """Return the mean over clips of `measured`."""
    found = [measured(clip, views, **options, seed=seed) for seed, clip in enumerate(clips)]
    return {who: {name: float(np.mean([each[who][name] for each in found])) for name in found[0][who]}
            for who in found[0]}  # fmt: skip


def cells() -> Iterator[tuple[tuple, dict]]:
    """Yield cameras, size, noise, grid and confidences, and the scores."""
    clips = [true_clip(seed) for seed in SEEDS]
    for count, views in CAMERAS.items():
        for sigma_px in SIGMAS_PX:
            for confidences in CONFIDENCES:
                found = mean_scores(clips, views, sigma_px=sigma_px, confidences=confidences)
                yield (count, 1.0, sigma_px, 0, confidences), found
    for zoom in (zoom for zoom in ZOOMS.values() if zoom != 1):
        yield (5, zoom, 4, 0, "good"), mean_scores(clips, CAMERAS[5], zoom=zoom)
    for grid_px in GRIDS_PX:
        yield (5, 1.0, 4, grid_px, "good"), mean_scores(clips, CAMERAS[5], grid_px=grid_px)


def row(found: dict) -> list[str]:
    """Return scores of capture, the oracle and true identities as text."""
    who = "learned", "oracle", "dlt"
    return [*(" / ".join(f"{found[each][name]:.1f}" for each in who) for name in ("recall", "pcp", "mm")),
            f"{found['learned']['inside']:.0f}"]  # fmt: skip


def levels() -> dict:
    """Return the tables of one factor after the other, and of all cameras, confidences and noises."""
    found = {}
    for key, scored in cells():
        found[key] = scored
        print(*key, *row(scored), flush=True)
    columns = ["recall, %", "PCP, %", "mm", "in 90 % regions, %"]
    single = [
        *([f"noise of {s:g} px", *row(found[5, 1.0, s, 0, "good"])] for s in SIGMAS_PX),
        *([f"confidences {c}", *row(found[5, 1.0, 4, 0, c])] for c in CONFIDENCES),
        *([f"{n} cameras", *row(found[n, 1.0, 4, 0, "good"])] for n in CAMERAS),
        *([f"images of {size}", *row(found[5, zoom, 4, 0, "good"])] for size, zoom in ZOOMS.items()),
        *([f"rounded to {grid} px", *row(found[5, 1.0, 4, grid, "good"])] for grid in GRIDS_PX),
    ]
    combined = []
    for n in CAMERAS:
        for c in CONFIDENCES:
            both = [(each["learned"], each["oracle"]) for each in (found[n, 1.0, s, 0, c] for s in SIGMAS_PX)]
            combined.append(
                [f"{n} cameras, {c}",
                 *(f"{min(a[name] - b[name] for a, b in both):+.1f}" for name in ("recall", "pcp")),
                 f"{100 * max(a['mm'] / b['mm'] - 1 for a, b in both):+.1f}",
                 f"{min(a['inside'] for a, _ in both):.0f} to {max(a['inside'] for a, _ in both):.0f}"]
            )  # fmt: skip
    worst = ["", "least recall, %", "least PCP, %", "most mm, %", "in 90 % regions, %"]
    return {"levels": (["", *columns], single), "combined": (worst, combined)}


def rooms() -> dict:
    """Return the table of two rooms: stills of an operating room, and a meal."""
    theatre = _exact(
        "theatre", clips=1, seed=203, seconds=4, persons=[6, 7], interaction="huddle", rig=_few_pixels(3)
    )  # fmt: skip
    stills = replace(theatre.select(frames=list(range(0, len(theatre), 5))), fps=1 / 75)
    cases = {
        "operating room, video": (theatre, {"sigma_px": 6, "confidences": "missing"}),
        "operating room, stills 75 s apart": (stills, {"sigma_px": 6, "confidences": "missing"}),
        "meal, a table hides legs": (_meal(), {"sigma_px": 5, "grid_px": 5.7}),
    }
    found = [
        [name, *row(mean_scores([clip, clip], list(range(len(clip.rig))), **options))]
        for name, (clip, options) in cases.items()
    ]
    return {"rooms": (["", "recall, %", "PCP, %", "mm", "in 90 % regions, %"], found)}


def _few_pixels(views: int) -> synth.RigConfig:
    """Return a ring of cameras near the ceiling of a small room, 640 x 480 px."""
    ring = {"radius": [3.0, 4.0], "height": [2.0, 2.8], "focal": 420, "size": [640, 480], "views": views}
    return synth.RigConfig(name="ring", ring=synth.RingConfig(**ring))


def stills() -> dict:
    """Return the table of stills of crowded rooms with few cameras, of other scenes than `rooms`."""
    scenes = {"huddle": (411, [6, 7]), "table": (412, [6, 7]), "circle_talk": (414, [6, 7]), "counter": (313, [5, 6])}
    cases = [
        ("huddle", [0, 2, 3], False), ("huddle", [1, 2, 4], True), ("table", [0, 2, 3], False),
        ("table", [0, 1, 3], True), ("table", [0, 2], False), ("circle_talk", [0, 2, 3], False),
        ("counter", [0, 1, 2, 3], True),
    ]  # fmt: skip
    rows = []
    for name, views, hidden in cases:
        seed, persons = scenes[name]
        clip = _exact(
            f"stills_{name}", clips=1, seed=seed, seconds=2, persons=persons, interaction=name, rig=_few_pixels(5)
        )
        clip = replace(clip.select(frames=list(range(0, len(clip), 5))), fps=1 / 75)
        clip = _without_most_legs(clip) if hidden else clip
        found = mean_scores([clip, clip], views, sigma_px=6, confidences="missing")
        title = f"{name.replace('_', ' ')}, {len(views)} cameras{', legs hidden' * hidden}"
        rows.append([title, *row(found), f"{found['learned']['people']:.2f}"])
    return {"stills": (["", "recall, %", "PCP, %", "mm", "in 90 % regions, %", "found per person"], rows)}


def _meal() -> Clip:
    """Return five people at a table that hides most of their legs."""
    return _without_most_legs(
        _exact("meal", clips=1, seed=202, seconds=4, persons=[5, 5], interaction="table", rig=_around_table())
    )


def _around_table() -> synth.RigConfig:
    """Return a ring of five cameras around a table."""
    ring = {"radius": [2.6, 3.4], "height": [1.3, 2.4], "focal": 1300, "size": [1920, 1080], "views": 5}
    return synth.RigConfig(name="ring", ring=synth.RingConfig(**ring))


FAULTS = "none", "all a little", "one displaced", "one focal length", "one blind"
"""All cameras displaced by 2.5 cm and 0.5 degrees; one by 10 cm and 2 degrees; the focal length of one 3 % off; one
without detections."""


def faulty_rooms() -> Iterator[tuple[tuple[str, str, str], Clip, Clip, DetectionNoise]]:
    """Yield rooms with faults: fault, number of cameras and room; the clip; and what the oracle is given, with the true
    calibration."""
    for seed in SEEDS:
        rooms = {
            "Shelf's cameras": ({"persons": [3, 4], "rig": "shelf"}, {"sigma_px": 5}),
            "meal": (
                {"persons": [4, 5], "interaction": "table", "rig": _around_table()}, {"sigma_px": 5, "grid_px": 5.7}
            ),
            "operating room": (
                {"persons": [5, 6], "interaction": "huddle", "rig": _few_pixels(5)},
                {"sigma_px": 6, "confidences": "missing"},
            ),
        }  # fmt: skip
        for number, (room, (scene, noise)) in enumerate(rooms.items()):
            exact = _exact(f"faulty{number}_{seed}", clips=1, seed=930 + 10 * number + seed, seconds=12, **scene)
            exact = exact.select(frames=slice(0, 60))
            for count in (2, 3, 4, 5):
                rng = np.random.default_rng([seed, number, count])
                views = sorted(rng.permutation(5)[:count].tolist())
                options = {"grid_px": 0, "confidences": "good"} | noise
                given, told, truth = detected(exact, views, 1.0, seed=seed, **options)
                view = int(rng.integers(count))
                # Of two cameras with one blind, nobody can be measured.
                for fault in FAULTS[: 5 if count > 2 else 4]:
                    faulty, right = (
                        with_fault(clip, fault, view, np.random.default_rng([seed, number, count]))
                        for clip in (given, told)
                    )
                    yield (fault, f"{count} cameras", room), faulty, replace(right, rig=told.rig), truth


def with_fault(clip: Clip, fault: str, view: int, rng: np.random.Generator) -> Clip:
    """Return a clip with one of `FAULTS`; `view` is the camera that alone has it."""
    if fault == "all a little":
        for each in range(len(clip.rig)):
            clip = planted(clip, each, Fault.displaced, 0.025, rng)
    if fault == "one displaced":
        clip = planted(clip, view, Fault.displaced, 0.1, rng)
    if fault == "one focal length":
        clip = planted(clip, view, Fault.focal_length, 0.03, rng)
    if fault == "one blind":
        xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
        xy[:, view], score[:, view] = np.nan, np.nan
        clip = replace(clip, detections=Detections2D(BODY25, xy, score))
    return clip


def calibration() -> dict:
    """Return the table of rooms with faulty calibrations: means over the rooms with each fault, of each number of
    cameras, and of each kind."""
    found: dict[str, list] = defaultdict(list)
    for names, given, told, noise in faulty_rooms():
        seen = np.isfinite(given.detections.score).sum(1) >= 2
        both = (
            scores(given, capture(given, CONFIG), seen),
            scores(told, capture(told, CONFIG, noise), seen),
        )
        for name in ("all", *names):
            found[name].append(both)
        print(*names, *(f"{a['recall']:.1f}" for a in both), flush=True)
    order = ["all", *FAULTS, *(f"{n} cameras" for n in (2, 3, 4, 5))]
    order += [name for name in found if name not in order]
    rows = [
        [
            f"{name} ({len(found[name])})",
            *(" / ".join(f"{np.mean([each[who][kind] for each in found[name]]):.1f}" for who in (0, 1))
              for kind in ("recall", "within 10 cm", "pcp")),
            f"{np.mean([each[0]['inside'] for each in found[name]]):.0f}",
        ]
        for name in order
    ]  # fmt: skip
    columns = ["fault, cameras, room", "within 20 cm, %", "within 10 cm, %", "PCP, %", "in 90 % regions, %"]
    return {"calibration": (columns, rows)}


def _without_most_legs(clip: Clip) -> Clip:
    """Return a clip in which a table hides four fifths of the joints of legs, each in all frames."""
    legs = [n for n, name in enumerate(BODY25.joints) if name.endswith(("knee", "ankle", "toe", "heel"))]
    hidden = np.random.default_rng(0).uniform(size=clip.detections.score[0].shape) < 0.8
    hidden[..., np.setdiff1d(np.arange(len(BODY25)), legs)] = False
    score = np.where(hidden, np.nan, clip.detections.score)
    xy = np.where(np.isnan(score)[..., None], np.nan, clip.detections.xy)
    return replace(clip, detections=Detections2D(BODY25, xy, score))


def meal() -> dict:
    """Return the table of the joints of the meal: how many are measured and completed well, and in their regions."""
    given, _, _ = detected(_meal(), list(range(5)), 1.0, 5, 5.7, "good", 0)
    poses = capture(given, CONFIG)
    done, truth, rows = dmae.complete(poses, given.fps), convert(given.truth, BODY25).xyz.astype(float), []
    matches = match(poses.xyz, truth)
    cov = take_matched(done.cov.reshape(*done.cov.shape[:3], 9), matches).reshape(*truth.shape, 3).astype(float)
    measured = np.isfinite(take_matched(poses.xyz, matches)[..., 0])
    off = take_matched(done.xyz, matches) - truth
    known = np.isfinite(off).all(-1)
    stated = known & np.isfinite(cov).all((-1, -2))
    inside = np.zeros(known.shape, bool)
    inside[stated] = np.einsum("ni,nij,nj->n", off[stated], np.linalg.inv(cov[stated]), off[stated]) < QUANTILE
    for kind in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
        joints = np.isin(np.arange(len(BODY25)), BODY25.index(f"l_{kind}", f"r_{kind}"))
        row = [kind, f"{100 * measured[..., joints].mean():.0f}"]
        for some in (measured & joints, ~measured & joints):
            error, held = np.linalg.norm(off[some & known], axis=-1), inside[some & stated]
            row.append(f"{1000 * np.median(error):.0f}" if len(error) > 100 else "-")
            row.append(f"{100 * held.mean():.0f}" if len(held) > 100 else "-")
        rows.append(row)
    columns = [
        "",
        "measured, %",
        "measured: median, mm",
        "in 90 % regions, %",
        "completed: median, mm",
        "in 90 % regions, %",
    ]
    return {"meal": (columns, rows)}


def ghosts() -> dict:
    """Return the table of two people among ghosts, with ghosts of other seeds than those that the rules were made on.

    A cell has the number of clips with each number of people; in the last column both people stand like mannequins.
    """
    rows = []
    still = np.repeat(two_people(20)[10:11], 60, 0)
    for count in (0, 20, 50, 150, 500):
        cells = []
        for frames, fixed, people in (
            (12, False, None), (12, True, None), (60, False, None), (60, True, None), (60, True, still)
        ):  # fmt: skip
            number = 20 if count < 150 else 4 if count < 500 else int(frames == 12)
            clips = [haunted_clip(count, frames, fixed, seed, people) for seed in range(1000, 1000 + number)]
            found = Counter(capture(clip, CONFIG).xyz.shape[1] for clip in clips)
            cells.append(", ".join(f"{people}: {times} of {number}" for people, times in sorted(found.items())) or "-")
            print(count, frames, fixed, cells[-1], flush=True)
        rows.append([str(count), *cells])
    columns = [
        "ghosts a view", "12 frames, random", "12 frames, fixed", "60 frames, random", "60 frames, fixed",
        "60 frames, fixed, people stand",
    ]  # fmt: skip
    return {"ghosts": (columns, rows)}


def generated_ghosts() -> dict:
    """Return the table of two generated people, with ghosts of the simulated detector."""
    rows = []
    for count, numbers in {0: (6, 6), 20: (6, 6), 50: (6, 6), 150: (4, 2), 500: (1, 0)}.items():
        cells = []
        for seconds, number in zip((0.8, 2.4), numbers, strict=True):
            detector = synth.preset("detector", "shelf_openpose")
            detector = replace(detector, ghosts=replace(detector.ghosts, count=float(count)))
            made = {"clips": 1, "seconds": seconds, "persons": [2, 2], "detector": detector}
            clips = [_kept(f"ghosts{seed}_{seconds}_{count}", seed=seed, **made) for seed in range(500, 500 + number)]
            found = Counter(capture(clip, CONFIG).xyz.shape[1] for clip in clips)
            cells.append(", ".join(f"{people}: {times} of {number}" for people, times in sorted(found.items())) or "-")
            print(count, seconds, cells[-1], flush=True)
        rows.append([str(count), *cells])
    return {"generated_ghosts": (["ghosts a view", "20 frames", "60 frames"], rows)}


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    makers = {
        "levels": levels, "rooms": rooms, "stills": stills, "meal": meal, "ghosts": ghosts,
        "generated_ghosts": generated_ghosts, "calibration": calibration,
    }  # fmt: skip
    if unknown := set(sys.argv[1:]) - set(makers):
        sys.exit(f"no tables {', '.join(unknown)}; there are {', '.join(makers)}")
    file = ROOT / "docs/results/noise_levels.json"
    before = json.loads(file.read_text()) if file.is_file() else {"tables": {}}
    tables = {name: (table["columns"], table["rows"]) for name, table in before["tables"].items()}
    made = {}
    for wanted in sys.argv[1:] or makers:
        made |= makers[wanted]()
    sys.argv[1:] = []
    write_tables("noise_levels", tables | made)
    # Tables that were not made now keep the commit that made them.
    content = json.loads(file.read_text())
    for name in before["tables"].keys() - made.keys():
        content["tables"][name]["measured"] = before["tables"][name].get("measured", before["measured"])
    file.write_text(json_text(content) + "\n")
