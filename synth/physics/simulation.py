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
from synth.scene.build import STEPS_PER_CONTROL, SUBSTEPS, Scene, build_scene
from synth.scene.sampling import load_motions
from synth.scene.spec import PLAN_FPS, SceneSpec

_SETTLING = 0.25
"""Time for which people hold their first pose before the clip, s."""
_AT_ONCE = 1e-6
"""Times as near as this to a step are at the step, in steps."""


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

    Motion is planned at `PLAN_FPS` and simulated in steps of 2.5 ms, whatever the frame rate of the clip, which only
    says at which times states are kept.

    Args:
        spec: The scene.
        rig: The cameras, which become part of the model.
        motions: One for each person at `PLAN_FPS`, in place and of the body's size, as
            `synth.scene.sampling.sample_scene` returns them. By default they are drawn again from the spec.
        painted: Whether to add textures and smooth shading, which pictures need and labels do not.

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
    # Numbers of the steps, from the first frame on, at which states are kept; they may lie between two steps.
    kept = np.arange(spec.frames) * (PLAN_FPS * SUBSTEPS) / spec.fps
    steps = max((spec.planned_frames - 1) * SUBSTEPS, int(np.ceil(kept[-1] - _AT_ONCE)))
    reference = make_reference(plan.root, plan.rotations, plan.bearing, PLAN_FPS, SUBSTEPS, steps)
    holding, leading = (Controller(scene.model, data, r, masses) for r in (reference.still(), reference))
    states = StatesAt(scene.model, kept)
    planned, shifts, overlaps = _run(scene, data, holding, leading, states, steps, spec.planned_frames)
    joints = joint_positions(scene.model, states.qpos, bodies)
    judged = joints if spec.fps == PLAN_FPS else joint_positions(scene.model, planned, bodies)
    planned = zip(bodies, plan.root.swapaxes(0, 1), plan.rotations.swapaxes(0, 1), strict=True)
    # Clips are judged at the rate of the plan, so that the same ones are fit for use at any frame rate.
    wanted = np.stack([reference_joints(body, root, rotations) for body, root, rotations in planned], axis=1)
    return Simulation(
        model=scene.model,
        fps=spec.fps,
        qpos=states.qpos,
        joints=joints,
        skeleton=SKELETON,
        depth=np.stack([landmarks(body)[2] for body in bodies]),
        bodies=moved_with(scene.model, bodies),
        geom_ids=scene.geom_ids,
        objects=scene.objects,
        quality=asdict(assess(judged, wanted, overlaps, shifts, PLAN_FPS, plan.beyond)),
    )


class StatesAt:
    """States of a simulation at some times, between two steps where need be.

    Args:
        model: The scene.
        times: (F,) sorted times, as numbers of steps.

    Attributes:
        qpos: (F, nq) float64.
    """

    def __init__(self, model: mujoco.MjModel, times: np.ndarray):
        self._model, self._times, self._next = model, times, 0
        self.qpos, self._before = np.empty((len(times), model.nq)), np.empty(model.nq)

    def see(self, data: mujoco.MjData, step: int) -> None:
        """Take the state after so many steps; all have to be seen in turn."""
        while self._next < len(self._times) and self._times[self._next] <= step + _AT_ONCE:
            self.qpos[self._next] = self._between(data.qpos, self._times[self._next] - (step - 1))
            self._next += 1
        self._before[:] = data.qpos

    def _between(self, after: np.ndarray, share: float) -> np.ndarray:
        if share > 1 - _AT_ONCE:
            return after
        change, state = np.empty(self._model.nv), self._before.copy()
        mujoco.mj_differentiatePos(self._model, change, 1.0, self._before, after)
        mujoco.mj_integratePos(self._model, state, change, share)
        return state


def _run(
    scene: Scene,
    data: mujoco.MjData,
    holding: Controller,
    leading: Controller,
    states: StatesAt,
    steps: int,
    frames: int,
) -> tuple[np.ndarray, np.ndarray, Overlaps]:
    """States (F, nq), shifts of paths (F, P, 2), m, and overlaps of all F frames of the plan; `states` takes others."""
    model, persons = scene.model, int(scene.geom_persons.max()) + 1
    # Bodies that overlap in the first pose are eased apart before the clip begins.
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
