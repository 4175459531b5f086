"""Render existing clips again: as other images, at another quality, or with other cameras. Nothing is simulated."""

import shutil
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.rng import Stream, generator
from dmae.data.store import clip_folders, load_clip, save_clip
from dmae.data.typed import decode
from dmae.files.checksums import begin_data_set, find_damage, write_checksums
from dmae.files.contents import whole_folder
from dmae.files.structured import read_json
from dmae.formats.config import clip_range
from dmae.parallel import process_count
from synth.datasets.clip import label_clip
from synth.datasets.config import OcclusionConfig, RenderConfig
from synth.datasets.forecast import Forecast, bytes_in, image_cost, lacks_images, makespan
from synth.datasets.generate import CONFIG, ImageTally, as_settings, claim, make_clips, with_images
from synth.datasets.images import add_images, check_images
from synth.detector.config import DetectorConfig
from synth.physics.body_state import BodyState, load_state, save_state
from synth.physics.simulation import rebuilt_scene
from synth.rigs.config import NO_RIG
from synth.rigs.coverage import Stage, stage_of
from synth.rigs.rig import make_rig
from synth.rooms.room import arena_file
from synth.scene.spec import SceneSpec


def render(config: RenderConfig) -> list[dict]:
    """Make a data set of clips that are rendered again, or add its missing clips. Return its manifest.

    Raises:
        FileNotFoundError: there is no clip, or it contains no body states.
        ValueError: `out` is the folder of the clips or contains something else, or `synth generate` did not make the
            clips.
    """
    out = Path(config.out)
    folders, settings, rig = _checked(config)
    claim(out, settings)
    lines = [read_json(folder / "clip.json")["provenance"]["manifest"] for folder in folders]
    images = sum(line["frames"] for line in lines) * len(rig)
    tasks = {folder.name: (config, settings, folder) for folder in folders}
    return make_clips(config, _render, tasks, begin_data_set(out), images)


def forecast_rendering(config: RenderConfig) -> Forecast:
    """Forecast the time and the disk space of what `render` would make, from a few images of one clip.

    Nothing is written to `config.out`. Raises as `render`.
    """
    folders, settings, _ = _checked(config)
    left, new = [], []
    for folder in folders:
        made = Path(config.out) / folder.name / "clip.json"
        if not made.is_file() or lacks_images(made, config.kinds):
            left.append(folder)
            new.append(not made.is_file())
    if not left:
        return Forecast(0, 0, 0, 0.0, 0.0)
    frames = [read_json(folder / "clip.json")["provenance"]["manifest"]["frames"] for folder in left]
    start, middle = time.perf_counter(), left[len(left) // 2]
    clip, state = load_clip(middle), load_state(middle)
    if config.rig != NO_RIG:
        clip = _relabelled(config, settings, clip, state)
    with tempfile.TemporaryDirectory() as place:
        save_clip(replace(clip, images=None), Path(place) / "clip")
        labels, label_bytes = (time.perf_counter() - start) / len(clip), bytes_in(Path(place) / "clip")
        cost = image_cost(config, clip, state, len(clip), Path(place) / "images")
    each = [
        cost.clip_seconds + number * (cost.frame_seconds + labels * labelled)
        for number, labelled in sorted(zip(frames, new, strict=True))
    ]
    took, labelled = makespan(each, process_count(config.workers)), int(np.dot(frames, new))
    size = (cost.bytes * sum(frames) + label_bytes * labelled) / len(clip)
    return Forecast(sum(new), labelled, sum(frames) * len(clip.rig), float(took), float(size) / 1e6)


def _checked(config: RenderConfig) -> tuple[list[Path], dict, CameraRig]:
    """Return the folders of the clips, the settings of the new data set, and the cameras of the first clip."""
    out, data = Path(config.out), Path(config.data)
    folders = clip_folders(data)
    if not folders:
        raise FileNotFoundError(f"data={data}: no clip of it is whole")
    numbers = clip_range(len(folders), config.first, config.clips)
    folders = folders[numbers.start : numbers.stop]
    if out.resolve() in (data.resolve(), folders[0].resolve().parent) or data.resolve() in out.resolve().parents:
        raise ValueError(
            f"out={out}: expected another folder than data={data}; `synth generate` with the options of the data set "
            "and images=... adds images to it"
        )
    settings = _settings(config, folders[0])
    clip = load_clip(folders[0])
    load_state(folders[0])
    rig = clip.rig if config.rig == NO_RIG else _new_rig(config, settings, SceneSpec.of(clip))
    check_images(config, rig)
    return folders, settings, rig


_LEFT_OUT = ("data", "out", "first", "clips", "workers", "backend", "dry_run", "rig")
"""Options that are not settings of the new data set, or that it keeps unless another rig is given."""


def _settings(config: RenderConfig, folder: Path) -> dict:
    path = folder.parent / CONFIG
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such file; expected a data set that `synth generate` made, or a clip in it"
        )
    settings = read_json(path) | as_settings(config, leave=_LEFT_OUT)
    if config.rig != NO_RIG:
        settings["rig"] = as_settings(config)["rig"]
    return settings | {"rendered_from": str(Path(config.data).resolve())}


def _new_rig(config: RenderConfig, settings: dict, spec: SceneSpec) -> CameraRig:
    return make_rig(config.rig, rng=generator(spec.seed, spec.clip, Stream.CAMERAS), stage=_stage(settings, spec))


def _stage(settings: dict, spec: SceneSpec) -> Stage:
    return stage_of(arena_file(spec.arena), settings["scene"]["middle"], spec.radius)


def _render(config: RenderConfig, settings: dict, folder: Path) -> dict:
    """Render one clip into the new data set, or only the images that it lacks there, and return its manifest line."""
    target = Path(config.out) / folder.name
    try:
        load_clip(target)
        whole = not find_damage(target, fast=True)
    except (FileNotFoundError, ValueError):
        whole = False
    if whole:
        return with_images(config, target)
    clip, state = load_clip(folder), load_state(folder)
    if config.rig == NO_RIG:
        # Without images, and without the numbers of pixels that were counted in them.
        bare = {key: value for key, value in clip.provenance.items() if key != "images"}
        occlusion = clip.occlusion and replace(clip.occlusion, visible_pixels=None, amodal_pixels=None)
        clip = replace(clip, images=None, occlusion=occlusion, provenance=bare)
    else:
        clip = _relabelled(config, settings, clip, state)
    shutil.rmtree(target, ignore_errors=True)
    with whole_folder(target) as partial:
        save_clip(clip, partial)
        save_state(state, partial)
        add_images(clip, state, partial, config, ImageTally(config).add)
        write_checksums(partial)
    return clip.provenance["manifest"]


def _relabelled(config: RenderConfig, settings: dict, clip: Clip, state: BodyState) -> Clip:
    spec = SceneSpec.of(clip)
    rig = _new_rig(config, settings, spec)
    dropped = ("occlusion", "calibration_error")
    line = {key: value for key, value in clip.provenance["manifest"].items() if key not in dropped}
    scene, detector = rebuilt_scene(clip, state, rig, painted=False), decode(DetectorConfig, settings["detector"])
    return label_clip(
        line, spec, scene, state.qpos, rig, detector=detector, occlusion=OcclusionConfig(), error=config.rig.error,
        stage=_stage(settings, spec),
    )  # fmt: skip
