"""Heads as published evaluations place them."""

import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14, get_skeleton
from dmae.evaluation.paper_tables.head_placement import convert_with_head
from dmae.metrics.protocols import protocol
from tests.support.clips import t_pose, walkers

ENDS = list(SHELF14.index("bottom_head", "top_head"))


def poses() -> Poses3D:
    return Poses3D(BODY25, t_pose()[None, None])


@pytest.mark.parametrize(
    ("head", "bottom", "top"),
    [
        # Nose at (0.1, 0, 1.62), ears at 1.64 and shoulders at 1.45 above the origin.
        ("mvpose", (0.05, 0, 1.535), (0.075, 0, 1.705)),
        ("voxelpose", (0.0375, 0, 1.5375), (0.05625, 0, 1.7125)),
    ],
)
def test_ends_are_where_the_formula_says(head, bottom, top):
    placed = convert_with_head(poses(), SHELF14, head).xyz[0, 0, ENDS]
    np.testing.assert_allclose(placed, [bottom, top], atol=1e-6)


def test_heads_of_protocols_are_known():
    heads = {name: convert_with_head(poses(), SHELF14, rules.head).xyz[0, 0, ENDS] for name, rules in protocol.items()}
    for name in ("strict", "4da", "hkbu"):
        np.testing.assert_array_equal(heads[name], convert(poses(), SHELF14).xyz[0, 0, ENDS])
    assert np.linalg.norm(heads["mvpose"] - heads["voxelpose"]) > 0.01


def test_all_but_the_head_is_converted_as_elsewhere():
    placed, plain = convert_with_head(walkers(), SHELF14, "mvpose"), convert(walkers(), SHELF14)
    rest = [joint for joint in range(len(SHELF14)) if joint not in ENDS]
    np.testing.assert_array_equal(placed.xyz[:, :, rest], plain.xyz[:, :, rest])


def test_a_head_without_a_nose_is_absent():
    xyz = t_pose()[None, None].copy()
    xyz[0, 0, BODY25.index("nose")] = np.nan
    placed = convert_with_head(Poses3D(BODY25, xyz), SHELF14, "voxelpose")
    assert np.isnan(placed.xyz[0, 0, ENDS]).all()
    assert (placed.source[0, 0, ENDS] == Source.ABSENT).all()


def test_a_head_that_is_known_stays():
    known = walkers(skeleton=SHELF14)
    assert convert_with_head(known, SHELF14, "mvpose") is known
    fused = get_skeleton("body25+shelf14")
    both = Poses3D(fused, np.concatenate([walkers().xyz, aside_head(known.xyz)], 2))
    np.testing.assert_array_equal(convert_with_head(both, SHELF14, "mvpose").xyz, aside_head(known.xyz))


def aside_head(xyz: np.ndarray) -> np.ndarray:
    xyz = xyz.copy()
    xyz[:, :, ENDS] += 0.1
    return xyz
