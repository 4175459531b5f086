"""The frozen pack: detections of points in several views, and the true points. Its numbers never change.

`docs/tools/regression_pack.py` made it. Results on a new pack cannot be compared with older ones; announce it to the
projects that use it.
"""

import hashlib
import io
from dataclasses import dataclass, fields
from functools import cache
from importlib import resources

import numpy as np

FILE = resources.files("dmae.regression") / "pack.npz"
_SHA256 = "42feb6110e7ad3e8e577e0fbb0602fdb21054738e1c3a4b1081517aa215020a5"


@dataclass(frozen=True, eq=False, repr=False)
class Case:
    """n points seen by V views, with one kind of difficulty."""

    name: str  # Name, unique in the pack
    K: np.ndarray  # (V, 3, 3) intrinsics, px
    dist: np.ndarray  # (V, 5) or (V, 8) OpenCV distortion k1 k2 p1 p2 k3 [k4 k5 k6], zeros for a pinhole
    cam_from_world: np.ndarray  # (V, 4, 4) rigid transforms, m
    size: np.ndarray  # (V, 2) image width and height, px
    xy: np.ndarray  # (n, V, 2) pixels as detected, distorted; NaN where a view does not see the point
    # (n, V) in [0, 1], larger is more certain. NaN where `xy` is NaN, and where a view gave pixels without a
    # confidence; these pixels do not count.
    confidence: np.ndarray
    # (n, 3) true points, m, world. NaN where no view can have seen the point; a solver must return NaN there.
    xyz: np.ndarray
    usable: np.ndarray  # (n, V) True for the views with a detection that is not a gross error
    sigma: float  # Standard deviation of the usable pixels along one axis, px; 0 if they are exact

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
    """Return the cases of the pack, easy ones first; ValueError if the file is not the one of this version."""
    data = FILE.read_bytes()
    if hashlib.sha256(data).hexdigest() != _SHA256:
        raise ValueError(f"{FILE}: does not match its checksum; the installation is damaged, install it again")
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
