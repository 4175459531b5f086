"""Measure how well `synth plan` predicts: `docs/results/plan.json`.

    python docs/tools/plan_proof.py                   # both parts
    python docs/tools/plan_proof.py part=subsets clips=12
    python docs/tools/plan_proof.py part=rings clips=6
    make twin && python docs/tools/plan_proof.py part=again scores=runs/twin_scores

Subsets: each three and four of Shelf's cameras capture the twin's people. The result is compared with the scores of
`dmae evaluate` on the recording with the same cameras. Nothing is fitted to the recording's scores. Rings: rigs that
are planned for a room are compared with rings of the same number of cameras and the same lens, on people that planning
did not use. Again: the comparison of the first part, with other clips of the twin that `dmae evaluate` scored.
"""

import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from provenance import measured
from scipy.stats import spearmanr

from dmae.cli import compose
from dmae.data.json_values import json_text
from dmae.data.rng import Stream, generator
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.evaluate import evaluate
from dmae.formats.reading import DataConfig
from synth.cli import SYNTH
from synth.planning.places import given_cameras
from synth.planning.plan import check_numbers, check_rigs, expected, find_candidates, gather_evidence
from synth.planning.search import JointEvidence, choose, predict
from synth.rigs.config import RigConfig, RingConfig
from synth.rigs.coverage import stage_of
from synth.rigs.lenses import joined
from synth.rigs.rig import make_rig
from synth.rooms.room import arena_file

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docs" / "results" / "plan.json"
ALLOWED = 1.5
"""Points of PCP by which a prediction may differ."""
_RINGS = 2
_DRAWS = 400


def subsets(clips: int, workers: int) -> Iterator[dict[str, dict]]:
    """Yield the tables of Shelf's subsets."""
    config = _config(["scene=shelf_twin", "rig=shelf", "views=[3,4]", "seed=1"], clips, workers)
    candidates = find_candidates(config)
    rigs = [list(rig) for number in (3, 4) for rig in combinations(range(5), number)]
    figures = check_rigs(config, candidates.rig, rigs, check_numbers(config))
    evidence = gather_evidence(config, candidates)
    real = _real()
    rows, deviations, pcp = [], [], {}
    for rig, values in zip(rigs, figures["pcp"], strict=True):
        found, (value, low, high) = expected(values), real[tuple(rig)]
        deviations.append(abs(found.value - value))
        pcp[tuple(rig)] = found.value
        rows.append([" ".join(map(str, rig)), f"{value:.1f} ({low:.1f} to {high:.1f})",
                     f"{found.value:.1f} ({found.low:.1f} to {found.high:.1f})", f"{found.value - value:+.1f}",
                     f"{predict(evidence, rig).missing:.1f}"])  # fmt: skip
    print(*rows, sep="\n")
    score = {tuple(rig): predict(evidence, rig).score for rig in rigs}
    orders = []
    for words, numbers in (("ten of three", (3,)), ("five of four", (4,)), ("all fifteen", (3, 4))):
        chosen = [tuple(rig) for rig in rigs if len(rig) in numbers]
        measured = [real[rig][0] for rig in chosen]
        orders.append([words, *(f"{spearmanr(measured, [of[rig] for rig in chosen])[0]:.2f}" for of in (pcp, score)),
                       _own_order(real, chosen)])  # fmt: skip
    within = sum(deviation <= ALLOWED for deviation in deviations)
    orders_header = [
        "subsets",
        "rank correlation, captured",
        "by visibility alone",
        "the recording with its own halves",
    ]
    columns = ["cameras", "Shelf, PCP %", "predicted, PCP %", "difference", "not measured, by visibility %"]
    orders_header = [
        "subsets",
        "rank correlation, captured",
        "by visibility alone",
        "the recording with its own halves",
    ]
    yield {
        "subsets": {"columns": columns, "rows": rows},
        "orders": {"columns": orders_header, "rows": orders},
        "deviations": {"columns": ["predictions within 1.5 points", "mean difference", "greatest"],
                       "rows": [[f"{within} of {len(rigs)}", f"{np.mean(deviations):.1f}", f"{max(deviations):.1f}"]]},
    }  # fmt: skip


