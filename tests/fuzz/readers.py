"""Everything that reads a file from elsewhere, each with files to change."""

import hashlib
import json
import lzma
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import trimesh

from dmae.cli import DMAE
from dmae.command_line.presets import copy_presets
from dmae.command_line.renamed_presets import renamed_options
from dmae.completion.model_card import model_card
from dmae.completion.network.build import build_network
from dmae.completion.training.checkpoints import CHECKPOINT, CheckedCheckpoints, newest_checkpoint
from dmae.completion.weights import load_model, save_model
from dmae.data.cameras import CameraRig
from dmae.data.images import (
    KINDS,
    Images,
    write_amodal,
    write_depth,
    write_flow,
    write_ids,
    write_normals,
    write_parts,
    write_rgb,
    write_video,
)
from dmae.data.resume import claim_folder
from dmae.data.skeleton import BODY25, SHELF14
from dmae.data.store import load_clip, save_clip, write_manifest
from dmae.evaluation.report_section import read_scores
from dmae.files.contents import read_text
from dmae.formats.calibrations.files import read_calibration
from dmae.formats.calibrations.registry import calibration_format
from dmae.formats.npz import export_npz, read_npz
from dmae.formats.panoptic import write_poses as write_panoptic
from dmae.formats.reading import DataConfig, load
from dmae.formats.registry import reader as recording_reader
from dmae.formats.trc import read_trc, write_trc
from dmae.formats.writing import write_recording
from synth.cli import SYNTH
from synth.datasets.verify import verify
from synth.motion.readers import reader as motion_reader
from synth.motion.readers.joint_names import read_mapping
from synth.motion.readers.smpl import write_npz as write_smpl
from synth.motion.readers.take_lists import read_take_list
from synth.motion.source import MotionConfig, read_take
from synth.rooms.meshes import MESHES, load_mesh
from synth.rooms.mjcf import compile_mjcf
from synth.rooms.props import prop_size
from synth.scene.sampling import sample_scene
from synth.scene.spec import SceneConfig, SceneSpec
from tests.support.calibrations import TEXTS
from tests.support.calibrations import write as write_camera
from tests.support.clips import full_clip, walkers
from tests.support.completers import SMALL
from tests.support.marker_files import c3d
from tests.support.marker_files import t_pose as marker_t_pose
from tests.support.motion_files import amc, bvh
from tests.support.recordings import recording, write_frames, write_openpose_recording


@dataclass(frozen=True)
class Reader:
    """Something that reads files.

    Attributes:
        name: `<kind>/<name>`; `tests.fuzz.test_fuzz` checks that the registries' names are all there.
        write: Writes the files into an empty folder.
        read: Reads them, and returns what should be looked at.
        targets: Patterns of the files that are changed, one at a time.
        repair: Called after a change: puts checksums right, which would hide what lies behind.
        finite: Whether NaN is implausible in what is read.
        unnamed: Whether it reads a text, so that errors cannot name a file.
        errors: Those that its documentation states.
    """

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]
    targets: tuple[str, ...] = ("**/*",)
    repair: Callable[[Path], None] | None = None
    finite: bool = False
    unnamed: bool = False
    errors: tuple[type[Exception], ...] = (ValueError, FileNotFoundError)


FPS = 25.0


def _read_recording(name: str, folder: Path, **options) -> list:
    return list(load(DataConfig(name, str(folder), fps=None if name in ("clip", "shelf") else FPS, **options)))


def _write_shelf(folder: Path) -> None:
    from dmae.formats.recordings.candidate_assembly import BODY25_LINKS

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


def _write_panoptic(folder: Path) -> None:
    from dmae.data.skeleton import PANOPTIC19
    from dmae.formats.calibrations.files import write_calibration

    clip = recording(BODY25, 3, 2)
    write_frames(clip, folder)
    write_calibration(clip.rig, folder / "calibration_x.json", "panoptic")
    write_panoptic(walkers(3, 2, PANOPTIC19), FPS, folder)


def _write_pose2sim(folder: Path) -> None:
    from dmae.formats.calibrations.files import write_calibration

    clip = recording(BODY25, 3, 2)
    write_frames(clip, folder / "pose", "{camera}_json/{camera}_{frame:06d}.json")
    (folder / "calibration").mkdir()
    write_calibration(clip.rig, folder / "calibration/Calib.toml", "pose2sim")
    (folder / "Config.toml").write_text("[project]\nframe_rate = 30\n[pose]\npose_model = 'BODY_25'\n")


