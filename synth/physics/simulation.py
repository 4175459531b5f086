"""Simulate a scene: people follow their motions in MuJoCo, with weight, contact and limited strength."""

from dataclasses import dataclass

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from synth.errors import FailedSimulation
from synth.motion.motion import Motion
from synth.people.body import SKELETON, landmarks
from synth.people.skinning import let_swing
from synth.physics.body_state import BodyState, joint_positions, moved_with, reference_joints
from synth.physics.controller import Controller, JointAddresses, find_joints, make_reference
from synth.physics.planning import plan_motions
from synth.scene.build import STEPS_PER_CONTROL, SUBSTEPS, Scene, build_scene
from synth.scene.sampling import load_motions
from synth.scene.spec import PLAN_FPS, SceneSpec

# Quality, and the limits beyond which a simulation is unfit for use

DEEP = 0.04
"""Overlap of two people above which it is visible, m."""
# Limits of a clip: share of its contact frames with deep overlaps, overlap (m), sidestep (m), median distance from the
# reference (m), drop of hips below the reference (m), share of frames with sliding feet.
_MOST_DEEP, _MOST_OVERLAP, _MOST_SHIFT, _MOST_ERROR, _MOST_DROP, _MOST_SLIDE = 0.1, 0.12, 1.2, 0.25, 0.35, 0.1
_SLIDING, _SLIDE_TIME = 0.25, 0.04
_ON_FLOOR = 0.035


def assess(
    joints: np.ndarray, wanted: np.ndarray, overlaps: np.ndarray, shifts: np.ndarray, fps: float, beyond: float
) -> dict[str, float]:
    """Assess a simulation. Raises FailedSimulation if the clip is unfit for use.

    Args:
        joints: (F, P, 39, 3) simulated joints of `SKELETON`, m.
        wanted: (F, P, 39, 3) joints of the reference, m.
        overlaps: (2, F) deepest overlap between people, and of people and objects, m; below 0 where only cloth is in
            contact, -inf without contact.
        shifts: (F, P, 2) displacements of people off their paths, m.
        beyond: The share `beyond_limits`.

    Returns:
        `tracking_error_mm`: median distance of the joints from the reference, mm.
        `contact_frames`: number of frames in which people touch each other, cloth included.
        `penetration_mm`: deepest overlap of two people's solid parts, measured every other physics step, mm.
        `deep_share`: share of the contact frames in which an overlap exceeds 40 mm.
        `object_penetration_mm`: deepest overlap of a person and an object, floor or wall, mm.
        `shift_m`: greatest distance by which contact pushed a person off the planned path, m.
        `foot_slide`: share of the time in which people have feet on the floor and slide: all heels and toes on the
        floor, or both of one foot, move faster than 0.25 m/s over 0.04 s. Points below 35 mm before and after are on
        the floor.
        `beyond_limits`: share of joints, over all frames, in which the motion exceeded `synth.people.joint_limits`; it
        was limited.
    """
    people, objects = overlaps
    contact = np.isfinite(people)
    quality = {
        "tracking_error_mm": _mm(np.median(np.linalg.norm(joints - wanted, axis=-1))),
        "contact_frames": int(contact.sum()),
        "penetration_mm": _mm(max(0.0, people.max())),
        "deep_share": round(float((people[contact] > DEEP).mean()) if contact.any() else 0.0, 4),
        "object_penetration_mm": _mm(max(0.0, objects.max())),
        "shift_m": round(float(np.linalg.norm(shifts, axis=-1).max()), 4),
        "foot_slide": _foot_slide(joints, fps),
        "beyond_limits": round(beyond, 4),
    }
    (hips,) = SKELETON.index("body25.mid_hip")
    # Sliding of the reference motion itself is not counted: another seed would not change it.
    slide = quality["foot_slide"] - _foot_slide(wanted, fps)
    drop = float((wanted - joints)[:, :, hips, 2].max())
    limits = [
        ("share of contact frames with overlaps above 40 mm", quality["deep_share"], _MOST_DEEP),
        ("deepest overlap of two people, mm", quality["penetration_mm"], 1000 * _MOST_OVERLAP),
        ("push off the planned path, m", quality["shift_m"], _MOST_SHIFT),
        ("median tracking error, mm", quality["tracking_error_mm"], 1000 * _MOST_ERROR),
        ("drop of a person's hips, m", drop, _MOST_DROP),
        ("share of the time in which standing feet slide", slide, _MOST_SLIDE),
    ]
    for what, found, most in limits:
        if not found <= most:
            raise FailedSimulation(f"{what}: {found:.3g}, at most {most:.3g} is allowed")
    return quality


def _mm(metres: float) -> float:
    return round(1000 * float(metres), 2)


