"""Measure how often `dmae detect` finds people in rendered views, and compare real videos with published poses.

    python docs/tools/found_people.py            # all, into docs/results/found_people.json: 25 minutes
    python docs/tools/found_people.py views      # rendered views of three people alone
    python docs/tools/found_people.py rooms      # rendered images, each searched by itself: 3 minutes
    python docs/tools/found_people.py videos     # Pose2Sim's recording alone, with DMAE_DATA

A person is unoccluded if at most 20 % of its joints are hidden by anything other than its own body. A person is found
if the median error of its joints is below 0.2 of its height. A ghost is a detection that is near none of the people.
In rooms, people count of whom 30 % of the joints are visible, as the annotators of photographs include them.
"""

import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from provenance import provenance

import dmae
import synth
from dmae.data.conversion import convert, convert_detections
from dmae.data.json_values import json_text
from dmae.data.skeleton import BLAZEPOSE33, BODY25
from dmae.detection.pipeline import check_people, make_detector, to_detections
from dmae.detection.registry import PoseDetectorConfig
from synth.detector.statistics import match_detections
from synth.motion.config import MotionConfig
from synth.recognition.realism import NEAR, UNOBSTRUCTED, sightings
from synth.rigs.config import CameraPlacement, RandomConfig, RigConfig
from synth.scene.config import SceneConfig

RESULT = Path(__file__).parents[1] / "results/found_people.json"
_SEEDS = (6007, 7411, 8123)
"""Seeds that were not used in development. Seeds 72, 172, 901, 1733, 2210, 3407 and 5021 were used."""
_OPTIONS = {
    "clips": 6, "scene": "shelf_twin", "persons": [3, 3], "seconds": 1.2, "images": ["rgb"], "rgb": "jpeg",
}  # fmt: skip
_LEAST_PX = 40
_ROOMS = {
    "wide": (("office", "market"), [150.0, 300.0], MotionConfig()),
    "low": (("living_room", "warehouse"), [450.0, 1000.0], MotionConfig(actions=["sit", "bend", "crouch", "lift"])),
}
"""Rooms, focal lengths, px, and motion: people seen from afar, and people who sit, crouch and bend."""
_HEIGHTS = {"50 to 100 px": (50, 100), "100 to 200 px": (100, 200), "200 px or more": (200, np.inf)}
_VISIBLE = 0.3
_TORSO = {"shoulders": ("l_shoulder", "r_shoulder"), "hips": ("l_hip", "r_hip")}
"""Joints for which the median offset from the true joints is recorded, along the torso and relative to its length."""
_EXCHANGED_MM = 50


def views(seed: int, made: str | None = None) -> dict:
    """Return the number of people found and of ghosts in the clips of a seed.

    The clips are generated now, or read from `<made>/<seed>`.
    """
    counts = dict.fromkeys(("images", "people", "found", "ghosts", "joints", "near", "detections"), 0)
    seconds, above = 0.0, {name: [] for name in _TORSO}
    with TemporaryDirectory() as folder:
        clips = dmae.load_dataset(f"{made}/{seed}") if made else synth.generate(**_OPTIONS, seed=seed, out=folder)
        for clip in clips:
            start = time.process_time()
            found = dmae.detect(clip, skeleton="body25")
            seconds += time.process_time() - start
            seen, match = sightings(clip), match_detections(found, convert(clip.truth, BODY25))
            plain = (seen.unobstructed.mean(-1) >= UNOBSTRUCTED) & (seen.height >= _LEAST_PX) & ~np.isnan(match.height)
            error = np.linalg.norm(match.found - seen.xy, axis=-1) / seen.height[..., None]
            counted = seen.visible & (plain & match.matched)[..., None] & ~np.isnan(error)
            counts["images"] += len(clip) * len(clip.rig)
            counts["people"] += int(plain.sum())
            counts["found"] += int((plain & match.matched).sum())
            counts["ghosts"] += int((match.left_over & ~match.near).sum())
            counts["joints"] += int(counted.sum())
            counts["near"] += int((error[counted] < NEAR).sum())
            torso = np.stack([seen.xy[..., BODY25.index(*names), :].mean(-2) for names in _TORSO.values()])
            length = torso[0] - torso[1]
            for name, names in _TORSO.items():
                joints = BODY25.index(*names)
                off = (match.found - seen.xy)[..., joints, :] * length[..., None, :]
                off = off.sum(-1) / (length**2).sum(-1)[..., None]
                above[name].append(off[counted[..., joints]])
            counts["detections"] += int(found.detections.observed.any(-1).sum())
    medians = {name: float(np.median(np.concatenate(each))) for name, each in above.items()}
    return counts | {"cpu_s": round(seconds, 1), "above_true": medians}