def _write_pose2sim_video(folder: Path) -> None:
    _write_pose2sim(folder)
    (folder / "Config.toml").write_text("[pose]\npose_model = 'BODY_25'\n")
    write_video(folder / "videos/cam0.mp4", np.zeros((3, 16, 16, 3), np.uint8), 30)


def _write_released(folder: Path) -> None:
    clip = recording(BODY25, 3, 2)
    rig = clip.rig
    cameras = [
        {"K": rig.K[v].tolist(), "R": rig.cam_from_world[v, :3, :3].tolist(), "T": rig.cam_from_world[v, :3, 3],
         "res": [960.0, 600.0], "id": v, "Pos": rig.centers[v][:, None]}
        for v in range(2)
    ]  # fmt: skip
    np.save(folder / "camera_params.npy", cameras, allow_pickle=True)
    values = np.nan_to_num(np.concatenate([clip.detections.xy / (959, 599), clip.detections.score[..., None]], -1))
    found = {
        f"img_{v}": {f"{n:04d}": [{"identity": i, "meta": p} for i, p in enumerate(values[n, v])] for n in range(3)}
        for v in range(2)
    }
    np.save(folder / "shelf_eval_2d_detection_dict.npy", found, allow_pickle=True)
    truth = np.empty((3, 2), object)
    for place in np.ndindex(truth.shape):
        truth[place] = np.ones((15, 3)) if place[1] else []
    np.save(folder / "shelf_3d_eval_4dassoc.npy", truth, allow_pickle=True)


def _write_clip(folder: Path) -> None:
    save_clip(replace(full_clip(3, 2), poses=walkers(3, 2)), folder)


def _repair_sums(described: str, data: str, folder: Path) -> None:
    """Put the checksum of a file of arrays into the JSON beside it."""
    try:
        meta = json.loads((folder / described).read_bytes())
        meta["sha256"] = hashlib.sha256((folder / data).read_bytes()).hexdigest()
    except (ValueError, TypeError, RecursionError):
        return
    (folder / described).write_text(json.dumps(meta))


def _write_data_set(folder: Path) -> None:
    for name in ("000000", "000001"):
        save_clip(replace(full_clip(3, 2), id=name), folder / name)
    write_manifest(folder, [{"id": name, "status": "ok", "seed": 0, "frames": 3} for name in ("000000", "000001")])
    (folder / "config.json").write_text(json.dumps({"scene": {"fps": 25.0}, "images": "none"}))


def _write_pictures(folder: Path) -> None:
    image = np.arange(16 * 16).reshape(16, 16)
    for frame in range(2):
        write_depth(folder / f"depth/left/{frame:06d}.png", image.astype(np.float32) / 100)
        write_ids(folder / f"ids/left/{frame:06d}.png", image)
        write_parts(folder / f"parts/left/{frame:06d}.png", image)
        write_normals(folder / f"normals/left/{frame:06d}.png", np.broadcast_to([0.6, 0.0, 0.8], (16, 16, 3)))
        write_flow(folder / f"flow/left/{frame:06d}.png", np.dstack([image, -image]) / 8.0)
        write_amodal(folder / f"amodal/left/{frame:06d}.png", image.astype(np.uint32) << 8 * frame)
        for ending in ("png", "jpg"):
            write_rgb(folder / f"{ending}/rgb/left/{frame:06d}.{ending}", np.dstack([image] * 3).astype(np.uint8))
    rgb = np.random.default_rng(0).integers(0, 255, (4, 16, 16, 3)).astype(np.uint8)
    write_video(folder / "rgb/left.mp4", rgb, 25)


def _read_pictures(kind: str, folder: Path) -> list:
    return list(Images(folder, ("left",), (0, 1), (kind,), ("a",)).read(kind, "left"))


def _read_colours(format: str, ending: str, folder: Path) -> list:
    return list(Images(folder / ending, ("left",), (0, 1), ("rgb",), (), format).read("rgb", "left"))


@cache
def _model():
    import torch

    torch.manual_seed(0)
    return build_network(SMALL, len(SHELF14)).eval()


def _write_weights(folder: Path) -> None:
    clips = ["000000", "validation 000001"]
    facts = {"denoises": False, "calibration": None, "steps": 12, "validation_clips": clips[1:]}
    save_model(_model(), SHELF14, folder, facts)
    (folder / "training.json").write_text(json.dumps({"clips": dict.fromkeys(clips, "")}))
    (folder / "config.yaml").write_text(
        "data: {path: runs/walks}\nvalidation_data: [runs/dances]\nmax_minutes: null\n"
        "learning:\n  batch: 16\n  lr: 0.002\n  loss: euclidean\nseed: 0\n"
    )


