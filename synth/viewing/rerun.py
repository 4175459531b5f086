"""Write a clip as a recording for the Rerun viewer."""

from pathlib import Path

import cv2
import numpy as np
import rerun as rr

from dmae.data.clip import Clip
from dmae.data.labels import Visibility
from dmae.reporting.figures import PERSONS
from synth.viewing.overlay import COLOURS, Overlay

_JPEG_QUALITY = 80


def write_recording(clip: Clip, path: Path) -> None:
    """Write people, cameras, and in each view the images and the joints, coloured and named by their occluder.

    Raises:
        ValueError: the clip has no visibility.
    """
    overlay = Overlay(clip, width=int(clip.rig.size[:, 0].max()))
    path.parent.mkdir(parents=True, exist_ok=True)
    # Leaving the context flushes the file.
    with rr.RecordingStream("synth", recording_id=clip.id) as recording:
        recording.save(str(path))
        recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        _log_cameras(recording, overlay)
        images = None
        if clip.images and "rgb" in clip.images.kinds:
            images = [clip.images.read("rgb", name) for name in clip.rig.names]
        for frame in range(len(clip)):
            recording.set_time("frame", sequence=frame)
            recording.set_time("time", duration=frame / clip.fps)
            _log_people(recording, overlay, frame)
            for view, name in enumerate(clip.rig.names):
                _log_joints(recording, overlay, frame, view)
                if images:
                    pixels = cv2.cvtColor(next(images[view]), cv2.COLOR_RGB2BGR)
                    _, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
                    picture = rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")
                    recording.log(f"world/camera_{name}/image", picture)


def _log_cameras(recording: rr.RecordingStream, overlay: Overlay) -> None:
    rig = overlay.rig
    for view, name in enumerate(rig.names):
        turn = rr.Transform3D(translation=rig.centers[view], mat3x3=rig.cam_from_world[view, :3, :3].T)
        recording.log(f"world/camera_{name}", turn, static=True)
        lens = rr.Pinhole(
            image_from_camera=rig.K[view], resolution=rig.size[view].tolist(), camera_xyz=rr.ViewCoordinates.RDF
        )
        recording.log(f"world/camera_{name}/image", lens, static=True)


def _log_people(recording: rr.RecordingStream, overlay: Overlay, frame: int) -> None:
    """Log joints, larger the more cameras see them."""
    seen = overlay.clip.occlusion.visible_views[frame] / len(overlay.rig)
    for person, joints in enumerate(overlay.clip.truth.xyz[frame]):
        known = [joint for joint in overlay.joints if np.isfinite(joints[joint]).all()]
        bones = [joints[list(bone)] for bone in overlay.bones if set(bone) <= set(known)]
        colour = [int(PERSONS[person % len(PERSONS)][i : i + 2], 16) for i in (1, 3, 5)]
        radii = 0.01 + 0.02 * seen[person, known]
        recording.log(f"world/person_{person}/joints", rr.Points3D(joints[known], colors=[colour], radii=radii))
        recording.log(f"world/person_{person}/bones", rr.LineStrips3D(bones, colors=[colour], radii=0.008))


def _log_joints(recording: rr.RecordingStream, overlay: Overlay, frame: int, view: int) -> None:
    clip = overlay.clip
    codes = clip.occlusion.visibility[frame, view][:, overlay.joints]
    points, colours, labels = [], [], []
    for person, joint in zip(*np.nonzero(codes <= Visibility.HIDDEN_BY_OBJECT), strict=True):
        occluder = overlay.occluder_name(frame, view, person, joint)
        points.append(overlay.pixels[frame, view, person, joint])
        colours.append(COLOURS[Visibility(codes[person, joint])])
        name = clip.truth.skeleton.joints[overlay.joints[joint]].rpartition(".")[2]
        labels.append(f"person {person} {name}" + (f", behind {occluder}" if occluder else ""))
    # Labels are shown on hovering: hundreds at once would cover the image.
    marks = rr.Points2D(np.reshape(points, (-1, 2)), colors=colours, labels=labels, radii=4.0, show_labels=False)
    recording.log(f"world/camera_{clip.rig.names[view]}/image/joints", marks)
