"""From a scene's specification to the MuJoCo model of it."""

from dataclasses import dataclass

import mujoco
import numpy as np

from dmae.cameras import CameraRig
from dmae.images import FIRST_OBJECT_ID
from dmae.rng import Stream, generator
from synth.arena import arena_file, footprints
from synth.body import SIDES
from synth.control import HELD
from synth.coverage import check_outside
from synth.decor import Finish, decorate
from synth.interactions.script import Load
from synth.lens import add_cameras
from synth.motion.limbs import PALM
from synth.person import HIDDEN_GROUP, add_person
from synth.placement import placed_discs
from synth.props import prop_space, prop_spec
from synth.spec import PersonSpec, PropSpec, SceneSpec
from synth.textures import add_texture, paint

_GRIP_DAMPING = 1.0
"""Of a carried thing, N m s / rad, and N s / m."""
_LONGEST_STEP = 0.0025
"""Of the physics, s: kicks move a few centimetres in twice that."""


@dataclass(frozen=True)
class Scene:
    """A scene ready to be simulated.

    Attributes:
        model: The MuJoCo model; people's bodies are named `person<p>/<segment>`.
        substeps: How often the forces that lead people are set in a frame, each time for `synth.control.HELD` steps.
        geom_ids: (ngeom,) uint16, as in the ids of images: 1 + p for what shows of person p, 256 + k for object k,
            0 for the solid parts of people, which only touch.
        geom_persons: (ngeom,) index of the person a geom belongs to, -1 for things.
        objects: Names of all that is no person, at least "floor".
        obstacles: (K, 3) x, y and radius of discs that cover what stands about, furniture of an interaction apart, m.
        holds: (H, 3) index of each equality constraint by which a hand holds a thing, when it begins and ends, s.
    """

    model: mujoco.MjModel
    substeps: int
    geom_ids: np.ndarray
    geom_persons: np.ndarray
    objects: tuple[str, ...]
    obstacles: np.ndarray
    holds: np.ndarray


def build_scene(spec: SceneSpec, rig: CameraRig, *, painted: bool = True) -> Scene:
    """Put a room, its props, people in T-pose and cameras together.

    Without paint textures and smooth shading are left out, which labels do not need.

    Raises:
        ValueError: an MJCF file is missing or lacks what is needed; a camera cannot be rendered.
        FailedSimulation: a camera is within a thing.
    """
    world = mujoco.MjSpec.from_file(str(arena_file(spec.arena)))
    _set_options(world, spec.fps)
    # A child of the scene's stream: the noise of textures is none of the draws that made the spec.
    rng = generator(spec.seed, spec.clip, Stream.SCENE).spawn(1)[0] if painted else None
    decorate(world, spec.decor)
    for name, finish in (("floor", spec.decor.floor), ("wall", spec.decor.wall)):
        _cover(world, name, finish, spec.arena, rng=rng)
    for number, prop in enumerate(spec.furniture):
        add_prop(world, f"furniture{number}/", prop)
    obstacles = [footprints(arena_file(spec.arena))]
    for number, prop in enumerate(spec.props):
        obstacles.append(add_prop(world, f"{number}/", prop))
    for number, person in enumerate(spec.persons):
        at = (*person.start, person.body.hip_height)
        add_person(world, number, person.body, person.looks, position=at, rng=rng)
    for number, load in enumerate(spec.loads):
        _add_load(world, f"load{number}/", load, spec.persons)
    add_cameras(world, rig)
    model = world.compile()
    identity = _identify(model)
    check_outside(rig, model, identity[0])
    grips = [grip for load in spec.loads for grip in load.grips for _ in SIDES]
    holds = np.array([(number, grip.begin, grip.end) for number, grip in enumerate(grips)]).reshape(-1, 3)
    return Scene(model, _substeps(spec.fps), *identity, np.concatenate(obstacles), holds)


def _substeps(fps: float) -> int:
    return int(np.ceil(1 / (fps * HELD * _LONGEST_STEP) - 1e-9))


def _set_options(world: mujoco.MjSpec, fps: float) -> None:
    world.compiler.degree = False
    option = world.option
    option.timestep = 1 / (fps * _substeps(fps) * HELD)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # MuJoCo 4.0.0 solves with a sparse Jacobian wrongly, and scenes of this size would get one.
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE


def _cover(world: mujoco.MjSpec, name: str, finish: Finish, arena: str, *, rng: np.random.Generator | None) -> None:
    material = world.material(name)
    if material is None:
        raise ValueError(f"arena {arena!r}: needs a material named {name!r}, which the scene covers with a texture")
    if rng:
        add_texture(world, material, paint(finish.pattern, finish.colours, 512, rng=rng))


def add_prop(world: mujoco.MjSpec, prefix: str, prop: PropSpec) -> np.ndarray:
    """Put a thing into a scene, its names prefixed; the (K, 3) discs that it takes on the floor, m."""
    thing = prop_spec(prop.kind, prop.scale, prop.up)
    tint = thing.material("tint")
    if tint is not None and prop.tint:
        tint.rgba = [*prop.tint, 1]
    half = prop.yaw / 2
    frame = world.worldbody.add_frame(pos=[*prop.at, 0], quat=[np.cos(half), 0, 0, np.sin(half)])
    world.attach(thing, prefix=prefix, frame=frame)
    return placed_discs(prop_space(prop.kind, prop.scale, prop.up).discs, prop.at, prop.yaw)


def _add_load(world: mujoco.MjSpec, prefix: str, load: Load, persons: tuple[PersonSpec, ...]) -> None:
    """Add a thing that moves freely, tied to the palms of those who hold it as long as they do."""
    thing = prop_spec(load.kind)
    body = thing.worldbody.first_body()
    thing_body = body.name
    # Between palms nothing swings for long.
    body.add_joint(name="free", type=mujoco.mjtJoint.mjJNT_FREE, damping=_GRIP_DAMPING)
    for number, grip in enumerate(load.grips):
        for side, sign in SIDES.items():
            across = sign * load.half_width * (1 if number % 2 == 0 else -1)
            body.add_site(name=f"grip{number}{side}", pos=[0, across, grip.height])
    half = load.yaw / 2
    frame = world.worldbody.add_frame(pos=load.at, quat=[np.cos(half), 0, 0, np.sin(half)])
    world.attach(thing, prefix=prefix, frame=frame)
    for number, grip in enumerate(load.grips):
        for side, sign in SIDES.items():
            holder, name = persons[grip.person].body, f"{prefix}grip{number}{side}"
            palm = PALM * (1, sign * holder.arms, 1) * holder.stature
            world.body(f"person{grip.person}/{side}_hand").add_site(name=f"{name}/palm", pos=palm)
            # The grip itself keeps hands at the surface; rubbing against it they would turn the thing.
            for part in ("forearm", "hand"):
                world.add_exclude(bodyname1=prefix + thing_body, bodyname2=f"person{grip.person}/{side}_{part}")
            world.add_equality(
                type=mujoco.mjtEq.mjEQ_CONNECT,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                name1=name,
                name2=f"{name}/palm",
                active=grip.begin <= 0,
                solref=[0.02, 1.0],
            )


def _identify(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Ids and persons of geoms, and names of objects: a body is an object, and so is a geom of the world itself."""
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
