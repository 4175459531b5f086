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
    found = {split: Counter() for split in selection.splits}
    given: dict[str, list[Episode]] = defaultdict(list)
    rates: dict[str, set[float]] = defaultdict(set)
    for task, (counts, fps, each) in selection.each_clip(_episodes, out):
        found[task.split] += counts
        given[task.split] += each
        rates[task.split].add(fps)
    for split, each_rate in rates.items():
        if len(each_rate) > 1:
            several = ", ".join(map(str, sorted(each_rate)))
            raise ValueError(f"format=lerobot: expected clips of one frame rate, found {several} fps")
        write_episodes(out / split, given[split], *each_rate)
    return found


def _write_csv(task: ClipTask) -> Counter:
    motion, _, counts = _retargeted(task)
    write_joint_csv(motion, task.file("csv"))
    return counts


def _episodes(task: ClipTask) -> tuple[Counter, float, list[Episode]]:
    motion, words, counts = _retargeted(task)
    return counts, task.load().fps / task.every, episodes(motion, words)


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
