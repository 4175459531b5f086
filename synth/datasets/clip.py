"""Generate one clip from a configuration, a seed and a number: truth, labels, detections and images."""

import json
import platform
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import Enum
from importlib import metadata
from pathlib import Path

import cv2
import mujoco
import numpy as np
import scipy

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.images import KINDS
from dmae.data.rng import Stream, generator
from synth.datasets.occlusion import OcclusionConfig, confirm, summary
from synth.datasets.occlusion_target import sample_hidden_scene
from synth.detector.config import DetectorConfig
from synth.detector.simulated_detector import detect
from synth.errors import FailedSimulation
from synth.interactions import InteractionConfig
from synth.labels.silhouettes import person_pixels
from synth.labels.visibility import joint_visibility
from synth.motion.source import MotionConfig
from synth.physics.simulation import simulate
from synth.rendering.image_files import render_images
from synth.rendering.renderer import ImageQuality, Renderer
from synth.rigs.coverage import Stage
from synth.rigs.lenses import add_cameras
from synth.rigs.miscalibration import calibration_error, miscalibrate
from synth.rigs.rig import RigConfig, make_rig
from synth.rooms.catalogue import arena_file
from synth.rooms.props import PropsConfig
from synth.rooms.room import load_room
from synth.scene.sampling import SampledScene, sample_scene
from synth.scene.spec import SceneConfig, SceneSpec


class ImageKinds(Enum):
    """Kinds of images that are rendered."""

    none = ()
    rgb = ("rgb",)
    all = KINDS


