"""Motions of Unitree G1 robots from people who touch: joint CSV, and LeRobot v3 with an episode for each person.

Which hand touches whom, and where, is known from the simulation; `dmae export` infers it from joints.
"""

from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from dmae.data.conversion import convert
from dmae.formats.g1 import Episode, episodes, write_episodes, write_joint_csv
from dmae.formats.retargeting import Contact, RobotMotion, load_robot, retarget
from synth.datasets.exporters import exporter
from synth.datasets.exporters.selection import ClipTask, Selection
from synth.physics.body_state import BodyState, load_state


@exporter("g1", images=False, skeleton="body25", only=True)
def export_g1(selection: Selection, out: Path) -> dict[str, Counter]:
    """Unitree G1 joint CSV, a file for each person, in m and radians: `<split>/<clip>_P1.csv`."""
    load_robot(selection.robot)  # what is missing is said before the first clip
    return selection.export(_write_csv, out)


@exporter("lerobot", images=False, skeleton="body25", only=True)
def export_lerobot(selection: Selection, out: Path) -> dict[str, Counter]:
    """LeRobot v3 data set of Unitree G1 robots for each split: `<split>/data`, `<split>/meta`."""
    load_robot(selection.robot)
    found = selection.export(_write_part, out)
    given, rates = defaultdict(list), defaultdict(dict)
    for task in selection.tasks(out):
        with np.load(task.part("npz")) as part:
            rates[task.split][float(part["fps"])] = None
            words, joints = str(part["task"]), tuple(part["joints"].tolist())
            of_persons = zip(part["qpos"], part["flags"], part["measured"], strict=True)
            given[task.split] += [Episode(words, joints, *arrays) for arrays in of_persons]
    for split, fps in rates.items():
        if len(fps) > 1:
            raise ValueError(f"format=lerobot: expected clips of one frame rate, found {', '.join(map(str, fps))} fps")
        write_episodes(out / split, given[split], *fps)
    return found


def _write_csv(task: ClipTask) -> Counter:
    motion, _, counts = _retargeted(task)
    write_joint_csv(motion, task.file("csv"))
    return counts


def _write_part(task: ClipTask) -> Counter:
    motion, words, counts = _retargeted(task)
    each = episodes(motion, words)
    parts: dict = {name: np.stack([getattr(one, name) for one in each]) for name in ("qpos", "flags", "measured")}
    np.savez(
        task.part("npz"),
        fps=task.load().fps / task.every,
        joints=np.array(motion.joints),
        task=words,
        **parts,
    )
    return counts


def _retargeted(task: ClipTask) -> tuple[RobotMotion, str, Counter]:
    """Return the motion of a clip's people, one frame in `every`, and their interaction or actions in words."""
    clip, state = task.load(), load_state(task.folder)
    assert clip.truth is not None
    contacts = hand_contacts(state)
    motion = retarget(convert(clip.truth, task.skeleton), clip.fps, load_robot(task.robot), contacts)
    kind = clip.provenance["spec"].get("interaction", {}).get("kind") or "none"
    words = ", ".join(state.action_names) if kind == "none" else kind
    people = motion.qpos.shape[1]
    return motion.every(task.every), words.replace("_", " "), Counter(clips=1, persons=people)


def hand_contacts(state: BodyState) -> list[Contact]:
    """Return the contacts of hands with hands, arms and trunks of other people."""
    points: dict[tuple[int, int, int, str, int], np.ndarray] = {}
    names = [name.partition("/") for name in state.contact_names]
    frames = len(state.qpos)
    for frame, pair, point in zip(state.contact_frame, state.contact_between, state.contact_point, strict=True):
        for one, other in (pair, pair[::-1]):
            (person, _, hand), (partner, _, part) = names[one], names[other]
            if person == partner or not (person.startswith("person") and partner.startswith("person")):
                continue
            if hand not in ("l_hand", "r_hand"):
                continue
            if part in ("pelvis", "spine", "chest"):
                part = "l_trunk"
            side, _, part = part.partition("_")
            if part not in ("trunk", "upper_arm", "forearm", "hand"):
                continue
            key = (int(person[6:]), "lr".index(hand[0]), int(partner[6:]), part, "lr".index(side))
            points.setdefault(key, np.full((frames, 3), np.nan))[frame] = point
    return [Contact(*key, point=each) for key, each in points.items()]
