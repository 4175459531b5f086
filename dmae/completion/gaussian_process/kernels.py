"""Kernels: the learned similarity of two poses of a person for one joint; and their file."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path

import numpy as np

from dmae.files.structured import read_json

FORMAT = 1
SHIPPED = Path(__file__).parents[2] / "models" / "gaussian_process" / "kernels.json"

PARAMETERS = (
    "wide", "wide_width", "time", "time_scale", "both", "both_width", "both_time_scale", "noise", "tolerance",
)  # fmt: skip
"""Parameters of a kernel in addition to the weights of joints, all positive, see `covariance` and `noise_of`."""


class Exactness(StrEnum):
    """The poses that a kernel was learned on."""

    exact = "exact"
    """True poses."""
    noisy = "noisy"
    """Perturbed and captured poses."""


@dataclass(frozen=True)
class Kernel:
    """What was learned for the joints of a limb that hang, hidden, from one joint, or for a joint of the torso.

    Attributes:
        anchor: Name of the joint from which they hang, of the left side or the middle; for a joint of the torso
            `neck-l_hip`, of the joint that it is placed from and its own.
        exactness: The poses that it is for.
        weights: 1/m; how much the offset of each joint from its parent counts in the distance between poses.
        parameters: One for each of `PARAMETERS`.
    """

    anchor: str
    exactness: Exactness
    weights: dict[str, float]
    parameters: dict[str, float]


@dataclass(frozen=True)
class KernelSet:
    """All kernels, and the bones by which people are brought to one size.

    Attributes:
        kernels: By anchor and exactness.
        bones: m; usual lengths of bones, by `parent-joint`.
        recipe: How the kernels were made.
    """

    kernels: dict[tuple[str, Exactness], Kernel]
    bones: dict[str, float]
    recipe: dict

    def save(self, path: Path) -> None:
        """Write the kernels as JSON."""
        rounded = [_rounded(asdict(kernel)) for kernel in self.kernels.values()]
        content = {"format": FORMAT, "recipe": self.recipe, "bones": _rounded(self.bones), "kernels": rounded}
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content, indent=1) + "\n")


def load_kernels(path: Path) -> KernelSet:
    """Read the kernels that `KernelSet.save` wrote.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is not of this format.
    """
    content = read_json(path)
    try:
        if content["format"] != FORMAT:
            raise ValueError(f"expected format {FORMAT}, found {content['format']!r}")
        kernels = [Kernel(**kernel) for kernel in content["kernels"]]
        for kernel in kernels:
            _check(kernel)
        return KernelSet({(k.anchor, Exactness(k.exactness)): k for k in kernels}, content["bones"], content["recipe"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: not a file of kernels of this version of dmae: {error}") from None


@cache
def shipped_kernels() -> KernelSet:
    """Return the kernels that come with the package."""
    return load_kernels(SHIPPED)


def covariance(
    squared: np.ndarray, seconds: np.ndarray, parameters: dict[str, float], exp: Callable = np.exp
) -> np.ndarray:
    """Return the covariance (...) of poses at a weighted squared distance and a distance in time, s.

    It is the sum of a squared exponential of the distance, a wider one, a Matern kernel (nu = 5/2) of the time between
    poses, and a product of the two kinds; Rasmussen & Williams 2006, (4.9) and (4.17). Works on tensors with their
    `exp`.

    Args:
        squared: (...) squared distance.
        seconds: (...) s, not negative.
        parameters: Of the kernel.
    """
    p = parameters
    return (
        exp(-squared / 2)
        + p["wide"] * exp(-squared / (2 * p["wide_width"] ** 2))
        + p["time"] * _matern(seconds / p["time_scale"], exp)
        + p["both"] * exp(-squared / (2 * p["both_width"] ** 2)) * _matern(seconds / p["both_time_scale"], exp)
    )


def noise_of(residuals: np.ndarray, scale: np.ndarray, parameters: dict[str, float]) -> np.ndarray:
    """Return the variance of the noise of each training pose, in the unit of `covariance`.

    Poses that the others contradict are noisier, as by the weights of Student's t.

    Args:
        residuals: (...) squared distance of each training pose from what the others predict, and `scale`, their usual
            squared distance.
    """
    return parameters["noise"] * (1 + residuals / (parameters["tolerance"] * scale))


def _matern(distance: np.ndarray, exp: Callable) -> np.ndarray:
    scaled = 5**0.5 * distance
    return (1 + scaled + scaled**2 / 3) * exp(-scaled)


def _check(kernel: Kernel) -> None:
    numbers = [*kernel.weights.values(), *(kernel.parameters[name] for name in PARAMETERS)]
    if not (np.isfinite(numbers).all() and min(kernel.parameters.values()) > 0):
        raise ValueError(f"the numbers of {kernel.anchor!r} must be finite, and its parameters positive")


def _rounded(values):
    if isinstance(values, dict):
        return {name: _rounded(value) for name, value in values.items()}
    return float(f"{values:.5g}") if isinstance(values, float) else values
