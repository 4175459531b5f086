"""Identity of scored data: the options and clips that must be equal for two scores to be compared."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict

import numpy as np

from dmae.data.clip import Clip

_TOLERANCES = {"joints": 5e-3, "mean": 0.01, "detected": 5e-3, "pixels": 1.0, "score": 5e-3, "offset_px": 0.02}
"""Tolerances for simulated clips, because rounding differs between processors: counts, scores and offsets are relative,
positions are in m and px."""
_RELATIVE = {"joints", "detected", "score", "offset_px"}
_UNDER_TEST = (
    "data", "methods", "poses", "weights", "views", "baseline", "changed", "out", "first", "clips", "shard",
    "workers", "backend", "dry_run",
)  # fmt: skip
"""Options of `dmae evaluate` that may differ: the scored methods, and facts that clips and results contain anyway."""


def scored_options(config) -> dict:
    """Return the options of `dmae evaluate` on which scores depend, by dotted name. The values are JSON-able."""
    options = {name: value for name, value in asdict(config).items() if name not in _UNDER_TEST}
    return dict(_flat(json.loads(json.dumps(options))))


def scored_clip(clip: Clip) -> dict:
    """Return JSON-able facts that identify a clip.

    For a recording this is a checksum. A simulation with the same seed differs in its last digits between machines.
    For a simulated clip the facts are therefore counts and means: the number of `joints` of the truth and their
    `mean` position, m; the number of `detected` joints and the means of their `pixels`, `score` and `offset_px`.
    """
    found = clip.detections
    truth = np.empty((len(clip), 0, 0, 3)) if clip.truth is None else clip.truth.xyz.astype(np.float64)
    facts = {
        "frames": len(clip),
        "fps": clip.fps,
        "cameras": list(clip.rig.names),
        "persons": truth.shape[1],
        "joints": int(np.isfinite(truth).all(-1).sum()),
    }
    if clip.detection_labels is None:
        arrays = (truth, found.xy, found.score, clip.rig.projections, clip.rig.dist)
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays))
        return facts | {"sha256": digest.hexdigest()}
    facts |= {"mean": _means(truth), "detected": int(found.observed.sum())}
    facts |= {"pixels": _means(found.xy.astype(np.float64)), "score": _means(found.score[..., None])[0]}
    offsets = clip.detection_labels.offset_px
    return facts if offsets is None else facts | {"offset_px": _means(np.asarray(offsets, np.float64)[..., None])[0]}


def option_differences(old: dict, new: dict) -> dict[str, str]:
    """Return the options that differ between two scores, by name, each with both values as text."""
    missing = "not an option"
    return {
        name: f"{name}={_text(old.get(name, missing))} in the baseline, {_text(new.get(name, missing))} here"
        for name in sorted({*old, *new})
        if old.get(name, missing) != new.get(name, missing)
    }


def clip_differences(old: dict[str, dict], new: dict[str, dict]) -> list[str]:
    """Return one line for each difference between the clips of two scores; empty if they are equal up to rounding."""
    lines = [f"clip {name!r} is of the baseline alone" for name in old if name not in new]
    lines += [f"clip {name!r} is not of the baseline" for name in new if name not in old]
    for name in old:
        for fact in {**old[name], **new.get(name, {})} if name in new else ():
            pair = old[name].get(fact), new[name].get(fact)
            if not _same(fact, *pair):
                lines.append(f"clip {name!r}: {fact} {_text(pair[0])} in the baseline, {_text(pair[1])} here")
    return lines


def _same(fact: str, old, new) -> bool:
    if fact not in _TOLERANCES or None in (old, new):
        return old == new
    one, other = np.array(old, float), np.array(new, float)
    allowed = _TOLERANCES[fact] * (np.abs(one) if fact in _RELATIVE else 1)
    return one.shape == other.shape and bool((np.abs(one - other) <= allowed).all())


def _means(values: np.ndarray) -> list[float | None]:
    """Return the mean of each column along the last axis; None for a column without numbers."""
    rows = values.reshape(-1, values.shape[-1])
    rows = rows[np.isfinite(rows).all(-1)]
    return [round(float(mean), 5) for mean in rows.mean(0)] if len(rows) else [None] * values.shape[-1]


def _flat(options: dict, prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in options.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _text(value) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
