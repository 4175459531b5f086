"""Write a clip as a recording for the Rerun viewer, each layer as an entity that the viewer can hide."""

from pathlib import Path

import cv2
import numpy as np
import rerun as rr

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D, Source, person_name
from dmae.data.labels import Visibility
from dmae.files.contents import written_whole
from dmae.progress import progress
from dmae.viewing.overlay import (
    COLOURS,
    DETECTED,
    RED,
    TRUE,
    Layers,
    Overlay,
    first_joints,
    images_of,
    occluder_name,
    person_colour,
)

_JPEG_QUALITY = 80


def write_recording(clip: Clip, path: Path, layers: Layers) -> None:
    """Write people and cameras, and for each view its images, detections and joints.

    If the occluders are known, the colour and label of a true joint show its occluder.
    """
    frames = np.arange(len(clip))
    # Leaving the context of the stream flushes the file.
    with written_whole(path) as part, rr.RecordingStream("dmae", recording_id=clip.id) as recording:
        recording.save(str(part))
        recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        _log_cameras(recording, clip.actual_rig)
        for frame, images in zip(progress(frames, "recording", len(frames)), images_of(clip, frames), strict=True):
            recording.set_time("frame", sequence=int(frame))
            recording.set_time("time", duration=frame / clip.fps)
            if clip.has_images:
                _log_images(recording, clip.rig.names, images)
            if layers.truth:
                _log_truth(recording, clip, clip.actual_rig, frame, layers)
            if layers.poses:
                _log_poses(recording, clip, frame, layers)
            if layers.detections:
                for view, name in enumerate(clip.rig.names):
                    xy = clip.detections.xy[frame, view].reshape(-1, 2)
                    _log_marks(recording, name, "detections", xy[np.isfinite(xy).all(-1)], DETECTED)


def _camera(name: str, *parts: str) -> list[object]:
    """Return the path of an entity of a camera; in a list names may have spaces, dots and slashes."""
    return ["world", f"camera_{name}", *parts]


def _log_cameras(recording: rr.RecordingStream, rig: CameraRig) -> None:
    for view, name in enumerate(rig.names):
        turn = rr.Transform3D(translation=rig.centers[view], mat3x3=rig.cam_from_world[view, :3, :3].T)
        recording.log(_camera(name), turn, static=True)
        lens = rr.Pinhole(
            image_from_camera=rig.K[view], resolution=rig.size[view].tolist(), camera_xyz=rr.ViewCoordinates.RDF
        )
        recording.log(_camera(name, "image"), lens, static=True)


def _log_images(recording: rr.RecordingStream, names: tuple[str, ...], images) -> None:
    for name, image in zip(names, images, strict=True):
        pixels = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        _, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        image = rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")
        recording.log(_camera(name, "image"), image)


def _log_poses(recording: rr.RecordingStream, clip: Clip, frame: int, layers: Layers) -> None:
    assert clip.poses is not None
    poses, joints = clip.poses, first_joints(clip.poses)
    source = poses.source[frame][:, joints]
    completed = source == Source.COMPLETED
    kinds = {"measured": (source != Source.ABSENT) & ~completed, "completed": completed}
    wanted = {"measured": layers.measured, "completed": layers.completed}
    pixels = clip.rig.project(poses.xyz[frame : frame + 1][:, :, joints])[0][0]
    for person, xyz in enumerate(poses.xyz[frame][:, joints]):
        known = np.zeros(len(joints), bool)
        for kind in (kind for kind in kinds if wanted[kind]):
            here = kinds[kind][person]
            known |= here
            colour = RED if kind == "completed" else person_colour(person)
            points = rr.Points3D(xyz[here], colors=[colour], radii=0.02)
            recording.log(f"world/{person_name(person)}/{kind}", points)
        _log_bones(recording, f"world/{person_name(person)}/bones", poses, xyz, known, person_colour(person))
    for kind in (kind for kind in kinds if wanted[kind]):
        for view, name in enumerate(clip.rig.names):
            shown = np.nonzero(kinds[kind] & np.isfinite(pixels[view]).all(-1))
            colours = [RED if kind == "completed" else person_colour(p) for p in shown[0].tolist()]
            labels = [f"{person_name(p)} {_joint(poses, joints[j])}" for p, j in zip(*shown, strict=True)]
            _log_marks(recording, name, kind, pixels[view][shown], colours, labels)


def _log_truth(recording: rr.RecordingStream, clip: Clip, rig: CameraRig, frame: int, layers: Layers) -> None:
    """Log true joints. If occlusion is known, a joint that more cameras see is drawn larger."""
    assert clip.truth is not None
    truth, joints = clip.truth, first_joints(clip.truth)
    radii = np.full((truth.xyz.shape[1], len(joints)), 0.015)
    if clip.occlusion is not None:
        radii = 0.01 + 0.02 * clip.occlusion.visible_views[frame][:, joints] / len(rig)
    for person, xyz in enumerate(truth.xyz[frame][:, joints]):
        known = np.isfinite(xyz).all(-1)
        colour = TRUE if layers.poses else person_colour(person)
        points = rr.Points3D(xyz[known], colors=[colour], radii=radii[person, known])
        recording.log(f"world/truth/{person_name(person)}/joints", points)
        _log_bones(recording, f"world/truth/{person_name(person)}/bones", truth, xyz, known, colour)
    pixels = rig.project(truth.xyz[frame : frame + 1][:, :, joints])[0][0]
    for view, name in enumerate(rig.names):
        shown = np.isfinite(pixels[view]).all(-1)
        if layers.occlusion and clip.occlusion is not None:
            codes = clip.occlusion.visibility[frame, view][:, joints]
            shown &= codes <= Visibility.HIDDEN_BY_OBJECT
        colours, labels = [], []
        for person, joint in zip(*np.nonzero(shown), strict=True):
            label, colour = f"{person_name(person)} {_joint(truth, joints[joint])}", TRUE
            if layers.occlusion:
                occluder = occluder_name(clip, frame, view, person, joints[joint])
                label += f", behind {occluder}" if occluder else ""
                colour = COLOURS[Visibility(codes[person, joint])]
            colours.append(colour)
            labels.append(label)
        _log_marks(recording, name, "truth", pixels[view][shown], colours, labels)


def _log_bones(recording, path: str, poses: Poses3D, xyz: np.ndarray, known: np.ndarray, colour) -> None:
    bones = [xyz[list(bone)] for bone in Overlay.bones(poses) if known[list(bone)].all()]
    recording.log(path, rr.LineStrips3D(bones, colors=[colour], radii=0.008))


def _log_marks(recording, camera: str, layer: str, points: np.ndarray, colours, labels=None) -> None:
    """Log marks in a view; labels appear on hovering only, as hundreds would cover the image."""
    marks = rr.Points2D(np.reshape(points, (-1, 2)), colors=colours, labels=labels, radii=4.0, show_labels=False)
    recording.log(_camera(camera, "image", layer), marks)


def _joint(poses: Poses3D, joint: int) -> str:
    return poses.skeleton.joints[joint].rpartition(".")[2]