def _foot_slide(joints: np.ndarray, fps: float) -> float:
    soles = [SKELETON.index(f"body25.{side}_{point}")[0] for side in "lr" for point in ("big_toe", "heel")]
    points = joints[:, :, soles]
    # Over shorter times the tremor of feet dominates.
    step = max(1, round(_SLIDE_TIME * fps))
    speed = np.linalg.norm(points[step:, ..., :2] - points[:-step, ..., :2], axis=-1) * fps / step
    low = points[..., 2] < _ON_FLOOR
    bearing = low[step:] & low[:-step]
    slides = (speed > _SLIDING) | ~bearing
    flat, gliding = (every.reshape(*every.shape[:2], 2, 2).all(-1) for every in (bearing, slides))
    skates = (bearing.any(-1) & slides.all(-1)) | (flat & gliding).any(-1)
    return round(float(skates.mean()) if skates.size else 0.0, 4)


# States, forces and contacts at the times of the frames

AT_ONCE = 1e-6
"""Times closer than this to a step count as the time of the step, in steps."""


class StatesAt:
    """A recorder of the states of a simulation at given times, interpolated between two steps where necessary.

    Args:
        joints: Addresses of the people's joints.
        geom_persons: (ngeom,) index of the person that a geom belongs to, -1 for objects.
        times: (F,) sorted times, as numbers of steps.

    Attributes:
        qpos: (F, nq) float64.
        forces: (F, P, 17, 3) forces and torques that are applied to people in the last step before each time.
    """

    def __init__(self, model: mujoco.MjModel, joints: JointAddresses, geom_persons: np.ndarray, times: np.ndarray):
        self._model, self._joints, self._persons, self._times, self._next = model, joints, geom_persons, times, 0
        self.qpos, self._before = np.empty((len(times), model.nq)), np.empty(model.nq)
        self.forces = np.empty((len(times), *joints.moves(np.empty(model.nv)).shape), np.float32)
        self._contacts: list[tuple[np.ndarray, ...]] = []

    def see(self, data: mujoco.MjData, step: int) -> None:
        """Record the state after this number of steps; call it for all steps in order."""
        while self._next < len(self._times) and self._times[self._next] <= step + AT_ONCE:
            self.qpos[self._next] = self._between(data.qpos, self._times[self._next] - (step - 1))
            self.forces[self._next] = self._joints.moves(data.qfrc_applied)
            self._contacts.append(self._pressing(data))
            self._next += 1
        self._before[:] = data.qpos

    def contacts(self) -> tuple[np.ndarray, ...]:
        """Return frame (C,), geoms (C, 2), point (C, 3), force of the first on the second (C, 3) and depth (C,)."""
        frames = np.repeat(np.arange(len(self._contacts)), [len(found[0]) for found in self._contacts])
        return frames, *(np.concatenate(part) for part in zip(*self._contacts, strict=True))

    def _between(self, after: np.ndarray, share: float) -> np.ndarray:
        if share > 1 - AT_ONCE:
            return after
        change, state = np.empty(self._model.nv), self._before.copy()
        mujoco.mj_differentiatePos(self._model, change, 1.0, self._before, after)
        mujoco.mj_integratePos(self._model, state, change, share)
        return state

    def _pressing(self, data: mujoco.MjData) -> tuple[np.ndarray, ...]:
        """Return the contacts of people in which a force acts."""
        contact, local = data.contact, np.zeros((data.ncon, 6))
        for number in range(data.ncon):
            mujoco.mj_contactForce(self._model, data, number, local[number])
        pressing = np.flatnonzero((local[:, 0] > 0) & (self._persons[contact.geom] >= 0).any(1))
        # The rows of a contact's frame are its axes, first the normal from the first geom to the second.
        forces = np.einsum("cij,ci->cj", contact.frame[pressing].reshape(-1, 3, 3), local[pressing, :3])
        return contact.geom[pressing], contact.pos[pressing], forces, -contact.dist[pressing]


# The simulation

_SETTLING = 0.25
"""Time for which people hold their first pose before the clip, s."""


