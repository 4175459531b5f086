"""Surfaces of people: girths as in surveys, and close to the capsules."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree

from synth.people.body import SEGMENTS, Body, body_at, segment_origins
from synth.people.clothing import Garment, PersonLooks
from synth.people.mjcf import capsules
from synth.people.surfaces import parts, trunk_sections

_GREY = (0.5, 0.5, 0.5)
_SHORT = Garment(False, "plain", (_GREY, _GREY))
BARE = PersonLooks(_GREY, "bald", _GREY, _SHORT, _SHORT, _GREY, _GREY, untucked=True)

# ANSUR II (Gordon et al., NATICK/TR-15/007, 2014), means of men and women, m. Upper arms are tensed there.
GIRTHS = {
    0.0: {"chest": 1.057, "waist": 0.941, "hips": 1.019, "neck": 0.398, "thigh": 0.625, "calf": 0.392, "ankle": 0.229,
          "upper_arm": 0.358, "forearm": 0.310, "wrist": 0.176, "head": 0.574},
    1.0: {"chest": 0.947, "waist": 0.861, "hips": 1.021, "neck": 0.330, "thigh": 0.616, "calf": 0.373, "ankle": 0.215,
          "upper_arm": 0.306, "forearm": 0.264, "wrist": 0.155, "head": 0.561},
}  # fmt: skip
# Waist, upper arm and calf of boys and girls, m, after Snyder et al. (UM-HSRI-77-17, 1977).
CHILDREN = {6: (0.54, 0.180, 0.240), 10: (0.62, 0.210, 0.290)}


def tape(body: Body, segment: str, axis: int, at: float, pick=max) -> float:
    """Length of a tape around the bare skin of a segment, m: the greatest near `at`, m, along an axis."""
    (skin,) = [mesh for name, made_of, mesh in parts(body, BARE) if (name, made_of) == (segment, "skin")]
    corners = skin.vertices[skin.faces]
    start, end = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)]).swapaxes(0, 1)
    lengths = []
    for place in at + np.linspace(-0.01, 0.01, 5) * body.stature:
        cut = (start[:, axis] - place) * (end[:, axis] - place) < 0
        share = (place - start[cut, axis]) / (end[cut, axis] - start[cut, axis])
        points = start[cut] + share[:, None] * (end - start)[cut]
        lengths.append(ConvexHull(np.delete(points, axis, axis=1)).area)
    return pick(lengths)


def girths(body: Body) -> dict[str, float]:
    size, along = body.stature, body.stature * body.arms
    angle = np.linspace(0, 2 * np.pi, 400)
    # The squareness of the trunk.
    cos, sin = (np.sign(wave) * np.abs(wave) ** (2 / 2.3) for wave in (np.cos(angle), np.sin(angle)))
    around = {}
    for name, height in (("chest", 0.225), ("waist", 0.10), ("hips", 0.0)):
        depth, breadth = trunk_sections(body, np.array([height]))[0, 2:]
        around[name] = np.hypot(np.diff(depth * cos), np.diff(breadth * sin)).sum()
    return around | {
        "neck": tape(body, "head", 2, 0.010 * size),
        "head": tape(body, "head", 2, 0.105 * size * body.head),
        "thigh": tape(body, "l_thigh", 2, -0.05 * size),
        "calf": tape(body, "l_shin", 2, -0.07 * size),
        "ankle": tape(body, "l_shin", 2, -0.21 * size, min),
        "upper_arm": tape(body, "l_upper_arm", 1, 0.09 * along),
        "forearm": tape(body, "l_forearm", 1, 0.035 * along),
        "wrist": tape(body, "l_forearm", 1, 0.132 * along, min),
    }


@pytest.mark.parametrize("body", [Body(1.756, 85.5, 0.0), Body(1.629, 67.8, 1.0)])
def test_girths_of_average_people_follow_a_survey(body):
    found = girths(body)
    for name, expected in GIRTHS[body.feminine].items():
        assert found[name] == pytest.approx(expected, rel=0.1), name
    assert np.mean([found[name] / expected for name, expected in GIRTHS[body.feminine].items()]) > 0.95


@pytest.mark.parametrize("age", CHILDREN)
def test_girths_of_children_follow_a_survey(age):
    found = girths(body_at(0, age))
    np.testing.assert_allclose([found[name] for name in ("waist", "upper_arm", "calf")], CHILDREN[age], rtol=0.08)


def drawn_on(surface, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) points spread evenly over a mesh."""
    corners = surface.vertices[surface.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    shares = rng.dirichlet((1, 1, 1), count)
    return (corners[rng.choice(len(area), count, p=area / area.sum())] * shares[..., None]).sum(1)


def outside(points: np.ndarray, ends: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """(N,) distance of points (N, 3) from the nearest of capsules (C, 2, 3), m; below 0 within one."""
    axis = ends[:, 1] - ends[:, 0]
    share = np.einsum("ncj,cj->nc", points[:, None] - ends[:, 0], axis) / np.maximum((axis**2).sum(1), 1e-12)
    nearest = ends[:, 0] + np.clip(share, 0, 1)[..., None] * axis
    return (np.linalg.norm(points[:, None] - nearest, axis=-1) - radii).min(1)


@pytest.mark.parametrize(
    "body",
    [
        Body(),
        Body(1.62, 56, 1.0),
        Body(1.85, 118),
        Body(1.55, 75, 1.0, 0.95, 1.05),
        Body(1.93, 70, 0.0, 1.05, 0.95),
        body_at(0, 4),
        body_at(1, 9, index=2),
        body_at(0, 13, index=-1.5),
    ],
    ids=lambda body: f"{body.stature:.2f} m, {body.mass:.0f} kg",
)
def test_solids_fit_the_skin(body):
    rng = np.random.default_rng(0)
    origins = segment_origins(body, np.zeros((1, 3)), np.tile(np.eye(3), (1, len(SEGMENTS), 1, 1)))[0]
    surfaces = [(mesh, origins[SEGMENTS.index(segment)]) for segment, _, mesh in parts(body, BARE)]
    skin = np.concatenate([drawn_on(mesh, 400, rng) + origin for mesh, origin in surfaces])
    segments, ends, radii = capsules(body)
    ends = ends + origins[segments][:, None]
    # With clothes: 35 mm on the average adult.
    assert np.percentile(outside(skin, ends, radii), 95) < 0.020 * body.stature

    which, along = rng.integers(len(radii), size=6000), rng.uniform(-0.5, 1.5, (6000, 1)).clip(0, 1)
    axis = ends[which, 1] - ends[which, 0]
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9)
    way = rng.normal(size=(6000, 3))
    # From the axis at right angles, and from its ends in all directions.
    way -= np.where((along > 0) & (along < 1), (way * axis).sum(1, keepdims=True), 0) * axis
    way *= radii[which, None] / np.linalg.norm(way, axis=1, keepdims=True)
    solid = ends[which, 0] * (1 - along) + ends[which, 1] * along + way
    solid = solid[outside(solid, ends, radii) > -1e-6]
    assert np.percentile(cKDTree(skin).query(solid)[0], 95) < 0.022 * body.stature