def _read_weights(folder: Path):
    model, _, _ = load_model(folder)
    return {**asdict(model.config), "weights": list(model.state_dict().values())}


def _write_checkpoint(folder: Path) -> None:
    weights = dict(list(_model().state_dict().items())[:3])
    state = {"state_dict": weights, "epoch": 1, "global_step": 10, "loops": {"fit": [1, 2, {"x": 1.5}]}}
    CheckedCheckpoints().save_checkpoint(state, folder / CHECKPOINT)


def _repair_checkpoint(folder: Path) -> None:
    head, _, content = (folder / CHECKPOINT).read_bytes().partition(b"\n")
    if head.startswith(b"dmae checkpoint "):
        digest = hashlib.sha256(content).hexdigest().encode()
        (folder / CHECKPOINT).write_bytes(b"dmae checkpoint " + digest + b"\n" + content)


def _read_checkpoint(folder: Path):
    path = newest_checkpoint(folder)
    return path and list(CheckedCheckpoints().load_checkpoint(path).get("state_dict", {}).values())


@cache
def _scores() -> str:
    import tempfile

    from dmae.evaluation.evaluate import evaluate
    from tests.support.scored_clips import circling, config

    with tempfile.TemporaryDirectory() as folder:
        save_clip(circling(frames=60), Path(folder))
        return json.dumps(evaluate(config(folder, methods=["linear"], input="perturbed_poses")))


def _write_scores(folder: Path) -> None:
    (folder / "scores.json").write_text(_scores())


def _read_scores(folder: Path) -> None:
    read_scores(folder / "scores.json")


@cache
def _spec() -> str:
    config = SceneConfig(seconds=0.2, arena="office", props=[1, 2])
    return sample_scene(config, MotionConfig(), seed=0, clip=0).spec.to_json()


def _write_mesh(suffix: str, folder: Path) -> None:
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


def _write_room(folder: Path) -> None:
    (folder / "room.xml").write_text(ROOM)
    (folder / "more.xml").write_text(MORE)
    (folder / "cube.obj").write_text(CUBE)


def _read_room(folder: Path) -> dict:
    prop_size.cache_clear()
    model = compile_mjcf(folder / "room.xml")
    prop_size(str(folder / "room.xml"))
    return {"geoms": model.geom_size, "places": model.geom_pos}


PRESETS = {
    "scene": "arena: studio\npersons: [2, 4]\nseconds: 12.04\nmiddle: [0.6, -0.2]\n",
    "rig": "name: mine\ncameras:\n  - {name: a, size: [64, 48], focal: 50, position: [4, 0, 2], target: [0, 0, 1]}\n",
    "motion": "kind: procedural\nweights: {kick: 3}\n",
    "detector": "# A detector.\ndefaults: [clean, _self_]\nname: mine\nnoise: {minimum: 2.0, bias: 0.4}\nghosts: 0.5\n",
}


def _write_presets(folder: Path) -> None:
    for group, text in PRESETS.items():
        (folder / group).mkdir()
        (folder / group / "mine.yaml").write_text(text)


@cache
def _options(program: str, command: str):
    return {"dmae": DMAE, "synth": SYNTH}[program].commands[command].options()


def _read_presets(folder: Path) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as copy:
        copy_presets(_options("synth", "generate"), folder, Path(copy), partial(renamed_options, "synth generate"))


def _write_motion(kind: str, folder: Path) -> None:
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
        motion = sample_motion()
        write_smpl(folder / "take.npz", motion)


TAKES = "file\tsubject\tset\tseconds\na/02_01.bvh\t2\ttrain\t3.5\n60_01.amc\t60\ttest\t12.1\n"


def _write_compressed(folder: Path) -> None:
    _write_motion("bvh", folder)
    plain = folder / "take.bvh"
    (folder / "take.bvh.xz").write_bytes(lzma.compress(plain.read_bytes()))
    plain.unlink()


@cache
def sample_motion():
    from synth.motion.source import load_motion

    return load_motion(MotionConfig(), seconds=0.5, fps=30, rng=np.random.default_rng(0))


def _read_motion(kind: str, folder: Path):
    (path,) = folder.glob(f"*.{kind}")
    os.utime(path, follow_symlinks=False)  # takes are cached until their file changes
    return read_take(path)


def _write_calibration(format: str, folder: Path) -> None:
    write_camera(folder, format)


def _read_calibration(folder: Path) -> CameraRig:
    return read_calibration(folder, size=(1000, 600))


def _write_poses(folder: Path) -> None:
    export_npz(walkers(3, 2), FPS, folder / "poses.npz")