@dataclass(frozen=True)
class Simulation(Scene):
    """A simulated clip: its scene, cameras included, and states, from which labels are read, never from the reference
    motion."""

    fps: float  # Frames per second
    state: BodyState  # State of the bodies in each frame
    joints: np.ndarray  # (F, P, 39, 3) float64 joints of `SKELETON`, m, world
    # (P, 39) greatest distance before a joint at which a ray that meets its own limb counts as seeing it, m
    depth: np.ndarray
    bodies: np.ndarray  # (P, 39) index of the model's body that each joint moves with
    quality: dict  # What `assess` returns

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
            f"found {len(motions)} of {sorted(lengths)} frames"
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
    let_swing(scene.model, states.qpos, spec.fps)
    joints = joint_positions(scene.model, states.qpos, bodies)
    judged = joints if spec.fps == PLAN_FPS else joint_positions(scene.model, planned, bodies)
    motion = zip(bodies, plan.root.swapaxes(0, 1), plan.rotations.swapaxes(0, 1), strict=True)
    # Clips are judged at the rate of the plan, so that the same clips are fit for use at any frame rate.
    wanted = np.stack([reference_joints(body, root, rotations) for body, root, rotations in motion], axis=1)
    return Simulation(
        **vars(scene),
        fps=spec.fps,
        state=_body_state(spec, scene, states, motions, kept / SUBSTEPS),
        joints=joints,
        depth=np.stack([landmarks(body)[2] for body in bodies]),
        bodies=moved_with(scene.model, bodies),
        quality=assess(judged, wanted, overlaps, shifts, PLAN_FPS, plan.beyond),
    )


def rebuilt_scene(clip: Clip, state: BodyState, rig: CameraRig | None = None, *, painted: bool = True) -> Scene:
    """Return the scene of a simulated clip, built again for cameras, by default its own; its cloth swings as before.

    Raises ValueError if the clip has no scene in its provenance, or one in which its states are impossible, and
    FileNotFoundError if a file of the room does not exist.
    """
    spec = SceneSpec.of(clip)
    scene = build_scene(spec, rig or clip.actual_rig, painted=painted)
    if scene.model.nq != state.qpos.shape[1] or tuple(dict.fromkeys(scene.geom_names)) != state.contact_names:
        raise ValueError(f"clip {clip.id!r}: its states are of another scene; has the room {spec.arena} changed?")
    let_swing(scene.model, state.qpos, clip.fps)
    return scene


def _body_state(
    spec: SceneSpec, scene: Scene, states: StatesAt, motions: list[Motion], planned: np.ndarray
) -> BodyState:
    """Return the recorded states; `planned` (F,) are the times of the recorded frames, in frames of the plan."""
    joints, names = find_joints(scene.model, len(spec.persons)), scene.geom_names
    contact_names = tuple(dict.fromkeys(names))
    frame, geoms, point, force, depth = states.contacts()
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
        root=joints.root(states.qpos),
        rotations=joints.quats(states.qpos),
        forces=states.forces,
        shapes=tuple(person.body for person in spec.persons),
        actions=np.array([[action_names.index(name) for name in each] for each in doing]).T,
        action_names=action_names,
        contact_frame=frame,
        contact_between=np.array([contact_names.index(name) for name in names])[geoms],
        contact_names=contact_names,
        contact_point=point,
        contact_force=force,
        contact_depth=depth,
    )


def _run(
    scene: Scene,
    data: mujoco.MjData,
    holding: Controller,
    leading: Controller,
    states: StatesAt,
    steps: int,
    frames: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return states (F, nq), path shifts (F, P, 2), m, and overlaps (2, F) in the plan's F frames; record `states`."""
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
    overlaps = np.full((2, frames), -np.inf)
    record_overlaps(data, scene.geom_persons, overlaps[:, 0])
    held, begin, end = scene.holds[:, 0].astype(int), *scene.holds[:, 1:].T
    for step in range(steps):
        frame, within = step // SUBSTEPS + 1, step % SUBSTEPS
        if within == 0:
            data.eq_active[held] = (begin <= frame / PLAN_FPS) & (frame / PLAN_FPS < end)
        leading.apply(step)
        mujoco.mj_step(model, data, STEPS_PER_CONTROL)
        states.see(data, step + 1)
        if frame < frames:
            record_overlaps(data, scene.geom_persons, overlaps[:, frame])
        if within == SUBSTEPS - 1:
            _check(data, frame / PLAN_FPS)
            if frame < frames:
                qpos[frame], shifts[frame] = data.qpos, leading.shift
    _check(data, steps / (PLAN_FPS * SUBSTEPS))
    return qpos, shifts, overlaps


def record_overlaps(data: mujoco.MjData, persons: np.ndarray, deepest: np.ndarray) -> None:
    """Raise the `deepest` (2,) overlaps of a frame, m, by the contacts of one of its steps."""
    one, other = persons[data.contact.geom].T
    with_object = np.minimum(one, other) < 0
    for kind, which in enumerate((~with_object & (one != other), with_object)):
        deepest[kind] = max(deepest[kind], (-data.contact.dist[which]).max(initial=-np.inf))


def _check(data: mujoco.MjData, seconds: float) -> None:
    if data.warning.number.any() or not np.isfinite(data.qpos).all():
        raised = [mujoco.mjtWarning(i).name for i in np.flatnonzero(data.warning.number)]
        raise FailedSimulation(f"the solver failed at {seconds:.2f} s: {', '.join(raised) or 'state is not finite'}")
