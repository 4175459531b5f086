"""The two networks of BlazePose, run by LiteRT on one thread."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

MODELS = Path(__file__).parents[2] / "models" / "blazepose"
"""Folder of the networks, which are part of the package."""


class Network:
    """A network of one input: images (S, S, 3) float32.

    Attributes:
        size: S, px.

    Raises:
        ValueError: the runtime `ai-edge-litert` is not installed.
    """

    def __init__(self, name: str):
        try:
            from ai_edge_litert.interpreter import Interpreter
        except ImportError:
            raise ValueError(
                "detector=blazepose needs the package ai-edge-litert, which is not installed: "
                "pip install ai-edge-litert"
            ) from None
        with _quiet():
            self._interpreter = Interpreter(model_path=str(MODELS / f"{name}.tflite"), num_threads=1)
            self._interpreter.allocate_tensors()
        (given,) = self._interpreter.get_input_details()
        self._input, self.size = given["index"], int(given["shape"][1])
        self._outputs = {each["name"]: each["index"] for each in self._interpreter.get_output_details()}

    def __call__(self, picture: np.ndarray, *outputs: str) -> list[np.ndarray]:
        """Return the named outputs for an image (S, S, 3) float32."""
        self._interpreter.set_tensor(self._input, picture[None])
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(self._outputs[name])[0] for name in outputs]


@contextmanager
def _quiet() -> Iterator[None]:
    """Prevent the runtime from writing to the terminal; it bypasses `sys.stderr`."""
    try:
        target = sys.stderr.fileno()
    except (OSError, ValueError, AttributeError):
        yield
        return
    kept = os.dup(target)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        sys.stderr.flush()
        os.dup2(nowhere, target)
        yield
    finally:
        os.dup2(kept, target)
        os.close(kept)
        os.close(nowhere)
