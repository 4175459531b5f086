"""Small scenes and motions for tests of the generator."""

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.rng import Stream, generator
from synth.motion.config import MotionConfig
from synth.motion.motion import Motion
from synth.people.body import SEGMENTS, Body
from synth.people.clothing import sample_looks
from synth.rigs.config import RigConfig
from synth.rigs.rig import make_rig
from synth.rooms.decor import Decor, Finish
from synth.scene.spec import PersonSpec, SceneSpec

RIG = make_rig(RigConfig(), rng=generator(0, 0, Stream.CAMERAS))
BODY = Body()


def gliding(body: Body, frames: int, start, velocity, fps: float = 25.0) -> Motion:
    """An upright person, arms hanging, who glides forward at a velocity (2,), m/s, with legs that do not move."""
    velocity = np.asarray(velocity, float)
    rotations = np.tile(np.eye(3), (frames, len(SEGMENTS), 1, 1))
    for side, sign in (("l", 1), ("r", -1)):
        hanging = Rotation.from_euler("x", -1.35 * sign).as_matrix()
        for part in ("upper_arm", "forearm", "hand"):
            rotations[:, SEGMENTS.index(f"{side}_{part}")] = hanging
    rotations = Rotation.from_euler("z", np.arctan2(velocity[1], velocity[0])).as_matrix() @ rotations
    root = np.zeros((frames, 3))
    root[:, :2] = start + np.arange(frames)[:, None] / fps * velocity
    root[:, 2] = body.hip_height
    return Motion("gliding", fps, root, rotations, body.hip_height)


def scene(bodies, frames: int, *, clearance: float = 0.0, props=(), arena: str = "studio") -> SceneSpec:
    """A scene of people with these bodies, without motions."""
    rng = np.random.default_rng(0)
    persons = tuple(PersonSpec(b, sample_looks(b.feminine, rng=rng), "test", (0.0, 0.0), 0.0, 0.0) for b in bodies)
    grey = ((0.6, 0.6, 0.6), (0.5, 0.5, 0.5))
    return SceneSpec(
        seed=0,
        clip=0,
        fps=25.0,
        frames=frames,
        arena=arena,
        decor=Decor(Finish("planks", grey), Finish("plaster", grey)),
        clearance=clearance,
        persons=persons,
        props=tuple(props),
        motion=MotionConfig(),
        seconds=frames / 25,
    )
