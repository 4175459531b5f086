"""Why are joints of people in plain sight not where they are? `docs/results/wrong_places.json`.

    python docs/tools/wrong_places.py data=meter       # the sets of `docs/tools/record.py realism`, and DMAE_DATA

BlazePose's second network gets the region of a person and returns its joints, so that nobody has to be found. The
same people are looked at with one thing changed at a time: the image, then the clothes, then what else is in the room.
A person in a real recording is looked at in the same way; its joints are those of OpenPose.
"""

import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from provenance import measured

import dmae
from dmae.data.cameras import CameraRig
from dmae.data.clip import Detections2D
from dmae.data.conversion import convert, convert_detections
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.json_values import json_text
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import BLAZEPOSE33, BODY25
from dmae.data.store import clip_folders, load_clip
from dmae.detection.detectors.landmarks import Network, Region, corrected_torso, find_person, pyramid_of
from dmae.detection.images import find_cameras
from synth.detector.parts import kind_of
from synth.people.skinning import let_swing
from synth.physics.body_state import load_state
from synth.recognition.realism import NEAR, in_plain_sight, sightings
from synth.rendering.renderer import Renderer
from synth.scene.build import build_scene
from synth.scene.spec import SceneSpec

FILE = Path(__file__).parents[2] / "docs/results/wrong_places.json"
COMMAND = "python docs/tools/wrong_places.py data=meter"
_PEOPLE, _PASSES = 40, 2
_AROUND = 1.05
"""Radius of the region relative to the greatest distance of a joint from the hips: the crown is not a joint."""
_FITS = 0.2
"""The network sees the person if the median error of the visible joints is below this fraction of the height."""
_UNDRAWN = 5
"""A geom group that is not drawn."""
_SEEN = 0.5
"""Confidence from which a joint that OpenPose found counts as visible."""
_REAL_STATURE = 1.65
"""Height of the person in the recording, m: the lengths of its limbs and trunk are those of bodies of 1.53 to 1.75."""
_KINDS = np.array([str(kind_of(joint)) for joint in BODY25.joints])
_PARTS = {
    "arms": ("elbow", "wrist"), "knees": ("knee",), "ankles": ("ankle",), "feet": ("big_toe", "heel"),
}  # fmt: skip
_INDEX = {joint: i for i, joint in enumerate(BODY25.joints)}


@dataclass(frozen=True)
class Seen:
    """A person in an image."""

    clip: Path
    place: tuple[int, int, int]  # Frame, view, person
    xyz: np.ndarray  # (25, 3) m
    xy: np.ndarray  # (25, 2) px
    visible: np.ndarray  # (25,)
    height: float  # Of the body, px
    rig: CameraRig


def main(data: str) -> None:
    network, rendered = Network("pose_landmark_full"), _rendered(Path(data))
    errors = {name: [] for name in (*_IMAGE, *_SCENES)}
    for number, (person, name, image) in enumerate(_images(rendered)):
        errors[name].append((person, _error(network, image, person)))
        if number % 100 == 0:
            print(number, person.clip, flush=True)
    real = {name: [] for name in ("by OpenPose in the same image", "by OpenPose in all four images")}
    for name, person, image in _real():
        real[name].append((person, _error(network, image, person)))
    measured_by = measured("mujoco")
    changes = [_row(name, some) for name, some in errors.items()]
    changes += [_row(f"a real person, joints {name}", some) for name, some in real.items()]
    offsets = []
    for kind in dict.fromkeys(_KINDS):
        cells = [_offset(some, kind) for some in (errors["as drawn"], *real.values())]
        offsets.append([f"`{kind}`", *cells])
    tables = {
        "changes": {
            "command": COMMAND,
            "columns": ["image", "people", "seen, %", "joints within 5 % of the height, %", *_PARTS],
            "rows": changes,
        },
        "offsets": {
            "command": COMMAND,
            "columns": ["joint", "rendered", *(f"real, {name}" for name in real)],
            "rows": offsets,
        },
    }
    FILE.write_text(json_text({"measured": measured_by, "tables": tables}) + "\n")
    for table in tables.values():
        print(*(" | ".join(row) for row in (table["columns"], *table["rows"])), sep="\n")


