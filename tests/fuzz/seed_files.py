"""Files of every kind that a reader reads, for the fuzzer to change."""

import json
import lzma
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import trimesh

from dmae.completion.network import DMAE
from dmae.completion.training import CHECKPOINT, CheckedCheckpoints
from dmae.completion.weights import save_model
from dmae.data.images import write_image, write_video
from dmae.data.skeleton import BODY25, SHELF14
from dmae.data.store import save_clip, write_manifest
from dmae.evaluation.review import Decision, ReviewVerdict, save_decisions
from dmae.formats.calibrations import write_calibration as write_rig
from dmae.formats.own import export_npz
from dmae.formats.panoptic import write_poses as write_panoptic_poses
from dmae.formats.writing import write_recording
from synth.labels.physical_labels import save_physical_labels
from synth.motion.config import MotionConfig
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_scene
from tests.support.animal_files import write_deeplabcut, write_movement, write_sleap
from tests.support.clips import full_clip, walkers
from tests.support.marker_files import c3d
from tests.support.marker_files import t_pose as marker_t_pose
from tests.support.motion_files import amc, bvh
from tests.support.physical_labels import made_labels
from tests.support.recordings import recording, write_frames, write_openpose_recording
from tests.support.smpl_files import write_smpl
from tests.support.tracked_recordings import (
    write_caliscope,
    write_freemocap,
    write_mediapipe,
    write_mmpose,
    write_released,
)
from tests.support.training import TINY_NETWORK

FPS = 25.0


def write_shelf(folder: Path) -> None:
    from dmae.formats.shelf import BODY25_LINKS

    clip = recording(BODY25, 3, 2)
    (folder / "detection").mkdir()
    cameras = {
        str(view): {"K": K.ravel().tolist(), "RT": pose[:3].ravel().tolist(), "imgSize": size.tolist()}
        for view, (K, pose, size) in enumerate(zip(clip.rig.K, clip.rig.cam_from_world, clip.rig.size, strict=True))
    }
    (folder / "calibration.json").write_text(json.dumps(cameras))
    for view in range(2):
        lines = ["4 3"]
        for frame in range(3):
            for joint in range(25):
                rows = [f"0.{view + 3} 0.4", f"0.{frame + 2} 0.{joint + 10}", "0.9 0.8"]
                lines += ["2", *rows] if joint % 2 == 0 else ["0", "", "", ""]
            for a, b in BODY25_LINKS:
                lines += ["0.9 0.1", "0.2 0.8"] if a % 2 == b % 2 == 0 else [""] * (2 * (a % 2 == 0))
        (folder / f"detection/{view}.txt").write_text("\n".join(lines) + "\n")
    rows = [" ".join(str(j / 10) for j in range(15)) for _ in range(3)]
    person = ["1", "0", *rows, " ".join(["1"] * 15)]
    (folder / "gt.txt").write_text("\n".join(["15 3", *person * 3]) + "\n")


def write_panoptic(folder: Path) -> None:
    from dmae.data.skeleton import PANOPTIC19

    clip = recording(BODY25, 3, 2)
    write_frames(clip, folder)
    write_rig(clip.rig, folder / "calibration_x.json", "panoptic")
    write_panoptic_poses(walkers(3, 2, PANOPTIC19), FPS, folder)


def write_pose2sim(folder: Path) -> None:
    clip = recording(BODY25, 3, 2)
    write_frames(clip, folder / "pose", "{camera}_json/{camera}_{frame:06d}.json")
    (folder / "calibration").mkdir()
    write_rig(clip.rig, folder / "calibration/Calib.toml", "pose2sim")
    (folder / "Config.toml").write_text("[project]\nframe_rate = 30\n[pose]\npose_model = 'BODY_25'\n")


def write_pose2sim_video(folder: Path) -> None:
    write_pose2sim(folder)
    (folder / "Config.toml").write_text("[pose]\npose_model = 'BODY_25'\n")
    write_video(folder / "videos/cam0.mp4", np.zeros((3, 16, 16, 3), np.uint8), 30)


def write_released_with_truth(folder: Path) -> None:
    write_released(folder)
    truth = np.empty((3, 2), object)
    for place in np.ndindex(truth.shape):
        truth[place] = np.ones((15, 3)) if place[1] else []
    np.save(folder / "shelf_3d_eval_4dassoc.npy", truth, allow_pickle=True)


def write_clip(folder: Path) -> None:
    save_clip(replace(full_clip(3, 2), poses=walkers(3, 2)), folder)


