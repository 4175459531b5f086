"""Use folders of image files, one folder per camera, as the images of a clip."""

import re
from dataclasses import replace
from pathlib import Path

from dmae.data.clip import Clip
from dmae.data.images import Images, picture_files
from dmae.files.pictures import check_picture
from dmae.formats.recordings.camera_matching import match_cameras, natural


def with_pictures(clip: Clip, folder: Path) -> Clip:
    """Return the clip with the image files of a folder as its colour images. The folder contains one folder per camera.

    Folders are matched to cameras by `match_cameras`, like detections. A file is the first frame of the clip if its
    name ends with the number of that frame, and if it has the same position in every folder. Otherwise the first file
    is frame 0 or, if there are too few files for this, the first frame of the clip; a note states the assumption.
    Another note says if images have another size than in the calibration.

    Raises:
        FileNotFoundError: the folder contains no folders of images.
        ValueError: a camera has no images or too few of them, or an image is damaged.
    """
    folders = sorted(
        (each for each in Path(folder).glob("*") if each.is_dir() and picture_files(each)),
        key=lambda each: natural(each.name),
    )
    if not folders:
        raise FileNotFoundError(f"{folder}: expected a folder of PNG or JPEG files for each camera, found none")
    index, how = match_cameras([each.name for each in folders], clip.rig, Path(folder), "pictures", "data.images=...")
    lacking = [name for view, name in enumerate(clip.rig.names) if view not in index]
    if lacking:
        raise ValueError(f"{folder}: expected pictures of each camera, found none of {', '.join(lacking)}")
    ordered = [folders[index.index(view)] for view in range(len(clip.rig))]
    files, notes = [picture_files(each) for each in ordered], [how] if how else []
    for each, size, name in zip(files, clip.rig.size.tolist(), clip.rig.names, strict=True):
        found = list(check_picture(each[0]))
        if found != size:
            notes.append(f"camera {name}: {each[0].name} has {found} px, the calibration says {size}")
        if len(each) < len(clip):
            parent = each[0].parent
            raise ValueError(f"{parent}: expected {len(clip)} pictures or more as of the detections, found {len(each)}")
    first, least = clip.provenance.get("first_frame", 0), min(map(len, files))
    places = {_index_of_number(each, first) for each in files}
    start = places.pop() if len(places) == 1 else None
    if start is None or least < start + len(clip):
        start = first if least >= first + len(clip) else 0
        notes.append(f"the first of the {least} pictures is assumed to be frame {first - start}")
    frames = tuple(range(start, start + len(clip)))
    images = Images(folder, clip.rig.names, frames, ("rgb",), rgb="png", files=tuple(each.name for each in ordered))
    return replace(
        clip, images=images, provenance=clip.provenance | {"notes": [*clip.provenance.get("notes", ()), *notes]}
    )


def _index_of_number(files: tuple[Path, ...], number: int) -> int | None:
    """Return the index of the file with this number as the last number in its name; None if there is none."""
    numbers = [re.findall(r"\d+", file.stem) for file in files]
    return next((place for place, found in enumerate(numbers) if found and int(found[-1]) == number), None)
