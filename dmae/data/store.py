"""Clips and data sets on disk: one folder per clip, with arrays in one safetensors file and the rest in one JSON."""

import hashlib
import json
import os
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.images import Images
from dmae.data.labels import DetectionLabels, OcclusionLabels
from dmae.data.skeleton import decode_skeleton, encode
from dmae.files.arrays import digest_of, read_tensors, tensor_pieces
from dmae.files.checks import child
from dmae.files.contents import read_text, write_atomic
from dmae.files.mapped import frame_blocks
from dmae.files.structured import parse_json, read_json

FORMAT = 1
MANIFEST = "manifest.jsonl"
CHECKSUMS = "checksums.json"
_LABELS = {
    "occlusion": {
        "visibility": "visibility",
        "occluder": "hidden_by",
        "depth_margin": "depth_margin",
        "visible_pixels": "visible_pixels",
        "amodal_pixels": "amodal_pixels",
    },
    "detection_labels": {
        "person": "detected_person",
        "joint_person": "detected_joint_person",
        "error": "detected_error",
        "offset_px": "detected_off",
    },
}
"""Fields of the labels of a clip, and the names of their arrays on disk. Older clips lack some of them."""


def save_clip(clip: Clip, folder: Path) -> None:
    """Write a clip to a folder, over the clip in it, if any, with the path of its images, which are not copied.

    Raises ValueError if the clip contains numbers that `load_clip` refuses, infinite coordinates for example.
    """
    clip.check_numbers()
    folder = Path(folder)
    arrays, digest = _arrays(clip), hashlib.sha256()
    meta = {
        "format": FORMAT,
        "id": clip.id,
        "fps": clip.fps,
        "cameras": clip.rig.names,
        "skeletons": {
            name: encode(getattr(clip, name).skeleton)
            for name in ("detections", "truth", "poses")
            if getattr(clip, name) is not None
        },
        "objects": clip.occlusion.objects if clip.occlusion else (),
        "images": _images_meta(clip.images, folder),
        "provenance": clip.provenance,
    }
    # The checksums of a clip that was in this folder are not valid for the new clip.
    (folder / CHECKSUMS).unlink(missing_ok=True)
    # The JSON is written last and contains the checksum of the arrays, so that loading detects files that do not match.
    write_atomic(folder / "arrays.safetensors", digest_of(tensor_pieces(arrays), digest))
    write_atomic(folder / "clip.json", json.dumps(meta | {"sha256": digest.hexdigest()}, indent=1))


def _arrays(clip: Clip) -> dict[str, np.ndarray]:
    rigs = {"rig": clip.rig} | ({} if clip.true_rig is None else {"true_rig": clip.true_rig})
    arrays = {f"{key}.{f.name}": getattr(rig, f.name) for key, rig in rigs.items() for f in fields(rig)[1:]}
    for name in ("detections", "truth", "poses"):
        if (part := getattr(clip, name)) is not None:
            arrays |= {f"{name}.{f.name}": getattr(part, f.name) for f in fields(part)[1:]}
    for name in ("truth.rays", "poses.rays"):
        if name in arrays and all(np.isnan(arrays[name][part]).all() for part in frame_blocks(arrays[name])):
            del arrays[name]
    for part, names in _LABELS.items():
        labels = getattr(clip, part)
        stored = {} if labels is None else {stored: getattr(labels, name) for name, stored in names.items()}
        arrays |= {name: array for name, array in stored.items() if array is not None}
    return arrays


def _images_meta(images: Images | None, folder: Path) -> dict | None:
    if images is None:
        return None
    where = os.path.relpath(images.folder.resolve(), folder.resolve())
    some = [name for name in ("files", "borders") if getattr(images, name)]
    names = ("views", "frames", "kinds", "parts", "rgb", *some)
    return {"folder": where} | {name: getattr(images, name) for name in names}


def load_clip(folder: Path) -> Clip:
    """Return the clip in a folder. The arrays of a long clip stay in their file, and are read when they are accessed.

    Raises FileNotFoundError, or ValueError if a file is malformed, damaged or has another format version.
    """
    folder = Path(folder)
    if not (folder / "clip.json").is_file():
        data_set = "; this is a data set, name the folder of one clip in it" if (folder / MANIFEST).is_file() else ""
        data_set = data_set if folder.exists() else ", found no such folder"
        raise FileNotFoundError(f"{folder}: expected a clip folder holding clip.json and arrays.safetensors{data_set}")
    meta = read_json(folder / "clip.json")
    found = meta.get("format") if isinstance(meta, dict) else None
    if found != FORMAT:
        raise ValueError(f"{folder / 'clip.json'}: expected a clip of format {FORMAT}, found format {found!r}")
    path = folder / "arrays.safetensors"
    arrays = read_tensors(path, meta.get("sha256"))
    try:
        clip = assemble_clip(folder, meta, arrays)
        clip.check_numbers()
    except KeyError as error:
        raise ValueError(f"{folder}: clip.json or arrays.safetensors lacks {error}") from None
    except (SafetensorError, ValueError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f"{folder}: clip.json and arrays.safetensors are no clip: {error}") from None
    return clip


