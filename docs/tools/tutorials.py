"""Tutorials: the scripts of `examples/`, executed, with their printed output and figures.

The output is stored in `docs/tutorials/executed/` with a checksum of the script, so that `docs/tools/pages.py` writes
the pages without the recordings and the minutes that some scripts need. `python docs/tools/tutorials.py` executes the
scripts that have changed since.
"""

import ast
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
EXECUTED = ROOT / "docs/tutorials/executed"

TITLES = {
    "clip_from_arrays": "A clip from your own arrays",
    "pose2sim_recording": "A Pose2Sim recording to completed 3D",
    "gait_cycles": "Heel strikes and gait cycles",
    "dataset_and_model": "A data set, and a model trained on it",
    "train_a_detector": "A detector that learns from simulated images",
    "triangulation_check": "Your triangulation under pytest",
    "benchmark_method": "Your method on the benchmark",
    "frames_as_they_come": "Frames as they come",
    "custom_detector_error": "A detector error of your own",
}


def names() -> list[str]:
    """Return the names of the tutorials in reading order."""
    return [name for name in TITLES if (EXAMPLES / f"{name}.py").is_file()]


def checksum(name: str) -> str:
    return hashlib.sha256((EXAMPLES / f"{name}.py").read_bytes()).hexdigest()


def executed(name: str) -> dict | None:
    """Return the stored output of a script; None if the script changed since or was never executed."""
    path = EXECUTED / f"{name}.json"
    kept = json.loads(path.read_text()) if path.is_file() else {}
    return kept if kept.get("sha256") == checksum(name) else None


def execute(name: str) -> None:
    """Run a script and store its printed output and figures.

    Raises:
        CalledProcessError: the script failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "ignore"}
        command = [sys.executable, str(EXAMPLES / f"{name}.py"), folder]
        before = os.times()
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=folder, env=environment)
        after = os.times()
        image = Path(folder, f"{name}.png").read_bytes()
    EXECUTED.mkdir(parents=True, exist_ok=True)
    (EXECUTED / f"{name}.png").write_bytes(image)
    # Other programs that run at the same time lengthen this less than the time until the end.
    cpu_s = round(sum(after[2:4]) - sum(before[2:4]))
    kept = {"sha256": checksum(name), "date": date.today().isoformat(), "cpu_s": cpu_s, "printed": done.stdout}
    (EXECUTED / f"{name}.json").write_text(json.dumps(kept, indent=1) + "\n")


def page(name: str) -> str:
    """The page of a tutorial.

    Raises:
        ValueError: the script was not executed since it changed.
    """
    kept = executed(name)
    if kept is None:
        raise ValueError(f"examples/{name}.py changed since it was executed; run python docs/tools/tutorials.py")
    source = (EXAMPLES / f"{name}.py").read_text()
    introduction = ast.get_docstring(ast.parse(source))
    first, _, rest = introduction.partition("\n\n")
    code = source[source.index('"""', 3) + 3 :].strip()
    return f"""# {TITLES[name]}

{first}

{rest}

![What the script draws](executed/{name}.png)

```python title="examples/{name}.py"
{code}
```

It prints, after {kept["cpu_s"]} s of processor time:

```text
{kept["printed"].strip()}
```
"""


if __name__ == "__main__":
    for name in sys.argv[1:] or [name for name in names() if executed(name) is None]:
        print(f"examples/{name}.py", flush=True)
        execute(name)
