"""Parts of work on a data set, made on several machines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def merge(
    parts: Sequence[str | Path], out: str | Path, *, partial: bool = False, clips: str | Path | None = None
) -> None:
    """Join what `dmae capture`, `evaluate` or `stress` made of parts of a data set.

        dmae.merge(["captured/1", "captured/2"], "runs/captured")

    Args:
        parts: Folders of the parts, in any order.
        out: Folder to write; it does not exist yet, or is empty.
        partial: Whether clips may be missing.
        clips: Of stress tests, folder of the data set, where it is not where the first part found it.

    Raises:
        FileNotFoundError: a folder holds no part.
        ValueError: parts are of other commands, options or data, or damaged; a clip is in two of them; clips are
            missing.

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
