"""Contenders of a stress test: each is a capture and a completion method, from detections to completed poses."""

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import yaml

from dmae.completion.methods.registry import find_method
from dmae.data.clip import Poses3D
from dmae.data.json_values import decode
from dmae.data.resources import resource_folder
from dmae.evaluation.stress.config import PAPER, StressConfig
from dmae.reconstruction.config import CaptureConfig

_SHIPPED = Path(__file__).parents[2] / "models"


@dataclass(frozen=True)
class Contender:
    """A capture, and the completion method that fills the joints that it did not measure.

    Attributes:
        name: Name in the results.
        about: Description in words.
        capture: Configuration of the capture.
        method: Completion method, or `module:function`.
        weights: Folder of the weights of a learned method; None for those that come with the package.
    """

    name: str
    about: str
    capture: CaptureConfig
    method: str
    weights: str | None

    @property
    def fill(self) -> Callable[[Poses3D, float], Poses3D]:
        """The function that fills poses. Its arguments are the poses and the frames per second."""
        return _filling(self.method, self.weights)

    @property
    def settings(self) -> dict:
        """All settings on which its results depend, JSON-able."""
        return _settings(self)


def contenders(config: StressConfig) -> list[Contender]:
    """Return the contenders of a configuration.

    Raises:
        ValueError: a method does not exist.
        FileNotFoundError: the weights do not exist.
    """
    found = []
    for name in dict.fromkeys(config.methods):
        if name == PAPER:
            found.append(_paper(config))
            continue
        method = find_method(name)
        weights = config.weights if method.learned else None
        found.append(Contender(name, method.help, config.capture, name, weights))
    for each in found:
        if each.weights and not (Path(each.weights) / "model.json").is_file():
            raise FileNotFoundError(f"{each.weights}: expected a folder that `dmae train` wrote, holding model.json")
    return found


def source_hash(name: str) -> str | None:
    """Return a hash of the module of `module:function`; None for the project's own methods."""
    module, colon, _ = name.partition(":")
    spec = find_spec(module) if colon else None
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest() if spec and spec.origin else None


def _paper(config: StressConfig) -> Contender:
    options = yaml.safe_load((resource_folder("dmae", "configs") / "capture/paper.yaml").read_text())
    if config.paper_weights:
        about, method = f"Captured with the paper's thresholds, completed by {config.paper_weights}.", "dmae"
    else:
        about, method = (
            "Captured with the paper's thresholds, filled linearly: no weights of its network given.",
            "linear",
        )
    return Contender(PAPER, about, decode(CaptureConfig, options), method, config.paper_weights)


@cache
def _filling(method: str, weights: str | None) -> Callable[[Poses3D, float], Poses3D]:
    return find_method(method).load(Path(weights) if weights else None)


@cache
def _settings(contender: Contender) -> dict:
    method = contender.method
    settings = {"capture": asdict(contender.capture), "method": method, "file": source_hash(method)}
    if find_method(method).learned:
        settings["weights"] = _hash_of_weights(contender.weights)
    return settings


def _hash_of_weights(folder: str | None) -> str:
    """Return a hash of the descriptions of the weights, which contain the checksums of the weights."""
    files = [Path(folder) / "model.json"] if folder else sorted(_SHIPPED.glob("*/model.json"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
