"""Scenes in glTF and USD, read by other libraries: what moves and what sees is where the labels say."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import synth
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25
from dmae.data.store import load_clip
from dmae.formats.animation import WORLD_Y_UP
from synth.datasets.exporters.export import export
from synth.people.skinning import Skin, mesh_triangles
from synth.physics.body_state import load_state
from synth.physics.simulation import rebuilt_scene
from synth.rendering.sensor import encode
from synth.scene.spec import SceneSpec

_GL_FROM_CV = np.diag([1.0, -1.0, -1.0])
_WRIST = BODY25.index("l_wrist")[0]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "pass"
    list(
        synth.generate(
            seconds=0.4,
            scene=synth.preset("scene", "studio", persons=[2, 2]),
            interaction=synth.preset("interaction", "pass_box", bystanders=0),
            clips=1,
            seed=204,  # The second person wears a cap, a coat to the knees and a backpack.
            out=folder,
        )
    )
    return folder


@pytest.fixture(scope="module")
def clip(data):
    return load_clip(data / "000000")


@pytest.fixture(scope="module")
def drawn(data, clip):
    """The triangles (T, 3, 3) of the second person in the last frame, as images show them, for each material."""
    states = load_state(data / "000000")
    model = rebuilt_scene(clip, states, painted=False).model
    state = mujoco.MjData(model)
    state.qpos[:] = states.qpos[-1]
    mujoco.mj_kinematics(model, state)
    skin = Skin(model)
    skin.apply(state, (len(clip) - 1) / clip.fps)
    found = {}
    bodies = [number for number in range(model.nbody) if model.body(number).name.startswith("person1/")]
    own = np.flatnonzero((model.geom_group < 3) & np.isin(model.geom_bodyid, bodies))
    for geom in [*skin.persons[1].geoms, *np.setdiff1d(own, skin.persons[1].geoms)]:
        corners = mesh_triangles(model, geom) @ state.geom_xmat[geom].reshape(3, 3).T + state.geom_xpos[geom]
        found.setdefault(model.mat(model.geom_matid[geom]).name, []).append(corners)
    return {material: np.concatenate(parts) for material, parts in found.items()}


def test_skins_of_glb_are_the_surfaces_of_images(data, clip, drawn, tmp_path):
    pygltflib = pytest.importorskip("pygltflib")
    export(data, tmp_path / "out", "glb")
    content = pygltflib.GLTF2().load(tmp_path / "out/train/000000.glb")

    def values(number: int) -> np.ndarray:
        accessor, blob = content.accessors[number], content.binary_blob()
        kind = {5121: "u1", 5125: "<u4", 5126: "<f4"}[accessor.componentType]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor.type]
        at = content.bufferViews[accessor.bufferView].byteOffset
        return np.frombuffer(blob, kind, accessor.count * width, at).reshape(accessor.count, width)

    animation = content.animations[0]
    last = {
        (c.target.node, c.target.path): values(animation.samplers[c.sampler].output)[-1] for c in animation.channels
    }
    (node,) = (node for node in content.nodes if node.name == "person1")
    skin, mesh = content.skins[node.skin], content.meshes[node.mesh]
    above = {child: number for number, node in enumerate(content.nodes) for child in node.children or ()}
    turned = np.eye(4)
    turned[:3, :3] = WORLD_Y_UP
    moves = np.tile(turned, (len(skin.joints), 1, 1))
    for bone, joint in enumerate(skin.joints):
        chain = [joint]
        while (chain[-1], "rotation") in last:
            chain.append(above[chain[-1]])
        assert content.nodes[chain[-2]].name == "person1/pelvis"
        for each in chain[-2::-1]:
            step = np.eye(4)
            step[:3, :3] = Rotation.from_quat(last[each, "rotation"]).as_matrix()
            step[:3, 3] = last[each, "translation"]
            moves[bone] = moves[bone] @ step
    names = [content.nodes[joint].name.removeprefix("person1/") for joint in skin.joints]
    of_hand = content.nodes[above[skin.joints[names.index("l_hand")]]].name
    assert of_hand == "person1/l_forearm", "bones are attached to each other"
    moves = moves @ values(skin.inverseBindMatrices).reshape(-1, 4, 4).swapaxes(1, 2)
    attributes = mesh.primitives[0].attributes
    assert {primitive.attributes.POSITION for primitive in mesh.primitives} == {attributes.POSITION}
    weights = values(attributes.WEIGHTS_0)
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-6)
    blended = np.einsum("nk,nkij->nij", weights, moves[values(attributes.JOINTS_0)])
    points = np.einsum("nij,nj->ni", blended[:, :3, :3], values(attributes.POSITION)) + blended[:, :3, 3]
    assert len(np.unique(values(attributes.POSITION), axis=0)) > 0.97 * len(points)  # Parts share their borders
    colours = {material.name: material.pbrMetallicRoughness.baseColorFactor for material in content.materials}
    looks = SceneSpec.of(clip).persons[1].looks
    for name, plain in (("hair", [looks.hair_colour]), ("top", looks.top.colours), ("bottom", looks.bottom.colours)):
        shown = encode(np.array(colours[f"person1/{name}"][:3])) / 255
        np.testing.assert_allclose(shown, np.mean(plain, 0), atol=0.06)
    away = {}
    for primitive in mesh.primitives:
        name = content.materials[primitive.material].name
        away[name] = np.abs(points[values(primitive.indices).reshape(-1, 3)] - drawn[name] @ WORLD_Y_UP.T)
    assert away.keys() == drawn.keys()
    away = np.concatenate(list(away.values()))
    assert away.max() < 1e-5


def test_skins_of_usd_are_the_surfaces_of_images(data, drawn, tmp_path):
    pytest.importorskip("pxr", reason="usd-core, of the extra `usd`, is not installed")
    from pxr import Usd, UsdGeom, UsdSkel, Vt

    export(data, tmp_path / "out", "usd")
    stage = Usd.Stage.Open(str(tmp_path / "out/train/000000.usdc"))
    end = stage.GetEndTimeCode()
    root, cache = UsdSkel.Root.Get(stage, "/scene/person1"), UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    (binding,) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    (skinned,) = binding.GetSkinningTargets()
    mesh = UsdGeom.Mesh(skinned.GetPrim())
    points = Vt.Vec3fArray(mesh.GetPointsAttr().Get())
    moves = cache.GetSkelQuery(binding.GetSkeleton()).ComputeSkinningTransforms(end)
    assert skinned.ComputeSkinnedPoints(moves, points, end)
    triangles = np.array(points)[np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)]
    np.testing.assert_allclose(triangles, np.concatenate(list(drawn.values())), atol=2e-5)


def test_glb_has_people_things_cameras_and_lights_of_the_labels(data, clip, tmp_path):
    trimesh, pygltflib = pytest.importorskip("trimesh"), pytest.importorskip("pygltflib")
    export(data, tmp_path / "out", "glb")
    file = tmp_path / "out/train/000000.glb"
    scene, rig, truth = trimesh.load(file), clip.actual_rig, convert(clip.truth, BODY25).xyz
    np.testing.assert_allclose(
        scene.graph.get("person1: l_wrist")[0][:3, 3], WORLD_Y_UP @ truth[0, 1, _WRIST], atol=1e-6
    )
    assert scene.bounds[0][1] == pytest.approx(0, abs=1e-3)  # feet and floor
    names = " ".join(scene.graph.nodes)
    assert "person0/head" in names and "load0/box" in names and "floor" in names
    content = pygltflib.GLTF2().load(file)
    nodes = {node.name: node for node in content.nodes}
    for view, name in enumerate(rig.names):
        node = nodes[f"camera {name}"]
        np.testing.assert_allclose(node.translation, rig.centers[view], atol=1e-9)
        turn = trimesh.transformations.quaternion_matrix(np.roll(node.rotation, 1))[:3, :3]
        np.testing.assert_allclose(turn, rig.cam_from_world[view, :3, :3].T @ _GL_FROM_CV, atol=1e-9)
        camera = content.cameras[node.camera]
        height = rig.size[view][1]
        assert np.tan(camera.perspective.yfov / 2) == pytest.approx(height / 2 / rig.K[view, 1, 1])
        assert camera.extras["K"] == rig.K[view].tolist()
    assert content.extensions["KHR_lights_punctual"]["lights"]
    (moved,) = [
        c for c in content.animations[0].channels if c.target.node == content.nodes.index(nodes["person1: l_wrist"])
    ]
    view = content.bufferViews[content.accessors[content.animations[0].samplers[moved.sampler].output].bufferView]
    path = np.frombuffer(content.binary_blob(), "<f4", view.byteLength // 4, view.byteOffset).reshape(-1, 3)
    np.testing.assert_array_equal(path, truth[:, 1, _WRIST])


def test_usd_cameras_see_joints_where_the_labels_say(data, clip, tmp_path):
    pytest.importorskip("pxr", reason="usd-core, of the extra `usd`, is not installed")
    from pxr import Usd, UsdGeom

    export(data, tmp_path / "out", "usd")
    stage = Usd.Stage.Open(str(tmp_path / "out/train/000000.usdc"))
    rig, frame = clip.actual_rig, len(clip) - 1
    joint = convert(clip.truth, BODY25).xyz[frame, 1, _WRIST].astype(float)
    move = UsdGeom.XformCache(frame).GetLocalToWorldTransform(stage.GetPrimAtPath("/scene/person1__l_wrist"))
    np.testing.assert_allclose(move.ExtractTranslation(), joint, atol=1e-9)
    assert stage.GetTimeCodesPerSecond() == clip.fps
    for view, name in enumerate(rig.names):
        frustum = UsdGeom.Camera(stage.GetPrimAtPath(f"/scene/camera_{name}")).GetCamera(0).frustum
        x, y, _, w = np.r_[joint, 1] @ frustum.ComputeViewMatrix() @ np.array(frustum.ComputeProjectionMatrix())
        width, height = rig.size[view]
        seen = (x / w + 1) / 2 * width - 0.5, (1 - y / w) / 2 * height - 0.5
        expected = rig.undistorted[view : view + 1].project(joint[None])[0].ravel()
        np.testing.assert_allclose(seen, expected, atol=1e-3)


@pytest.mark.parametrize("format", ["glb", "usd"])
def test_a_single_frame_is_a_scene(data, clip, tmp_path, format):
    assert export(data, tmp_path / "out", format, every=len(clip))["splits"]["train"]["persons"] == 2
    if format == "glb":
        scene = pytest.importorskip("trimesh").load(tmp_path / "out/train/000000.glb")
        found = scene.graph.get("person1: l_wrist")[0][:3, 3]
        np.testing.assert_allclose(found, WORLD_Y_UP @ convert(clip.truth, BODY25).xyz[0, 1, _WRIST], atol=1e-6)
    else:
        pxr = pytest.importorskip("pxr", reason="usd-core, of the extra `usd`, is not installed")
        stage = pxr.Usd.Stage.Open(str(tmp_path / "out/train/000000.usdc"))
        assert stage.GetEndTimeCode() == stage.GetStartTimeCode() == 0
