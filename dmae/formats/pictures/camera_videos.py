"""Use videos, one per camera, as the images of a clip."""

from dataclasses import replace
from pathlib import Path

from dmae.data.clip import Clip
from dmae.data.images import Images
from dmae.files.videos import open_video
from dmae.formats.recordings.camera_matching import match_cameras, natural

_ENDINGS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")


def with_videos(clip: Clip, folder: Path) -> Clip:
    """Return the clip with the videos of a folder, one per camera, as its colour images.

    Videos are matched to cameras by `match_cameras`, like detections. Frame n of a video, counted from 0, is frame
    number n of the detections. If the videos are too short for this but long enough for the clip, their first frame is
    the first frame of the clip. If a video has another image size than the calibration, its images are stretched when
    they are drawn. A note in `provenance["notes"]` reports each of these cases.

    Raises:
        FileNotFoundError: the folder contains no videos.
        ValueError: a camera has no video, or a video is damaged or has too few frames.
    """
    files = sorted(
        (file for file in Path(folder).glob("*") if file.suffix.lower() in _ENDINGS),
        key=lambda file: natural(file.name),
    )
    if not files:
        raise FileNotFoundError(f"{folder}: expected a video for each camera, <camera>.mp4, found none")
    index, how = match_cameras([file.stem for file in files], clip.rig, Path(folder))
    lacking = [name for view, name in enumerate(clip.rig.names) if view not in index]
    if lacking:
        raise ValueError(f"{folder}: expected a video for each camera, found none of {', '.join(lacking)}")
    ordered = [files[index.index(view)] for view in range(len(clip.rig))]
    notes, counts = [how] if how else [], []
    for file, size, name in zip(ordered, clip.rig.size.tolist(), clip.rig.names, strict=True):
        with open_video(file) as video:
            stream = video.streams.video[0]
            counts.append(stream.frames or None)
            found = [stream.width, stream.height]
        if found != size:
            notes.append(f"camera {name}: {file.name} has pictures of {found} px, the calibration says {size}")
    first = clip.provenance.get("first_frame", 0)
    least = min((count for count in counts if count), default=first + len(clip))
    if least < first + len(clip):
        if least < len(clip):
            short = ordered[counts.index(least)]
            raise ValueError(f"{short}: expected {len(clip)} frames or more as of the detections, found {least}")
        notes.append(f"the first frame of the videos is assumed to be frame {first}, as they have {least} frames")
        first = 0
    images = Images(
        Path(folder),
        clip.rig.names,
        tuple(range(first, first + len(clip))),
        ("rgb",),
        files=tuple(f.name for f in ordered),
    )
    provenance = clip.provenance | {"notes": [*clip.provenance.get("notes", ()), *notes]}
    return replace(clip, images=images, provenance=provenance)