def assemble_clip(folder: Path, meta: dict, arrays: dict[str, np.ndarray]) -> Clip:
    """Return the clip of a folder from the content of its JSON, and from its arrays of all frames or some frames."""
    if not isinstance(meta["id"], str) or not isinstance(meta["provenance"], dict):
        raise ValueError("expected an id that is a text, and a provenance that is an object")
    if not isinstance(meta["objects"], list) or not all(isinstance(name, str) for name in meta["objects"]):
        raise ValueError("expected objects to be a list of texts")
    parts: dict[str, Any] = {name: _part(name, skeleton, arrays) for name, skeleton in meta["skeletons"].items()}
    images = meta["images"]
    if images:
        listed = {name: tuple(images[name]) for name in ("views", "frames", "kinds", "parts")}
        listed["files"] = tuple(images.get("files", ()))
        listed["borders"] = tuple((int(left), int(top)) for left, top in images.get("borders", ()))
        images = Images(folder / images["folder"], rgb=images["rgb"], **listed)
    return Clip(
        id=meta["id"],
        fps=meta["fps"],
        rig=_rig("rig", meta, arrays),
        true_rig=_rig("true_rig", meta, arrays) if "true_rig.K" in arrays else None,
        images=images,
        provenance=meta["provenance"],
        **parts,
        occlusion=_labels("occlusion", OcclusionLabels, arrays, objects=tuple(meta["objects"])),
        detection_labels=_labels("detection_labels", DetectionLabels, arrays),
    )


def is_of_frames(array: str) -> bool:
    """Return whether the first axis of an array on disk is frames. The first axis of arrays of cameras is views."""
    return array.startswith(("detections.", "truth.", "poses.")) or any(
        array in each.values() for each in _LABELS.values()
    )


def _rig(name: str, meta: dict, arrays: dict[str, np.ndarray]) -> CameraRig:
    return CameraRig(meta["cameras"], **{f.name: arrays[f"{name}.{f.name}"] for f in fields(CameraRig)[1:]})


def _part(name: str, skeleton: str | dict, arrays: dict[str, np.ndarray]) -> Detections2D | Poses3D:
    kind = Detections2D if name == "detections" else Poses3D
    values: dict[str, Any] = {f.name: arrays[f"{name}.{f.name}"] for f in fields(kind)[1:] if f.name != "rays"}
    if kind is Poses3D:
        # The array of rays is not stored if it contains no ray.
        values["rays"] = arrays.get(f"{name}.rays")
    return kind(decode_skeleton(skeleton, name), **values)


def _labels(part: str, kind: type, arrays: dict[str, np.ndarray], **more) -> Any:
    """Return the labels of a clip; None if their first array was not stored."""
    first, *_ = _LABELS[part].values()
    if first not in arrays:
        return None
    return kind(**{name: arrays.get(stored) for name, stored in _LABELS[part].items()}, **more)


def clip_folders(path: Path) -> list[Path]:
    """Return the folders of the clips of a data set with status ok, in the order of its manifest; or the clip itself.

    Raises FileNotFoundError if the path is neither a clip nor a data set; ValueError if all clips failed.
    """
    path = Path(path)
    if (path / "clip.json").is_file():
        return [path]
    if (path / MANIFEST).is_file():
        folders = [path / line["id"] for line in read_manifest(path) if line["status"] == "ok"]
        if not folders:
            raise ValueError(f"{path}: no clip of this data set is ok, nothing to do")
        return folders
    found = "neither; dmae capture data=... makes a clip of a recording" if path.exists() else "no such folder"
    raise FileNotFoundError(f"{path}: expected a clip (clip.json) or a data set ({MANIFEST}), found {found}")


def read_manifest(path: Path) -> list[dict]:
    """Return the lines of the manifest of a data set, one per clip: `id`, `status`, `seed`, `quality` and more.

    Raises FileNotFoundError, or ValueError if a line is malformed, or its clip would be outside the data set.
    """
    file, lines = Path(path) / MANIFEST, []
    for number, text in enumerate(read_text(file).splitlines(), 1):
        try:
            try:
                line = parse_json(text)
            except ValueError as error:
                raise ValueError(f"expected JSON, {error}") from None
            if not isinstance(line, dict) or not {"id", "status"} <= line.keys():
                raise ValueError(f"expected an object with id and status, found {text:.60}")
            child(Path(path), line["id"], "clip")
        except ValueError as error:
            raise ValueError(f"{file}, line {number}: {error}") from None
        lines.append(line)
    return lines


def all_failed(lines: list[dict]) -> str:
    """Say that all clips of these lines of a manifest failed, and why."""
    if len(lines) == 1:
        return f"the clip failed: {lines[0]['reason']}"
    return f"all {len(lines)} clips failed, the first because of this: {lines[0]['reason']}"


def write_manifest(path: Path, lines: list[dict]) -> None:
    """Write the manifest of a data set, sorted by clip id."""
    ordered = sorted(lines, key=lambda line: line["id"])
    write_atomic(Path(path) / MANIFEST, "".join(json.dumps(line) + "\n" for line in ordered))
