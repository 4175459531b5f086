"""Build the MuJoCo model of a scene from its specification."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.rng import Stream, generator
from synth.interactions.script import Load
from synth.motion.geometry import PALM
from synth.people.body import SIDES
from synth.people.mjcf import HIDDEN_GROUP, add_person
from synth.people.outfit import drapes
from synth.rigs.coverage import check_outside
from synth.rigs.lenses import add_cameras
from synth.rooms.decor import decorate
from synth.rooms.props import footprints, prop_size, prop_spec
from synth.rooms.room import FLOOR, WALL, arena_file, load_room
from synth.scene.placement import placed_discs
from synth.scene.spec import PLAN_FPS, PersonSpec, PropSpec, SceneSpec
from synth.textures import add_texture, paint

_GRIP_DAMPING = 1.0
"""Damping of a carried object, N m s / rad and N s / m."""
STEPS_PER_CONTROL = 2
"""Physics steps between two updates of the controller's forces."""
SUBSTEPS = 8
"""Updates of the controller's forces per frame of the plan. A physics step takes 2.5 ms. A kicking foot moves a few
centimetres in two steps."""


@dataclass(frozen=True)
class Scene:
    """A scene that is ready for simulation."""

    model: mujoco.MjModel  # The MuJoCo model; people's bodies are named `person<p>/<segment>`
    # (ngeom,) uint16 ids, the same as in id images: 1 + p for the visible surface of person p, 256 + k for object k, 0
    # for the solid parts of people, which only collide
    geom_ids: np.ndarray
    geom_persons: np.ndarray  # (ngeom,) index of the person that a geom belongs to, -1 for objects
    objects: tuple[str, ...]  # Names of the objects, at least "floor"
    # (K, 3) x, y and radius of discs that cover the room's objects and the props, without furniture, m
    obstacles: np.ndarray
    # (H, 3) one row per equality constraint that ties a hand to an object: the index of the constraint, and the times
    # at which it begins and ends, s
    holds: np.ndarray

    @property
    def geom_names(self) -> list[str]:
        """The name of the owner of each geom: `person<p>/<segment>`, or the name of an object."""
        return [
            self.model.body(self.model.geom_bodyid[geom]).name
            if person >= 0
            else self.objects[self.geom_ids[geom] - FIRST_OBJECT_ID]
            for geom, person in enumerate(self.geom_persons)
        ]


def build_scene(spec: SceneSpec, rig: CameraRig, *, painted: bool = True) -> Scene:
    """Assemble a room, its props, people in T-pose and cameras, textured and smooth if `painted`, as images need it.

    Raises ValueError if an MJCF file is missing or malformed, or a camera cannot be rendered, and FailedSimulation if a
    camera is inside an object.
    """
    world, _ = load_room(spec.arena)
    world.option.timestep = 1 / (PLAN_FPS * SUBSTEPS * STEPS_PER_CONTROL)
    world.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # MuJoCo 4.0.0 gives wrong solutions with a sparse Jacobian, and would choose one for scenes of this size.
    world.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    # Textures use a child of the scene's random stream, so they do not change the draws that made the spec.
    rng = generator(spec.seed, spec.clip, Stream.SCENE).spawn(1)[0] if painted else None
    decorate(world, spec.decor)
    for name, finish in ((FLOOR, spec.decor.floor), (WALL, spec.decor.wall)):
        material = world.material(name)
        if rng and material is not None:
            add_texture(world, material, paint(finish.pattern, finish.colours, 512, rng=rng))
    for number, prop in enumerate(spec.furniture):
        add_prop(world, f"furniture{number}/", prop)
    obstacles = [footprints(arena_file(spec.arena))]
    for number, prop in enumerate(spec.props):
        obstacles.append(add_prop(world, f"{number}/", prop))
    for number, person in enumerate(spec.persons):
        at = (*person.start, person.body.hip_height)
        add_person(world, number, person.body, person.looks, person.hands, position=at, rng=rng)
        if drapes(person.body, person.looks):
            # `synth.people.skinning.let_swing` fills it.
            still = [spec.fps, *np.zeros(2 * spec.frames)]
            world.add_numeric(name=f"person{number}/swing", data=still, size=len(still))
    for number, load in enumerate(spec.loads):
        _add_load(world, f"load{number}/", load, spec.persons)
    add_cameras(world, rig)
    model = world.compile()
    identity = _identify(model)
    check_outside(rig, model, identity[0])
    grips = [grip for load in spec.loads for grip in load.grips for _ in SIDES]
    holds = np.array([(number, grip.begin, grip.end) for number, grip in enumerate(grips)]).reshape(-1, 3)
    return Scene(model, *identity, np.concatenate(obstacles), holds)