@dataclass(frozen=True)
class GenerateConfig:
    """Simulate clips with exact truth. The same configuration and seed give the same clips."""

    out: str = "runs/data"
    """Folder of the data set. Clips that it already holds are kept."""
    seed: int = 0
    """Seed of the whole data set; 0 is a seed."""
    clips: int = 8
    """Number of clips."""
    workers: int = 1
    """Processes; -1 for one a core."""
    images: ImageKinds = ImageKinds.none
    """Images that are rendered beside the labels."""
    quality: ImageQuality = ImageQuality.standard
    """Quality of the images."""
    retries: int = 5
    """Number of times that a failed clip is tried again, with another seed (`attempt_seed`)."""
    scene: SceneConfig = field(default_factory=SceneConfig)
    props: PropsConfig = field(default_factory=PropsConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    interaction: InteractionConfig = field(default_factory=InteractionConfig)
    rig: RigConfig = field(default_factory=RigConfig)
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    occlusion: OcclusionConfig = field(default_factory=OcclusionConfig)

    def __post_init__(self):
        for name, least in (("seed", 0), ("clips", 1), ("retries", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected {least} or more, got {getattr(self, name)}")
        if self.workers == 0:
            raise ValueError("workers: expected a number of processes, or -1 for one a core; got 0")


def attempt_seed(seed: int, attempt: int) -> int:
    """Return the seed of a clip's attempt: `seed` itself at attempt 0, later a hash of both."""
    return int(np.random.SeedSequence([seed, attempt]).generate_state(1, np.uint64)[0] >> 1) if attempt else seed


def clip_id(index: int) -> str:
    """Return the name of a clip, which is that of its folder."""
    return f"{index:06d}"


def check(config: GenerateConfig) -> None:
    """Check a configuration before anything is made.

    Raises:
        ValueError: the configuration cannot be met.
        FileNotFoundError: a file that it names does not exist.
        FailedSimulation: no cameras fit, or `occlusion.target` is out of reach.
    """
    load_room(config.scene.arena)
    rig = _some_rig(config)
    add_cameras(mujoco.MjSpec(), rig)
    config.occlusion.check(rig)
    with suppress(FailedSimulation):
        _scene(replace(config, occlusion=OcclusionConfig()), rig, config.seed, 0)
    if config.occlusion.target:
        _check_target(config)


def _check_target(config: GenerateConfig) -> None:
    """Raise FailedSimulation if the occlusion target is out of reach in all of a few clips."""
    tries = [(attempt, clip) for attempt in range(min(config.retries, 2) + 1) for clip in range(min(config.clips, 3))]
    for number, (attempt, clip) in enumerate(tries, 1):
        seed = attempt_seed(config.seed, attempt)
        try:
            _scene(config, _rig(config, seed, clip), seed, clip)
            return
        except FailedSimulation:
            if number == len(tries):
                raise


def _some_rig(config: GenerateConfig) -> CameraRig:
    """Return the cameras of the first clip, at the first attempt at which any fit."""
    for attempt in range(config.retries):
        with suppress(FailedSimulation):
            return _rig(config, attempt_seed(config.seed, attempt), 0)
    return _rig(config, attempt_seed(config.seed, config.retries), 0)


def _rig(config: GenerateConfig, seed: int, index: int) -> CameraRig:
    return make_rig(config.rig, rng=generator(seed, index, Stream.CAMERAS), stage=_stage(config))


def _stage(config: GenerateConfig) -> Stage:
    # Placed cameras look at the origin: the area of people as seen from there.
    return Stage(config.scene.radius + float(np.hypot(*config.scene.middle)), arena_file(config.scene.arena))


def generate_clip(config: GenerateConfig, index: int, *, images: Path | None = None) -> Clip:
    """Generate clip `index` of a data set. It does not depend on which other clips are made.

    Args:
        config: The data set.
        index: Number of the clip.
        images: Folder of the images, if `config.images` selects any; without it none are rendered.

    Raises:
        FailedSimulation: the clip failed with every seed; the message is that of the last attempt.
        ValueError: the configuration cannot be met.
    """
    for attempt in range(config.retries):
        with suppress(FailedSimulation):
            return _attempt(config, index, attempt, images)
    return _attempt(config, index, config.retries, images)


def _attempt(config: GenerateConfig, index: int, attempt: int, images: Path | None) -> Clip:
    seed = attempt_seed(config.seed, attempt)
    rig = _rig(config, seed, index)
    spec, motions = _scene(config, rig, seed, index)
    with_images = images is not None and config.images != ImageKinds.none
    simulation = simulate(spec, rig, motions, painted=with_images)
    truth = Poses3D(simulation.skeleton, simulation.joints)
    occlusion = joint_visibility(
        simulation.model,
        simulation.qpos,
        simulation.joints,
        simulation.depth,
        simulation.geom_ids,
        rig,
        simulation.bodies,
    )
    occlusion = replace(occlusion, objects=simulation.objects)
    confirm(occlusion.visibility, config.occlusion)
    detected = detect(truth, occlusion, rig, spec.fps, config.detector, rng=generator(seed, index, Stream.DETECTOR))
    rendered = None
    if with_images:
        with Renderer(simulation.model, simulation.geom_ids, rig, config.quality) as renderer:
            rendered = render_images(renderer, simulation.qpos, rig, images, spec.fps, config.images.value)
            if "ids" in rendered.kinds:
                visible, amodal = person_pixels(renderer, simulation.qpos, rendered, len(spec.persons))
                occlusion = replace(occlusion, visible_pixels=visible, amodal_pixels=amodal)
    line = {
        "id": clip_id(index),
        "status": "ok",
        "seed": seed,
        "attempts": attempt + 1,
        "frames": len(simulation.qpos),
        "persons": len(spec.persons),
        "quality": simulation.quality,
        "occlusion": summary(occlusion.visibility, config.occlusion),
    }
    reported = miscalibrate(rig, config.rig.error, rng=generator(seed, index, Stream.CALIBRATION))
    if reported:
        line["calibration_error"] = calibration_error(rig, reported, _stage(config))
    return Clip(
        id=line["id"],
        fps=spec.fps,
        rig=reported or rig,
        detections=detected.detections,
        truth=truth,
        occlusion=occlusion,
        detection_labels=detected.labels,
        images=rendered,
        true_rig=rig if reported else None,
        provenance={"manifest": line, "spec": json.loads(spec.to_json()), **_filled(spec), "versions": _versions()},
    )


def _filled(spec: SceneSpec) -> dict[str, list[str]]:
    """Return what was filled into the room of a scene, for the provenance."""
    filled = load_room(spec.arena).filled
    return {"room": list(filled)} if filled else {}


def _scene(config: GenerateConfig, rig: CameraRig, seed: int, index: int) -> SampledScene:
    if config.occlusion.target:
        return sample_hidden_scene(
            config.scene,
            config.motion,
            config.props,
            config.occlusion,
            rig,
            config.interaction,
            seed=seed,
            clip=index,
        )
    return sample_scene(config.scene, config.motion, config.props, config.interaction, seed=seed, clip=index)


def _versions() -> dict[str, str]:
    modules = {"numpy": np, "scipy": scipy, "opencv": cv2, "mujoco": mujoco}
    return {
        "dmae-synth": metadata.version("dmae-synth"),
        "python": platform.python_version(),
        **{name: module.__version__ for name, module in modules.items()},
    }
