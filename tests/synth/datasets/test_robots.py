"""Data sets of robots from simulated people, whose contacts are known."""

import json

import numpy as np
import pytest

import synth
from dmae.formats.retargeting import load_robot, retarget
from synth.datasets.exporters.export import export
from synth.datasets.exporters.robots import hand_contacts
from synth.physics.body_state import load_state
from tests.support.robots import TwoRobots, needs_robot


@pytest.fixture(scope="module")
def dancers(tmp_path_factory):
    """Half a second of two people who hold each other."""
    needs_robot()
    folder = tmp_path_factory.mktemp("data") / "dance"
    alone = synth.preset("interaction", "dance", bystanders=0)
    rig = synth.RigConfig(ring=synth.RingConfig(views=1))
    scene = synth.preset("scene", "studio", persons=[2, 2])
    list(synth.generate(seconds=0.5, scene=scene, interaction=alone, rig=rig, clips=1, seed=7, out=folder))
    return folder


def test_hands_that_hold_people_hold_robots(dancers):
    from dmae.data.conversion import convert
    from dmae.data.skeleton import BODY25
    from dmae.data.store import load_clip

    clip, contacts = load_clip(dancers / "000000"), hand_contacts(load_state(dancers / "000000"))
    assert {(each.part, each.person) for each in contacts} >= {("hand", 0), ("hand", 1), ("trunk", 0)}
    robot = load_robot()
    motion = retarget(convert(clip.truth, BODY25), clip.fps, robot, contacts)
    (held,) = [each for each in contacts if each.part == "hand" and each.person == 0]
    hands = (f"{('left', 'right')[side]}_wrist_yaw" for side in (held.side, held.other_side))
    assert abs(TwoRobots().gap(motion.qpos[-1], *hands)) < 0.03


def test_data_sets_of_robots(dancers, tmp_path):
    summary = export(dancers, tmp_path / "lerobot", "lerobot", every=2)
    info = json.loads((tmp_path / "lerobot/train/meta/info.json").read_text())
    assert (summary["splits"]["train"]["persons"], info["total_episodes"]) == (2, 2)
    frames = len(load_state(dancers / "000000").qpos)
    assert info["total_frames"] == 2 * len(range(0, frames, 2))
    export(dancers, tmp_path / "g1", "g1")
    assert np.loadtxt(tmp_path / "g1/train/000000_P2.csv", delimiter=",").shape == (frames, 36)
