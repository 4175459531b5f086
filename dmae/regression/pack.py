"""The frozen pack: detections of points in several views, and the true points. Its numbers never change."""

import hashlib
import io
from dataclasses import dataclass, fields
from functools import cache
from importlib import resources

import numpy as np

from dmae.files.contents import write_atomic

_FILE = resources.files("dmae.regression") / "pack.npz"
_SHA256 = "42feb6110e7ad3e8e577e0fbb0602fdb21054738e1c3a4b1081517aa215020a5"


@dataclass(frozen=True, eq=False, repr=False)
class Case:
    """n points seen by V views, with one kind of difficulty.

    Attributes:
        name: Name, unique in the pack.
        K: (V, 3, 3) intrinsics, px.
        dist: (V, 5) or (V, 8) OpenCV distortion k1 k2 p1 p2 k3 [k4 k5 k6], zeros for a pinhole.
        cam_from_world: (V, 4, 4) rigid transforms, m.
        size: (V, 2) image width and height, px.
        xy: (n, V, 2) pixels as detected, distorted; NaN where a view does not see the point.
        confidence: (n, V) in [0, 1], larger is more certain. NaN where `xy` is NaN, and where a view gave pixels
            without a confidence; these pixels do not count.
        xyz: (n, 3) true points, m, world. NaN where no view can have seen the point; a solver must return NaN there.
        usable: (n, V) True for the views with a detection that is not a gross error.
        sigma: Standard deviation of the usable pixels along one axis, px; 0 if they are exact.
    """

    name: str
    K: np.ndarray
    dist: np.ndarray
    cam_from_world: np.ndarray
    size: np.ndarray
    xy: np.ndarray
    confidence: np.ndarray
    xyz: np.ndarray
    usable: np.ndarray
    sigma: float

    def __repr__(self) -> str:
        return f"Case({self.name!r})"

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arguments of a solver, by keyword. They are copies, so the solver may change them."""
        names = ("K", "dist", "cam_from_world", "size", "xy", "confidence")
        return {name: getattr(self, name).copy() for name in names}

    @property
    def due(self) -> np.ndarray:
        """(n,) True for the points that can be determined: two views or more saw them without a gross error."""
        return np.isfinite(self.xyz[:, 0]) & (self.usable.sum(-1) >= 2)

    @property
    def unknowable(self) -> np.ndarray:
        """(n,) True for points that cannot be determined: fewer than two views, or rays that meet behind cameras."""
        seen = np.isfinite(self.xy[..., 0]) & np.isfinite(self.confidence)
        return np.isnan(self.xyz[:, 0]) | (seen.sum(-1) < 2)


@cache
def cases() -> tuple[Case, ...]:
    """Return the cases of the pack, easy ones first.

    Raises:
        ValueError: the file is not the one this version was released with.
    """
    data = _FILE.read_bytes()
    if hashlib.sha256(data).hexdigest() != _SHA256:
        raise ValueError(f"{_FILE}: does not match its checksum; the installation is damaged, install it again")
    return tuple(unpack(data))


def unpack(data: bytes) -> list[Case]:
    """Return the cases in the bytes of a pack."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = dict(file)
    names = list(dict.fromkeys(key.partition("/")[0] for key in arrays))
    found = []
    for name in names:
        values = {field.name: arrays[f"{name}/{field.name}"] for field in fields(Case)[1:]}
        for key in ("xy", "confidence"):
            values[key] = values[key].astype(np.float64)
        found.append(Case(name, **values | {"sigma": float(values["sigma"])}))
    return found


def write_pack(pack: list[Case]) -> str:
    """Replace the file of the pack, and return the checksum to write into this module."""
    arrays = {f"{case.name}/{field.name}": getattr(case, field.name) for case in pack for field in fields(Case)[1:]}
    for key in arrays:
        if key.endswith(("/xy", "/confidence")):
            arrays[key] = arrays[key].astype(np.float32)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_atomic(_FILE, buffer.getvalue())
    return hashlib.sha256(buffer.getvalue()).hexdigest()