WRITE_RECORDING = {
    "clip": _write_clip,
    "coco": lambda folder: write_recording(full_clip(3, 2), folder, "coco"),
    "easymocap": lambda folder: write_recording(full_clip(3, 2), folder, "easymocap"),
    "openpose": lambda folder: write_openpose_recording(recording(BODY25, 3, 2), folder),
    "panoptic": _write_panoptic,
    "pose2sim": _write_pose2sim,
    "released": _write_released,
    "shelf": _write_shelf,
}
_CLIP = partial(_repair_sums, "clip.json", "arrays.safetensors")
_WEIGHTS = partial(_repair_sums, "model.json", "weights.safetensors")

READERS = [
    *(Reader(f"calibration/{format}", partial(_write_calibration, format), _read_calibration) for format in TEXTS),
    *(
        Reader(f"recording/{name}", write, partial(_read_recording, name), repair=_CLIP if name == "clip" else None)
        for name, write in WRITE_RECORDING.items()
    ),
    Reader("recording/pose2sim video", _write_pose2sim_video,
           lambda folder: list(load(DataConfig("pose2sim", str(folder)))), ("videos/*",)),
    Reader("poses/npz", _write_poses, lambda folder: read_npz(folder / "poses.npz")),
    Reader("poses/trc", lambda folder: write_trc(walkers(3, 1), FPS, folder / "poses.trc"),
           lambda folder: read_trc(folder / "poses.trc"), errors=(ValueError, FileNotFoundError, KeyError)),
    *(Reader(f"motion/{kind}", partial(_write_motion, kind), partial(_read_motion, kind), finite=True)
      for kind in ("amc", "bvh", "c3d", "npz")),
    Reader("motion/compressed", _write_compressed, lambda folder: _read_motion("xz", folder), finite=True),
    Reader("motion/list", lambda folder: (folder / "takes.tsv").write_text(TAKES),
           lambda folder: [str(take) for take in read_take_list(folder / "takes.tsv")]),
    Reader("motion/mapping", lambda folder: (folder / "names.yaml").write_text("LeftUpLeg: lThigh\n'Hips': hip\n"),
           lambda folder: read_mapping(folder / "names.yaml")),
    *(Reader(f"mesh/{suffix[1:]}", partial(_write_mesh, suffix),
             lambda folder, suffix=suffix: [*map(tuple, load_mesh.__wrapped__(str(folder / f"box{suffix}")))],
             finite=True)
      for suffix in MESHES),
    Reader("room/mjcf", _write_room, _read_room, finite=True),
    Reader("preset/generate", _write_presets, _read_presets),
    Reader("clip/clip", _write_clip, load_clip, repair=_CLIP),
    Reader("clip/data set", _write_data_set, lambda folder: verify(folder) and None, ("*.json*", "*/clip.json")),
    *(Reader(f"images/{kind}", _write_pictures, partial(_read_pictures, kind), (f"{kind}/**/*",))
      for kind in KINDS),
    *(Reader(f"images/rgb as {format}", _write_pictures, partial(_read_colours, format, ending), (f"{ending}/**/*",))
      for format, ending in (("png", "png"), ("jpeg", "jpg"))),
    Reader("scene/spec", lambda folder: (folder / "spec.json").write_text(_spec()),
           lambda folder: SceneSpec.from_json(read_text(folder / "spec.json")),
           unnamed=True),
    Reader("run/settings", lambda folder: (folder / "config.json").write_text('{"a": {"b": 1}, "c": [1, 2]}'),
           lambda folder: claim_folder(folder / "config.json", {"a": {"b": 1}, "c": [1, 2]}, "a data set")),
    Reader("model/weights", _write_weights, _read_weights, ("model.json", "weights.safetensors"), _WEIGHTS,
           finite=True),
    Reader("model/card", _write_weights, lambda folder: model_card(folder, [], "make"),
           ("model.json", "training.json", "config.yaml")),
    Reader("model/checkpoint", _write_checkpoint, _read_checkpoint, (CHECKPOINT,), _repair_checkpoint),
    Reader("scores/scores", _write_scores, _read_scores),
]  # fmt: skip


def registered() -> set[str]:
    """Return the names that the registries have, of which each must have a reader here."""
    return {
        *(f"calibration/{name}" for name in calibration_format),
        *(f"recording/{name}" for name in recording_reader),
        *(f"motion/{name}" for name in motion_reader),
        *(f"mesh/{suffix[1:]}" for suffix in MESHES),
        *(f"images/{kind}" for kind in Images.__dataclass_fields__["kinds"].default),
    }
