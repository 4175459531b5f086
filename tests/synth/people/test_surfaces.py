"""The cache of surfaces: the same as new ones, made again when damaged, bounded in number."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from synth.people import surfaces
from synth.people.body import Body
from synth.people.clothing import sample_looks
from synth.people.mjcf import add_person

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