def add_prop(world: mujoco.MjSpec, prefix: str, prop: PropSpec) -> np.ndarray:
    """Add a prop to a scene, prefix its names, and return the discs (K, 3) that it covers: x, y, radius, m."""
    child = prop_spec(prop.kind, prop.scale, prop.up)
    tint = child.material("tint")
    if tint is not None and prop.tint:
        tint.rgba = [*prop.tint, 1]
    _attach(world, child, prefix, (*prop.at, 0), prop.yaw)
    return placed_discs(prop_size(prop.kind, prop.scale, prop.up).discs, prop.at, prop.yaw)


def _attach(world: mujoco.MjSpec, child: mujoco.MjSpec, prefix: str, at: Sequence[float], yaw: float) -> None:
    frame = world.worldbody.add_frame(pos=at, quat=[np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    world.attach(child, prefix=prefix, frame=frame)


def _add_load(world: mujoco.MjSpec, prefix: str, load: Load, persons: tuple[PersonSpec, ...]) -> None:
    """Add an object that moves freely and is tied to palms while they grip it."""
    child = prop_spec(load.kind)
    body = child.worldbody.first_body()
    child_body = body.name
    # Damping stops an object between two palms from swinging for long.
    body.add_joint(name="free", type=mujoco.mjtJoint.mjJNT_FREE, damping=_GRIP_DAMPING)
    for number, grip in enumerate(load.grips):
        for side, sign in SIDES.items():
            across = sign * load.half_width * (1 if number % 2 == 0 else -1)
            body.add_site(name=f"grip{number}{side}", pos=[0, across, grip.height])
    _attach(world, child, prefix, load.at, load.yaw)
    for number, grip in enumerate(load.grips):
        for side, sign in SIDES.items():
            holder, name = persons[grip.person].body, f"{prefix}grip{number}{side}"
            palm = PALM * (1, sign * holder.arms, 1) * holder.stature
            world.body(f"person{grip.person}/{side}_hand").add_site(name=f"{name}/palm", pos=palm)
            # The grip already keeps the hands at the surface. Friction of the hands would turn the object.
            for part in ("forearm", "hand"):
                world.add_exclude(bodyname1=prefix + child_body, bodyname2=f"person{grip.person}/{side}_{part}")
            world.add_equality(
                type=mujoco.mjtEq.mjEQ_CONNECT,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                name1=name,
                name2=f"{name}/palm",
                active=grip.begin <= 0,
                solref=[0.02, 1.0],
            )


def _identify(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return ids (ngeom,) and persons (ngeom,) of geoms, and names of objects: bodies of none, geoms of the world."""
    ids, persons = np.zeros(model.ngeom, np.uint16), np.full(model.ngeom, -1)
    objects: list[str] = []
    for geom in range(model.ngeom):
        body = model.body(model.geom_bodyid[geom])
        top = model.body(body.rootid[0]).name
        if top.startswith("person"):
            persons[geom] = int(top.removeprefix("person").partition("/")[0])
            ids[geom] = 0 if model.geom_group[geom] == HIDDEN_GROUP else 1 + persons[geom]
            continue
        name = (body.name if body.id else model.geom(geom).name) or f"geom{geom}"
        if name not in objects:
            objects.append(name)
        ids[geom] = FIRST_OBJECT_ID + objects.index(name)
    return ids, persons, tuple(objects)
