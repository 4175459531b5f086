"""Choose cameras: simulated people, what each camera sees of them, and the search for the best rig."""

import time
from dataclasses import dataclass, replace

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.formats.rig import intrinsics
from dmae.progress import progress
from synth.datasets.clip import attempt_seed, label_clip
from synth.datasets.config import OcclusionConfig
from synth.datasets.occlusion import DETECTED
from synth.detector.config import DetectorConfig
from synth.detector.parts import by_joint
from synth.detector.view import View, height
from synth.errors import until_success
from synth.labels.visibility import joint_visibility
from synth.physics.simulation import Simulation, simulate
from synth.planning.config import PlanConfig
from synth.planning.places import CandidateCameras
from synth.rigs.config import MiscalibrationConfig
from synth.rigs.coverage import Stage
from synth.rigs.placement import aimed
from synth.scene.sampling import sample_scene
from synth.scene.spec import SceneSpec

_RETRIES = 5
_PLACEHOLDER_CENTER = np.array([[0.0, 0.0, 50.0]])
"""Centre of the placeholder camera that MuJoCo's model is compiled with, m. It is not used to see anything."""


@dataclass(frozen=True)
class Rehearsal:
    """A simulated clip without cameras."""

    number: int  # Number of the clip
    spec: SceneSpec  # The scene
    simulation: Simulation  # Its states

    def seen_by(self, rig: CameraRig, detector: DetectorConfig, frames: slice = slice(None)) -> Clip:
        """Return the clip that these cameras record, each independently: truth, visibility and simulated detections."""
        line = {"id": f"{self.number:06d}"}
        return label_clip(
            line, self.spec, self.simulation, self.simulation.qpos[frames], rig, detector=detector,
            occlusion=OcclusionConfig(), error=MiscalibrationConfig(), stage=Stage(),
            seconds=(np.arange(len(self.simulation.qpos)) / self.spec.fps)[frames],
        )  # fmt: skip


def rehearse(config: PlanConfig, number: int) -> Rehearsal:
    """Simulate the people of a clip. The result does not depend on cameras or on other clips.

    Raises:
        FailedSimulation: the clip failed with every seed; the message is from the last attempt.
        ValueError: the configuration cannot be met.
    """
    return until_success(lambda attempt: _attempt(config, number, attempt), _RETRIES)


def _attempt(config: PlanConfig, number: int, attempt: int) -> Rehearsal:
    seed = attempt_seed(config.seed, attempt)
    spec, motions = sample_scene(
        config.setting(), config.motion, interaction=config.interaction, seed=seed, clip=number
    )
    away = aimed(["none"], intrinsics(100.0, [64, 64]), _PLACEHOLDER_CENTER, np.zeros(3), [64, 64])
    return Rehearsal(number, spec, simulate(spec, away, motions, painted=False))


# The evidence of each candidate camera on each joint: the probability and the accuracy of its detection.

_JOINTS = BODY25.index(
    "nose", "r_ear", "l_ear", "neck", "r_shoulder", "r_elbow", "r_wrist", "l_shoulder", "l_elbow", "l_wrist",
    "r_hip", "r_knee", "r_ankle", "l_hip", "l_knee", "l_ankle",
)  # fmt: skip
"""Joints that are used. Of joints that are close together only one is used."""
_WIDE_FOCAL, _WIDE_SIDE = 20.0, 4000
"""Focal length and image side of a pinhole that sees nearly everything in front of it, px. It tests all directions from
one place."""
_LEAST_SCALE = 0.003
"""Least error of a detected joint if a preset has no noise, m."""


@dataclass(frozen=True)
class JointEvidence:
    """Evidence of C candidates on N joints. Each person, joint and frame counts as one of the N."""

    probability: np.ndarray  # (N, C) float32 probability that the camera detects the joint
    # (N, C, 6) float32 inverse covariance of the joint's position from one camera, 1/m^2, times the probability: xx,
    # yy, zz, xy, xz, yz
    information: np.ndarray


