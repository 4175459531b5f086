"""One clip: from a configuration, a seed and a number to truth, labels, detections and images."""

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

from dmae.cameras import CameraRig
from dmae.clip import Clip, Poses3D
from dmae.images import KINDS
from dmae.rng import Stream, generator
from synth.arena import arena_file
from synth.coverage import Stage
from synth.detect import DetectorConfig, detect
from synth.interactions import InteractionConfig
from synth.lens import add_cameras
from synth.motion.source import MotionConfig
from synth.occlusion import OcclusionConfig, confirm, sample_hidden_spec, summary
from synth.pixels import person_pixels
from synth.props import PropsConfig
from synth.quality import FailedSimulation
from synth.render import Quality, Renderer, render_images
from synth.rigs import RigConfig, calibration_error, make_rig, miscalibrate
from synth.sample import sample_spec
from synth.simulate import simulate
from synth.spec import SceneConfig, SceneSpec
from synth.visibility import joint_visibility


class ImageKinds(Enum):
    """Which images are rendered."""

    none = ()
    rgb = ("rgb",)
    all = KINDS


@dataclass(frozen=True)
class GenerateConfig:
    """`synth generate`.

    Attributes:
        out: Folder of the data set.
        seed: Of the whole data set; 0 is a seed.
        clips: How many.
        workers: Processes; -1 for one a core.
        images: Which images are rendered beside the labels.
        quality: How much is spent on an image.
        retries: How often a clip that fails is begun anew, with another seed (`attempt_seed`).
        scene, props, motion, interaction, rig, detector: What the clips are drawn from.
        occlusion: How much is to be hidden from how many cameras.
    """

    out: str = "runs/data"
    seed: int = 0
    clips: int = 8
    workers: int = 1
    images: ImageKinds = ImageKinds.none
    quality: Quality = Quality.standard
    retries: int = 5
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
    """The seed in whose place a clip is drawn at an attempt: `seed` itself at attempt 0, a hash of both later."""
    return int(np.random.SeedSequence([seed, attempt]).generate_state(1, np.uint64)[0] >> 1) if attempt else seed


def clip_id(index: int) -> str:
    """The name of a clip, and of its folder."""
    return f"{index:06d}"


def check(config: GenerateConfig) -> None:
    """Find out what is wrong with a configuration before anything is made.

    Raises:
        ValueError, FileNotFoundError: the configuration cannot be met.
        FailedSimulation: no cameras fit, or `occlusion.target` is out of reach.
    """
    rig = _some_rig(config)
    add_cameras(mujoco.MjSpec(), rig)
    config.occlusion.check(rig)
    with suppress(FailedSimulation):
        _spec(replace(config, occlusion=OcclusionConfig()), rig, config.seed, 0)
    if config.occlusion.target:
        _check_target(config)


def _check_target(config: GenerateConfig) -> None:
    """Raises FailedSimulation if the occlusion asked for is out of reach in all of a few clips."""
    tries = [(attempt, clip) for attempt in range(min(config.retries, 2) + 1) for clip in range(min(config.clips, 3))]
    for number, (attempt, clip) in enumerate(tries, 1):
        seed = attempt_seed(config.seed, attempt)
        try:
            _spec(config, _rig(config, seed, clip), seed, clip)
            return
        except FailedSimulation:
            if number == len(tries):
                raise


def _some_rig(config: GenerateConfig) -> CameraRig:
    """The cameras of the first clip, at the first attempt at which there are any that fit."""
    for attempt in range(config.retries):
        with suppress(FailedSimulation):
            return _rig(config, attempt_seed(config.seed, attempt), 0)
    return _rig(config, attempt_seed(config.seed, config.retries), 0)


def _rig(config: GenerateConfig, seed: int, index: int) -> CameraRig:
    return make_rig(config.rig, rng=generator(seed, index, Stream.CAMERAS), stage=_stage(config))


