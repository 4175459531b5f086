"""`dmae evaluate`: score methods over clips and camera subsets."""

import sys
from pathlib import Path

from dmae.data.clip import Source
from dmae.data.json_values import json_text
from dmae.evaluation.config import SCORED, EvaluateConfig
from dmae.evaluation.evaluate import evaluate, forecast
from dmae.evaluation.gates import check_baseline, compare_scores, scored_options
from dmae.evaluation.scores import read_scores
from dmae.files.contents import write_atomic
from dmae.formats.reading import Clips
from dmae.metrics.score_tables import score_tables
from dmae.reporting.tables import counted, print_tables

WORSE = 2
"""Exit status where a figure is worse than the baseline; errors have status 1, and so has what cannot be compared."""


def run(config: EvaluateConfig, out: Path) -> None:
    """Score, print and write; with a baseline exit with `WORSE` where a figure is worse."""
    baseline = None if config.baseline is None else read_scores(Path(config.baseline))
    if baseline is not None:
        # Check this first, so that a long run does not end with scores that cannot be compared.
        check_baseline(baseline, scored_options(config), config.changed)
    if config.dry_run:
        print(f"{out}: {forecast(config)}")
        return
    scores = evaluate(config)
    clips = Clips(config.data)
    poses = clips[0].poses if clips.reader.name == "clip" and not config.poses else None
    if poses is not None and (poses.source == Source.COMPLETED).any():
        print(f"Scored is a new capture of the detections; poses={config.data.path} scores the completed poses there")
    missing = [] if config.methods or config.poses else [*{*SCORED} - {each["method"] for each in scores["results"]}]
    for name in missing:
        print(f"{name} is not scored: its weights know people, and nothing of {clips[0].detections.skeleton.name}")
    path = out / "scores.json"
    write_atomic(path, json_text(scores))
    print_tables(score_tables(scores))
    truth, own = clips[0].truth, clips[0].detections.skeleton
    if truth is not None and own in truth.skeleton.parts and scores["skeleton"] != own.name:
        print(
            f"scored on {scores['skeleton']}, to which joints of {own.name} are converted, with errors of its own; "
            f"skeleton={own.name} compares them as they are, as dmae report does"
        )
    rigs = [each["cameras"] for each in scores["clips"].values()]
    for each in scores["results"] if all({*rig} == {*rigs[0]} for rig in rigs) else ():
        if 0 < each["views"] < len(rigs[0]):
            worst = ", ".join(rigs[0][view] for view in each["worst"]["cameras"])
            print(f"{each['method']}, {counted(each['views'], 'view')}: worst with {worst}")
    print(path)
    if baseline is not None:
        gate = compare_scores(baseline, scores, config.changed)
        print(gate)
        if not gate.passed:
            sys.exit(WORSE if gate.worse else 1)