def _rendered(data: Path) -> list[Seen]:
    """Return people in plain sight, drawn from all images."""
    everybody = []
    for folder in sorted(each for part in data.glob("*/*") if part.name.isdigit() for each in clip_folders(part)):
        clip = load_clip(folder)
        seen, xyz = sightings(clip), convert(clip.truth, BODY25).xyz.astype(float)
        for frame, view, person in np.argwhere(in_plain_sight(seen)).tolist():
            place = frame, view, person
            joints = xyz[frame, person], seen.xy[place], seen.visible[place]
            everybody.append(Seen(folder, place, *joints, float(seen.height[place]), clip.actual_rig))
    drawn = generator(0, 0, Stream.VALIDATION).permutation(len(everybody))[:_PEOPLE]
    return [everybody[i] for i in sorted(drawn.tolist())]


def _curve(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    table = np.clip(255 * change(np.arange(256) / 255), 0, 255).astype(np.uint8)
    return lambda image: table[image]


def _sharper(image: np.ndarray) -> np.ndarray:
    soft = cv2.GaussianBlur(image, (0, 0), 1.5).astype(np.float32)
    return np.clip(2.0 * image - soft, 0, 255).astype(np.uint8)


def _noisy(image: np.ndarray) -> np.ndarray:
    noise = generator(0, 1, Stream.VALIDATION).normal(0, 8, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


_IMAGE: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "as drawn": lambda image: image,
    "brighter: to the power of 0.6": _curve(lambda x: x**0.6),
    "darker: to the power of 1.3": _curve(lambda x: x**1.3),
    "1.3 times the contrast": _curve(lambda x: 1.3 * (x - 0.4) + 0.45),
    "sharper": _sharper,
    "blurred by 1.2 px": lambda image: cv2.GaussianBlur(image, (0, 0), 1.2),
    "noise of 8 of 255": _noisy,
    "without colour": lambda image: np.repeat(image.mean(-1, keepdims=True), 3, -1).astype(np.uint8),
}
_SCENES = {
    "all in plain clothes and white shoes": {"dressed": True},
    "without other people": {"alone": True},
    "without people and things": {"alone": True, "empty": True},
}


def _images(people: list[Seen]) -> Iterator[tuple[Seen, str, np.ndarray]]:
    """Yield each person with the name of a change and its image."""
    for folder in dict.fromkeys(each.clip for each in people):
        clip, state, own = load_clip(folder), load_state(folder), [each for each in people if each.clip == folder]
        for person in own:
            image = clip.images.at("rgb", clip.rig.names[person.place[1]], person.place[0])
            for name, change in _IMAGE.items():
                yield person, name, change(image)
        for name, change in _SCENES.items():
            for number in dict.fromkeys(each.place[2] for each in own) if change.get("alone") else (None,):
                spec = SceneSpec.of(clip)
                scene = build_scene(_dressed(spec) if change.get("dressed") else spec, clip.actual_rig)
                let_swing(scene.model, state.qpos, clip.fps)
                ids, group = scene.geom_ids, scene.model.geom_group
                if number is not None:
                    group[(ids > 0) & (ids < FIRST_OBJECT_ID) & (ids != 1 + number)] = _UNDRAWN
                if change.get("empty"):
                    room = [k for k, each in enumerate(scene.objects) if each.startswith(("floor", "wall"))]
                    group[(ids >= FIRST_OBJECT_ID) & ~np.isin(ids, FIRST_OBJECT_ID + np.array(room))] = _UNDRAWN
                with Renderer(scene.model, ids, clip.actual_rig) as renderer:
                    for person in own:
                        frame, view, this = person.place
                        if number not in (None, this):
                            continue
                        seconds = frame / clip.fps
                        yield person, name, renderer.image(state.qpos[frame], view, ("rgb",), seconds=seconds).rgb


def _dressed(spec: SceneSpec) -> SceneSpec:
    persons = []
    for person in spec.persons:
        top, bottom = (replace(each, pattern="plain") for each in (person.looks.top, person.looks.bottom))
        looks = replace(person.looks, top=top, bottom=bottom, shoes=(0.85, 0.85, 0.85), sole=(0.13, 0.12, 0.11))
        persons.append(replace(person, looks=looks))
    return replace(spec, persons=tuple(persons))


def _real() -> Iterator[tuple[str, Seen, np.ndarray]]:
    """Yield a person who walks before four cameras, twice: with joints of OpenPose in the same image, and in all."""
    data = Path(os.environ["DMAE_DATA"], "pose2sim")
    folder = data / "S00_P00_SingleParticipant/S00_P00_T01_BalancingTrial"
    clip = dmae.read(folder)
    poses = dmae.capture(clip)
    number = int((poses.source != dmae.Source.ABSENT).sum((0, 2)).argmax())
    xyz = convert(dmae.complete(poses, fps=clip.fps), BODY25).xyz[:, number].astype(float)
    found = convert_detections(clip.detections, BODY25)
    # BODY_25B's neck is higher.
    neck, shoulders = _INDEX["neck"], BODY25.index("l_shoulder", "r_shoulder")
    xyz[:, neck], found.xy[..., neck, :] = xyz[:, shoulders].mean(1), found.xy[..., shoulders, :].mean(-2)
    found.score[..., neck] = found.score[..., shoulders].min(-1)
    projected, depth = clip.rig.project(xyz)
    for view, camera in enumerate(find_cameras(data / "videos")):
        for frame, image in enumerate(camera.read(0, len(camera))):
            if image is None or frame % 5:
                continue
            apart = np.linalg.norm(found.xy[frame, view] - projected[frame, view], axis=-1)
            own = int(np.nanmedian(np.where(np.isnan(apart).all(-1, keepdims=True), np.inf, apart), -1).argmin())
            visible = np.nan_to_num(found.score[frame, view, own]) >= _SEEN
            height = _REAL_STATURE * clip.rig.focal[view] / depth[frame, view, _INDEX["mid_hip"]]
            for name, xy in (
                ("by OpenPose in the same image", found.xy[frame, view, own].astype(float)),
                ("by OpenPose in all four images", projected[frame, view]),
            ):
                place = frame, view, number
                yield name, Seen(folder, place, xyz[frame], xy, visible, float(height), clip.rig), image


def _error(network: Network, image: np.ndarray, person: Seen) -> np.ndarray:
    """Return the errors (25, 2) of the joints that the network finds, relative to the height."""
    hips, neck = (person.xy[_INDEX[joint]] for joint in ("mid_hip", "neck"))
    radius = _AROUND * np.nanmax(np.linalg.norm(person.xy - hips, axis=-1))
    region = Region.around(hips + 0.5, hips + 0.5 + radius * (neck - hips) / np.linalg.norm(neck - hips))
    pyramid = pyramid_of(np.ascontiguousarray(image))
    for _ in range(_PASSES):
        found = find_person(network, pyramid, region)
        region = found.region or region
    shape = (1, 1, 1, len(BLAZEPOSE33))
    joints = Detections2D(BLAZEPOSE33, corrected_torso(found.xy).reshape(*shape, 2), np.ones(shape))
    return (convert_detections(joints, BODY25).xy[0, 0, 0].astype(float) - person.xy) / person.height


def _row(name: str, some: list[tuple[Seen, np.ndarray]]) -> list[str]:
    error = np.linalg.norm([vector for _, vector in some], axis=-1)
    counted = np.array([person.visible for person, _ in some]) & ~np.isnan(error)
    fits = np.array([np.median(own[which]) < _FITS for own, which in zip(error, counted, strict=True)])
    near, counted = error < NEAR, counted & fits[:, None]
    parts = [np.isin(_KINDS, kinds) for kinds in ((*_KINDS,), *_PARTS.values())]
    shares = [f"{100 * near[counted & part].mean():.1f}" for part in parts]
    return [name, str(len(some)), f"{100 * fits.mean():.1f}", *shares]


def _offset(some: list[tuple[Seen, np.ndarray]], kind: str) -> str:
    """Return the robust mean offset of a kind of joint: forward, outward and up its limb, cm."""
    maps, vectors = [], []
    for person, vector in some:
        frames, jacobian = _frames(person.xyz), _jacobian(person)
        for joint in np.flatnonzero((kind == _KINDS) & person.visible & np.isfinite(vector).all(-1)):
            outward = -1 if BODY25.joints[joint].startswith("r_") else 1
            each = jacobian[joint] @ frames[joint] * (1, outward, 1)
            if np.isfinite(each).all():
                maps.append(each)
                vectors.append(vector[joint])
    if len(vectors) < 20:
        return "-"
    maps, vectors, shift = np.array(maps), np.array(vectors), np.zeros(3)
    for _ in range(10):
        # Weights of absolute errors, below 1 % of the height those of squares.
        weight = np.maximum(np.linalg.norm(vectors - maps @ shift, axis=-1), 0.01) ** -0.5
        shift = np.linalg.lstsq((maps * weight[:, None, None]).reshape(-1, 3), (vectors * weight[:, None]).ravel())[0]
    return ", ".join(f"{100 * value:+.1f}" for value in shift)


def _jacobian(person: Seen) -> np.ndarray:
    """Return (25, 2, 3): the motion of each joint in the image, in heights, for 1 m along x, y and z."""
    moved = np.concatenate([person.xyz[None], person.xyz + 0.01 * np.eye(3)[:, None]])
    xy = person.rig.project(moved)[0][:, person.place[1]]
    return np.moveaxis(xy[1:] - xy[0], 0, -1) / 0.01 / person.height


def _frames(xyz: np.ndarray) -> np.ndarray:
    """Return the (25, 3, 3) axes of each joint, as columns: forward, to the left, and up its limb."""
    at = dict(zip(BODY25.joints, xyz, strict=True))
    ahead = np.cross(at["l_shoulder"] - at["r_shoulder"], at["neck"] - at["mid_hip"])
    frames = np.tile(_axes(at["neck"] - at["mid_hip"], ahead), (len(BODY25), 1, 1))
    for side in "lr":
        shoulder, elbow, wrist, hip, knee, ankle, heel, toe, small = (
            at[f"{side}_{name}"]
            for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "heel", "big_toe", "small_toe")
        )
        up = np.cross(toe - heel, small - toe)
        up = up * np.sign(up @ (knee - ankle))
        for name, axis, forward in (
            ("elbow", shoulder - elbow, ahead), ("wrist", elbow - wrist, ahead), ("knee", hip - ankle, toe - heel),
            ("ankle", knee - ankle, toe - heel), ("heel", up, toe - heel), ("big_toe", up, toe - heel),
        ):  # fmt: skip
            frames[_INDEX[f"{side}_{name}"]] = _axes(axis, forward)
    return frames


def _axes(up: np.ndarray, forward: np.ndarray) -> np.ndarray:
    up = up / np.linalg.norm(up)
    forward = forward - (forward @ up) * up
    forward = forward / np.linalg.norm(forward)
    return np.stack([forward, np.cross(up, forward), up], -1)


if __name__ == "__main__":
    given = dict(each.split("=", 1) for each in sys.argv[1:])
    if set(given) != {"data"}:
        sys.exit("expected data=<the folder of the meter's data sets>")
    main(given["data"])