def gather(rehearsal: Rehearsal, candidates: CandidateCameras, detector: DetectorConfig, frames: int) -> JointEvidence:
    """Return the evidence of candidates on the joints of a clip, in `frames` frames, evenly spread.

    Visibility is computed once for each place, by rays through the simulated scene. The detector's preset gives the
    probability and the accuracy of a detection for each kind of visibility.
    """
    done = rehearsal.simulation
    chosen = np.unique(np.linspace(0, len(done.qpos) - 1, frames).round().astype(int))
    joints = done.joints[chosen][:, :, DETECTED]
    first = np.unique(candidates.place, return_index=True)[1]
    rank = np.searchsorted(candidates.place[first], candidates.place)
    # Cameras at the same places that see nearly everything in front of them.
    side, rig = [_WIDE_SIDE, _WIDE_SIDE], candidates.rig[first]
    K = np.tile(intrinsics(_WIDE_FOCAL, side), (len(rig), 1, 1))
    all_round = replace(rig.undistorted, K=K, size=np.tile(side, (len(rig), 1)))
    seen = joint_visibility(
        done.model, done.qpos[chosen], joints, done.depth[:, DETECTED], done.geom_ids,
        all_round, done.bodies[:, DETECTED], done.objects, chosen / done.fps,
    )  # fmt: skip
    assert seen.occluder is not None
    xy, along = candidates.rig.project(joints)
    inside = candidates.rig.inside(xy) & (along > 0)
    parts = by_joint(detector.parts)
    probability, scale = np.empty((2, *xy.shape[:-1]))
    for camera in range(len(candidates)):
        visibility = np.where(inside[:, camera], seen.visibility[:, rank[camera]], Visibility.OUTSIDE_IMAGE)
        view = View(
            fps=done.fps, size=candidates.rig.size[camera], xyz=joints, true_xy=xy[:, camera],
            visibility=visibility, occluder=seen.occluder[:, rank[camera]], parts=parts, times=detector.times,
            minimum_score=0.0, random=np.random.default_rng,
        )  # fmt: skip
        probability[:, camera] = 1 - detector.misses.probability(view)
        pixels = np.hypot(parts["noise"] * height(xy[:, camera])[..., None], detector.noise.minimum)
        pixels = pixels * np.where(visibility == Visibility.VISIBLE, 1.0, detector.noise.hidden)
        scale[:, camera] = pixels * along[:, camera] / candidates.rig.K[camera, 0, 0]
    return _evidence(joints, candidates.rig, probability, scale)


def _evidence(joints: np.ndarray, rig: CameraRig, probability: np.ndarray, scale: np.ndarray) -> JointEvidence:
    """Return the evidence on joints (F, P, 25, 3), m. `probability` and `scale`, m, are (F, C, P, 25) each."""
    toward = joints[:, None] - rig.centers[:, None, None]
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    x, y, z = np.moveaxis(toward, -1, 0)
    # A camera measures the position across its ray, but not along it.
    plane = np.stack([1 - x * x, 1 - y * y, 1 - z * z, -x * y, -x * z, -y * z], -1)
    weight = probability / np.maximum(np.nan_to_num(scale, nan=np.inf), _LEAST_SCALE) ** 2
    present = np.isfinite(joints).all(-1)[:, :, _JOINTS]
    rows = [
        np.moveaxis(array[:, :, :, _JOINTS], 1, 3)[present].astype(np.float32)
        for array in (probability, np.nan_to_num(plane * weight[..., None]))
    ]
    return JointEvidence(*rows)


# Choose cameras: add the best next camera repeatedly, then exchange each camera for a better one.

_HALF_WEIGHT_ERROR = 0.05
"""Standard error at which a measured joint counts half, m."""
_RIDGE = 1e-3
"""Added information, 1/m^2. It keeps the determinant above zero for joints that only one camera sees."""
_EXCHANGES = 3
"""Greatest number of times that each camera is exchanged for the best one of all places."""
_TIMED_ROWS = 2000
"""Number of joints in the measurement of the search time."""


@dataclass(frozen=True)
class RigPrediction:
    """Prediction of the search for a rig, before any capture."""

    score: float  # From 0 to 1: the share of joints that are measured, each weighted by its accuracy
    missing: float  # Share of joints that are not measured, %
    error: float  # Median standard error of joints, mm


