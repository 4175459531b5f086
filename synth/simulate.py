"""From a scene and its people's intentions to what really happens, with weight, contact and limited strength."""

from dataclasses import asdict, dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from dmae.cameras import CameraRig
from dmae.skeleton import Skeleton
from synth.body import Body, segment_origins
from synth.control import HELD, Controller
from synth.feet import bearing, plant, planted
from synth.interactions import InteractionKind
from synth.landmarks import SKELETON, landmarks
from synth.legroom import limb_points, part_legs
from synth.limits import within
from synth.motion import SEGMENTS, Motion
from synth.motion.source import MotionKind
from synth.plan import give_way
from synth.quality import Contacts, FailedSimulation, Overlaps, assess
from synth.reference import make_reference
from synth.sample import load_motions
from synth.scene import Scene, build_scene
from synth.spec import SceneSpec

_SETTLING = 0.25
"""Time in which people stand in their first pose before the clip, s."""
_ROUNDS = 12
"""In which legs are given room."""


@dataclass(frozen=True)
class Simulation:
    """A clip as it happened. Labels are read from this state, never from the reference motion.

    Attributes:
        model: The scene, cameras included.
        fps: Frames per second.
        qpos: (F, nq) float64 state in each frame.
        joints: (F, P, J, 3) float64 joints, m, world.
        skeleton: `body25+shelf14`, J = 39.
        depth: (P, J) how far before a joint a ray may first meet its own limb and still count as seeing it, m.
        bodies: (P, J) index of the model's body that each joint moves with.
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
    bodies: np.ndarray
    geom_ids: np.ndarray
    objects: tuple[str, ...]
    quality: dict


def simulate(spec: SceneSpec, rig: CameraRig, *, painted: bool = True) -> Simulation:
    """Let a scene's people move; see `synth.scene.build_scene` for paint.

    Raises:
        FailedSimulation: the clip is unfit for use; the message says why. Another seed may do better.
        ValueError: the scene cannot be built.
    """
    return simulate_motions(spec, load_motions(spec), rig, painted=painted)


def simulate_motions(spec: SceneSpec, motions: list[Motion], rig: CameraRig, *, painted: bool = True) -> Simulation:
    """`simulate` with given motions: one a person, all of as many frames, of the body's size and in place."""
    lengths = {len(motion) for motion in motions}
    if len(motions) != len(spec.persons) or lengths != {spec.frames}:
        raise ValueError(
            f"expected {len(spec.persons)} motions of {spec.frames} frames, "
            f"got {len(motions)} of {sorted(lengths)} frames"
        )
    scene = build_scene(spec, rig, painted=painted)
    bodies = [person.body for person in spec.persons]
    plan = plan_motions(spec, motions, scene.obstacles)
    data, masses = mujoco.MjData(scene.model), np.array([body.mass for body in bodies])
    reference = make_reference(plan.root, plan.rotations, plan.bearing, spec.fps, scene.substeps)
    holding, leading = (Controller(scene.model, data, r, masses) for r in (reference.still(), reference))
    qpos, shifts, overlaps = _run(scene, data, holding, leading, spec)
    joints = joint_places(scene.model, qpos, bodies)
    planned = zip(bodies, plan.root.swapaxes(0, 1), plan.rotations.swapaxes(0, 1), strict=True)
    wanted = np.stack([reference_joints(body, root, rotations) for body, root, rotations in planned], axis=1)
    return Simulation(
        model=scene.model,
        fps=spec.fps,
        qpos=qpos,
        joints=joints,
        skeleton=SKELETON,
        depth=np.stack([landmarks(body)[2] for body in bodies]),
        bodies=moved_with(scene.model, bodies),
        geom_ids=scene.geom_ids,
        objects=scene.objects,
        quality=asdict(assess(joints, wanted, overlaps, shifts, spec.fps, plan.beyond)),
    )


class Plan(NamedTuple):
    """What people mean to do.

    Attributes:
        root: (F, P, 3) hips, m.
        rotations: (F, P, 16, 3, 3) orientation of each of `SEGMENTS`, world.
        bearing: (F, P, 2) shares of the weight on the left and the right foot.
        beyond: Share of all joints' time in which they were to turn beyond their limits.
    """

    root: np.ndarray
    rotations: np.ndarray
    bearing: np.ndarray
    beyond: float


