"""Stress: corrupt a clip, and find what breaks methods of completion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from dmae.data.clip import Clip
from dmae.evaluation.corruption import corrupt as corruption
from dmae.public.arguments import checked
from dmae.public.options import composed


@checked
def corrupt(clip: Clip, levels: Mapping[str, float], *, seed: int = 0) -> Clip:
    """Return a clip, simulated or real, with corrupted detections, cameras or frame rate.

    Args:
        clip: V cameras. Its truth does not change, except that frames may be left out.
        levels: Levels of corruptions of `dmae stress` by name, for example `{"objects": 40, "cameras": 2}`, or by
            `module:function`; at level 0 nothing changes.
        seed: Seed of random numbers.

    Returns:
        A clip without images, poses and labels of detections, because these do not fit the new detections.

    Raises:
        ValueError: there is no such corruption or level, or the clip has too few cameras or people for it.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> fewer = dmae.corrupt(clip, {"objects": 40, "cameras": 2})
        >>> len(fewer.rig) == len(clip.rig) - 2
        True
    """
    if not isinstance(levels, Mapping):
        raise TypeError(f"levels: expected levels by name, as {{'objects': 40}}, found {levels!r:.80}")
    return corruption.corrupt(clip, levels, seed=seed)


@checked
def stress(clips: Sequence[Clip], out: str | Path | None = None, *overrides: str) -> dict:
    """Corrupt clips step by step, and score every method at each step.

    Args:
        clips: All with truth, or all without. Without truth, the reference is what all cameras measured in the
            original clips.
        out: Folder of `stress.json`, the page `stress.html` and cached results; None to write nothing.
        overrides: Options as on the command line: `"axes=[objects,jitter]"`, `"methods=[linear,dmae]"`.

    Returns:
        The content of `stress.json`: scores of each method along each axis, and where it breaks
        (`dmae.evaluation.stress.curves.curves`).

    Raises:
        ValueError: clips do not allow a requested axis, or an option is unknown.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> result = dmae.stress([clip], None, "axes=[cameras]", "pairs=[]", "methods=[linear]")
        >>> [point["level"] for point in result["axes"][0]["methods"]["linear"]["points"]]
        [0.0, 1.0, 2.0, 3.0]
    """
    from dmae.evaluation.stress.matrix import CACHE, compute, prepare
    from dmae.evaluation.stress.page import write_result

    matrix = prepare(clips, composed("stress", *overrides), out and Path(out) / CACHE)
    result = compute(matrix)
    if out:
        write_result(result, Path(out))
    return result
