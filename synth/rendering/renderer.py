"""Render a scene: colour, depth, ids, body parts, normals, flow and amodal masks of persons."""

import copy
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.images import FIRST_OBJECT_ID, KINDS, Images, write_image, write_video
from synth.people.body import SEGMENTS
from synth.people.mjcf import geom_parts
from synth.people.skinning import Skin, locate, mesh_triangles
from synth.rendering.config import ImageQuality, ImagingConfig
from synth.rendering.opengl import OpenGLPainter, find_backend
from synth.rendering.raycasting import RayPainter
from synth.rendering.sensor import Sensor, decode, encode
from synth.rigs.lenses import ELSEWHERE, joined, pinholes, warps


class LensPainter(OpenGLPainter):
    """Paint images through the lenses of a rig of V cameras by warping images of their pinholes."""

    def __init__(self, model, geom_ids, rig: CameraRig, backend, settings, imaging: ImagingConfig):
        cameras = pinholes(rig)
        self._pinholes = joined(cameras)
        super().__init__(model, geom_ids, self._pinholes, backend, settings, imaging)
        self._maps = [warps(rig[view : view + 1]) for view in range(len(rig))]
        ends = np.cumsum([len(each) for each in cameras]).tolist()
        self._parts = [range(end - len(each), end) for end, each in zip(ends, cameras, strict=True)]

    def paint(self, data: mujoco.MjData, view: int, kinds: tuple[str, ...]) -> tuple[np.ndarray | None, ...]:
        """Return images of these kinds. Pixels where the lens shows nothing are NaN or 0."""
        parts = [super(LensPainter, self).paint(data, part, kinds) for part in self._parts[view]]
        rgb, depth, geoms, normals = (list(images) for images in zip(*parts, strict=True))
        if len(parts) > 1 and depth[0] is not None:
            depth = [image * self._along_axis(view, part) for image, part in zip(depth, self._parts[view], strict=True)]
        return tuple(self._bent(images, view) for images in (rgb, depth, geoms, normals))

    def paint_alone(self, data: mujoco.MjData, view: int, owner: int) -> np.ndarray:
        """Return (H, W) True for the pixels that geoms with the id `owner` would cover if nothing else were there."""
        images = [super(LensPainter, self).paint_alone(data, part, owner) for part in self._parts[view]]
        bent = self._bent([image.astype(np.uint16) for image in images], view)
        assert bent is not None
        return bent > 0

    def _along_axis(self, view: int, part: int) -> np.ndarray:
        """Return (h, w) by what depth in a pinhole of a view is multiplied, to be along the axis of the view itself."""
        ahead, side = (self._pinholes.cam_from_world[each, :3, :3] for each in (self._parts[view][0], part))
        x, y, z = side @ ahead[2] @ np.linalg.inv(self._pinholes.K[part])
        width, height = self._pinholes.size[part]
        return (x * np.arange(width) + (y * np.arange(height) + z)[:, None]).astype(np.float32)

    def _bent(self, images: list[Any], view: int) -> np.ndarray | None:
        """Return the distorted image from the images of the pinholes. Only colours are interpolated."""
        maps = self._maps[view]
        if images[0] is None or maps is None:
            return images[0]
        how = cv2.INTER_LINEAR if images[0].dtype == np.uint8 else cv2.INTER_NEAREST
        nothing: Any = (np.nan,) * 4 if images[0].dtype == np.float32 else 0
        bent: Any = None
        for image, pixels in zip(images, maps, strict=True):
            border = {"borderMode": cv2.BORDER_CONSTANT, "borderValue": nothing}
            part = cv2.remap(image, pixels, None, how, **border)  # type: ignore[call-overload]  # one map of x and y
            if bent is None:
                bent = part
            else:
                shown = pixels[..., 0] > ELSEWHERE
                bent[shown] = part[shown]
        return bent


# Flow: how far the surface at each pixel moves in the image until the next frame


