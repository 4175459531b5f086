"""Our own formats: clip folders (`dmae.data.store`), and poses as a NumPy archive that needs no pickle.

`docs/reference/files.md` lists the arrays of both. `source` is an index of `source_names`; `skeleton` is a name, or the
definition of your own skeleton as JSON. A person is absent from a frame if all its joints are absent.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
from numpy.lib.format import header_data_from_array_1_0, write_array_header_1_0

from dmae.data.array_fields import UNSET
from dmae.data.clip import Clip, Poses3D, Source, person_name, person_names
from dmae.data.store import load_clip, save_clip
from dmae.files.arrays import read_arrays
from dmae.files.checks import check_rate
from dmae.files.contents import write_atomic
from dmae.files.mapped import frame_blocks
from dmae.formats.poses import PoseFile
from dmae.formats.registry import pose_reader, pose_writer, reader, recording_writer
from dmae.formats.skeletons import named_skeleton, read_skeleton_text, skeleton_text


@pose_writer("npz", fused=True, errors=True)
def write_npz_poses(poses: Poses3D, clip: Clip, path: Path) -> None:
    """A NumPy archive with joints, their sources, covariances and names."""
    export_npz(poses, clip.fps, path, person_names(clip, poses.xyz.shape[1]))


@pose_reader("npz", file="*.npz")
def read_npz_poses(path: Path) -> PoseFile:
    """A NumPy archive that `write_npz_poses` wrote, or with `joints` (F, P, J, 3) m and `joint_names` of your own."""
    return PoseFile(*read_npz(path))


def export_npz(poses: Poses3D, fps: float, path: Path, people: Sequence[str] | None = None) -> None:
    """Write poses as an archive of the arrays that `docs/reference/files.md` lists; people are by default P1, ..."""
    people = people or [person_name(person) for person in range(poses.xyz.shape[1])]
    arrays = {
        "joints": poses.xyz,
        "source": poses.source,
        "source_names": np.array([source.name.lower() for source in Source]),
        "cov": poses.cov,
        "views": poses.views,
        "joint_names": np.array(poses.skeleton.joints),
        "person_names": np.array(people, str),
        "skeleton": np.array(skeleton_text(poses.skeleton)),
        "fps": np.array(fps, np.float64),
    }
    # This writes the same archive as numpy.savez_compressed, without loading whole arrays into memory.
    with TemporaryFile(prefix="dmae-") as file:
        with ZipFile(file, "w", ZIP_DEFLATED) as archive:
            for name, array in arrays.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    write_array_header_1_0(member, header_data_from_array_1_0(array) | {"fortran_order": False})
                    for part in frame_blocks(array) if array.ndim else [...]:
                        member.write(array[part].tobytes())
        file.seek(0)
        write_atomic(Path(path), iter(partial(file.read, 1 << 20), b""))


def read_npz(path: Path) -> tuple[Poses3D, float | None]:
    """Return the poses of an archive of `export_npz` or of another program, and its frames per second, None if unknown.

    `joints` and `joint_names` are enough: joints that are not NaN then count as measured. Without `skeleton`, their
    names decide, in any order.

    Raises FileNotFoundError if there is no file, and ValueError, which names missing arrays, if it is no such archive.
    """
    path = Path(path)
    optional = ("source", "cov", "views", "skeleton", "fps")
    arrays = read_arrays(path, "an .npz archive of poses", ("joints", "joint_names"), optional)
    names = [*map(str, np.atleast_1d(arrays["joint_names"]))]
    if "skeleton" in arrays:
        skeleton, order = read_skeleton_text(path, str(arrays["skeleton"])), [*range(len(names))]
        if [*skeleton.joints] != names:
            raise ValueError(f"{path}: expected the joints of {skeleton.name}, {[*skeleton.joints]}, found {names}")
    else:
        skeleton, order, _ = named_skeleton(names, (), None, path)
    try:
        found = [arrays.get(name, UNSET) for name in ("joints", "source", "cov", "views")]
        if any(each is not None and each.shape[2:3] != (len(names),) for each in found):
            shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items() if array.ndim > 1)
            raise ValueError(
                f"expected shape (F, P, {len(names)}, 3) of joints, {len(names)} as joint_names; found {shapes}"
            )
        ordered: list[Any] = [each if each is None else each[:, :, order] for each in found]
        poses = Poses3D(skeleton, *ordered)
        poses.check_numbers()
        return poses, check_rate("fps", arrays["fps"].item()) if "fps" in arrays else None
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"{path}: {error}") from None


@reader("clip", signs=[["clip.json"], ["manifest.jsonl"]], data_set=True)
def read_clip(path: Path) -> Clip:
    """A clip folder or a data set of clips, which synth generate and dmae capture write."""
    return load_clip(path)


@pose_reader("clip", signs=["clip.json"])
def read_clip_poses(path: Path) -> PoseFile:
    """The captured or completed poses of a clip folder."""
    clip = load_clip(path)
    if clip.poses is None:
        raise ValueError(f"{path}: clip {clip.id!r} has no poses; run dmae capture on it first")
    return PoseFile(clip.poses, clip.fps, clip.id)


@recording_writer("clip")
def write_clip(clip: Clip, path: Path) -> None:
    """A clip folder, with all data of the clip."""
    save_clip(clip, path)
