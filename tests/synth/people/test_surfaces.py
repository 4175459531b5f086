"""Surfaces of people: girths as in surveys, and close to the capsules."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull, cKDTree

from synth.people.body import SEGMENTS, Body, body_at, segment_origins
from synth.people.clothing import Garment, PersonLooks
from synth.people.outfit import parts
from synth.people.solids import capsules
from synth.people.surface import DENSITY, BareBody, assets, bare_body, volume
from tests.support.surfaces import Posed, in_t_pose

_GREY = (0.5, 0.5, 0.5)
_SHORT = Garment(False, "plain", (_GREY, _GREY))
BARE = PersonLooks(_GREY, "bald", _GREY, _SHORT, _SHORT, _GREY, _GREY, untucked=True)
BODIES = [
    Body(),
    Body(1.62, 56, 1.0),
    Body(1.85, 118),
    Body(1.55, 75, 1.0, 0.95, 1.05),
    Body(1.93, 70, 0.0, 1.05, 0.95),
    body_at(0, 4),
    body_at(1, 9, index=2),
    body_at(0, 13, index=-1.5),
]


def named(body: Body) -> str:
    return f"{body.stature:.2f} m, {body.mass:.0f} kg"


# ANSUR II (Gordon et al., NATICK/TR-15/007, 2014), means of men and women, m. Upper arms are tensed there.
GIRTHS = {
    0.0: {"chest": 1.057, "waist": 0.941, "hips": 1.019, "neck": 0.398, "thigh": 0.625, "calf": 0.392, "ankle": 0.229,
          "upper_arm": 0.358, "forearm": 0.310, "wrist": 0.176, "head": 0.574},
    1.0: {"chest": 0.947, "waist": 0.861, "hips": 1.021, "neck": 0.330, "thigh": 0.616, "calf": 0.373, "ankle": 0.215,
          "upper_arm": 0.306, "forearm": 0.264, "wrist": 0.155, "head": 0.561},
}  # fmt: skip
# Waist, upper arm and calf of boys and girls, m, after Snyder et al. (UM-HSRI-77-17, 1977).
CHILDREN = {6: (0.54, 0.180, 0.240), 10: (0.62, 0.210, 0.290)}
ARMS = [i for i, segment in enumerate(SEGMENTS) if segment.endswith(("arm", "hand"))]


def tape(bare: BareBody, middle: np.ndarray, axis: np.ndarray, own: np.ndarray) -> float:
    """Length of a tape around some triangles (T,) of the skin in a plane through `middle` across an axis, m."""
    corners = bare.vertices[assets().faces[own]]
    start, end = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)]).swapaxes(0, 1)
    near, far = (start - middle) @ axis, (end - middle) @ axis
    cut = near * far < 0
    share = near[cut] / (near - far)[cut]
    points = start[cut] + share[:, None] * (end - start)[cut]
    across = np.linalg.svd(np.eye(3) - np.outer(axis, axis))[0][:, :2]
    return ConvexHull(points @ across).area


def girths(body: Body) -> dict[str, float]:
    bare, size, up = bare_body(body), body.stature, np.array((0, 0, 1.0))
    weights = bare.weights[assets().faces].mean(1)
    left = bare.vertices[assets().faces][:, :, 1].min(1) > 0
    no_arms = weights[:, ARMS].sum(1) < 0.5

    def round_trunk(height: float) -> float:
        return tape(bare, height * size * body.trunk * up, up, no_arms)

    def round_limb(segment: str, at: float, pick=max, own=None) -> float:
        """The greatest tape within 0.01 of stature of a place along a segment, given as a fraction of its length."""
        number = SEGMENTS.index(segment)
        bone = bare.origins[number + 1] - bare.origins[number]
        own = weights[:, number] > 0.3 if own is None else own
        axis = bone / np.linalg.norm(bone)
        steps = np.linspace(-0.01, 0.01, 5) * size
        return pick(tape(bare, bare.origins[number] + at * bone + step * axis, axis, own) for step in steps)

    head = bare.origins[SEGMENTS.index("head")]
    of_head, tilted = weights[:, SEGMENTS.index("head")] > 0.3, np.array((np.sin(0.2), 0, np.cos(0.2)))
    return {
        "chest": round_trunk(0.205),
        "waist": round_trunk(0.10),
        "hips": round_trunk(0.0),
        "neck": tape(bare, head + 0.02 * size * tilted, tilted, of_head),
        "head": tape(bare, head + 0.105 * size * body.head * up, up, of_head),
        "thigh": round_limb("l_thigh", 0.25, own=(weights[:, SEGMENTS.index("l_thigh")] > 0.3) & left),
        "calf": round_limb("l_shin", 0.28),
        "ankle": round_limb("l_shin", 0.85, min),
        "upper_arm": round_limb("l_upper_arm", 0.5),
        "forearm": round_limb("l_forearm", 0.22),
        "wrist": round_limb("l_forearm", 0.90, min),
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


@pytest.mark.parametrize("body", BODIES, ids=named)
def test_the_skin_contains_the_mass_of_the_person(body):
    bare, faces = bare_body(body), assets().faces
    assert volume(bare.vertices, faces) * DENSITY == pytest.approx(body.mass, rel=0.01)
    mirrored = cKDTree(bare.vertices).query(bare.vertices * (1, -1, 1))[0]
    assert mirrored.max() < 0.001


def drawn_on(surface: Posed, count: int, rng: np.random.Generator) -> np.ndarray:
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


def segment_origins_in_t_pose(body: Body) -> np.ndarray:
    return segment_origins(body, np.array([[0, 0, body.hip_height]]), np.tile(np.eye(3), (1, len(SEGMENTS), 1, 1)))[0]


@pytest.mark.parametrize("body", BODIES, ids=named)
def test_snug_solids_fit_the_skin_of_trunk_arms_and_legs(body):
    """From 72 to 95 % of it are within 10 mm; of plain ones, from 43 to 78 %."""
    fitted = ("pelvis", "spine", "chest", "arm", "thigh", "shin")
    parts = [part for part in in_t_pose(body, BARE, naked=True) if part.segment.endswith(fitted)]
    skin = np.concatenate([drawn_on(part, 6000, np.random.default_rng(0)) for part in parts])
    gaps = []
    for each in (body, replace(body, snug=True)):
        segments, ends, radii = capsules(each)
        gaps.append(outside(skin, ends + segment_origins_in_t_pose(body)[segments][:, None], radii))
    # 4 mm under the skin.
    plain, snug = gaps[0], gaps[1] - 0.004
    assert abs(np.median(snug)) < 0.004
    assert np.percentile(snug, 95) < 0.009 * body.stature
    assert (np.abs(snug) < 0.010).mean() > max(0.7, (np.abs(plain) < 0.010).mean() + 0.15)


@pytest.mark.parametrize("body", BODIES, ids=named)
def test_solids_fit_the_skin(body):
    rng = np.random.default_rng(0)
    origins = segment_origins_in_t_pose(body)
    parts = in_t_pose(body, BARE, naked=True)
    area = [trimesh.Trimesh(part.vertices, part.faces, process=False).area for part in parts]
    counts = np.ceil(60000 * np.array(area) / sum(area)).astype(int)
    skin = np.concatenate([drawn_on(part, count, rng) for part, count in zip(parts, counts, strict=True)])
    segments, ends, radii = capsules(body)
    ends = ends + origins[segments][:, None]
    gap = outside(skin, ends, radii)
    assert abs(np.median(gap)) < 0.005 * body.stature
    # Hips and thighs of women are wider than their solids.
    assert np.percentile(gap, 95) < (0.020 + 0.009 * body.figure) * body.stature

    which, along = rng.integers(len(radii), size=6000), rng.uniform(-0.5, 1.5, (6000, 1)).clip(0, 1)
    axis = ends[which, 1] - ends[which, 0]
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9)
    way = rng.normal(size=(6000, 3))
    # From the axis at right angles, and from its ends in all directions.
    way -= np.where((along > 0) & (along < 1), (way * axis).sum(1, keepdims=True), 0) * axis
    way *= radii[which, None] / np.linalg.norm(way, axis=1, keepdims=True)
    solid = ends[which, 0] * (1 - along) + ends[which, 1] * along + way
    solid = solid[outside(solid, ends, radii) > -1e-6]
    assert np.percentile(cKDTree(skin).query(solid)[0], 95) < 0.025 * body.stature


@pytest.mark.parametrize("body", BODIES, ids=named)
@pytest.mark.parametrize("untucked", [True, False])
def test_no_skin_is_left_under_cloth_around_the_waist(body, untucked):
    """Skin bends more sharply than cloth, and would come through it on a person who sits."""
    skin = [part for part in parts(body, replace(BARE, untucked=untucked)) if part.material == "skin"]
    trunk = [part for part in skin if part.segment in ("pelvis", "spine", "chest", "l_thigh", "r_thigh")]
    assert not any((np.abs(part.vertices[:, 2] / body.stature - 0.05) < 0.1).any() for part in trunk)


@pytest.mark.parametrize(("material", "upper", "lower"), [("top", "upper_arm", "forearm"), ("bottom", "thigh", "shin")])
@pytest.mark.parametrize("side", ["l", "r"])
def test_patterns_go_on_past_elbows_and_knees(material, upper, lower, side):
    long = replace(_SHORT, long=True)
    found = {part.segment: part for part in parts(BODIES[1], replace(BARE, top=long, bottom=long))
             if part.material == material}  # fmt: skip
    one, other = (found[f"{side}_{name}"] for name in (upper, lower))
    places, uv = (
        [(part.vertices[part.faces] if kind else part.uv).reshape(-1, 2 + kind) for part in (one, other)]
        for kind in (1, 0)
    )
    apart, same = cKDTree(places[0]).query(places[1])
    seam = apart < 1e-6
    difference = uv[0][same[seam]] - uv[1][seam]
    assert seam.sum() > 5
    # Around the limb, whole turns are the same place. The pattern of this shirt repeats twice around its trunk.
    turn = 0.5 if material == "top" else 1
    difference[:, 0] -= turn * np.round(difference[:, 0] / turn)
    assert np.abs(difference).max() < 1e-6


@pytest.mark.parametrize("body", [BODIES[1], BODIES[2]], ids=named)
@pytest.mark.parametrize(
    ("one", "other"), [("pelvis", "l_thigh"), ("spine", "pelvis"), ("chest", "spine"), ("chest", "l_upper_arm"),
                       ("chest", "r_upper_arm")]
)  # fmt: skip
def test_patterns_of_shirts_go_on_past_seams(body, one, other):
    found = {part.segment: part for part in parts(body, BARE) if part.material == "top"}
    corners = [(found[name].vertices[found[name].faces].reshape(-1, 3), found[name].uv.reshape(-1, 2))
               for name in (one, other)]  # fmt: skip
    apart, same = cKDTree(corners[0][0]).query(corners[1][0])
    seam = apart < 1e-6
    difference = (corners[0][1][same] - corners[1][1])[seam]
    assert seam.sum() > 5
    assert np.abs(difference[:, 1]).max() < 1e-6
    # Whole repeats are the same place. In the armpit, where the sleeve closes, they differ.
    difference[:, 0] -= np.round(difference[:, 0])
    assert (np.abs(difference[:, 0]) < 1e-6).mean() > (0.85 if "arm" in other else 0.999)