def write_data_set(folder: Path) -> None:
    for name in ("000000", "000001"):
        save_clip(replace(full_clip(3, 2), id=name), folder / name)
    write_manifest(folder, [{"id": name, "status": "ok", "seed": 0, "frames": 3} for name in ("000000", "000001")])
    (folder / "config.json").write_text(json.dumps({"scene": {"fps": 25.0}, "images": "none"}))


def write_decisions(folder: Path) -> None:
    decisions = [Decision(1, "neck", 0, 2, ReviewVerdict.blank), Decision(0, "nose", 1, 1, ReviewVerdict.accept)]
    save_decisions(folder, walkers(3, 2), decisions)


def write_physics(folder: Path) -> None:
    save_physical_labels(made_labels(frames=2, views=2, persons=1), folder)


@cache
def _model():
    import torch

    torch.manual_seed(0)
    return DMAE(TINY_NETWORK, len(SHELF14)).eval()


def write_weights(folder: Path) -> None:
    clips = ["000000", "validation 000001"]
    facts = {"denoises": False, "calibration": None, "steps": 12, "validation_clips": clips[1:]}
    save_model(_model(), SHELF14, folder, facts)
    (folder / "training.json").write_text(json.dumps({"clips": dict.fromkeys(clips, "")}))
    (folder / "config.yaml").write_text(
        "data: {path: runs/walks}\nvalidation_data: [runs/dances]\nmax_minutes: null\n"
        "learning:\n  batch: 16\n  lr: 0.002\n  loss: relative\nseed: 0\n"
    )


def write_checkpoint(folder: Path) -> None:
    weights = dict(list(_model().state_dict().items())[:3])
    state = {"state_dict": weights, "epoch": 1, "global_step": 10, "loops": {"fit": [1, 2, {"x": 1.5}]}}
    CheckedCheckpoints().save_checkpoint(state, folder / CHECKPOINT)


@cache
def _scores() -> str:
    import tempfile

    from dmae.evaluation.evaluate import evaluate
    from tests.support.scored_clips import circling, config

    with tempfile.TemporaryDirectory() as folder:
        save_clip(circling(frames=60), Path(folder))
        return json.dumps(evaluate(config(folder, methods=["linear"], input="perturbed_poses")))


def write_scores(folder: Path) -> None:
    (folder / "scores.json").write_text(_scores())


@cache
def spec() -> str:
    config = SceneConfig(seconds=0.2, arena="office", props=[1, 2])
    return sample_scene(config, MotionConfig(), seed=0, clip=0).spec.to_json()


def write_mesh(suffix: str, folder: Path) -> None:
    mesh = trimesh.creation.box((0.4, 0.5, 1.2))
    mesh.export(folder / f"box{suffix}")
    if suffix == ".obj":
        text = (folder / "box.obj").read_text()
        (folder / "box.obj").write_text("mtllib box.mtl\nusemtl red\n" + text)
        (folder / "box.mtl").write_text("newmtl red\nKd 0.8 0.1 0.1\n")


ROOM = """<mujoco model="room">
  <compiler angle="radian" meshdir="."/>
  <include file="more.xml"/>
  <custom><text name="floor" data="tiles oak"/><numeric name="props" data="0 1"/></custom>
  <asset><material name="floor" specular="0.1"/><material name="wall"/><mesh name="m" file="cube.obj"/></asset>
  <worldbody>
    <light type="spot" pos="0 0 3" dir="0 0 -1" diffuse="0.4 0.4 0.4"/>
    <geom name="floor" type="plane" size="5 5 0.1" material="floor"/>
    <body name="shelf" pos="1 0 0"><geom type="box" size="0.4 0.2 0.9" contype="0" conaffinity="2147483647"/>
      <replicate count="3" offset="0 0.5 0"><geom type="sphere" size="0.1"/></replicate>
      <geom type="mesh" mesh="m"/></body>
  </worldbody>
</mujoco>
"""
MORE = '<mujocoinclude><worldbody><geom type="capsule" fromto="0 0 0 0 0 1" size="0.1"/></worldbody></mujocoinclude>'
CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def write_room(folder: Path) -> None:
    (folder / "room.xml").write_text(ROOM)
    (folder / "more.xml").write_text(MORE)
    (folder / "cube.obj").write_text(CUBE)


