"""Everything that reads a file from elsewhere, each with files to change."""

import hashlib
import os
from dataclasses import asdict
from functools import partial
from pathlib import Path

from dmae.cli import DMAE
from dmae.command_line.options import Program
from dmae.command_line.presets import read_presets
from dmae.completion.training import CHECKPOINT, CheckedCheckpoints, newest_checkpoint
from dmae.completion.weights import load_model, model_card
from dmae.data.images import KINDS, Images
from dmae.data.resume import claim_folder
from dmae.data.skeleton import get_skeleton
from dmae.data.store import load_clip
from dmae.evaluation.report.page import read_shown_scores
from dmae.evaluation.review import load_decisions
from dmae.files.contents import read_text
from dmae.formats.calibrations import calibration_format, read_calibration
from dmae.formats.own import read_npz
from dmae.formats.poses import read_poses
from dmae.formats.reading import Clips, DataConfig
from dmae.formats.registry import pose_reader
from dmae.formats.registry import reader as recording_reader
from dmae.formats.trc import read_trc, write_trc
from synth.cli import SYNTH
from synth.datasets.verify import verify
from synth.labels.physical_labels import physical_labels
from synth.motion.readers import reader as motion_reader
from synth.motion.readers.dialects import read_mapping
from synth.motion.readers.takes import read_take_list
from synth.motion.source import read_take
from synth.rooms.props import MESHES, load_mesh, prop_size
from synth.rooms.room import compile_mjcf
from synth.scene.spec import SceneSpec
from tests.fuzz.own_files import OWN_FILES
from tests.fuzz.reader import Reader, repair_sums
from tests.fuzz.seed_files import (
    CAPTURE_PRESETS,
    FPS,
    PRESETS,
    TAKES,
    WRITE_RECORDING,
    spec,
    write_checkpoint,
    write_clip,
    write_colours,
    write_compressed,
    write_data_set,
    write_decisions,
    write_images,
    write_mesh,
    write_motion,
    write_physics,
    write_pose2sim_video,
    write_poses,
    write_presets,
    write_room,
    write_scores,
    write_weights,
)
from tests.support.animal_files import SPIDER, write_deeplabcut, write_dogs_nc
from tests.support.calibrations import TEXTS, write, write_storage
from tests.support.clips import walkers
from tests.support.tracked_recordings import write_coco_results, write_mmpose

TABLE = "frame,person,joint,x,y,z,source\n3,P1,neck,0.1,0.2,1.5,measured\n4,P1,nose,0.1,0.3,1.6,completed\n"


def _read_recording(name: str, folder: Path, **options) -> list:
    return list(Clips(DataConfig(name, str(folder), fps=None if name in ("clip", "shelf") else FPS, **options)))


def _read_images(kind: str, folder: Path) -> list:
    return list(Images(folder, ("left",), (0, 1), (kind,), ("a",)).read(kind, "left"))


def _read_colours(format: str, folder: Path) -> list:
    return list(Images(folder, ("left",), (0, 1), ("rgb",), (), format).read("rgb", "left"))


def _read_weights(folder: Path):
    model, _, _ = load_model(folder)
    return {**asdict(model.config), "weights": list(model.state_dict().values())}


def _repair_checkpoint(folder: Path) -> None:
    head, _, content = (folder / CHECKPOINT).read_bytes().partition(b"\n")
    if head.startswith(b"dmae checkpoint "):
        digest = hashlib.sha256(content).hexdigest().encode()
        (folder / CHECKPOINT).write_bytes(b"dmae checkpoint " + digest + b"\n" + content)


def _read_checkpoint(folder: Path):
    path = newest_checkpoint(folder)
    return path and list(CheckedCheckpoints().load_checkpoint(path).get("state_dict", {}).values())


def _read_room(folder: Path) -> dict:
    prop_size.cache_clear()
    model = compile_mjcf(folder / "room.xml")
    prop_size(str(folder / "room.xml"))
    return {"geoms": model.geom_size, "places": model.geom_pos}


def _read_presets(program: Program, command: str, folder: Path) -> None:
    read_presets(program.commands[command], folder)


def _read_motion(kind: str, folder: Path):
    (path,) = folder.glob(f"*.{kind}")
    os.utime(path, follow_symlinks=False)  # takes are cached until their file changes
    return read_take(path)


def _read_physics(folder: Path):
    found = physical_labels(folder)
    return found.contacts.persons, found.forces.residual, found.surface.visibility


_CLIP = partial(repair_sums, "clip.json", "arrays.safetensors")
_WEIGHTS = partial(repair_sums, "model.json", "weights.safetensors")

