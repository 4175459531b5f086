"""Simulated people for planning cameras. They are simulated once and can then be seen by any cameras."""

from contextlib import suppress
from dataclasses import dataclass

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from synth.datasets.clip import attempt_seed
from synth.datasets.labelling import label_clip
from synth.datasets.occlusion import OcclusionConfig
from synth.detector.config import DetectorConfig
from synth.errors import FailedSimulation
from synth.people.landmarks import landmarks
from synth.physics.joint_positions import moved_with
from synth.physics.simulation import simulate
from synth.planning.config import PlanConfig
from synth.planning.mounts import stage_of
from synth.rigs.camera_geometry import intrinsics, look_at, pose
from synth.rigs.miscalibration import MiscalibrationConfig
from synth.rooms.catalogue import arena_file
from synth.scene.sampling import sample_scene
from synth.scene.spec import SceneSpec

_RETRIES = 5
_PLACEHOLDER_CENTER = np.array([[0.0, 0.0, 50.0]])
"""Centre of the placeholder camera that MuJoCo's model is compiled with, m. It is not used to see anything."""


@dataclass(frozen=True)
class Rehearsal:
    """A simulated clip without cameras.

    Attributes:
        number: Number of the clip.
        spec: The scene.
        model: The compiled scene.
        geom_ids: (ngeom,) ids of the owners of its geoms.
        objects: Names of its objects.
        qpos: (F, nq) states of the simulation.
        joints: (F, P, 39, 3) joints of `synth.people.landmarks.SKELETON`, m, world.
    """

    number: int
    spec: SceneSpec
    model: mujoco.MjModel
    geom_ids: np.ndarray
    objects: tuple[str, ...]
    qpos: np.ndarray
    joints: np.ndarray

    @property
    def depth(self) -> np.ndarray:
        """(P, 39) greatest depth of each joint under the surface of its limb, m."""
        return np.stack([landmarks(person.body)[2] for person in self.spec.persons])

    @property
    def bodies(self) -> np.ndarray:
        """(P, 39) index of the body that each joint moves with."""
        return moved_with(self.model, [person.body for person in self.spec.persons])

    def seen_by(self, rig: CameraRig, detector: DetectorConfig) -> Clip:
        """Return the clip that these cameras record: truth, visibility and simulated detections.

        The detections of a view do not depend on the other cameras.
        """
        stage = stage_of(arena_file(self.spec.arena), np.zeros(2), self.spec.radius)
        line = {"id": f"{self.number:06d}"}
        return label_clip(
            line, self.spec, self, self.qpos, rig, detector=detector, occlusion=OcclusionConfig(),
            error=MiscalibrationConfig(), stage=stage,
        )  # fmt: skip


def rehearse(config: PlanConfig, number: int) -> Rehearsal:
    """Simulate the people of a clip. The result does not depend on cameras or on other clips.

    Args:
        config: The plan.
        number: Number of the clip.

    Raises:
        FailedSimulation: the clip failed with every seed; the message is that of the last attempt.
        ValueError: the configuration cannot be met.
    """
    for attempt in range(_RETRIES):
        with suppress(FailedSimulation):
            return _attempt(config, number, attempt)
    return _attempt(config, number, _RETRIES)


def _attempt(config: PlanConfig, number: int, attempt: int) -> Rehearsal:
    seed = attempt_seed(config.seed, attempt)
    spec, motions = sample_scene(
        config.setting(), config.motion, interaction=config.interaction, seed=seed, clip=number
    )
    away = CameraRig(
        ("none",),
        [intrinsics(100.0, [64, 64])],
        np.zeros((1, 5)),
        pose(look_at(_PLACEHOLDER_CENTER, np.zeros(3)), _PLACEHOLDER_CENTER),
        [(64, 64)],
    )
    done = simulate(spec, away, motions, painted=False)
    return Rehearsal(number, spec, done.model, done.geom_ids, done.objects, done.qpos, done.joints)
