"""Read predictions made elsewhere, and check that they fit their clip."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.formats.poses import pose_paths, read_poses
from dmae.numerics.body import bone_lengths
from dmae.numerics.statistics import mean_known
from dmae.reporting.tables import listed

_LARGER = 2.5  # If people are larger or smaller than the true people by this factor, the poses are in another unit
_UNITS = {1000: "mm", 100: "cm", 39.37: "inches", 3.281: "feet", 0.001: "km"}  # Units, as factors from metres


def predictions_of(path: Path, clips: Sequence[str]) -> dict[str, Path]:
    """Return the path of the poses of each clip: poses of one clip, or a folder with poses named after their clips.

    Raises FileNotFoundError if there are no poses at the path, and ValueError if the ids of clips and poses differ.
    """
    found = pose_paths(path)
    if found is None:
        if len(clips) > 1:
            raise ValueError(
                f"poses={path}: expected poses of the {len(clips)} clips {listed(clips, 5)}, found poses of one clip; "
                f"give a folder that holds {clips[0]}.npz and so on"
            )
        return {clips[0]: Path(path)}
    lacking, spare = [name for name in clips if name not in found], [name for name in found if name not in clips]
    if lacking or spare:
        raise ValueError(
            f"poses={path}: expected poses of the clips {listed(clips, 5)}, found {listed(list(found), 5)}; "
            f"without poses: {listed(lacking, 5) or 'none'}; of no clip: {listed(spare, 5) or 'none'}"
        )
    return found


def read_prediction(path: Path, clip: Clip, truth: Poses3D, *, tracks: bool = False) -> Poses3D:
    """Return the poses of a clip, read from a file and converted to the skeleton of its truth; see `fitting`.

    Raises FileNotFoundError, or ValueError if the poses are malformed, or do not fit the clip: another clip, frame
    rate, length, skeleton, unit or number of persons.
    """
    found = read_poses(path)
    recorded = clip.provenance.get("recorded_as")
    if found.clip not in (None, clip.id, recorded):
        # In a data set, the name of the folder says whose poses it holds. Another id is accepted if no clip has it.
        named, another = path.name == clip.id, path.parent / found.clip
        what = f"{path}: expected poses of clip {recorded or clip.id!r}, found poses of clip {found.clip!r}"
        if not named:
            raise ValueError(
                f"{what}; if both clips are one recording, write the poses with dmae export clip={path} format=npz, "
                "and score that file"
            )
        if recorded or another.is_dir():
            raise ValueError(f"{what}; name each folder as its clip, or correct the id in {path / 'clip.json'}")
    if found.fps is not None and not np.isclose(found.fps, clip.fps, rtol=1e-3):
        raise ValueError(
            f"{path}: expected {clip.fps:g} frames a second as in clip {clip.id!r}, found {found.fps:g}; resample them"
        )
    return fitting(found.poses, truth, f"{path}: clip {clip.id!r}", tracks=tracks)


def fitting(poses: Poses3D, truth: Poses3D, where: str, *, tracks: bool = False) -> Poses3D:
    """Return poses (F, P, K, 3) m converted to the skeleton of the truth (F, T, J, 3) m that they are compared with.

    With `tracks`, person i of the poses has to be true person i. Raises ValueError, which names the poses by `where`,
    if they differ from the truth in length, unit or (with `tracks`) persons, or skeletons do not convert.
    """
    frames, persons = truth.xyz.shape[:2]
    if len(poses.xyz) != frames:
        raise ValueError(f"{where}: expected {frames} frames of poses as of truth, found {len(poses.xyz)}")
    if tracks and poses.xyz.shape[1] != persons:
        raise ValueError(
            f"{where}: expected {persons} persons, each of the index of the true one, found {poses.xyz.shape[1]}"
        )
    if np.isinf(poses.xyz).any():
        raise ValueError(f"{where}: poses have infinite coordinates; joints that are not known must be NaN")
    try:
        converted = convert(poses, truth.skeleton)
    except KeyError as error:
        raise ValueError(f"{where}: {error.args[0]}") from None
    _check_unit(converted, truth, where)
    return converted


def _check_unit(poses: Poses3D, truth: Poses3D, where: str) -> None:
    """Raise ValueError if the unit differs from metres. Compare bone lengths, which do not depend on the position."""
    ours, true = (mean_known(bone_lengths(each.xyz, truth.skeleton.bones), (0, 1)) for each in (poses, truth))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = ours / true
    ratios = ratios[np.isfinite(ratios)]
    if not len(ratios):
        return
    factor = float(np.median(ratios))
    if 1 / _LARGER < factor < _LARGER:
        return
    if not factor:
        raise ValueError(f"{where}: expected poses, found joints at one place; joints that are not known must be NaN")
    near = min(_UNITS, key=lambda unit: abs(np.log(factor / unit)))
    unit = f", as if in {_UNITS[near]}" if abs(np.log(factor / near)) < np.log(1.3) else ""
    raise ValueError(
        f"{where}: expected poses in m; their bones are {factor:.4g} times as long as the true ones{unit}. "
        f"Divide the coordinates by {near if unit else factor:.4g}, unless it is the truth that is not in m"
    )
