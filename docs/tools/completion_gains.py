"""Compare completion with the Gaussian process, by length of gap and body part: `docs/results/completion_gains.json`.

    python docs/tools/completion_gains.py CAPTURED... [--out FILE]     # data sets with truth that `dmae capture` wrote

`make gains` generates the data sets, with subjects that are in no training data, and runs this script. Changes are of
the mean errors of unmeasured joints. Intervals contain 90 % of a bootstrap over the people of clips.
"""

import argparse
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot
from provenance import measured

from dmae.completion.complete import completers
from dmae.completion.gaussian_process import place_limbs
from dmae.completion.methods import find_method
from dmae.completion.training_data import pose_pair
from dmae.data.clip import Poses3D
from dmae.data.json_values import json_text
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip
from dmae.evaluation.benchmark.holes import PARTS, part_of
from dmae.evaluation.synthetic_gaps import cut_gaps, perturb
from dmae.metrics.position import GAPS, in_region
from dmae.numerics.body import interpolate_bodies
from dmae.numerics.filling import take_estimate
from dmae.numerics.paths import gap_lengths, pchip
from dmae.progress import progress

FILE = Path(__file__).parents[1] / "results/completion_gains.json"
FPS = 25.0
KINDS = {"true": "true poses", "perturbed": "perturbed poses", "captured": "captured poses"}
REFERENCE = "one kernel"
"""The Gaussian process of limbs in noisy poses; `gaussian_process` differs from it where poses are exact."""
_RESAMPLED = 1000
_FEWEST = 50
"""Smallest number of unmeasured joints of a row."""
_PART = np.array([list(PARTS)[part_of(joint)] for joint in BODY25.joints])

Errors = dict[str, dict[tuple[str, str, str], list[tuple[float, int]]]]
Regions = dict[tuple[str, str], np.ndarray]


def methods() -> dict[str, Callable[[Poses3D, float], Poses3D]]:
    """Return the compared functions: filling methods, and `dmae.complete` by default."""
    plain = {
        "pchip_body": find_method("pchip_body").load(),
        REFERENCE: _one_kernel,
        "gaussian_process": find_method("gaussian_process").load(),
    }
    return plain | {"complete": completers(None)(BODY25)}


def _one_kernel(poses: Poses3D, fps: float) -> Poses3D:
    bodies = interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    place_limbs(bodies, fps)
    return take_estimate(poses, fps, bodies.filled)


def trials(folders: list[Path]) -> Iterator[tuple[str, Poses3D, Poses3D]]:
    """Yield kinds of poses, poses with gaps, and their truth."""
    pairs = [pose_pair(load_clip(clip), BODY25, FPS) for folder in folders for clip in clip_folders(folder)]
    pairs = [pair for pair in pairs if not np.isnan(pair.truth.xyz).all()]
    for number, pair in enumerate(progress(pairs, "completing")):
        rng = np.random.default_rng(number)
        given = cut_gaps(pair.truth, FPS, rng=rng)
        yield "true", given, pair.truth
        yield "perturbed", perturb(given, FPS, rng=rng), pair.truth
        if pair.captured is not None:
            yield "captured", pair.captured, pair.truth


def measure(folders: list[Path]) -> tuple[Errors, Regions]:
    """Return what is measured on all clips.

    Sums of errors, mm, and numbers of unmeasured joints for each person, by method, kind, length and part; and numbers
    of completed joints inside their stated regions, and of all with a region, by kind and length.
    """
    found: Errors = defaultdict(lambda: defaultdict(list))
    regions: Regions = defaultdict(lambda: np.zeros(2, int))
    fills = methods()
    for kind, given, truth in trials(folders):
        hidden = ~given.measured
        lengths = gap_lengths(given.measured)
        filled = {name: fill(given, FPS) for name, fill in fills.items()}
        done = {name: poses.xyz for name, poses in filled.items()}
        inside = in_region(filled["complete"].xyz - truth.xyz.astype(np.float64), filled["complete"].cov)
        counted = hidden & ~np.isnan(truth.xyz).any(-1)
        for xyz in done.values():
            counted &= ~np.isnan(xyz).any(-1)
        for low, high in GAPS:
            judged = inside[(lengths >= low) & (lengths <= (high or np.inf)) & hidden & ~np.isnan(inside)]
            regions[kind, _words(low, high)] += [int(judged.sum()), len(judged)]
        for name, xyz in done.items():
            error = 1000 * np.linalg.norm(xyz - truth.xyz.astype(np.float64), axis=-1)
            for low, high in GAPS:
                within = counted & (lengths >= low) & (lengths <= (high or np.inf))
                for part in PARTS:
                    for person in range(hidden.shape[1]):
                        where = within[:, person] & (part == _PART)
                        sums = float(error[:, person][where].sum()), int(where.sum())
                        found[name][kind, _words(low, high), part].append(sums)
    return found, regions