class SurfaceFlow:
    """The flow of images of a scene.

    Args:
        rig: V static cameras.
    """

    def __init__(self, model: mujoco.MjModel, rig: CameraRig):
        self._model, self._rig, self._next = model, rig, mujoco.MjData(model)
        self._later = copy.copy(model)
        self._skin = Skin(self._later)
        self._moves = np.concatenate([[False], model.body_weldid[model.geom_bodyid] > 0])
        self._view: int | None = None
        self._rays = np.empty(0)

    def __call__(
        self,
        data: mujoco.MjData,
        following: np.ndarray | None,
        seconds: float,
        view: int,
        depth: np.ndarray,
        geoms: np.ndarray,
    ) -> np.ndarray:
        """Return the flow (H, W, 2), float32 px; NaN where there is no surface.

        Args:
            data: State of the scene, positions and surfaces up to date.
            following: (nq,) the next state; None if there is none. Then all flow is NaN.
            seconds: Time of the next state in the clip, s.
            view: Index into the rig.
            depth: (H, W) m along the optical axis.
            geoms: (H, W) 1 + index of the geom at each pixel, 0 for none.
        """
        flow = np.full((*depth.shape, 2), np.nan, np.float32)
        if following is None:
            return flow
        flow[geoms > 0] = 0
        row, column = np.nonzero(self._moves[geoms])
        if not len(row):
            return flow
        self._next.qpos[:] = following
        mujoco.mj_kinematics(self._model, self._next)
        self._skin.apply(self._next, seconds)
        camera = self._rig[view : view + 1]
        pose, pixels = camera.cam_from_world[0], np.stack([column, row], -1).astype(float)
        rays = self._rays_of(camera, view, depth.shape)[row, column]
        points = camera.centers[0] + rays * (depth[row, column] / (rays @ pose[2, :3]))[:, None]
        geom = geoms[row, column].astype(int) - 1
        now, then = (each.geom_xmat.reshape(-1, 3, 3)[geom] for each in (data, self._next))
        own = np.einsum("rji,rj->ri", now, points - data.geom_xpos[geom])
        for bent in np.intersect1d(geom, self._skin.geoms):
            own[geom == bent] = self._bent(bent, own[geom == bent])
        places = self._next.geom_xpos[geom] + np.einsum("rij,rj->ri", then, own)
        xy, along = camera.project(places[None])
        flow[row, column] = np.where(along[0, 0, :, None] > 0, xy[0, 0] - pixels, np.nan)
        return flow

    def _bent(self, geom: int, points: np.ndarray) -> np.ndarray:
        """Return where points (R, 3) on a geom that bends are in the next state, both in the frame of the geom."""
        now, then = (mesh_triangles(model, geom) for model in (self._model, self._later))
        triangle, share = locate(now, points)
        return np.einsum("rk,rkx->rx", share, then[triangle])

    def _rays_of(self, camera: CameraRig, view: int, shape: tuple[int, ...]) -> np.ndarray:
        """Return (H, W, 3) unit rays through the pixels of a view, world. They are cached until the view changes."""
        if view != self._view:
            grid = np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[0])), -1).astype(float)
            self._view, self._rays = view, camera.rays(grid[None, None]).reshape(*shape, 3)
        return self._rays


# The renderer

_BLUR_STEP, _MOST = 2.0, 16
"""Distance in the image that the fastest geom moves from one image of an exposure to the next, px, and the greatest
number of images of an exposure."""

# Whether there are shadows, samples per pixel, slices, stacks and quads of round shapes. The last number is for ray
# casting: the side, in pixels, of the block that shares a ray.
_SETTINGS = {
    ImageQuality.draft: ((False, 0, 12, 8, 1), 2),
    ImageQuality.standard: ((True, 4, 20, 12, 2), 1),
    ImageQuality.high: ((True, 8, 28, 16, 4), 1),
}


class RenderedView(NamedTuple):
    """Images of one view of one frame; None for kinds that were not requested."""

    rgb: np.ndarray | None = None  # (H, W, 3) uint8
    depth: np.ndarray | None = None  # (H, W) float32 m along the optical axis; NaN where there is no surface
    ids: np.ndarray | None = None  # (H, W) uint16: 0 nothing, 1 + p person p, 256 + k object k
    # (H, W) uint8: 1 + index in `synth.people.body.SEGMENTS`; 0 where there is no person
    parts: np.ndarray | None = None
    # (H, W, 3) float32 unit normals of the surface, world; NaN where there is no surface
    normals: np.ndarray | None = None
    # (H, W, 2) float32 px that the surface at a pixel moves until the next state, even if it is hidden there; NaN where
    # there is no surface, or no next state
    flow: np.ndarray | None = None
    # (H, W) uint32; bit p is 1 where person p would be visible if nothing else were there
    amodal: np.ndarray | None = None


