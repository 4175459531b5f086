"""Simulate a scene: people follow their motions in MuJoCo, with weight, contact and limited strength."""

from dataclasses import asdict, dataclass

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import Skeleton
from synth.errors import FailedSimulation
from synth.motion.motion import Motion
from synth.people.landmarks import SKELETON, landmarks
from synth.physics.body_state import BodyState
from synth.physics.contacts import Contacts, Overlaps
from synth.physics.controller import Controller
from synth.physics.joint_addresses import find_joints
from synth.physics.joint_positions import joint_positions, moved_with, reference_joints
from synth.physics.planning import plan_motions
from synth.physics.quality import assess
from synth.physics.reference import make_reference
from synth.physics.states import AT_ONCE, StatesAt
from synth.scene.build import STEPS_PER_CONTROL, SUBSTEPS, Scene, build_scene
from synth.scene.sampling import load_motions
from synth.scene.spec import PLAN_FPS, SceneSpec

_SETTLING = 0.25
"""Time for which people hold their first pose before the clip, s."""


@dataclass(frozen=True)
class Simulation:
    """A simulated clip. Labels are read from its states, never from the reference motion.

    Attributes:
        model: The scene, cameras included.
        fps: Frames per second.
        state: State of the bodies in each frame.
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
    state: BodyState
    joints: np.ndarray
    skeleton: Skeleton
    depth: np.ndarray
    bodies: np.ndarray
    geom_ids: np.ndarray
    objects: tuple[str, ...]
    quality: dict

    @property
    def qpos(self) -> np.ndarray:
        """(F, nq) float64 state in each frame."""
        return self.state.qpos


def simulate(
    spec: SceneSpec, rig: CameraRig, motions: list[Motion] | None = None, *, painted: bool = True
) -> Simulation:
    """Simulate the people of a scene.

    Motion is planned at `PLAN_FPS` and simulated in steps of 2.5 ms, whatever the frame rate of the clip. The frame
    rate only determines the times at which states are recorded.

    Args:
        spec: The scene.
        rig: The cameras, which become part of the model.
        motions: One for each person at `PLAN_FPS`, in place and of the body's size, as
            `synth.scene.sampling.sample_scene` returns them. By default they are drawn again from the spec.
        painted: Whether to add textures and smooth shading, which images need and labels do not.

    Raises:
        FailedSimulation: the clip is unfit for use; the message says why. Another seed may do better.
        ValueError: the scene cannot be built, or motions are missing or of another length.
    """
    if motions is None:
        motions = load_motions(spec)
    lengths = {len(motion) for motion in motions}
    if len(motions) != len(spec.persons) or lengths != {spec.planned_frames}:
        raise ValueError(
            f"expected {len(spec.persons)} motions of {spec.planned_frames} frames, "
            f"got {len(motions)} of {sorted(lengths)} frames"
        )
    scene = build_scene(spec, rig, painted=painted)
    bodies = [person.body for person in spec.persons]
    plan = plan_motions(spec, motions, scene.obstacles)
    data, masses = mujoco.MjData(scene.model), np.array([body.mass for body in bodies])
    # Times at which states are recorded, in steps from the first frame on; they may be between two steps.
    kept = np.arange(spec.frames) * (PLAN_FPS * SUBSTEPS) / spec.fps
    steps = max((spec.planned_frames - 1) * SUBSTEPS, int(np.ceil(kept[-1] - AT_ONCE)))
    reference = make_reference(plan.root, plan.rotations, plan.bearing, PLAN_FPS, SUBSTEPS, steps)
    holding, leading = (Controller(scene.model, data, r, masses) for r in (reference.still(), reference))
    states = StatesAt(scene.model, find_joints(scene.model, len(bodies)), scene.geom_persons, kept)
    planned, shifts, overlaps = _run(scene, data, holding, leading, states, steps, spec.planned_frames)
    joints = joint_positions(scene.model, states.qpos, bodies)
    judged = joints if spec.fps == PLAN_FPS else joint_positions(scene.model, planned, bodies)
    planned = zip(bodies, plan.root.swapaxes(0, 1), plan.rotations.swapaxes(0, 1), strict=True)
    # Clips are judged at the rate of the plan, so that the same clips are fit for use at any frame rate.
    wanted = np.stack([reference_joints(body, root, rotations) for body, root, rotations in planned], axis=1)
    return Simulation(
        model=scene.model,
        fps=spec.fps,
        state=_body_state(spec, scene, states, motions, kept / SUBSTEPS),
        joints=joints,
        skeleton=SKELETON,
        depth=np.stack([landmarks(body)[2] for body in bodies]),
        bodies=moved_with(scene.model, bodies),
        geom_ids=scene.geom_ids,
        objects=scene.objects,
        quality=asdict(assess(judged, wanted, overlaps, shifts, PLAN_FPS, plan.beyond)),
    )


def _body_state(
    spec: SceneSpec, scene: Scene, states: StatesAt, motions: list[Motion], planned: np.ndarray
) -> BodyState:
    """Return the recorded states; `planned` (F,) are the times of the recorded frames, in frames of the plan."""
    joints, names = find_joints(scene.model, len(spec.persons)), scene.geom_names
    contact_names = tuple(dict.fromkeys(names))
    frame, geoms, *contact = states.contacts()
    doing, taking_part = [], len(spec.persons) - spec.interaction.bystanders
    for person, motion in enumerate(motions):
        together = spec.interaction.together and person < taking_part
        begins = ((0, spec.interaction.kind),) if together else motion.actions or ((0, motion.name),)
        # A frame between two frames of the plan belongs to the earlier one.
        which = np.searchsorted([begin for begin, _ in begins], np.floor(planned + AT_ONCE), side="right") - 1
        doing.append([begins[max(number, 0)][1] for number in which])
    action_names = tuple(dict.fromkeys(name for each in doing for name in each))
    return BodyState(
        qpos=states.qpos,
        root=joints.root(states.qpos).astype(np.float32),
        rotations=joints.quats(states.qpos).astype(np.float32),
        forces=states.forces,
        shapes=tuple(person.body for person in spec.persons),
        actions=np.array([[action_names.index(name) for name in each] for each in doing], np.int16).T,
        action_names=action_names,
        contact_frame=frame,
        contact_between=np.array([contact_names.index(name) for name in names], np.int16)[geoms],
        contact_names=contact_names,
        contact_point=contact[0],
        contact_force=contact[1],
        contact_depth=contact[2],
    )


def _run(
    scene: Scene,
    data: mujoco.MjData,
    holding: Controller,
    leading: Controller,
    states: StatesAt,
    steps: int,
    frames: int,
) -> tuple[np.ndarray, np.ndarray, Overlaps]:
    """Return states (F, nq), path shifts (F, P, 2), m, and overlaps in all F frames of the plan; record `states`."""
    model, persons = scene.model, int(scene.geom_persons.max()) + 1
    # Bodies that overlap in the first pose are moved apart before the clip begins.
    holding.start()
    for _ in range(round(_SETTLING / (STEPS_PER_CONTROL * model.opt.timestep))):
        holding.apply(0)
        mujoco.mj_step(model, data, STEPS_PER_CONTROL)
    settled = data.qpos.copy()
    leading.start()
    data.qpos[:] = settled
    mujoco.mj_forward(model, data)
    qpos, shifts = np.empty((frames, model.nq)), np.zeros((frames, persons, 2))
    qpos[0] = data.qpos
    states.see(data, 0)
    contacts = Contacts()
    contacts.watch(data, 0)
    held, begin, end = scene.holds[:, 0].astype(int), *scene.holds[:, 1:].T
    for step in range(steps):
        frame, within = step // SUBSTEPS + 1, step % SUBSTEPS
        if within == 0:
            data.eq_active[held] = (begin <= frame / PLAN_FPS) & (frame / PLAN_FPS < end)
        leading.apply(step)
        mujoco.mj_step(model, data, STEPS_PER_CONTROL)
        states.see(data, step + 1)
        if frame < frames:
            contacts.watch(data, frame)
        if within == SUBSTEPS - 1:
            _check(data, frame / PLAN_FPS)
            if frame < frames:
                qpos[frame], shifts[frame] = data.qpos, leading.shift
    _check(data, steps / (PLAN_FPS * SUBSTEPS))
    return qpos, shifts, contacts.overlaps(scene.geom_persons, frames)


def _check(data: mujoco.MjData, seconds: float) -> None:
    if data.warning.number.any() or not np.isfinite(data.qpos).all():
        raised = [mujoco.mjtWarning(i).name for i in np.flatnonzero(data.warning.number)]
        raise FailedSimulation(f"the solver failed at {seconds:.2f} s: {', '.join(raised) or 'state is not finite'}")
