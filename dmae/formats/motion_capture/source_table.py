"""Tables of the source and the covariance of each joint, for formats that cannot store them."""

from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from dmae.data.clip import Source
from dmae.data.store import write_atomic
from dmae.files.contents import read_text, written
from dmae.files.mapped import frame_blocks

_AXES = ("xx", "xy", "xz", "yy", "yz", "zz")
_ROWS, _COLUMNS = np.triu_indices(3)


def write_source_table(path: Path, names: Sequence[str], source: np.ndarray, first: int = 1) -> None:
    """Write `<name>.source.csv`: measured, denoised, completed or absent, one row per frame, one column per joint.

    Args:
        path: The pose file that the table belongs to.
        names: J names of joints, as in the pose file.
        source: (F, J) `Source`.
        first: Number of the first frame.
    """
    words = [kind.name.lower() for kind in Source]
    rows = (",".join([str(frame), *(words[kind] for kind in row.tolist())]) for frame, row in enumerate(source, first))
    write_atomic(source_table(path), written(chain([",".join(["Frame#", *names])], rows)))


def source_table(path: Path) -> Path:
    """Return the path of the table of sources of a pose file."""
    return Path(path).with_suffix(".source.csv")


def write_covariance_table(path: Path, names: Sequence[str], cov: np.ndarray, first: int = 1) -> None:
    """Write `<name>.covariance.csv`: six columns per joint, xx to zz, in the axes and the squared unit of the file.

    If no covariance is known, no table is written, and a table of earlier poses is removed.

    Args:
        cov: (F, J, 3, 3); NaN where unknown, which becomes an empty cell.
        path, names, first: As in `write_source_table`.
    """
    if all(np.isnan(cov[part]).all() for part in frame_blocks(cov)):
        covariance_table(path).unlink(missing_ok=True)
        return
    header = ",".join(["Frame#", *(f"{name}_{axes}" for name in names for axes in _AXES)])
    rows = (
        ",".join([str(frame), *("" if value != value else f"{value:.6g}" for value in values.tolist())])
        for part in frame_blocks(cov)
        for frame, values in enumerate(
            cov[part][:, :, _ROWS, _COLUMNS].reshape(part.stop - part.start, -1), first + part.start
        )
    )
    write_atomic(covariance_table(path), written(chain([header], rows)))


def read_covariance_table(path: Path, frames: int, joints: int) -> np.ndarray | None:
    """Return the covariances (F, J, 3, 3) that `write_covariance_table` wrote; None if there is no table.

    Args:
        path: The pose file that the table belongs to.
        frames: F, number of frames in the pose file.
        joints: J, number of joints in the pose file.

    Raises:
        ValueError: the table is malformed, or has other numbers of frames or joints.
    """
    table = covariance_table(path)
    if not table.is_file():
        return None
    lines = [line.split(",") for line in read_text(table).splitlines()[1:]]
    if len(lines) != frames or any(len(line) != 1 + len(_AXES) * joints for line in lines):
        raise ValueError(
            f"{table}: expected {frames} frames of {joints} markers as in {path.name}; delete it if it is not its"
        )
    try:
        values = np.array([[float(cell) if cell.strip() else np.nan for cell in line[1:]] for line in lines])
    except ValueError as error:
        raise ValueError(f"{table}: expected numbers, {error}") from None
    cov = np.empty((frames, joints, 3, 3))
    cov[..., _ROWS, _COLUMNS] = cov[..., _COLUMNS, _ROWS] = values.reshape(frames, joints, len(_AXES))
    return cov


def covariance_table(path: Path) -> Path:
    """Return the path of the table of covariances of a pose file."""
    return Path(path).with_suffix(".covariance.csv")


def person_paths(path: Path, persons: int) -> list[Path]:
    """Return one path per person: `<name>_P1.<suffix>` and so on, or only `path` if there is one person."""
    path = Path(path)
    if persons == 1:
        return [path]
    return [path.with_name(f"{path.stem}_P{person + 1}{path.suffix}") for person in range(persons)]