def standard_errors(information: np.ndarray) -> np.ndarray:
    """Return the standard errors (...) of positions, m, from inverse covariances (..., 6), as in `JointEvidence`."""
    xx, yy, zz, xy, xz, yz = np.moveaxis(np.asarray(information, np.float64), -1, 0)
    xx, yy, zz = xx + _RIDGE, yy + _RIDGE, zz + _RIDGE
    minors = yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy
    determinant = xx * minors[0] - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy)
    return np.sqrt(sum(minors) / np.maximum(determinant, 1e-12))


@dataclass(frozen=True)
class _State:
    """Joint evidence of some cameras on N joints."""

    # none, one: (N,) probabilities that no camera detects the joint, and that exactly one does
    none: np.ndarray
    one: np.ndarray
    information: np.ndarray  # (N, 6) sum over the cameras, as in `JointEvidence`

    @staticmethod
    def of(evidence: JointEvidence, chosen: list[int]) -> "_State":
        count = len(evidence.probability)
        state = _State(np.ones(count), np.zeros(count), np.zeros((count, 6)))
        for camera in chosen:
            state = state.with_camera(evidence, camera)
        return state

    def with_camera(self, evidence: JointEvidence, camera: int) -> "_State":
        found = evidence.probability[:, camera]
        return _State(
            self.none * (1 - found),
            self.one * (1 - found) + self.none * found,
            self.information + evidence.information[:, camera],
        )

    @property
    def measured(self) -> np.ndarray:
        """(N,) probability that two cameras or more detect the joint."""
        return 1 - self.none - self.one

    def value(self) -> float:
        """Return a score from 0 to 1: the share of joints measured, by accuracy; a little for one camera, to compare
        first ones."""
        exact = 1 / (1 + (standard_errors(self.information) / _HALF_WEIGHT_ERROR) ** 2)
        return float((self.measured * exact).mean() + 1e-3 * (1 - self.none).mean())


def predict(evidence: JointEvidence, chosen: list[int]) -> RigPrediction:
    """Return the prediction of the search for the cameras `chosen`."""
    state = _State.of(evidence, chosen)
    error = standard_errors(state.information)
    return RigPrediction(state.value(), float(100 * (1 - state.measured.mean())), float(1000 * np.median(error)))


def choose(evidence: JointEvidence, place: np.ndarray, numbers: range) -> dict[int, list[int]]:
    """Choose cameras for each number, by greedy search and exchange. Return sorted indices of the cameras.

    `place` (C,) is the index of each candidate's place; each place is used at most once. Each camera is exchanged for
    the best other one at most three times.
    """
    chosen, found = [], {}
    for number in progress(range(1, max(numbers) + 1), "choosing cameras"):
        chosen = [*chosen, int(_scores(evidence, place, chosen).argmax())]
        if number in numbers:
            chosen = _exchanged(evidence, place, chosen)
            found[number] = sorted(chosen)
    return found


def seconds_of_search(evidence: JointEvidence, rows: int, cameras: int, numbers: range) -> float:
    """Estimate the time of `choose`, s, with so many joints (`rows`) and cameras, measured with a few cameras."""
    found, few = evidence.probability.shape
    repeats = -(-_TIMED_ROWS // max(1, found))
    larger = JointEvidence(np.tile(evidence.probability, (repeats, 1)), np.tile(evidence.information, (repeats, 1, 1)))
    start = time.perf_counter()
    _scores(larger, np.arange(few), [0])
    each = (time.perf_counter() - start) / (few - 1) / (found * repeats)
    # Usually no camera changes any more after two rounds of exchanges.
    return each * rows * cameras * (max(numbers) + 2 * sum(numbers))


def _scores(evidence: JointEvidence, place: np.ndarray, others: list[int]) -> np.ndarray:
    """Return (C,) the score of the others plus each camera; -1 for cameras at an occupied place."""
    before = _State.of(evidence, others)
    free = ~np.isin(place, place[others])
    return np.array([before.with_camera(evidence, c).value() if free[c] else -1.0 for c in range(len(place))])


def _exchanged(evidence: JointEvidence, place: np.ndarray, chosen: list[int]) -> list[int]:
    """Return the cameras after exchanges of each for the best other one, in at most three rounds."""
    chosen = list(chosen)
    for _ in range(_EXCHANGES):
        before = list(chosen)
        for index in range(len(chosen)):
            others = chosen[:index] + chosen[index + 1 :]
            chosen[index] = int(_scores(evidence, place, others).argmax())
        if chosen == before:
            break
    return chosen