class Renderer:
    """Render one scene from all cameras of a rig; a context manager.

    Without a working OpenGL (`find_backend`), images are made by ray casting.

    Args:
        model: The scene, with the rig's cameras in it (`synth.rigs.lenses.add_cameras`).
        geom_ids: (ngeom,) uint16 id of the owner of each geom: 0 nothing, 1 + p person p, 256 + k object k.
        rig: V cameras. OpenGL images of distorted cameras are warped. Colour is interpolated; depth, ids and parts are
            taken from the nearest pixel, with an error of up to half a pixel.
        quality: Quality of the images.
        imaging: Light of colour images, and time of exposure. `synth.rendering.sensor` makes the camera's other faults.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        geom_ids: np.ndarray,
        rig: CameraRig,
        quality: ImageQuality = ImageQuality.standard,
        imaging: ImagingConfig | None = None,
    ):
        imaging = imaging or ImagingConfig()
        settings, step = _SETTINGS[quality]
        # A copy, because people's meshes change.
        model = copy.copy(model)
        backend = find_backend()
        if backend:
            self._painter: LensPainter | RayPainter = LensPainter(model, geom_ids, rig, backend, settings, imaging)
        else:
            self._painter = RayPainter(model, geom_ids, rig, step)
        self._model, self._data = model, mujoco.MjData(model)
        self._seconds, self._skin = np.nan, Skin(model)
        # Index 0 means no geom.
        self._ids = np.concatenate([[0], geom_ids]).astype(np.uint16)
        self._parts = np.concatenate([[0], geom_parts(model)]).astype(np.uint8)
        self._flow = SurfaceFlow(model, rig)
        self._rig, self._shutter = rig, imaging.shutter
        self.persons = int(geom_ids[geom_ids < FIRST_OBJECT_ID].max(initial=0))
        """Number of persons."""

    def image(
        self,
        qpos: np.ndarray,
        view: int,
        kinds: tuple[str, ...] = KINDS,
        following: np.ndarray | None = None,
        motion: np.ndarray | None = None,
        seconds: float = 0.0,
        interval: float = 0.0,
    ) -> RenderedView:
        """Render one view of the scene in the state `qpos` (nq,). It is fastest to render all frames of one view first.

        Args:
            view: Index into the rig.
            kinds: Kinds of images, from `dmae.data.images.KINDS`. Depth, ids and parts together cost as much as one of
                them. Normals cost two more passes, amodal one for each person.
            following: (nq,) the next state, which the flow refers to.
            motion: (nv,) motion of all joints during the exposure, for motion blur; None for a sharp image.
            seconds: Time of the state in the clip, s, which shapes of hands follow.
            interval: Time until the next state, s.
        """
        blurred = None
        if "rgb" in kinds and motion is not None and motion.any():
            blurred = self._exposed(qpos, motion, view, seconds)
            kinds = tuple(kind for kind in kinds if kind != "rgb")
        painted: tuple[Any, ...] = (None,) * 4
        if kinds:
            self._move(qpos, seconds)
            painted = self._painter.paint(self._data, view, kinds)
        rgb, depth, geoms, normals = painted
        flow = None
        if "flow" in kinds:
            flow = self._flow(self._data, following, seconds + interval, view, depth, geoms)
        amodal = None
        if "amodal" in kinds:
            amodal = np.zeros(geoms.shape, np.uint32)
            for person in range(self.persons):
                amodal |= self._painter.paint_alone(self._data, view, 1 + person).astype(np.uint32) << person
        return RenderedView(
            rgb=rgb if "rgb" in kinds else blurred,
            depth=depth if "depth" in kinds else None,
            ids=np.take(self._ids, geoms) if "ids" in kinds else None,
            parts=np.take(self._parts, geoms) if "parts" in kinds else None,
            normals=normals if "normals" in kinds else None,
            flow=flow,
            amodal=amodal,
        )

    def _exposed(self, qpos: np.ndarray, motion: np.ndarray, view: int, seconds: float) -> np.ndarray:
        """Return the mean light of images during the exposure, with the state `qpos` in its middle, as an image. Hands
        keep their shapes meanwhile."""

        def move(share: float) -> None:
            moved = qpos.copy()
            mujoco.mj_integratePos(self._model, moved, motion, share - 0.5)
            self._move(moved, seconds)

        ends, camera = [], self._rig[view : view + 1]
        for share in (0.0, 1.0):
            move(share)
            ends.append(camera.project(self._data.geom_xpos[None])[0])
        seen = (camera.inside(ends[0]) & camera.inside(ends[1]))[0, 0]
        far = np.linalg.norm(ends[1] - ends[0], axis=-1)[0, 0, seen].max(initial=0.0)
        count = int(np.clip(np.ceil(far / _BLUR_STEP), 1, _MOST))
        light: Any = 0.0
        for number in range(count):
            move((number + 0.5) / count)
            rgb: Any = self._painter.paint(self._data, view, ("rgb",))[0]
            light = light + decode(rgb)
        return encode(light / count)

    def motion(self, qpos: np.ndarray, frame: int, fps: float) -> np.ndarray:
        """Return the motion (nv,) of all joints during the exposure of a frame, from the states (F, nq) around it."""
        before, after = max(frame - 1, 0), min(frame + 1, len(qpos) - 1)
        motion = np.zeros(self._model.nv)
        if after > before and self._shutter:
            mujoco.mj_differentiatePos(self._model, motion, (after - before) / fps, qpos[before], qpos[after])
        return motion * min(self._shutter, 1 / fps)

    def alone(self, qpos: np.ndarray, view: int, person: int, seconds: float = 0.0) -> np.ndarray:
        """Return (H, W) True for the pixels that a person would cover if nothing else were there, as `image`."""
        self._move(qpos, seconds)
        return self._painter.paint_alone(self._data, view, 1 + person)

    def _move(self, qpos: np.ndarray, seconds: float) -> None:
        if self._seconds == seconds and np.array_equal(self._data.qpos, qpos):
            return
        self._seconds = seconds
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        self._skin.apply(self._data, seconds)
        self._painter.reshape(self._skin.meshes)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def close(self) -> None:
        self._painter.close()

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, *failure) -> None:
        self.close()


# The images of a clip


class RenderedImages(NamedTuple):
    """Images on disk, and the numbers of pixels of each person in them."""

    images: Images  # The images
    visible: np.ndarray | None  # (F, V, P) int32 number of pixels that show each person; None without id images
    # (F, V, P) int32 number of pixels that would show each person if nothing else were there; None without id images
    amodal: np.ndarray | None


def render_images(
    renderer: Renderer,
    qpos: np.ndarray,
    rig: CameraRig,
    folder: Path,
    fps: float,
    kinds: tuple[str, ...] = KINDS,
    rgb: str = "h264",
    seen: Callable[[], None] = lambda: None,
    sensors: Sequence[Sensor] = (),
) -> RenderedImages:
    """Write images of every view of every frame in the layout of `dmae.data.images`, with only one in memory at a time.

    Args:
        renderer: Renderer of the scene and the rig.
        qpos: (F, nq) states.
        rig: V cameras.
        folder: Folder to write the images to.
        fps: Frames per second of the videos.
        kinds: Kinds of images, from `dmae.data.images.KINDS`.
        rgb: Format of colour images, from `dmae.data.images.RGB_FILES`.
        seen: Called after each view of each frame.
        sensors: The sensor of each camera; none for colours without their faults.
    """
    images = Images(folder, rig.names, tuple(range(len(qpos))), kinds, SEGMENTS if "parts" in kinds else (), rgb)
    counted = "ids" in kinds
    visible, amodal = (np.zeros((len(qpos), len(rig), renderer.persons), np.int32) for _ in range(2))

    def rendered(view: int) -> Iterator[Any]:
        """Render the images of a view, write all that are not in a video, and yield the colours."""
        for frame, state in enumerate(qpos):
            following = qpos[frame + 1] if frame + 1 < len(qpos) else None
            motion = renderer.motion(qpos, frame, fps)
            image = renderer.image(state, view, kinds, following, motion, frame / fps, 1 / fps)
            if sensors and image.rgb is not None:
                image = image._replace(rgb=sensors[view].image(image.rgb, frame))
            for kind in kinds:
                path = images.path(kind, rig.names[view], frame)
                if path.suffix != ".mp4":
                    write_image(kind, path, getattr(image, kind))
            if counted:
                for person in range(renderer.persons):
                    visible[frame, view, person] = np.count_nonzero(image.ids == 1 + person)
                    amodal[frame, view, person] = np.count_nonzero(renderer.alone(state, view, person, frame / fps))
            seen()
            yield image.rgb

    for view, name in enumerate(rig.names):
        colours = rendered(view)
        if "rgb" in kinds and rgb == "h264":
            write_video(images.path("rgb", name), colours, fps)
        for _ in colours:
            pass
    return RenderedImages(images, visible if counted else None, amodal if counted else None)
