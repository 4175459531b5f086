"""Scenes in glTF and USD, read by other libraries: what moves and what sees is where the labels say."""

from pathlib import Path

import numpy as np
import pytest

import synth
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25
from dmae.data.store import load_clip
from synth.datasets.exporters.export import export

_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
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
            seed=7,
            out=folder,
        )
    )
    return folder


@pytest.fixture(scope="module")
def clip(data):
    return load_clip(data / "000000")


def true_rig(clip):
    return clip.rig if clip.true_rig is None else clip.true_rig


def test_glb_has_people_things_cameras_and_lights_of_the_labels(data, clip, tmp_path):
    trimesh, pygltflib = pytest.importorskip("trimesh"), pytest.importorskip("pygltflib")
    export(data, tmp_path / "out", "glb")
    file = tmp_path / "out/train/000000.glb"
    scene, rig, truth = trimesh.load(file), true_rig(clip), convert(clip.truth, BODY25).xyz
    np.testing.assert_allclose(scene.graph.get("person1: l_wrist")[0][:3, 3], _Y_UP @ truth[0, 1, _WRIST], atol=1e-6)
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
    rig, frame = true_rig(clip), len(clip) - 1
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