PRESETS = {
    "scene": "arena: studio\npersons: [2, 4]\nseconds: 12.04\nmiddle: [0.6, -0.2]\n",
    "rig": "name: mine\ncameras:\n  - {name: a, size: [64, 48], focal: 50, position: [4, 0, 2], target: [0, 0, 1]}\n",
    "motion": "kind: procedural\nweights: {kick: 3}\n",
    "detector": (
        "# A detector.\ndefaults: [clean, _self_]\nname: mine\nnoise: {minimum: 2.0, bias: 0.4}\nghosts: {count: 0.5}\n"
    ),
}


CAPTURE_PRESETS = {"capture": "defaults: [default, _self_]\nth_p: 0.2\ntracking: {coasting_s: 0.5}\n"}


def write_presets(presets: dict[str, str], folder: Path) -> None:
    for group, text in presets.items():
        (folder / group).mkdir()
        (folder / group / "mine.yaml").write_text(text)


def write_motion(kind: str, folder: Path) -> None:
    if kind == "bvh":
        bvh(
            folder / "take.bvh",
            [{"lShldr": (-90, 0, 0), "rShldr": (90, 0, 0), "root": (n / 50, 0, 0)} for n in range(8)],
        )
    elif kind == "amc":
        amc(folder / "99_01.amc", [{"root": (n / 9, 17, 0, 0, 0, 0)} for n in range(8)])
    elif kind == "c3d":
        step = np.arange(12)[:, None] * (0.01, 0, 0)
        c3d(folder / "take.c3d", {name: place + step for name, place in marker_t_pose().items()}, frames=12)
    else:
        write_smpl(folder / "take.npz", sample_motion())


TAKES = "file\tsubject\tset\tseconds\na/02_01.bvh\t2\ttrain\t3.5\n60_01.amc\t60\ttest\t12.1\n"


def write_compressed(folder: Path) -> None:
    write_motion("bvh", folder)
    plain = folder / "take.bvh"
    (folder / "take.bvh.xz").write_bytes(lzma.compress(plain.read_bytes()))
    plain.unlink()


@cache
def sample_motion():
    from synth.motion.source import load_motion

    return load_motion(MotionConfig(), seconds=0.5, fps=30, rng=np.random.default_rng(0))


def write_poses(folder: Path) -> None:
    export_npz(walkers(3, 2), FPS, folder / "poses.npz")


WRITE_RECORDING = {
    "caliscope": write_caliscope,
    "freemocap": write_freemocap,
    "mediapipe": write_mediapipe,
    "mmpose": write_mmpose,
    "deeplabcut": lambda folder: write_deeplabcut(folder, kind="h5"),
    "sleap": write_sleap,
    "movement": write_movement,
    "clip": write_clip,
    "coco": lambda folder: write_recording(full_clip(3, 2), folder, "coco"),
    "easymocap": lambda folder: write_recording(full_clip(3, 2), folder, "easymocap"),
    "openpose": lambda folder: write_openpose_recording(recording(BODY25, 3, 2), folder),
    "panoptic": write_panoptic,
    "pose2sim": write_pose2sim,
    "released": write_released_with_truth,
    "shelf": write_shelf,
}


_IMAGE = np.arange(16 * 16).reshape(16, 16)
_WRITE_IMAGE = {
    "depth": lambda path, frame: write_image("depth", path, _IMAGE.astype(np.float32) / 100),
    "ids": lambda path, frame: write_image("ids", path, _IMAGE),
    "parts": lambda path, frame: write_image("parts", path, _IMAGE),
    "normals": lambda path, frame: write_image("normals", path, np.broadcast_to([0.6, 0.0, 0.8], (16, 16, 3))),
    "flow": lambda path, frame: write_image("flow", path, np.dstack([_IMAGE, -_IMAGE]) / 8.0),
    "amodal": lambda path, frame: write_image("amodal", path, _IMAGE.astype(np.uint32) << 8 * frame),
}


def write_images(kind: str, folder: Path) -> None:
    if kind == "rgb":
        rgb = np.random.default_rng(0).integers(0, 255, (4, 16, 16, 3)).astype(np.uint8)
        write_video(folder / "rgb/left.mp4", rgb, 25)
        return
    for frame in range(2):
        _WRITE_IMAGE[kind](folder / f"{kind}/left/{frame:06d}.png", frame)


def write_colours(ending: str, folder: Path) -> None:
    for frame in range(2):
        write_image("rgb", folder / f"rgb/left/{frame:06d}.{ending}", np.dstack([_IMAGE] * 3).astype(np.uint8))