def table(found: Errors, kind: str) -> dict:
    """Return the rows of one kind of poses."""
    rows = []
    for length in (_words(*gap) for gap in GAPS):
        for part in ("all", *PARTS):
            parts = list(PARTS) if part == "all" else [part]
            sums = {name: np.sum([errors[kind, length, each] for each in parts], 0) for name, errors in found.items()}
            reference = sums[REFERENCE]
            if reference[:, 1].sum() < _FEWEST:
                continue
            mean = {name: each[:, 0].sum() / each[:, 1].sum() for name, each in sums.items()}
            changes = [_change(sums[name], reference) for name in found if name not in ("pchip_body", REFERENCE)]
            cells = [f"{mean['pchip_body']:.1f}", f"{mean[REFERENCE]:.1f}", *changes]
            rows.append([length, part, str(int(reference[:, 1].sum())), *cells])
    others = [f"{name}, %" for name in found if name not in ("pchip_body", REFERENCE)]
    return {"columns": ["frames", "part", "joints", "pchip_body, mm", f"{REFERENCE}, mm", *others], "rows": rows}


def region_table(regions: Regions) -> dict:
    """Return the rows of the shares of completed joints with their true position inside the stated 90 % region."""
    rows = []
    for kind, words in KINDS.items():
        sums = [regions[kind, _words(*gap)] for gap in GAPS]
        rows.append([words, *(f"{100 * inside / max(count, 1):.0f} of {count}" for inside, count in sums)])
    return {"columns": ["poses", *(f"{_words(*gap)} frames, % of joints" for gap in GAPS)], "rows": rows}


def _change(errors: np.ndarray, reference: np.ndarray) -> str:
    """Return the change of the mean error, %, and its interval; errors (people, 2) are sums and numbers."""
    drawn = np.random.default_rng(0).integers(len(errors), size=(_RESAMPLED, len(errors)))
    ratios = errors[drawn, 0].sum(1) / np.maximum(reference[drawn, 0].sum(1), 1e-9)
    low, high = np.quantile(100 * (ratios - 1), [0.05, 0.95])
    return f"{100 * (errors[:, 0].sum() / reference[:, 0].sum() - 1):+.0f} ({low:+.0f}..{high:+.0f})"


def _words(low: int, high: int | None) -> str:
    return f"{low}-{high}" if high else f"{low} or more"


def draw(tables: dict[str, dict]) -> None:
    """Draw the mean errors of all parts by length: `docs/images/completion_gains.svg`."""
    mpl.rcParams["svg.hashsalt"] = "completion_gains"
    figure, axes = pyplot.subplots(1, 3, figsize=(9, 3), layout="constrained", sharey=True)
    for axis, kind in zip(axes, ("captured", "perturbed", "true"), strict=True):
        rows = [row for row in tables[kind]["rows"] if row[1] == "all"]
        lengths, reference = [row[0] for row in rows], np.array([float(row[4]) for row in rows])
        axis.plot(lengths, [float(row[3]) for row in rows], "o-", color="tab:gray", label="pchip_body")
        axis.plot(lengths, reference, "s-", color="tab:blue", label=REFERENCE)
        change, low, high = np.array([re.findall(r"[-+]\d+", row[6]) for row in rows], float).T / 100
        axis.fill_between(lengths, reference * (1 + low), reference * (1 + high), color="tab:red", alpha=0.2, lw=0)
        axis.plot(lengths, reference * (1 + change), "^-", color="tab:red", label="dmae complete")
        axis.set(title=KINDS[kind], xlabel="unmeasured frames, at 25/s", ylim=(0, None))
    axes[0].set_ylabel("unmeasured joints: MPJPE, mm")
    axes[0].legend()
    figure.savefig(FILE.parents[1] / "images/completion_gains.svg", metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="+", type=Path, help="data sets with truth and captured poses")
    parser.add_argument("--out", type=Path, default=FILE)
    options = parser.parse_args()
    found, regions = measure(options.data)
    tables = {kind: {"command": "make gains", **table(found, kind)} for kind in KINDS}
    tables["regions"] = {"command": "make gains", **region_table(regions)}
    draw(tables)
    options.out.write_text(json_text({"measured": measured("torch"), "tables": tables}) + "\n")
    for kind, each in tables.items():
        print(kind, *("  ".join(row) for row in [each["columns"], *each["rows"]]), sep="\n", file=sys.stderr)


if __name__ == "__main__":
    main()
