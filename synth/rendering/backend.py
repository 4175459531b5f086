"""Find an OpenGL backend that works without a screen."""

import functools
import os
import subprocess
import sys
import warnings
from pathlib import Path

_OFF = ("disable", "disabled", "off", "false", "0")
_PROBE_SECONDS = 60


@functools.cache
def find_backend() -> str | None:
    """Return the OpenGL backend that works without a screen: `egl`, `osmesa` or the value of MUJOCO_GL; None for none.

    Each candidate is tried in a separate process, because a broken OpenGL may abort. The result is stored in MUJOCO_GL
    for MuJoCo and for later processes. Warns once if there is none.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked in _OFF:
        return None
    candidates = (asked,) if asked else ("egl", "osmesa")
    for backend in candidates:
        if _works(backend):
            os.environ["MUJOCO_GL"] = backend
            return backend
    os.environ["MUJOCO_GL"] = "disable"
    warnings.warn(
        f"no OpenGL works here (tried {', '.join(candidates)}); images are ray cast instead, which is slower and "
        "plainer. On Debian or Ubuntu: apt-get install libegl1 libgl1 libosmesa6",
        stacklevel=2,
    )
    return None


def _works(backend: str) -> bool:
    code = f"from synth.rendering.backend import make_context; make_context({backend!r}, 16, 16).free()"
    environment = os.environ | {
        "MUJOCO_GL": backend,
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]),
    }
    try:
        outcome = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, timeout=_PROBE_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return outcome.returncode == 0


def make_context(backend: str, width: int, height: int):
    """Return a current OpenGL context. `mujoco.Renderer` cannot be used: it is bound to the backend at import time."""
    if backend == "egl":
        from mujoco.egl import GLContext
    elif backend == "osmesa":
        from mujoco.osmesa import GLContext
    else:
        from mujoco.glfw import GLContext
    context = GLContext(width, height)
    context.make_current()
    return context