def rooms(name: str) -> dict:
    """Return people found and ghosts in images of rooms, searched by themselves as in videos and as photographs."""
    arenas, focal, motion = _ROOMS[name]
    config = RandomConfig(views=4, focal=focal, lenses=["pinhole"])
    rig = RigConfig(placement=CameraPlacement.random, random=config)
    counted = {}
    for arena in arenas:
        scene = SceneConfig(arena=arena, seconds=3, fps=1, persons=[3, 5])
        with TemporaryDirectory() as out:
            (clip,) = synth.generate(
                clips=1, seed=301, scene=scene, rig=rig, motion=motion, images=["rgb"], rgb="jpeg", out=out
            )
            for way, photographs in (("in videos", False), ("as photographs", True)):
                counts = _found_alone(clip, PoseDetectorConfig(photographs=photographs))
                total = counted.setdefault(way, dict.fromkeys(counts, 0))
                for key, count in counts.items():
                    total[key] = round(total[key] + count, 1)
    return counted


def _found_alone(clip: dmae.Clip, config: PoseDetectorConfig) -> dict:
    start, found = time.process_time(), []
    for camera in clip.rig.names:
        images = (clip.images.at("rgb", camera, frame) for frame in clip.images.frames)
        detectors = (make_detector(config) for _ in clip.images.frames)
        found.append(
            [
                check_people(detector, detector(image), config.name)
                for detector, image in zip(detectors, images, strict=True)
            ]
        )
    spent = time.process_time() - start
    frames = [np.arange(len(clip))] * len(found)
    detections = convert_detections(to_detections(found, frames, len(clip), BLAZEPOSE33), BODY25)
    seen = sightings(clip)
    match = match_detections(replace(clip, detections=detections, detection_labels=None), convert(clip.truth, BODY25))
    shown = (seen.visible.mean(-1) >= _VISIBLE) & ~np.isnan(match.height)
    counts = {"images": len(clip) * len(clip.rig)}
    for height, (least, most) in _HEIGHTS.items():
        people = shown & (match.height >= least) & (match.height < most)
        counts |= {f"people of {height}": int(people.sum()), f"found of {height}": int((people & match.matched).sum())}
    return counts | {"ghosts": int((match.left_over & ~match.near).sum()), "cpu_s": spent}


def videos(data: Path) -> dict:
    """Return distances between people in Pose2Sim's videos and the authors' poses, made from OpenPose's joints.

    The authors' poses are compared unchanged and shifted by one frame. In each of the four cameras, their detections
    are nearest to our detections in the next image of the videos, even if each image is detected separately.
    """
    trial = data / "S00_P00_SingleParticipant/S00_P00_T01_BalancingTrial"
    reference = dmae.read_poses(next(trial.glob("pose-3d/*_0-100.trc"))).poses
    start = time.process_time()
    clip = dmae.detect(data / "videos", data / "S00_Calibration")
    spent = time.process_time() - start
    captured = dmae.capture(clip)
    completed = dmae.complete(captured, clip.fps)
    joints = [name for name in captured.skeleton.joints if name in reference.skeleton.joints]
    mirrored = [
        reference.skeleton.joints[reference.skeleton.mirror[reference.skeleton.index(name)[0]]] for name in joints
    ]
    true, other = (reference.xyz[:, :1, reference.skeleton.index(*names)] for names in (joints, mirrored))
    rows = {}
    for name, poses in (("captured", captured), ("completed", completed)):
        xyz = poses.xyz[:, :, poses.skeleton.index(*joints)]
        same, next_frame = _distances(xyz, true), _distances(xyz[1:], true[:-1])
        exchanged = _distances(xyz, other) + _EXCHANGED_MM < same
        rows[name] = {
            "median_mm": float(np.nanmedian(same)),
            "median_next_frame_mm": float(np.nanmedian(next_frame)),
            "nearer_to_the_other_side": int(exchanged.sum()),
        }
    apart = _distances(completed.xyz[1:, :1, completed.skeleton.index(*joints)], true[:-1])[:, 0]
    per_joint = [np.nanmedian(each) if np.isfinite(each).any() else np.nan for each in apart.T]
    return {
        "people": int(captured.xyz.shape[1]),
        "measured": float((captured.source == dmae.Source.MEASURED).mean()),
        **rows,
        "joints": {joint: round(float(mm), 1) for joint, mm in zip(joints, per_joint, strict=True) if np.isfinite(mm)},
        "cpu_s": round(spent, 1),
    }


def _distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return distances, mm; NaN where either is unknown."""
    return 1000 * np.linalg.norm(a - b, axis=-1)


def main(parts: list[str]) -> None:
    known = json.loads(RESULT.read_text()) if RESULT.is_file() else {}
    chosen = parts or ["views", "rooms", "videos"]
    for part in chosen:
        name, _, made = part.partition("=")
        if name == "views":
            known["views"] = {str(seed): views(seed, made or None) for seed in _SEEDS}
        elif name == "rooms":
            known["rooms"] = {f"{each}, {way}": found for each in _ROOMS for way, found in rooms(each).items()}
        elif name == "videos" and "DMAE_DATA" in os.environ:
            known["videos"] = videos(Path(os.environ["DMAE_DATA"], "pose2sim"))
        else:
            sys.exit(f"{part}: expected views, rooms, or videos with DMAE_DATA set to the folder that holds pose2sim/")
        stamp = provenance("mujoco")
        if name == "rooms":
            known["rooms_measured"] = f"{stamp['date']}, commit {stamp['commit']}"
        else:
            known |= {"command": "python docs/tools/found_people.py", **stamp}
        RESULT.write_text(json_text(known) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
