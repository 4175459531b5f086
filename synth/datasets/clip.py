"""One clip from a configuration, a seed and a number: scene, simulation, truth, labels and detections."""

import json
import platform
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import metadata
from itertools import product

import cv2
import mujoco
import numpy as np
import scipy

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.rng import Stream, generator
from synth.datasets.config import GenerateConfig, OcclusionConfig
from synth.datasets.images import check_images
from synth.datasets.occlusion import confirm, sample_hidden_scene, summary
from synth.detector.config import DetectorConfig
from synth.detector.simulated_detector import custom_errors, detect
from synth.errors import FailedSimulation, until_success
from synth.labels.visibility import joint_visibility
from synth.people.body import SKELETON, landmarks
from synth.physics.body_state import BodyState, joint_positions, moved_with
from synth.physics.simulation import simulate
from synth.rigs.config import MiscalibrationConfig
from synth.rigs.coverage import Stage, stage_of
from synth.rigs.lenses import add_cameras
from synth.rigs.rig import calibration_error, make_rig, miscalibrate
from synth.rooms.room import arena_file, load_room
from synth.scene.build import Scene
from synth.scene.sampling import SampledScene, sample_scene
from synth.scene.spec import SceneSpec


def clip_id(index: int, prefix: str = "") -> str:
    """Return the name of a clip, which is also the name of its folder."""
    return f"{prefix}{index:06d}"


def attempt_seed(seed: int, attempt: int) -> int:
    """Return the seed of an attempt at a clip: `seed` itself for attempt 0, later a hash of both arguments."""
    return int(np.random.SeedSequence([seed, attempt]).generate_state(1, np.uint64)[0] >> 1) if attempt else seed


def generate_clip(config: GenerateConfig, index: int) -> Clip:
    """Generate clip `index` of a data set, without images. The result does not depend on other clips.

    Raises:
        FailedSimulation: the clip failed with every seed; the message is from the last attempt.
        ValueError: the configuration cannot be met.
    """
    return simulate_clip(config, index)[0]


def simulate_clip(config: GenerateConfig, index: int) -> tuple[Clip, BodyState]:
    """Generate clip `index` of a data set, without images, and its body states. Raises as `generate_clip`."""
    return until_success(lambda attempt: _attempt(config, index, attempt), config.retries)


def _attempt(config: GenerateConfig, index: int, attempt: int) -> tuple[Clip, BodyState]:
    seed = attempt_seed(config.seed, attempt)
    rig = _rig(config, seed, index)
    spec, motions = _scene(config, rig, seed, index)
    simulation = simulate(spec, rig, motions, painted=False)
    line = {
        "id": clip_id(index, config.prefix),
        "status": "ok",
        "seed": seed,
        "attempts": attempt + 1,
        "frames": len(simulation.qpos),
        "persons": len(spec.persons),
        "quality": simulation.quality,
    }
    clip = label_clip(
        line, spec, simulation, simulation.qpos, rig, detector=config.detector, occlusion=config.occlusion,
        error=config.rig.error, stage=_stage(config),
    )  # fmt: skip
    return clip, simulation.state


def _scene(config: GenerateConfig, rig: CameraRig, seed: int, index: int) -> SampledScene:
    if config.occlusion.target:
        return sample_hidden_scene(config, rig, seed=seed, clip=index)
    return sample_scene(config.scene, config.motion, config.props, config.interaction, seed=seed, clip=index)


def _rig(config: GenerateConfig, seed: int, index: int) -> CameraRig:
    return make_rig(config.rig, rng=generator(seed, index, Stream.CAMERAS), stage=_stage(config))


def _stage(config: GenerateConfig) -> Stage:
    return stage_of(arena_file(config.scene.arena), config.scene.middle, config.scene.radius)


def label_clip(
    line: dict,
    spec: SceneSpec,
    scene: Scene,
    qpos: np.ndarray,
    rig: CameraRig,
    *,
    detector: DetectorConfig,
    occlusion: OcclusionConfig,
    error: MiscalibrationConfig,
    stage: Stage,
    seconds: np.ndarray | None = None,
) -> Clip:
    """Return the clip of simulated states with its labels. The same states and cameras always give the same labels.

    Raises FailedSimulation if the clip does not meet the target.

    Args:
        line: The clip's line in the manifest. `occlusion` is added to it and, if the calibration has errors,
            `calibration_error`.
        qpos: (F, nq) states.
        occlusion: Settings of the summary of occlusion, and the target that the clip must meet.
        stage: The people's area, for the error of the calibration.
        seconds: (F,) times of the states, s; by default those of all frames of a clip.
    """
    bodies = [person.body for person in spec.persons]
    joints = joint_positions(scene.model, qpos, bodies)
    truth = Poses3D(SKELETON, joints)
    depth = np.stack([landmarks(body)[2] for body in bodies])
    moving = moved_with(scene.model, bodies)
    seconds = np.arange(len(qpos)) / spec.fps if seconds is None else seconds
    seen = joint_visibility(scene.model, qpos, joints, depth, scene.geom_ids, rig, moving, scene.objects, seconds)
    confirm(seen.visibility, occlusion)
    detected = detect(truth, seen, rig, spec.fps, detector, rng=generator(spec.seed, spec.clip, Stream.DETECTOR))
    line = line | {"occlusion": summary(seen.visibility, occlusion)}
    reported = miscalibrate(rig, error, rng=generator(spec.seed, spec.clip, Stream.CALIBRATION))
    if reported:
        line["calibration_error"] = calibration_error(rig, reported, stage)
    filled = load_room(spec.arena).filled
    return Clip(
        id=line["id"],
        fps=spec.fps,
        rig=reported or rig,
        detections=detected.detections,
        truth=truth,
        occlusion=seen,
        detection_labels=detected.labels,
        true_rig=rig if reported else None,
        provenance={
            "manifest": line,
            "spec": json.loads(spec.to_json()),
            **({"room": list(filled)} if filled else {}),
            "versions": {
                "dmae-synth": metadata.version("dmae-synth"),
                "python": platform.python_version(),
                "numpy": np.__version__,
                "scipy": scipy.__version__,
                "opencv": cv2.__version__,
                "mujoco": mujoco.__version__,
            },
        },
    )


def check(config: GenerateConfig) -> CameraRig:
    """Check a configuration before anything is made, and return the cameras of the first clip.

    Raises:
        ValueError: the configuration cannot be met.
        FileNotFoundError: a file that it names does not exist.
        FailedSimulation: no possible cameras were found, or `occlusion.target` cannot be met.
    """
    load_room(config.scene.arena)
    custom_errors(config.detector)
    rig = until_success(lambda attempt: _rig(config, attempt_seed(config.seed, attempt), 0), config.retries)
    add_cameras(mujoco.MjSpec(), rig)
    check_images(config, rig)
    with suppress(FailedSimulation):
        _scene(replace(config, occlusion=OcclusionConfig()), rig, config.seed, 0)
    if config.occlusion.target:
        # One of a few clips must meet it.
        check_target(config, range(min(config.clips, 3)))
    return rig


def check_target(config: GenerateConfig, clips: Sequence[int]) -> None:
    """Raise FailedSimulation if none of these clips can meet `occlusion.target`. Raises as `check`."""
    seeds = [attempt_seed(config.seed, attempt) for attempt in range(min(config.retries, 2) + 1)]
    tries = list(product(seeds, clips))
    until_success(lambda number: _scene(config, _rig(config, *tries[number]), *tries[number]), len(tries) - 1)
