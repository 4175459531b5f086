"""DeepLabCut: detections in the video of each camera, CSV or HDF5, of one animal or of several."""

from pathlib import Path

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.files.contents import read_text
from dmae.files.hdf5 import Hdf5, open_hdf5
from dmae.files.pickles import pickled_values
from dmae.formats.recordings import NumberedDetections, by_name, csv_rows
from dmae.formats.registry import reader
from dmae.formats.skeletons import NamedDetections, named_detections

_KEY = "df_with_missing"
_WHAT = "detections of DeepLabCut"
_HEADS = ["scorer", "individuals", "bodyparts", "coords"]
_COORDS = ("x", "y", "likelihood")

Labels = list[tuple[str, ...]]
"""Labels of the columns of a table: individual, unless there is only one, body part and coordinate of each column."""


@reader("deeplabcut", signs=[["*DLC*.h5"], ["*DLC*.csv"]], cameras=False)
def read_detections(path: Path, *, skeleton: Skeleton | None = None) -> NumberedDetections:
    """DeepLabCut's <camera>DLC_<network>.h5 or .csv of each camera, with a calibration of any format.

    If a camera has both, the .h5 file is read. A joint without coordinates is absent; an animal without joints also.

    Args:
        skeleton: By default one for the names of the joints, see `dmae.formats.skeletons.named_skeleton`.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is malformed, a camera has several files with the same suffix, or other joints.
    """
    return named_detections(_files(Path(path)), _read, skeleton)


def _read(file: Path) -> NamedDetections:
    labels, index, values = _read_table(file) if file.suffix == ".h5" else _read_csv(file)
    fine = index.ndim == 1 and index.dtype.kind in "fiu" and np.isfinite(index).all()
    if not fine or not len(index) or ((index < 0) | (index > 1e9) | (index != np.round(index))).any():
        raise ValueError(f"{file}: expected a row for each frame, by its number")
    if len(np.unique(index)) < len(index):
        raise ValueError(f"{file}: expected frames of different numbers")
    # Files of a single animal name no individual.
    names, people = _arranged(file, [("", *label) if len(label) == 2 else label for label in labels], values)
    return NamedDetections(names, people, index)


def _files(path: Path) -> dict[str, Path]:
    if path.is_file():
        raise ValueError(f"{path}: expected a folder with a file for each camera, found a file")
    found: dict[str, Path] = {}
    for suffix in (".h5", ".csv"):
        for file in by_name(path.glob(f"*DLC*{suffix}")):
            camera = file.stem.partition("DLC")[0].rstrip("_- ") or file.stem
            there = found.setdefault(camera, file)
            if there != file and there.suffix == suffix:
                raise ValueError(
                    f"{path}: expected one file for camera {camera!r}, found {there.name} and {file.name}; move one "
                    "of them away"
                )
    if not found:
        raise FileNotFoundError(f"{path}: expected <camera>DLC_<network>.h5 or .csv, found none")
    return found


def _read_csv(file: Path) -> tuple[Labels, np.ndarray, np.ndarray]:
    """Return labels of the columns, the index (F,) and values (F, columns)."""
    lines = [line.split(",") for line in read_text(file).splitlines() if line.strip()]
    heads = []
    while len(heads) < len(lines) and lines[len(heads)][0] in _HEADS:
        heads.append(lines[len(heads)])
    columns = len(heads[0]) if heads else 0
    if [head[0] for head in heads] not in (_HEADS, [_HEADS[0], *_HEADS[2:]]) or any(
        len(head) != columns for head in heads
    ):
        raise ValueError(f"{file}: expected {_WHAT}, lines of {', '.join(_HEADS)}, found {lines[:1]!s:.80}")
    rows = csv_rows(file, lines[len(heads) :], columns, len(heads) + 1)
    labels = list(zip(*(head[1:] for head in heads[1:]), strict=True))
    return labels, rows[:, 0], rows[:, 1:]


def _read_table(file: Path) -> tuple[Labels, np.ndarray, np.ndarray]:
    """Return the same as `_read_csv`, from an HDF5 file that pandas wrote in either of its two formats."""
    with open_hdf5(file, _WHAT) as table:
        if f"{_KEY}/table" in table:
            rows = table.array(f"{_KEY}/table")
            if not {"index", "values_block_0"} <= set(rows.dtype.names or ()) or rows.ndim != 1:
                raise ValueError(f"{file}: expected {_WHAT}, found the columns {rows.dtype.names}")
            labels, index, values = _pickled_labels(file, table), rows["index"], rows["values_block_0"]
        else:
            labels = _stored_labels(file, table)
            index, values = table.array(f"{_KEY}/axis1"), table.array(f"{_KEY}/block0_values")
    if values.ndim != 2 or values.shape != (len(index), len(labels)) or values.dtype.kind not in "fiu":
        raise ValueError(f"{file}: expected {_WHAT}, {len(labels)} numbers a frame, found shape {values.shape}")
    return labels, index, values.astype(np.float64)


def _pickled_labels(file: Path, table: Hdf5) -> Labels:
    """Return the labels of the columns in pandas' `table` format, which stores them as a pickle. No code is run."""
    pickle = table.attribute("non_index_axes", _KEY)
    try:
        ((_, labels),) = pickled_values(pickle.encode() if isinstance(pickle, str) else b"")
        labels = [tuple(label[1:]) for label in labels]
    except (ValueError, TypeError) as error:
        raise ValueError(f"{file}: expected {_WHAT}; its labels cannot be read, {error}") from None
    return labels


def _stored_labels(file: Path, table: Hdf5) -> Labels:
    """Return the labels of the columns in pandas' `fixed` format, which stores levels and indices into the levels."""
    parts = []
    for level in range(1, 4 if f"{_KEY}/block0_items_level3" in table else 3):
        names = table.texts(f"{_KEY}/block0_items_level{level}")
        index = table.array(f"{_KEY}/block0_items_label{level}")
        if index.ndim != 1 or index.dtype.kind not in "iu" or not ((index >= 0) & (index < len(names))).all():
            raise ValueError(f"{file}: expected {_WHAT}; labels of its columns are damaged")
        parts.append([names[number] for number in index])
    if len({len(part) for part in parts}) > 1:
        raise ValueError(f"{file}: expected {_WHAT}; labels of its columns are damaged")
    return list(zip(*parts, strict=True))


def _arranged(file: Path, labels: Labels, values: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Return the names of J joints, and the animals (F, D, J, 3): x, y in px and likelihood; NaN where absent."""
    wrong = [label for label in labels if len(label) != 3 or not all(isinstance(part, str) for part in label)]
    if wrong or not labels or any(label[2] not in _COORDS for label in labels):
        raise ValueError(f"{file}: expected columns x, y and likelihood of each joint, found {(wrong or labels)[:4]}")
    if len(set(labels)) < len(labels) or {label[2] for label in labels} != set(_COORDS):
        raise ValueError(f"{file}: expected x, y and likelihood of each joint once; labels of images have no "
                         "likelihood, analyse the videos instead")  # fmt: skip
    animals, names = (list(dict.fromkeys(label[level] for label in labels)) for level in (0, 1))
    if len(values) * len(animals) * len(names) > 100 * values.size:
        raise ValueError(f"{file}: expected the same joints of each animal")
    found = np.full((len(values), len(animals), len(names), 3), np.nan)
    which, at = ({name: number for number, name in enumerate(part)} for part in (animals, names))
    for (animal, name, coordinate), column in zip(labels, values.T, strict=True):
        found[:, which[animal], at[name], _COORDS.index(coordinate)] = column
    return names, found
