"""The images of a clip, rendered on request from the body states that are stored with its labels."""

import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.images import KINDS, Images
from dmae.data.store import save_clip
from synth.datasets.config import GenerateConfig, RenderConfig, RgbFormat
from synth.physics.body_state import BodyState
from synth.physics.simulation import rebuilt_scene
from synth.rendering.opengl import find_backend
from synth.rendering.renderer import Renderer, render_images
from synth.rendering.sensor import Sensor
from synth.scene.spec import SceneSpec

_FOLDER = "images"


def check_images(options: GenerateConfig | RenderConfig, rig: CameraRig) -> None:
    """Check that images can be rendered, before any work is done, and find the OpenGL backend.

    Raises ValueError if H.264 is requested for images with an odd width or height.
    """
    if not options.kinds:
        return
    odd = [name for name, size in zip(rig.names, rig.size.tolist(), strict=True) if size[0] % 2 or size[1] % 2]
    if odd and "rgb" in options.kinds and options.rgb is RgbFormat.h264:
        raise ValueError(
            f"rgb=h264: H.264 needs images of even width and height, and camera {odd[0]!r} has "
            f"{rig.size[rig.names.index(odd[0])].tolist()} px; ask for rgb=png or rgb=jpeg"
        )
    find_backend()


def missing_kinds(clip: Clip, options: GenerateConfig | RenderConfig) -> tuple[str, ...]:
    """Return the kinds of images that a clip lacks."""
    return tuple(kind for kind in options.kinds if clip.images is None or kind not in clip.images.kinds)


def add_images(
    clip: Clip,
    state: BodyState,
    folder: Path,
    options: GenerateConfig | RenderConfig,
    seen: Callable[[], None] = lambda: None,
) -> Clip:
    """Render the missing images of a clip from its states, write them and the clip to its folder, and return the clip.

    Labels do not change, except that id images add the numbers of pixels of each person. The clip refers to the new
    images only when all of them are complete. `seen` is called after each view of each frame.

    Raises as `synth.physics.simulation.rebuilt_scene`.
    """
    missing = missing_kinds(clip, options)
    if not missing:
        return clip
    rig = clip.actual_rig
    spec, scene = SceneSpec.of(clip), rebuilt_scene(clip, state)
    partial = folder / f".{_FOLDER}"
    shutil.rmtree(partial, ignore_errors=True)
    try:
        with Renderer(scene.model, scene.geom_ids, rig, options.quality, options.imaging) as renderer:
            sensors = [Sensor(options.imaging, spec.seed, spec.clip, view) for view in range(len(rig))]
            images, visible, amodal = render_images(
                renderer, state.qpos, rig, partial, clip.fps, missing, options.rgb.value, seen, sensors
            )
        for kind in missing:
            shutil.rmtree(folder / _FOLDER / kind, ignore_errors=True)
            (folder / _FOLDER).mkdir(exist_ok=True)
            (partial / kind).rename(folder / _FOLDER / kind)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    before = clip.images.kinds if clip.images else ()
    images = replace(
        images,
        folder=folder / _FOLDER,
        kinds=tuple(kind for kind in KINDS if kind in (*before, *missing)),
        parts=images.parts or (clip.images.parts if clip.images else ()),
        rgb=images.rgb if "rgb" in missing or not clip.images else clip.images.rgb,
    )
    if visible is not None and clip.occlusion is not None:
        clip = replace(clip, occlusion=replace(clip.occlusion, visible_pixels=visible, amodal_pixels=amodal))
    painted: dict = {"quality": options.quality.name, "opengl": find_backend() or "none, rays were cast"}
    if "rgb" in missing:
        painted["imaging"] = asdict(options.imaging)
    elif clip.images and "imaging" in clip.provenance["images"]:
        painted["imaging"] = clip.provenance["images"]["imaging"]
    clip = replace(clip, images=images, provenance=clip.provenance | {"images": painted})
    save_clip(clip, folder)
    return clip


def image_files(images: Images) -> set[Path]:
    """Return the paths of all files of images."""
    return {images.path(kind, view, frame) for kind in images.kinds for view in images.views for frame in images.frames}
