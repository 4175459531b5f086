"""Meshes as props: read or refused with a reason, on the floor, and opaque to rays."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from synth.motion.config import MotionConfig
from synth.rooms.config import MeshUp, PropsConfig
from synth.rooms.props import find_meshes, load_mesh, prop_size, prop_spec
from synth.scene.build import build_scene
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_scene
from synth.scene.spec import PropSpec, SceneSpec
from tests.support.scenes import BODY, RIG, scene


def box(size=(0.4, 0.5, 1.2)) -> trimesh.Trimesh:
    return trimesh.creation.box(size)


def saved(mesh, path: Path) -> str:
    mesh.export(path)
    return str(path)


def corners(parts) -> tuple[np.ndarray, np.ndarray]:
    vertices = np.concatenate([part.vertices for part in parts])
    return vertices.min(0), vertices.max(0)


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".ply", ".glb"])
def test_a_mesh_stands_on_the_floor_above_the_origin(tmp_path, suffix):
    mesh = box().apply_translation((3, 4, 5))
    (part,) = load_mesh(saved(mesh, tmp_path / f"box{suffix}"), up=MeshUp.z)
    low, high = corners([part])
    np.testing.assert_allclose(low, (-0.2, -0.25, 0), atol=1e-6)
    np.testing.assert_allclose(high, (0.2, 0.25, 1.2), atol=1e-6)


def test_glb_files_have_y_up_and_others_z(tmp_path):
    for suffix, height in ((".glb", 0.5), (".stl", 1.2)):
        _, high = corners(load_mesh(saved(box(), tmp_path / f"box{suffix}")))
        assert high[2] == pytest.approx(height)


def test_millimetres_are_scaled(tmp_path):
    path = saved(box((400, 500, 1200)), tmp_path / "mm.stl")
    _, high = corners(load_mesh(path, 0.001))
    np.testing.assert_allclose(high, (0.2, 0.25, 1.2), atol=1e-6)


def test_inverted_faces_are_turned_outward(tmp_path):
    mesh = box()
    mesh.invert()
    (part,) = load_mesh(saved(mesh, tmp_path / "in.stl"))
    assert trimesh.Trimesh(part.vertices, part.faces).volume == pytest.approx(0.24)


def test_a_mesh_scene_keeps_parts_positions_and_colours(tmp_path):
    top, leg = box((1, 0.1, 0.6)).apply_translation((0, 0.75, 0)), box((0.1, 0.7, 0.1)).apply_translation((0, 0.35, 0))
    top.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 51, 255])
    )
    path = saved(trimesh.Scene([top, leg]), tmp_path / "table.glb")
    parts = load_mesh(path)
    assert len(parts) == 2
    assert (1.0, 0.0, 0.2) in [part.colour for part in parts]
    low, high = corners(parts)
    np.testing.assert_allclose(high - low, (1.0, 0.6, 0.8), atol=1e-6)


def open_box() -> trimesh.Trimesh:
    mesh = box()
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    return mesh


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("lid.obj", open_box(), "this mesh is open: 3 of its 18 edges do not join two faces; close its holes"),
        ("mm.stl", box((400, 500, 1200)), "this mesh is huge: 400 x 500 x 1.2e.03 m .*props.scale=0.001 .*millimetres"),
        ("dust.stl", box((4e-4, 5e-4, 1e-3)), "this mesh is tiny.*choose another props.scale"),
        ("flat.stl", box((1, 1, 0)), "this mesh is flat"),
        ("many.ply", trimesh.creation.icosphere(subdivisions=7), "327680 faces are too many"),
        ("torn.glb", b"glTFgarbage" * 9, "this mesh is broken"),
        ("torn.ply", b"ply garbage", "this mesh is broken"),
        ("gap.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", "this mesh is broken"),
        ("torn.stl", b"x" * 100, "this mesh is empty"),
        ("none.obj", b"", "this mesh is empty"),
    ],
)
def test_unfit_meshes_are_refused_with_a_remedy(tmp_path, name, content, message):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        content.export(path)
    with pytest.raises(ValueError, match=f"{name}: .*{message}"):
        load_mesh(str(path))


def test_paths_without_meshes_are_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("chairs")
    with pytest.raises(ValueError, match=r"a folder without meshes; expected files ending in \.obj"):
        find_meshes(str(tmp_path))
    with pytest.raises(ValueError, match="is no mesh"):
        find_meshes(str(tmp_path / "notes.txt"))
    with pytest.raises(FileNotFoundError, match=r"props.path: there is no file or folder"):
        find_meshes(str(tmp_path / "gone"))
    with pytest.raises(ValueError, match=r"props.scale: expected more than 0 metres per unit"):
        PropsConfig(scale=0.0)
    with pytest.raises(ValueError, match=r"props.path names none"):
        PropsConfig(scale=0.001)


def test_rays_pass_through_a_ring_and_people_do_not(tmp_path):
    upright = trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0))
    ring = trimesh.creation.torus(0.5, 0.12).apply_transform(upright)
    model = prop_spec(saved(ring, tmp_path / "ring.obj")).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom = np.zeros(1, np.int32)

    def meets(x, z):
        return mujoco.mj_ray(model, data, np.array((x, -3.0, z)), np.array((0, 1.0, 0)), None, 1, -1, geom) >= 0

    # Its middle is 0.62 m high, its hole 0.38 m wide to each side.
    inside = [(0.01, 0.62), (0.3, 0.62), (0.01, 0.95)]
    on_it = [(0.501, 0.62), (-0.503, 0.61), (0.01, 0.13), (0.01, 1.12)]
    assert not any(meets(*at) for at in inside)
    assert all(meets(*at) for at in on_it)
    assert (model.geom_conaffinity > 0).all(), "people are stopped by its hull"


def test_the_size_of_a_prop_covers_it(tmp_path):
    space = prop_size(saved(box((1.0, 0.3, 0.9)), tmp_path / "bench.stl"))
    along = np.linspace(-0.5, 0.5, 21)
    edges = np.concatenate([np.column_stack([along, np.full(21, side)]) for side in (-0.15, 0.15)])
    assert (np.linalg.norm(edges[:, None] - space.discs[:, :2], axis=-1) <= space.discs[:, 2] + 1e-6).any(1).all()
    assert space.face == pytest.approx(0.9)


def test_scenes_with_meshes_of_your_own_survive_json(tmp_path):
    saved(box((300, 400, 900)), tmp_path / "b.stl")
    saved(trimesh.creation.cylinder(250, 700), tmp_path / "a.ply")
    config = SceneConfig(seconds=0.4, persons=[1, 1], props=[3, 3])
    spec = sample_scene(config, MotionConfig(), PropsConfig(str(tmp_path), 0.001), seed=0, clip=0).spec
    assert len(spec.props) == 3
    assert {Path(prop.kind).name for prop in spec.props} <= {"a.ply", "b.stl"}
    assert SceneSpec.from_json(spec.to_json()) == spec
    built = build_scene(spec, RIG)
    names = {f"{number}/{Path(prop.kind).stem}" for number, prop in enumerate(spec.props)}
    assert names <= set(built.objects)


def test_a_mesh_without_colours_takes_the_tint(tmp_path):
    red = box()
    red.visual.face_colors = [255, 0, 0, 255]
    kinds = [saved(box(), tmp_path / "plain.ply"), saved(red, tmp_path / "red.ply")]
    things = [PropSpec(kind, (1.5, y), 0.0, (0.0, 0.0, 1.0)) for kind, y in zip(kinds, (-1, 1), strict=True)]
    model = build_scene(scene([BODY], 5, props=things), RIG).model
    colours = [
        model.mat_rgba[model.geom_matid[model.body(f"{i}/{n}").geomadr[0]], :3] for i, n in ((0, "plain"), (1, "red"))
    ]
    np.testing.assert_allclose(colours, [(0, 0, 1), (1, 0, 0)])
