"""Simulate a scene: people follow their motions in MuJoCo, with weight, contact and limited strength."""

from dataclasses import asdict, dataclass

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import Skeleton
from synth.errors import FailedSimulation
from synth.motion.motion import Motion
from synth.people.landmarks import SKELETON, landmarks
from synth.physics.contacts import Contacts, Overlaps
from synth.physics.controller import Controller
from synth.physics.joint_positions import joint_positions, moved_with, reference_joints
from synth.physics.planning import plan_motions
from synth.physics.quality import assess
from synth.physics.reference import make_reference
from synth.scene.build import STEPS_PER_CONTROL, Scene, build_scene
from synth.scene.sampling import load_motions
from synth.scene.spec import SceneSpec

_SETTLING = 0.25
"""Time for which people hold their first pose before the clip, s."""


@dataclass(frozen=True)
class Simulation:
    """A simulated clip. Labels are read from its states, never from the reference motion.

    Attributes:
        model: The scene, cameras included.
        fps: Frames per second.
        qpos: (F, nq) float64 state in each frame.
        joints: (F, P, J, 3) float64 joints, m, world.
        skeleton: `body25+shelf14`, J = 39.
        depth: (P, J) greatest distance before a joint at which a ray that meets its own limb counts as seeing it, m.
        bodies: (P, J) index of the model's body that each joint moves with.
        geom_ids: (ngeom,) uint16: 1 + p for visible geoms of person p, 256 + k for those of object k, 0 for none.
        objects: Names of the objects.
        quality: Fields of `synth.physics.quality.SimulationQuality`; JSON-able.
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


def simulate(
    spec: SceneSpec, rig: CameraRig, motions: list[Motion] | None = None, *, painted: bool = True
) -> Simulation:
    """Simulate the people of a scene.

    Args:
        spec: The scene.
        rig: The cameras, which become part of the model.
        motions: One for each person, in place and of the body's size, as `synth.scene.sampling.sample_scene` returns
            them. By default they are drawn again from the spec.
        painted: Whether to add textures and smooth shading, which pictures need and labels do not.

    Raises:
        FailedSimulation: the clip is unfit for use; the message says why. Another seed may do better.
        ValueError: the scene cannot be built, or motions are missing or of another length.
    """
    if motions is None:
        motions = load_motions(spec)
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
    joints = joint_positions(scene.model, qpos, bodies)
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


def _run(
    scene: Scene, data: mujoco.MjData, holding: Controller, leading: Controller, spec: SceneSpec
) -> tuple[np.ndarray, np.ndarray, Overlaps]:
    """States (F, nq), shifts of paths (F, P, 2), m, and overlaps of all frames."""
    model, frames = scene.model, spec.frames
    # Bodies that overlap in the first pose are eased apart before the clip begins.
    holding.start()
    for _ in range(round(_SETTLING / (STEPS_PER_CONTROL * model.opt.timestep))):
        holding.apply(0)
        mujoco.mj_step(model, data, STEPS_PER_CONTROL)
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
            mujoco.mj_step(model, data, STEPS_PER_CONTROL)
            contacts.watch(data, frame)
        qpos[frame], shifts[frame] = data.qpos, leading.shift
        _check(data, frame / spec.fps)
    return qpos, shifts, contacts.overlaps(scene.geom_persons, frames)


def _check(data: mujoco.MjData, seconds: float) -> None:
    if data.warning.number.any() or not np.isfinite(data.qpos).all():
        raised = [mujoco.mjtWarning(i).name for i in np.flatnonzero(data.warning.number)]
        raise FailedSimulation(f"the solver failed at {seconds:.2f} s: {', '.join(raised) or 'state is not finite'}")