def plan_motions(spec: SceneSpec, motions: list[Motion], obstacles: np.ndarray) -> Plan:
    """What people mean to do once they keep to their joints' limits, and have made room for each other and for things.

    Args:
        spec: The scene, P people.
        motions: One a person, of F frames, in place.
        obstacles: (K, 3) x, y and radius of what stands about, m.
    """
    root = np.stack([motion.root for motion in motions], axis=1)
    recorded = spec.motion.kind is not MotionKind.procedural
    rotations, beyond = within(
        np.stack([motion.rotations for motion in motions], axis=1), spec.fps if recorded else None
    )
    standing = [
        planted(person.body, root[:, p], rotations[:, p], spec.fps, turn=person.turn, recorded=recorded)
        for p, person in enumerate(spec.persons)
    ]
    root[..., :2] += give_way(root[..., :2], spec.fps, clearance=spec.clearance, obstacles=obstacles)
    bodies = [person.body for person in spec.persons]
    firm = _plant(bodies, root, rotations, standing, spec.fps, recorded=recorded)
    if recorded and spec.interaction.kind is InteractionKind.none:
        # Made-up people keep their feet under them, and a script says how near people come.
        for _ in range(_ROUNDS):
            limbs = np.stack([limb_points(body, *(a[:, p] for a in firm)) for p, body in enumerate(bodies)], axis=1)
            shift = part_legs(limbs, spec.fps, obstacles)
            if not shift.any():
                break
            root[..., :2] += shift
            firm = _plant(bodies, root, rotations, standing, spec.fps, recorded=recorded)
    weight = [bearing(body, *(a[:, p] for a in firm), standing[p], spec.fps) for p, body in enumerate(bodies)]
    return Plan(*firm, np.stack(weight, axis=1), beyond)


def _plant(
    bodies: list[Body],
    root: np.ndarray,
    rotations: np.ndarray,
    standing: list[np.ndarray],
    fps: float,
    *,
    recorded: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """`plant` of everybody."""
    firm = [
        plant(body, root[:, p], rotations[:, p], standing[p], fps, recorded=recorded) for p, body in enumerate(bodies)
    ]
    return tuple(np.stack(part, axis=1) for part in zip(*firm, strict=True))


def _run(
    scene: Scene, data: mujoco.MjData, holding: Controller, leading: Controller, spec: SceneSpec
) -> tuple[np.ndarray, np.ndarray, Overlaps]:
    """States (F, nq), shifts of paths (F, P, 2) m, and overlaps of all frames."""
    model, frames = scene.model, spec.frames
    # Nobody begins inside a neighbour, or a hand inside its own hip: they are eased apart before the clip begins.
    holding.start()
    for _ in range(round(_SETTLING / (HELD * model.opt.timestep))):
        holding.apply(0)
        mujoco.mj_step(model, data, HELD)
    settled = data.qpos.copy()
    leading.start()
    data.qpos[:] = settled
    mujoco.mj_forward(model, data)
    qpos, shifts = np.empty((frames, model.nq)), np.zeros((frames, len(spec.persons), 2))
    qpos[0] = data.qpos
    contacts = Contacts()
    contacts.watch(data, 0)
    held, begin, end = scene.holds[:, 0].astype(int), *scene.holds[:, 1:].T
    for frame in range(1, frames):
        data.eq_active[held] = (begin <= frame / spec.fps) & (frame / spec.fps < end)
        for step in range((frame - 1) * scene.substeps, frame * scene.substeps):
            leading.apply(step)
            mujoco.mj_step(model, data, HELD)
            contacts.watch(data, frame)
        qpos[frame], shifts[frame] = data.qpos, leading.shift
        _check(data, frame / spec.fps)
    return qpos, shifts, contacts.overlaps(scene.geom_persons, frames)


def _check(data: mujoco.MjData, seconds: float) -> None:
    if data.warning.number.any() or not np.isfinite(data.qpos).all():
        raised = [mujoco.mjtWarning(i).name for i in np.flatnonzero(data.warning.number)]
        raise FailedSimulation(f"the solver failed at {seconds:.2f} s: {', '.join(raised) or 'state is not finite'}")


def joint_places(model: mujoco.MjModel, qpos: np.ndarray, bodies: list[Body]) -> np.ndarray:
    """(F, P, 39, 3) joints of `SKELETON` in the states (F, nq), m, world."""
    data = mujoco.MjData(model)
    ids = moved_with(model, bodies)
    points = np.stack([landmarks(body)[1] for body in bodies])
    joints = np.empty((len(qpos), *points.shape))
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        joints[frame] = data.xpos[ids] + (data.xmat[ids].reshape(*ids.shape, 3, 3) @ points[..., None])[..., 0]
    return joints


def moved_with(model: mujoco.MjModel, bodies: list[Body]) -> np.ndarray:
    """(P, 39) index of the model's body that each person's joints move with."""
    return np.array(
        [
            [model.body(f"person{p}/{SEGMENTS[segment]}").id for segment in landmarks(body)[0]]
            for p, body in enumerate(bodies)
        ]
    )


def reference_joints(body: Body, root: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """(F, 39, 3) joints of `SKELETON` where a reference (F, 3), (F, 16, 3, 3) has them, m, world."""
    segments, points, _ = landmarks(body)
    return segment_origins(body, root, rotations)[:, segments] + (rotations[:, segments] @ points[..., None])[..., 0]