READERS = [
    *(
        Reader(f"calibration/{format}", partial(write, format=format), partial(read_calibration, size=(1000, 600)))
        for format in TEXTS
    ),
    *(
        Reader(f"calibration/opencv {kind}", lambda folder, kind=kind: write_storage(folder / f"camera.{kind}"),
               read_calibration)
        for kind in ("xml", "json")
    ),
    *(
        Reader(f"recording/{name}", write, partial(_read_recording, name), repair=_CLIP if name == "clip" else None)
        for name, write in WRITE_RECORDING.items()
    ),
    Reader("recording/mmpose pickles", partial(write_mmpose, kind="pkl"), partial(_read_recording, "mmpose"),
           ("predictions/*",)),
    Reader("recording/mmpose frames", partial(write_mmpose, kind="frames"), partial(_read_recording, "mmpose"),
           ("predictions/*/*",)),
    Reader("recording/coco results", write_coco_results, partial(_read_recording, "coco"), ("keypoints/*",)),
    Reader("recording/pose2sim video", write_pose2sim_video,
           lambda folder: list(Clips(DataConfig("pose2sim", str(folder)))), ("videos/*",)),
    Reader("recording/deeplabcut fixed", partial(write_deeplabcut, kind="fixed"),
           partial(_read_recording, "deeplabcut"), ("*.h5",)),
    Reader("recording/deeplabcut csv", partial(write_deeplabcut, kind="csv", animals=2),
           partial(_read_recording, "deeplabcut"), ("*.csv",)),
    Reader("poses/movement", write_dogs_nc, lambda folder: read_poses(folder / "poses.nc").poses),
    Reader("skeleton/skeleton", lambda folder: (folder / "spider.yaml").write_text(SPIDER),
           lambda folder: [str(get_skeleton(str(folder / "spider.yaml")))]),
    Reader("poses/clip", write_clip, lambda folder: read_poses(folder).poses, repair=_CLIP),
    Reader("poses/panoptic", WRITE_RECORDING["panoptic"], lambda folder: read_poses(folder).poses),
    Reader("poses/npz", write_poses, lambda folder: read_npz(folder / "poses.npz")),
    Reader("poses/csv", lambda folder: (folder / "poses.csv").write_text(TABLE),
           lambda folder: read_poses(folder / "poses.csv").poses),
    Reader("poses/trc", lambda folder: write_trc(walkers(3, 1), FPS, folder / "poses.trc"),
           lambda folder: read_trc(folder / "poses.trc"), errors=(ValueError, FileNotFoundError, KeyError)),
    *(Reader(f"motion/{kind}", partial(write_motion, kind), partial(_read_motion, kind), finite=True)
      for kind in ("amc", "bvh", "c3d", "npz")),
    Reader("motion/compressed", write_compressed, lambda folder: _read_motion("xz", folder), finite=True),
    Reader("motion/list", lambda folder: (folder / "takes.tsv").write_text(TAKES),
           lambda folder: [str(take) for take in read_take_list(folder / "takes.tsv")]),
    Reader("motion/mapping", lambda folder: (folder / "names.yaml").write_text("LeftUpLeg: lThigh\n'Hips': hip\n"),
           lambda folder: read_mapping(folder / "names.yaml")),
    *(Reader(f"mesh/{suffix[1:]}", partial(write_mesh, suffix),
             lambda folder, suffix=suffix: [*map(tuple, load_mesh.__wrapped__(str(folder / f"box{suffix}")))],
             finite=True)
      for suffix in MESHES),
    Reader("room/mjcf", write_room, _read_room, finite=True),
    Reader("preset/generate", partial(write_presets, PRESETS), partial(_read_presets, SYNTH, "generate")),
    Reader("preset/capture", partial(write_presets, CAPTURE_PRESETS), partial(_read_presets, DMAE, "capture")),
    Reader("clip/clip", write_clip, load_clip, repair=_CLIP),
    Reader("clip/physics", write_physics, _read_physics),
    Reader("clip/decisions", write_decisions, lambda folder: load_decisions(folder, walkers(3, 2))),
    Reader("clip/data set", write_data_set, lambda folder: verify(folder) and None, ("*.json*", "*/clip.json")),
    *(Reader(f"images/{kind}", partial(write_images, kind), partial(_read_images, kind)) for kind in KINDS),
    *(Reader(f"images/rgb as {format}", partial(write_colours, ending), partial(_read_colours, format))
      for format, ending in (("png", "png"), ("jpeg", "jpg"))),
    Reader("scene/spec", lambda folder: (folder / "spec.json").write_text(spec()),
           lambda folder: SceneSpec.from_json(read_text(folder / "spec.json")),
           unnamed=True),
    Reader("run/settings", lambda folder: (folder / "config.json").write_text('{"a": {"b": 1}, "c": [1, 2]}'),
           lambda folder: claim_folder(folder / "config.json", {"a": {"b": 1}, "c": [1, 2]}, "a data set")),
    Reader("model/weights", write_weights, _read_weights, ("model.json", "weights.safetensors"), _WEIGHTS,
           finite=True),
    Reader("model/card", write_weights, lambda folder: model_card(folder, [], "make"),
           ("model.json", "training.json", "config.yaml")),
    Reader("model/checkpoint", write_checkpoint, _read_checkpoint, (CHECKPOINT,), _repair_checkpoint),
    Reader("scores/scores", write_scores, lambda folder: read_shown_scores(folder) and None),
    *OWN_FILES,
]  # fmt: skip


def registered() -> set[str]:
    """Return the names that the registries have, of which each must have a reader here."""
    return {
        *(f"calibration/{name}" for name in calibration_format),
        *(f"recording/{name}" for name in recording_reader),
        *(f"poses/{name}" for name in pose_reader),
        *(f"motion/{name}" for name in motion_reader),
        *(f"mesh/{suffix[1:]}" for suffix in MESHES),
        *(f"images/{kind}" for kind in Images.__dataclass_fields__["kinds"].default),
    }