_SUMS: dict[tuple[int, ...], np.ndarray] = {}
"""(actors, blocks, 2) correct and known limbs of the recording, by subset."""


def _real() -> dict[tuple[int, ...], tuple[float, float, float]]:
    """Return PCP of Shelf by subset, with the interval over blocks of time."""
    from dmae.evaluation.scores import figure_score, run_table

    path = str(Path(os.environ["DMAE_DATA"]) / "shelf")
    result = evaluate(EvaluateConfig(DataConfig("shelf", path), methods=["linear"], views=[4, 3]))
    found = {}
    for entry in result["results"]:
        for run in entry["runs"]:
            score, key = figure_score(run_table([run]), "pcp"), tuple(run["cameras"])
            found[key] = score.value, *score.interval
            sums = run["blocks"]["pcp"]
            _SUMS[key] = np.stack([np.array(sums["sum"], float), np.array(sums["count"], float)], -1)
    return found


def _own_order(real: dict, chosen: list[tuple[int, ...]]) -> str:
    """Return the median rank correlation of the orders that two random halves of the recording's seconds give."""
    sums, rng = np.array([_SUMS[rig] for rig in chosen]), np.random.default_rng(0)
    blocks, found = sums.shape[2], []
    for _ in range(_DRAWS):
        order = rng.permutation(blocks)
        halves = [sums[:, :, half].sum((1, 2)) for half in (order[: blocks // 2], order[blocks // 2 :])]
        first, second = (half[:, 0] / half[:, 1] for half in halves)
        if np.ptp(first) > 0 and np.ptp(second) > 0:
            found.append(spearmanr(first, second)[0])
    low, middle, high = np.quantile(found, [0.1, 0.5, 0.9])
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def again(scores: Path) -> Iterator[dict[str, dict]]:
    """Yield the table of how far scores of other clips of the twin agree with the recording."""
    real, predicted = _real(), {}
    for entry in json.loads((scores / "scores.json").read_text())["results"]:
        for run in entry["runs"] if entry["method"] == "linear" else ():
            predicted.setdefault(tuple(run["cameras"]), []).append(run["pcp"])
    mean = {rig: float(np.mean(predicted[rig])) for rig in real}
    clips = len(next(iter(predicted.values())))
    off = [abs(mean[rig] - real[rig][0]) for rig in real]
    within = sum(each <= ALLOWED for each in off)
    row = [str(clips)]
    for numbers in ((3,), (4,), (3, 4)):
        chosen = [rig for rig in real if len(rig) in numbers]
        row.append(f"{spearmanr([real[rig][0] for rig in chosen], [mean[rig] for rig in chosen])[0]:.2f}")
    columns = ["other clips", "ten of three", "five of four", "all fifteen", "within 1.5 points", "greatest difference"]
    yield {"again": {"columns": columns, "rows": [[*row, f"{within} of {len(off)}", f"{max(off):.1f}"]]}}


def rings(clips: int, workers: int) -> Iterator[dict[str, dict]]:
    """Yield the tables that compare planned rigs with rings, after each room."""
    columns = ["room", "cameras"]
    for heading in ("not measured, %", "PCP, %", "error, mm"):
        columns += [f"{heading}: planned", "rings", "difference"]
    ranked = ["room", "rigs", "rank correlation: score with PCP", "share not measured", "error"]
    rows, scores = [], []
    for room in ("office", "studio", "pillars"):
        config = _config(
            [f"scene={room}", "views=[3,4]", "scene.persons=[1,4]", "scene.seconds=3", "seed=3"], clips, workers
        )
        candidates, scene = find_candidates(config), config.setting()
        stage = stage_of(arena_file(scene.arena), np.array(scene.middle), scene.radius)
        parts, rigs, count = [candidates.rig], [], len(candidates)
        for number in config.numbers:
            for ring in range(_RINGS):
                lens = RingConfig(
                    number, focal=float(config.lens.matrix(config.lens.view_deg[0])[0, 0]), size=config.lens.size
                )
                made = make_rig(RigConfig(ring=lens), rng=generator(config.seed, ring, Stream.CAMERAS), stage=stage)
                parts.append(replace(made, names=tuple(f"{number}_{ring}_{name}" for name in made.names)))
                rigs.append(list(range(count, count + number)))
                count += number
        cameras = joined(parts)
        place = np.concatenate([candidates.place, len(cameras) + np.arange(count - len(candidates))])
        given = given_cameras(cameras)
        evidence = gather_evidence(config, replace(given, place=place))
        own = slice(len(candidates))
        mounted = JointEvidence(evidence.probability[:, own], evidence.information[:, own])
        chosen = choose(mounted, candidates.place, config.numbers)
        rigs = [*chosen.values(), *rigs]
        used = sorted({camera for rig in rigs for camera in rig})
        rank = {camera: index for index, camera in enumerate(used)}
        found = check_rigs(config, cameras[used], [[rank[c] for c in rig] for rig in rigs], check_numbers(config))
        guessed = [predict(evidence, rig) for rig in rigs]
        scores.append([room, str(len(rigs)), *(
            f"{spearmanr([getattr(each, guess) for each in guessed], found[name].mean(1))[0]:.2f}"
            for guess, name in (("score", "pcp"), ("missing", "missing"), ("error", "error"))
        )])  # fmt: skip
        print(scores[-1], flush=True)
        for index, number in enumerate(chosen):
            first = len(chosen) + _RINGS * index
            row = [room, str(number)]
            for name in ("missing", "pcp", "error"):
                planned, ring = found[name][index], found[name][first : first + _RINGS].mean(0)
                gain = expected(planned - ring)
                row += [
                    f"{planned.mean():.1f}",
                    f"{ring.mean():.1f}",
                    f"{gain.value:+.1f} ({gain.low:+.1f} to {gain.high:+.1f})",
                ]
            rows.append(row)
            print(row, flush=True)
        yield {"rings": {"columns": columns, "rows": rows}, "score": {"columns": ranked, "rows": scores}}


def _config(options: list[str], clips: int, workers: int):
    return compose(SYNTH.commands["plan"], [*options, f"search.check_clips={clips}", f"workers={workers}"])


def write(tables: dict[str, dict], command: str) -> None:
    """Write the tables of a part. The tables of other parts stay unchanged."""
    content = json.loads(FILE.read_text()) if FILE.is_file() else {"tables": {}}
    content["measured"] = measured("mujoco")
    content["tables"] |= {name: {"command": command, **table} for name, table in tables.items()}
    FILE.write_text(json_text(content) + "\n")


if __name__ == "__main__":
    given = {"part": "all", "clips": "12", "workers": "2", "scores": "runs/twin_scores"}
    given |= dict(each.split("=") for each in sys.argv[1:])
    if not os.environ.get("DMAE_DATA") or len(given) > 4 or given["part"] not in ("all", "subsets", "rings", "again"):
        sys.exit(
            "set DMAE_DATA to the folder that holds shelf/; options are part=all|subsets|rings|again clips=12 "
            "workers=2, and scores=<what make twin scored> for part=again"
        )
    command = f"python docs/tools/plan_proof.py part={given['part']} clips={given['clips']}"
    for part, function in {"subsets": subsets, "rings": rings}.items():
        if given["part"] in (part, "all"):
            for tables in function(int(given["clips"]), int(given["workers"])):
                write(tables, command.replace("=all", f"={part}"))
    if given["part"] == "again":
        for tables in again(Path(given["scores"])):
            write(tables, "make twin; python docs/tools/plan_proof.py part=again")
