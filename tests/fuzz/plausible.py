"""Find implausible values that a reader accepted: numbers that no camera, person or clip can have."""

from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig

_LARGEST = 1e9
_LARGEST_OF = {"cov": 1e31}
_RATES = {"fps", "rate"}
_UNCHECKED = {"provenance", "options", "seed", "sha256"}
"""What is kept as it was written, for people to read, and numbers that mean nothing by their size."""


def nonsense(value, name: str = "", *, finite: bool = False) -> str | None:
    """Return what is implausible in a value that a reader returned, with its place; None for nothing.

    Args:
        finite: Whether NaN, which marks absence in clips and poses, is implausible too.
    """
    if isinstance(value, CameraRig):
        return _of_rig(value, name)
    if is_dataclass(value):
        return _first(nonsense(getattr(value, f.name), f"{name}.{f.name}", finite=finite) for f in fields(value)
                       if f.name not in _UNCHECKED)  # fmt: skip
    if isinstance(value, dict):
        return _first(nonsense(item, f"{name}.{key}", finite=finite) for key, item in value.items()
                      if key not in _UNCHECKED)  # fmt: skip
    if isinstance(value, list | tuple):
        return _first(nonsense(item, f"{name}[{place}]", finite=finite) for place, item in enumerate(value))
    if isinstance(value, str | bytes | bool | Path | type(None)):
        return None
    if hasattr(value, "detach"):
        value = value.detach().numpy()
    if isinstance(value, int | float | np.ndarray | np.number):
        array = np.asarray(value)
        if array.dtype.kind not in "fiu":
            return None
        with np.errstate(invalid="ignore"):
            most = _LARGEST_OF.get(name.rpartition(".")[2], _LARGEST)
            wrong = (np.abs(array.astype(np.float64)) > most) | (finite & np.isnan(array))
        if wrong.any():
            return f"{name}: {array[wrong].flat[0] if array.ndim else array}"
        if name.rpartition(".")[2] in _RATES and not 1e-3 <= float(array) <= 1e5:
            return f"{name}: a rate of {array}"
    return None


def _of_rig(rig: CameraRig, name: str) -> str | None:
    focal = rig.K[:, [0, 1], [0, 1]]
    if not ((focal > 1e-2) & (focal < 1e7)).all():
        return f"{name}.K: focal lengths {focal.tolist()}"
    for field, most in (("K", 1e7), ("dist", 1e5), ("cam_from_world", 1e8), ("size", 1e6)):
        array = getattr(rig, field)
        if not (np.abs(array) <= most).all():
            return f"{name}.{field}: {array.tolist()}"
    return None


def _first(found) -> str | None:
    return next((what for what in found if what), None)
