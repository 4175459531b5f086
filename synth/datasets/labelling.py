"""Label the states of a scene for the cameras of a rig: truth, visibility, detections."""

import json
import platform
from importlib import metadata

import cv2
import mujoco
import numpy as np
import scipy

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.rng import Stream, generator
from synth.datasets.occlusion import OcclusionConfig, confirm, summary
from synth.detector.config import DetectorConfig
from synth.detector.simulated_detector import detect
from synth.labels.visibility import joint_visibility
from synth.people.landmarks import SKELETON, landmarks
from synth.physics.joint_positions import joint_positions, moved_with
from synth.rigs.coverage import Stage
from synth.rigs.miscalibration import MiscalibrationConfig, calibration_error, miscalibrate
from synth.rooms.room import load_room
from synth.scene.spec import SceneSpec


def label_clip(
    line: dict,
    spec: SceneSpec,
    scene,
    qpos: np.ndarray,
    rig: CameraRig,
    *,
    detector: DetectorConfig,
    occlusion: OcclusionConfig,
    error: MiscalibrationConfig,
    stage: Stage,
) -> Clip:
    """Return the clip of simulated states with its labels. The same states and cameras always give the same labels.

    Args:
        line: The clip's line in the manifest. `occlusion` is added to it and, if the calibration has errors,
            `calibration_error`.
        spec: The scene.
        scene: Its `model`, `geom_ids` and `objects`: a `synth.scene.build.Scene` or a simulation.
        qpos: (F, nq) states.
        rig: V cameras.
        detector: The simulated detector.
        occlusion: Settings of the summary of occlusion, and the target that the clip must meet.
        error: Errors of the calibration.
        stage: The people's area, for the error of the calibration.

    Raises:
        FailedSimulation: the clip does not meet the target.
    """
    bodies = [person.body for person in spec.persons]
    joints = joint_positions(scene.model, qpos, bodies)
    truth = Poses3D(SKELETON, joints)
    depth = np.stack([landmarks(body)[2] for body in bodies])
    moving = moved_with(scene.model, bodies)
    seen = joint_visibility(scene.model, qpos, joints, depth, scene.geom_ids, rig, moving, scene.objects)
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
            "versions": _versions(),
        },
    )


def _versions() -> dict[str, str]:
    modules = {"numpy": np, "scipy": scipy, "opencv": cv2, "mujoco": mujoco}
    return {
        "dmae-synth": metadata.version("dmae-synth"),
        "python": platform.python_version(),
        **{name: module.__version__ for name, module in modules.items()},
    }
