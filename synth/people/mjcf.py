"""People in MuJoCo: solid parts with mass and contacts, joints, and surfaces for images."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from dmae.data.skeleton import SKELETONS
from synth.people.body import PARENTS, SEGMENTS, Body, landmarks, side_and_name
from synth.people.clothing import PersonLooks
from synth.people.hands import HandChange, MovingHands
from synth.people.outfit import Part, drapes, paint_clothes, parts
from synth.people.skin import paint_iris, paint_lips, paint_shoe, paint_skin
from synth.people.skinning import SKINNED, pack
from synth.people.solids import CLOTH, capsule_names, capsules, inertias
from synth.people.surface import BareBody, bare_body
from synth.textures import add_texture, paint

_ARMS = ("forearm", "hand")
_TORSO = ("pelvis", "spine", "chest", "head", "thigh")
_TEXELS = 256
"""Side of the texture of hair, and of a repeat of the pattern of cloth, px."""
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
    spec: mujoco.MjSpec,
    person: int,
    body: Body,
    looks: PersonLooks,
    changes: Sequence[HandChange] = (),
    *,
    position,
    rng: np.random.Generator | None,
) -> None:
    """Add a person in the canonical T-pose.

    Bodies are named `person<p>/<segment>`; a free joint moves the pelvis, ball joints the others.

    Args:
        person: Index of the person. The person's solid parts touch everything except each other.
        body: Proportions.
        looks: Colours and clothes.
        changes: How the visible hands change; none for hands that keep the shapes of `looks`.
        position: (3,) of the mid point of the hip joints, m.
        rng: Draws the texture of the cloth. None leaves out all that only images need, and the sites of joints,
            `person<p>/<skeleton>.<joint>` for every known skeleton.
    """
    prefix = f"person{person}/"
    spec.nuser_geom = 1
    _add_materials(spec, prefix, body, looks, rng=rng)
    bodies = _add_segments(spec, prefix, body, position)
    _add_touch(spec, prefix, _add_capsules(bodies, prefix, person, body, looks.hands))
    if rng:
        _add_joints(bodies, prefix, body)
    if changes:
        looks = replace(looks, hands=None)
    bare, rows = bare_body(body, looks.hands), []
    for number, part in enumerate(parts(body, looks)):
        segment, name = SEGMENTS.index(part.segment), f"{prefix}{part.segment}/{part.material}{number}"
        bends = not ((part.bones[:, 0] == segment) & (part.weights[:, 0] > 1 - 1e-6)).all()
        if bends:
            rows.append(np.concatenate([part.bones, part.weights, part.vertices, part.normals], axis=1))
        _add_mesh(spec, name, part, bare, textured=rng is not None)
        bodies[segment].add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=prefix + part.material,
            contype=0,
            conaffinity=0,
            mass=0,
            userdata=[SKINNED if bends else 0],
        )
    numbers = pack(bare.rotations, bare.origins, np.concatenate(rows))
    spec.add_numeric(name=prefix + "skin", data=numbers, size=len(numbers))
    for number, (_, drape) in enumerate(drapes(body, looks)):
        packed = drape.pack()
        spec.add_numeric(name=f"{prefix}drape{number}", data=packed, size=len(packed))
    if changes:
        numbers = MovingHands.of(bare.fingers, changes).pack()
        spec.add_numeric(name=prefix + "hands", data=numbers, size=len(numbers))


def _add_segments(spec: mujoco.MjSpec, prefix: str, body: Body, position) -> list:
    bodies = []
    for i, (segment, parent) in enumerate(zip(SEGMENTS, PARENTS, strict=True)):
        within = spec.worldbody if parent < 0 else bodies[parent]
        added = within.add_body(name=prefix + segment, pos=position if parent < 0 else body.offsets[i])
        kind = mujoco.mjtJoint.mjJNT_FREE if parent < 0 else mujoco.mjtJoint.mjJNT_BALL
        added.add_joint(name=prefix + segment, type=kind)
        bodies.append(added)
    return bodies


def _add_capsules(bodies: list, prefix: str, person: int, body: Body, hands: tuple[str, str] | None) -> list[str]:
    """Add the solid parts; return their names without the prefix."""
    segments, ends, radii = capsules(body, hands)
    names = capsule_names(segments)
    if body.snug:
        for segment, mass, centre, inertia in zip(bodies, body.masses, *inertias(body, hands), strict=True):
            segment.explicitinertial, segment.mass, segment.ipos = True, mass, centre
            segment.fullinertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    volume = np.pi * radii**2 * (np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) + 4 / 3 * radii)
    share = volume / np.bincount(segments, volume)[segments]
    masses = share * body.masses[segments]
    for name, segment, (start, stop), radius, mass in zip(names, segments, ends, radii, masses, strict=True):
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
            margin=0.0 if foot else CLOTH,
            # The capsule is neither drawn nor hit by rays; the surfaces around it are.
            group=HIDDEN_GROUP,
            rgba=[0, 0, 0, 0],
        )
    return names


def _add_touch(spec: mujoco.MjSpec, prefix: str, solids: Sequence[str]) -> None:
    """Let forearms and hands touch the trunk, the head, the thighs, and the other forearm and hand."""
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


def _add_materials(
    spec: mujoco.MjSpec, prefix: str, body: Body, looks: PersonLooks, *, rng: np.random.Generator | None
) -> None:
    flat = {
        "skin": looks.skin,
        "brow": tuple(0.6 * hair + 0.25 * skin for hair, skin in zip(looks.hair_colour, looks.skin, strict=True)),
        "eye": (0.82, 0.78, 0.76),
        "iris": (0.13, 0.09, 0.07),
        "lip": tuple(c * f for c, f in zip(looks.skin, (0.86, 0.62, 0.60), strict=True)),
        "shoe": looks.shoes,
        "sole": looks.sole,
    }
    strands = tuple(tuple(shade * c for c in looks.hair_colour) for shade in (0.75, 1.15))
    woven = {"top": looks.top.colours, "bottom": looks.bottom.colours, "hair": strands}
    if looks.coat:
        woven["coat"] = looks.coat.cloth.colours
    if looks.hat:
        flat |= dict(zip(("hat", "brim"), looks.hat.colours, strict=True))
    if looks.bag:
        flat |= dict(zip(("bag", "strap"), looks.bag.colours, strict=True))
    for material, colour in flat.items():
        # Skin scatters light beneath its surface, so that its shaded side is not as dark.
        shine, glow = (0.05, 0.08) if material in ("skin", "lip") else (0.15, 0.0)
        spec.add_material(name=prefix + material, rgba=[*colour, 1], specular=shine, shininess=0.2, emission=glow)
    for material, colours in woven.items():
        rgba = [*np.mean(colours, axis=0), 1]
        specular, shininess = (0.5, 0.2) if material == "hair" else (0.05, 0.05)
        spec.add_material(name=prefix + material, rgba=rgba, specular=specular, shininess=shininess)
    if rng:
        painted = paint_clothes(body, looks, _TEXELS, rng=rng)
        painted["hair"] = paint("hair", strands, _TEXELS, rng=rng)
        painted["skin"] = paint_skin(body, looks, rng=rng)
        painted["iris"] = paint_iris(looks, rng=rng)
        painted["lip"] = paint_lips(body, looks, rng=rng)
        painted["shoe"] = paint_shoe(looks, rng=rng)
        # Textures of what not everybody wears have streams of their own, and change no other's.
        of_hat, of_bag = rng.spawn(2)
        if looks.bag:
            painted["bag"] = paint("plain", looks.bag.colours, _TEXELS, rng=of_bag)
        if looks.hat:
            painted["hat"] = paint(
                "plain" if looks.hat.kind == "cap" else "knit", looks.hat.colours, _TEXELS, rng=of_hat
            )
        for name, image in painted.items():
            material = spec.material(prefix + name)
            material.rgba = [1, 1, 1, 1]
            add_texture(spec, material, image)


def _add_mesh(spec: mujoco.MjSpec, name: str, part: Part, bare: BareBody, *, textured: bool) -> None:
    segment, faces, texture = SEGMENTS.index(part.segment), part.faces.ravel(), {}
    turn = bare.rotations[segment]
    if textured:
        texture = {"usertexcoord": part.uv.ravel(), "userfacetexcoord": np.arange(len(faces))}
    spec.add_mesh(
        name=name,
        uservert=((part.vertices - bare.origins[segment]) @ turn).ravel(),
        userface=faces,
        usernormal=(part.normals @ turn).ravel(),
        userfacenormal=faces,
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        **texture,
    )
