"""Join parts of work on a data set that several machines did."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def merge(
    parts: Sequence[str | Path], out: str | Path, *, partial: bool = False, clips: str | Path | None = None
) -> None:
    """Join the results of `dmae capture`, `evaluate` or `stress` for parts of a data set.

        dmae.merge(["captured/1", "captured/2"], "runs/captured")

    Args:
        parts: Folders of the parts, in any order.
        out: Folder to write, new or empty.
        partial: Whether clips may be missing.
        clips: For stress tests: folder of the data set, if it is no longer where the first part read it.

    Raises:
        FileNotFoundError: a folder contains no part.
        ValueError: parts belong to different commands, options or data, or are damaged; a clip is in two of them;
            clips are missing.

    Examples:
        >>> import subprocess, sys
        >>> for clip in synth.generate("scene.seconds=0.4", clips=2, seed=7, out="walks"): pass
        >>> for part in ("1/2", "2/2"):
        ...     line = [sys.executable, "-m", "dmae", "capture", "data=walks", f"shard={part}", f"out=parts/{part[0]}"]
        ...     done = subprocess.run(line, check=True, capture_output=True)
        >>> dmae.merge(["parts/1", "parts/2"], "captured")
        >>> len(dmae.load_dataset("captured"))
        2
    """
    from dmae.commands.merge import join_parts

    join_parts([Path(part) for part in parts], Path(out), partial=partial, clips=None if clips is None else str(clips))
