"""People in a MuJoCo scene: segments, joints, capsules for contact, and surfaces for images."""

import mujoco
import numpy as np

from dmae.data.skeleton import SKELETONS
from synth.materials.textures import add_texture, paint
from synth.people.body import Body, side_and_name
from synth.people.capsules import capsule_names, capsules
from synth.people.clothing import PersonLooks
from synth.people.landmarks import landmarks
from synth.people.segments import PARENTS, SEGMENTS
from synth.people.surfaces import Surface, surfaces

MOST_PERSONS = 30
"""Greatest number of people: contact filters are bits of a signed 32-bit number, one per person."""

_CLOTH = 0.012
"""Distance from the solid parts at which contact begins, m."""
_ARMS = ("forearm", "hand")
_TORSO = ("pelvis", "spine", "chest", "head", "thigh")
HIDDEN_GROUP = 3
"""Group of geoms that have contacts but are not drawn."""


def geom_parts(model: mujoco.MjModel) -> np.ndarray:
    """Return the body part of each geom, (ngeom,) uint8: 1 + its index in `SEGMENTS`, 0 if it is not of a person."""
    parts = np.zeros(model.nbody, np.uint8)
    for body in range(model.nbody):
        owner, _, segment = model.body(body).name.partition("/")
        if owner.startswith("person") and segment in SEGMENTS:
            parts[body] = 1 + SEGMENTS.index(segment)
    return parts[model.geom_bodyid]


def add_person(
    spec: mujoco.MjSpec, person: int, body: Body, looks: PersonLooks, *, position, rng: np.random.Generator | None
) -> None:
    """Add a person in the canonical T-pose.

    Bodies are named `person<p>/<segment>`; a free joint moves the pelvis, ball joints the others.

    Args:
        spec: The scene.
        person: Index of the person. The person's capsules touch everything except each other.
        body: Proportions.
        looks: Colours and clothes.
        position: (3,) of the mid point of the hip joints, m.
        rng: Draws the texture of the cloth. None leaves out all that only images need, and the sites of joints,
            `person<p>/<skeleton>.<joint>` for every known skeleton.
    """
    prefix = f"person{person}/"
    spec.nuser_geom = 1
    _add_materials(spec, prefix, looks, rng=rng)
    bodies = _add_segments(spec, prefix, body, position)
    _add_capsules(bodies, prefix, person, body, looks.hands)
    _add_touch(spec, prefix)
    if rng:
        _add_joints(bodies, prefix, body)
    for number, surface in enumerate(surfaces(body, looks, shaded=rng is not None)):
        name = f"{prefix}{surface.segment}/{surface.material}{number}"
        _add_mesh(spec, name, surface)
        bodies[SEGMENTS.index(surface.segment)].add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=prefix + surface.material,
            contype=0,
            conaffinity=0,
            mass=0,
            userdata=surface.share,
        )


def _add_segments(spec: mujoco.MjSpec, prefix: str, body: Body, position) -> list:
    bodies = []
    for i, (segment, parent) in enumerate(zip(SEGMENTS, PARENTS, strict=True)):
        within = spec.worldbody if parent < 0 else bodies[parent]
        added = within.add_body(name=prefix + segment, pos=position if parent < 0 else body.offsets[i])
        kind = mujoco.mjtJoint.mjJNT_FREE if parent < 0 else mujoco.mjtJoint.mjJNT_BALL
        added.add_joint(name=prefix + segment, type=kind)
        bodies.append(added)
    return bodies


def _add_capsules(bodies: list, prefix: str, person: int, body: Body, hands: tuple[str, str]) -> None:
    segments, ends, radii = capsules(body, hands)
    volume = np.pi * radii**2 * (np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) + 4 / 3 * radii)
    share = volume / np.bincount(segments, volume)[segments]
    masses = share * body.masses[segments]
    for name, segment, (start, stop), radius, mass in zip(capsule_names(), segments, ends, radii, masses, strict=True):
        foot = SEGMENTS[segment].endswith("foot")
        bodies[segment].add_geom(
            name=prefix + name,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*start, *stop],
            size=[radius, 0, 0],
            mass=mass,
            contype=1 << person,
            conaffinity=(2**31 - 1) & ~(1 << person),
            friction=[0.9 if foot else 0.3, 0.005, 0.0001],
            # Stiff enough that a kick overlaps by less than 40 mm. Contact begins before the solid parts overlap.
            solref=[0.006, 1.0],
            solimp=[0.95, 0.99, 0.002, 0.5, 2.0],
            margin=0.0 if foot else _CLOTH,
            # The capsule is neither drawn nor hit by rays; the surfaces around it are.
            group=HIDDEN_GROUP,
            rgba=[0, 0, 0, 0],
        )


def _add_touch(spec: mujoco.MjSpec, prefix: str) -> None:
    """Let forearms and hands touch the trunk, the head, the thighs, and the other forearm and hand."""
    solids = capsule_names()
    for i, one in enumerate(solids):
        for other in solids[:i]:
            if _touch(one.partition("/")[0], other.partition("/")[0]):
                spec.add_pair(geomname1=prefix + other, geomname2=prefix + one)


def _add_joints(bodies: list, prefix: str, body: Body) -> None:
    """Mark the joints of every skeleton as sites, for users of the model."""
    for name, skeleton in SKELETONS.items():
        segments, points, _ = landmarks(body, skeleton)
        for joint, segment, point in zip(skeleton.joints, segments, points, strict=True):
            bodies[segment].add_site(name=f"{prefix}{name}.{joint}", pos=point, group=HIDDEN_GROUP)


def _touch(one: str, other: str) -> bool:
    (side, name), (other_side, other_name) = side_and_name(one), side_and_name(other)
    if name in _ARMS and other_name in _ARMS:
        return side != other_side
    return (name in _ARMS and other_name in _TORSO) or (other_name in _ARMS and name in _TORSO)


def _add_materials(spec: mujoco.MjSpec, prefix: str, looks: PersonLooks, *, rng: np.random.Generator | None) -> None:
    flat = {
        "skin": looks.skin,
        "hair": looks.hair_colour,
        "brow": tuple(0.8 * c for c in looks.hair_colour),
        "eye": (0.92, 0.92, 0.90),
        "iris": (0.13, 0.09, 0.07),
        "lip": tuple(c * f for c, f in zip(looks.skin, (0.86, 0.62, 0.60), strict=True)),
        "shoe": looks.shoes,
        "sole": looks.sole,
    }
    for material, colour in flat.items():
        spec.add_material(name=prefix + material, rgba=[*colour, 1], specular=0.15, shininess=0.2)
    for material, garment in (("top", looks.top), ("bottom", looks.bottom)):
        added = spec.add_material(name=prefix + material, specular=0.05, shininess=0.05)
        if rng:
            add_texture(spec, added, paint(garment.pattern, garment.colours, 128, rng=rng))


def _add_mesh(spec: mujoco.MjSpec, name: str, surface: Surface) -> None:
    faces = surface.faces.ravel()
    shading = {}
    if surface.normals is not None:
        shading = {"usernormal": surface.normals.ravel(), "usertexcoord": surface.uv.ravel()}
        shading |= {"userfacenormal": faces, "userfacetexcoord": faces}
    spec.add_mesh(
        name=name,
        uservert=surface.vertices.ravel(),
        userface=faces,
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        **shading,
    )
