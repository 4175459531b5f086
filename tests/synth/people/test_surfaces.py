"""Surfaces of people: girths as in surveys, and close to the capsules."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree

from synth.people import surfaces
from synth.people.body import SEGMENTS, Body, body_at, segment_origins
from synth.people.clothing import Garment, PersonLooks, sample_looks
from synth.people.mjcf import add_person, capsules
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


# The cache of surfaces: the same as new ones, made again when damaged, bounded in number.

BODY = Body(1.71, 66, 1.0)
LOOKS = sample_looks(1.0, rng=np.random.default_rng(0))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("DMAE_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


@pytest.fixture
def made(monkeypatch) -> list:
    """Bodies whose surfaces were made while the test ran."""
    bodies, parts = [], surfaces.parts
    monkeypatch.setattr(surfaces, "parts", lambda body, looks: (bodies.append(body), parts(body, looks))[1])
    return bodies


def assert_same(one: list, other: list) -> None:
    assert len(one) == len(other) > 10
    for a, b in zip(one, other, strict=True):
        assert a[:2] == b[:2]
        for left, right in zip(a[2:], b[2:], strict=True):
            np.testing.assert_array_equal(left, right)
            assert left is None or left.dtype == right.dtype


@pytest.mark.parametrize("shaded", [True, False])
def test_cached_surfaces_equal_new_ones(folder, made, monkeypatch, shaded):
    first = surfaces.surfaces(BODY, LOOKS, shaded=shaded)
    again = surfaces.surfaces(BODY, LOOKS, shaded=shaded)
    assert made == [BODY]
    monkeypatch.setenv("DMAE_CACHE", "")
    assert_same(first, again)
    assert_same(first, surfaces.surfaces(BODY, LOOKS, shaded=shaded))
    assert made == [BODY, BODY]


def test_other_people_get_surfaces_of_their_own(folder, made):
    colours = replace(LOOKS, skin=(0.1, 0.2, 0.3), top=replace(LOOKS.top, pattern="plain"))
    for body, looks in (
        (BODY, LOOKS),
        (BODY, colours),
        (replace(BODY, age=12.0), LOOKS),
        (BODY, replace(LOOKS, hair="bun")),
    ):
        surfaces.surfaces(body, looks, shaded=False)
    assert len(made) == 3, "colours do not change surfaces"
    surfaces.surfaces(BODY, LOOKS, shaded=True)
    assert len(made) == 4


def test_a_change_of_code_invalidates_the_cache(folder, made, monkeypatch):
    surfaces.surfaces(BODY, LOOKS, shaded=False)
    monkeypatch.setattr(surfaces, "_made_by", lambda: "other code")
    surfaces.surfaces(BODY, LOOKS, shaded=False)
    assert len(made) == 2


@pytest.mark.parametrize(
    "spoil", [lambda b: b[:-1000], lambda b: b"", lambda b: b[:-9] + bytes([b[-9] ^ 255]) + b[-8:], lambda b: b * 2]
)
def test_damaged_files_are_made_anew(folder, made, spoil):
    first = surfaces.surfaces(BODY, LOOKS, shaded=True)
    (file,) = folder.iterdir()
    file.write_bytes(spoil(file.read_bytes()))
    assert_same(first, surfaces.surfaces(BODY, LOOKS, shaded=True))
    assert_same(first, surfaces.surfaces(BODY, LOOKS, shaded=True))
    assert len(made) == 2


def test_a_read_only_cache_is_tolerated(tmp_path, made, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("DMAE_CACHE", str(tmp_path / "file"))
    assert surfaces.surfaces(BODY, LOOKS, shaded=False)
    assert surfaces.surfaces(BODY, LOOKS, shaded=False)
    assert len(made) == 2


def test_the_default_cache_is_in_the_user_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("DMAE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    surfaces.surfaces(BODY, LOOKS, shaded=False)
    assert [path.name for path in tmp_path.iterdir()] == ["dmae-synth"]
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert surfaces._folder() == tmp_path / "home" / ".cache" / "dmae-synth"


def test_the_number_of_cached_files_is_bounded(folder, monkeypatch):
    monkeypatch.setattr(surfaces, "_SLOTS", 3)
    for number in range(8):
        surfaces.surfaces(replace(BODY, mass=60.0 + number), LOOKS, shaded=False)
    assert 1 < len(list(folder.iterdir())) <= 3


def _build(mass: float) -> float:
    return float(sum(s.vertices.sum() for s in surfaces.surfaces(replace(BODY, mass=mass), LOOKS, shaded=False)))


def test_processes_can_share_the_cache(folder, monkeypatch):
    masses = [60.0 + number % 3 for number in range(24)]
    with ProcessPoolExecutor(2) as pool:
        together = list(pool.map(_build, masses))
    monkeypatch.setenv("DMAE_CACHE", "")
    np.testing.assert_array_equal(together, [_build(mass) for mass in masses])
    assert len(list(folder.iterdir())) == 3, "no temporary file is left"


def test_models_from_cached_surfaces_are_identical(folder):
    def compiled() -> mujoco.MjModel:
        spec = mujoco.MjSpec()
        add_person(spec, 0, BODY, LOOKS, position=(0, 0, 1), rng=np.random.default_rng(0))
        return spec.compile()

    first, kept = compiled(), compiled()
    for field in ("mesh_vert", "mesh_normal", "mesh_texcoord", "mesh_face", "geom_pos", "geom_quat", "tex_data"):
        np.testing.assert_array_equal(getattr(first, field), getattr(kept, field))