def _stage(config: GenerateConfig) -> Stage:
    # People's area as seen from the origin, which is what placed cameras look at.
    return Stage(config.scene.radius + float(np.hypot(*config.scene.middle)), arena_file(config.scene.arena))


def generate_clip(config: GenerateConfig, index: int, *, images: Path | None = None) -> Clip:
    """Make clip `index` of a data set: the same whatever other clips are made, wherever and when.

    Args:
        config: The data set.
        index: Number of the clip.
        images: Folder that takes the images, if `config.images` asks for any; without it none are rendered.

    Raises:
        FailedSimulation: the clip failed with every seed; the message is that of the last.
        ValueError: the configuration cannot be met.
    """
    for attempt in range(config.retries):
        with suppress(FailedSimulation):
            return _attempt(config, index, attempt, images)
    return _attempt(config, index, config.retries, images)


def _attempt(config: GenerateConfig, index: int, attempt: int, images: Path | None) -> Clip:
    seed = attempt_seed(config.seed, attempt)
    rig = _rig(config, seed, index)
    spec = _spec(config, rig, seed, index)
    pictured = images is not None and config.images != ImageKinds.none
    simulation = simulate(spec, rig, painted=pictured)
    truth = Poses3D(simulation.skeleton, simulation.joints)
    sight = joint_visibility(
        simulation.model,
        simulation.qpos,
        simulation.joints,
        simulation.depth,
        simulation.geom_ids,
        rig,
        simulation.bodies,
    )
    visibility, hidden_by = sight.visibility, sight.hidden_by
    confirm(visibility, config.occlusion)
    detected = detect(
        truth, visibility, hidden_by, rig, spec.fps, config.detector, rng=generator(seed, index, Stream.DETECTOR)
    )
    rendered, visible_pixels, amodal_pixels = None, None, None
    if pictured:
        with Renderer(simulation.model, simulation.geom_ids, rig, config.quality) as renderer:
            rendered = render_images(renderer, simulation.qpos, rig, images, spec.fps, config.images.value)
            if "ids" in rendered.kinds:
                visible_pixels, amodal_pixels = person_pixels(renderer, simulation.qpos, rendered, len(spec.persons))
    line = {
        "id": clip_id(index),
        "status": "ok",
        "seed": seed,
        "attempts": attempt + 1,
        "frames": len(simulation.qpos),
        "persons": len(spec.persons),
        "quality": simulation.quality,
        "occlusion": summary(visibility, config.occlusion),
    }
    reported = miscalibrate(rig, config.rig.error, rng=generator(seed, index, Stream.CALIBRATION))
    if reported:
        line["calibration_error"] = calibration_error(rig, reported, _stage(config))
    return Clip(
        id=line["id"],
        fps=spec.fps,
        rig=reported or rig,
        truth=truth,
        visibility=visibility,
        hidden_by=hidden_by,
        depth_margin=sight.depth_margin,
        visible_pixels=visible_pixels,
        amodal_pixels=amodal_pixels,
        **detected._asdict(),
        objects=simulation.objects,
        images=rendered,
        true_rig=rig if reported else None,
        provenance={"manifest": line, "spec": json.loads(spec.to_json()), "versions": _versions()},
    )


def _spec(config: GenerateConfig, rig: CameraRig, seed: int, index: int) -> SceneSpec:
    if config.occlusion.target:
        return sample_hidden_spec(
            config.scene,
            config.motion,
            config.props,
            config.occlusion,
            rig,
            config.interaction,
            seed=seed,
            clip=index,
        )
    return sample_spec(config.scene, config.motion, config.props, interaction=config.interaction, seed=seed, clip=index)


def _versions() -> dict[str, str]:
    modules = {"numpy": np, "scipy": scipy, "opencv": cv2, "mujoco": mujoco}
    return {
        "dmae-synth": metadata.version("dmae-synth"),
        "python": platform.python_version(),
        **{name: module.__version__ for name, module in modules.items()},
    }
