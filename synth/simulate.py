"""From a scene and its people's intentions to what really happens, with weight, contact and limited strength."""

from dataclasses import asdict, dataclass

import mujoco
import numpy as np

from dmae.cameras import CameraRig
from dmae.skeleton import Skeleton
from synth.body import Body, segment_origins
from synth.control import Controller, make_reference
from synth.feet import plant, planted
from synth.landmarks import SKELETON, landmarks
from synth.motion import SEGMENTS, Motion
from synth.plan import give_way
from synth.quality import FailedSimulation, Overlaps, assess
from synth.scene import Scene, build_scene
from synth.spec import SceneSpec, load_motions

_SETTLING = 0.25
"""Time in which people stand in their first pose before the clip, s."""


@dataclass(frozen=True)
class Simulation:
    """A clip as it happened. Labels are read from this state, never from the reference motion.

    Attributes:
        model: The scene, cameras included.
        fps: Frames per second.
        qpos: (F, nq) float64 state in each frame.
        joints: (F, P, J, 3) float64 joints, m, world.
        skeleton: `body25+shelf14`, J = 39.
        depth: (P, J) how far before a joint a ray may first meet its own body and still count as seeing it, m.
        geom_ids: (ngeom,) uint16: 1 + p for geoms that show person p, 256 + k for those of object k, 0 for none.
        objects: Names of the objects.
        quality: How it went, see `synth.quality.Quality`; JSON-able.
    """

    model: mujoco.MjModel
    fps: float
    qpos: np.ndarray
    joints: np.ndarray
    skeleton: Skeleton
    depth: np.ndarray
    geom_ids: np.ndarray
    objects: tuple[str, ...]
    quality: dict


def simulate(spec: SceneSpec, rig: CameraRig) -> Simulation:
    """Let a scene's people move.

    Raises:
        FailedSimulation: the clip is unfit for use; the message says why. Another seed may do better.
        ValueError: the scene cannot be built.
    """
    return simulate_motions(spec, load_motions(spec), rig)


def simulate_motions(spec: SceneSpec, motions: list[Motion], rig: CameraRig) -> Simulation:
    """`simulate` with given motions: one a person, all of as many frames, of the body's size and in place."""
    lengths = {len(motion) for motion in motions}
    if len(motions) != len(spec.persons) or lengths != {spec.frames}:
        raise ValueError(
            f"expected {len(spec.persons)} motions of {spec.frames} frames, "
            f"got {len(motions)} of {sorted(lengths)} frames"
        )
    scene = build_scene(spec, rig)
    bodies = [person.body for person in spec.persons]
    root = np.stack([motion.root for motion in motions], axis=1)
    rotations = np.stack([motion.rotations for motion in motions], axis=1)
    standing = [
        planted(person.body, root[:, p], rotations[:, p], spec.fps, turn=person.turn)
        for p, person in enumerate(spec.persons)
    ]
    root[..., :2] += give_way(root[..., :2], spec.fps, clearance=spec.clearance, obstacles=scene.obstacles)
    for p, body in enumerate(bodies):
        rotations[:, p] = plant(body, root[:, p], rotations[:, p], standing[p])
    qpos, shifts, overlaps = _run(scene, bodies, root, rotations, spec.fps)
    joints = _joints(scene.model, qpos, bodies)
    wanted = np.stack([_wanted(body, root[:, p], rotations[:, p]) for p, body in enumerate(bodies)], axis=1)
    return Simulation(
        model=scene.model,
        fps=spec.fps,
        qpos=qpos,
        joints=joints,
        skeleton=SKELETON,
        depth=np.stack([landmarks(body)[2] for body in bodies]),
        geom_ids=scene.geom_ids,
        objects=scene.objects,
        quality=asdict(assess(joints, wanted, overlaps, shifts, spec.fps)),
    )


def _run(
    scene: Scene, bodies: list[Body], root: np.ndarray, rotations: np.ndarray, fps: float
) -> tuple[np.ndarray, np.ndarray, Overlaps]:
    """States (F, nq), shifts of paths (F, P, 2) m, and overlaps of all frames."""
    model, data = scene.model, mujoco.MjData(scene.model)
    reference = make_reference(root, rotations, fps, scene.substeps)
    masses = np.array([body.mass for body in bodies])
    controller = Controller(model, reference, masses)
    # Nobody begins inside a neighbour, or a hand inside its own hip: they are eased apart before the clip begins.
    still = Controller(model, reference.still(), masses)
    still.start(data)
    for _ in range(round(_SETTLING / model.opt.timestep)):
        still.apply(data, 0)
        mujoco.mj_step(model, data)
    settled = data.qpos.copy()
    controller.start(data)
    data.qpos[:] = settled
    mujoco.mj_forward(model, data)
    frames = len(root)
    qpos, shifts = np.empty((frames, model.nq)), np.zeros((frames, len(bodies), 2))
    qpos[0] = data.qpos
    overlaps = Overlaps(scene.geom_persons, frames)
    overlaps.watch(data, 0)
    for frame in range(1, frames):
        for step in range((frame - 1) * scene.substeps + 1, frame * scene.substeps + 1):
            controller.apply(data, step)
            mujoco.mj_step(model, data)
            overlaps.watch(data, frame)
        qpos[frame], shifts[frame] = data.qpos, controller.shift
        _check(data, frame / fps)
    return qpos, shifts, overlaps


def _check(data: mujoco.MjData, seconds: float) -> None:
    raised = [mujoco.mjtWarning(i).name for i, warning in enumerate(data.warning) if warning.number]
    if raised or not np.isfinite(data.qpos).all():
        raise FailedSimulation(f"the solver failed at {seconds:.2f} s: {', '.join(raised) or 'state is not finite'}")


def _joints(model: mujoco.MjModel, qpos: np.ndarray, bodies: list[Body]) -> np.ndarray:
    """(F, P, 39, 3) joints of `SKELETON` in the states (F, nq), m, world."""
    data = mujoco.MjData(model)
    ids = np.empty((len(bodies), len(SKELETON)), int)
    points = np.empty((*ids.shape, 3))
    for p, body in enumerate(bodies):
        segments, points[p], _ = landmarks(body)
        ids[p] = [model.body(f"person{p}/{SEGMENTS[segment]}").id for segment in segments]
    joints = np.empty((len(qpos), *points.shape))
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        joints[frame] = data.xpos[ids] + (data.xmat[ids].reshape(*ids.shape, 3, 3) @ points[..., None])[..., 0]
    return joints


def _wanted(body: Body, root: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """(F, 39, 3) joints of `SKELETON` where a reference (F, 3), (F, 16, 3, 3) has them, m, world."""
    segments, points, _ = landmarks(body)
    return segment_origins(body, root, rotations)[:, segments] + (rotations[:, segments] @ points[..., None])[..., 0]
