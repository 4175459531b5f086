"""Compiled functions: each is compiled for one kind of arguments, as the first capture on a machine waits for it."""

import importlib
import subprocess
import sys

from dmae.numerics import compiled

CAPTURE_AND_COMPLETE = """
import sys
from numba.core.dispatcher import Dispatcher
import dmae
from tests.support.stressed_clips import strollers

clip = strollers(frames=30)
dmae.complete(dmae.capture(clip), clip.fps)
for name, module in list(sys.modules.items()):
    for function in vars(module).values() if name.startswith("dmae") else ():
        if isinstance(function, Dispatcher) and function.__module__ == name:
            print(len(function.nopython_signatures), name, function.__name__)
"""


def test_capture_and_completion_compile_each_function_once():
    done = subprocess.run([sys.executable, "-c", CAPTURE_AND_COMPLETE], capture_output=True, text=True, check=True)
    found = [line for line in done.stdout.splitlines() if not line.startswith("0 ")]
    assert len(found) > 15
    assert not [line for line in found if not line.startswith("1 ")]


def test_it_is_said_that_functions_were_compiled_anew(tmp_path, monkeypatch):
    (tmp_path / "twofold.py").write_text(
        "from dmae.numerics.compiled import compiled\n\n@compiled()\ndef twice(x):\n    return 2 * x\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    for anew in (True, False):
        monkeypatch.setattr(compiled, "_FUNCTIONS", [])
        sys.modules.pop("twofold", None)
        assert importlib.import_module("twofold").twice(3) == 6
        assert compiled.compiled_anew() == anew
