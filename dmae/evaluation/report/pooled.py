"""Pool the findings of several clips: counts are added, moments and people stay with their clips."""

from collections.abc import Sequence
from functools import reduce

import numpy as np

from dmae.evaluation.report.findings import Findings
from dmae.evaluation.report.joint_groups import JointGroup, added

Groups = dict[str, dict[str, JointGroup]]
"""Tallies by breakdown and group."""


def pooled_groups(findings: Sequence[Findings], name: str) -> Groups:
    """Return the tallies of a field of `Findings` ("breakdowns", "residuals", ...), added up over clips."""
    return reduce(added_groups, (getattr(each, name) for each in findings), {})


def pooled_truth(findings: Sequence[Findings]) -> dict[str, JointGroup]:
    """Return the tallies against the truth, added up over the clips that have one."""
    return reduce(added, (each.against_truth for each in findings), {})


def pooled_regions(findings: Sequence[Findings]) -> dict[str, np.ndarray]:
    """Return the counts in regions of stated probability, added up over clips."""
    total: dict[str, np.ndarray] = {}
    for each in findings:
        for name, counts in each.regions.items():
            total[name] = total.get(name, 0) + counts
    return total


def added_groups(first: Groups, second: Groups) -> Groups:
    """Return the tallies of two sets of clips as one."""
    return {name: added(first.get(name, {}), second.get(name, {})) for name in {**first, **second}}
