"""Whole scenes for other renderers: room, props, people in motion, cameras with their lenses, and lights.

A clip is a file, in m: glTF 2.0, y up, or USD with UsdSkel, z up (`docs/reference/exports.md`). Each person is one
skinned mesh, clothes included; loads are rigid pieces that move. Colours are plain: textures and clothes' patterns are
not exported. A reader that ignores skins shows people with lowered arms at their first place.
"""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.conversion import convert
from dmae.files.contents import write_atomic
from dmae.formats.animation import WORLD_Y_UP
from dmae.formats.glb import BYTE, INDICES, INT, VERTICES, GltfFile
from dmae.numerics.body import continuous
from synth.datasets.exporters import exporter
from synth.datasets.exporters.selection import ClipTask, Selection
from synth.people.body import PARENTS, SEGMENTS
from synth.people.skinning import BONE_NAMES, FIRST_NODE, MOST_BONES, Skin, SkinOfPerson
from synth.physics.body_state import load_state
from synth.physics.simulation import rebuilt_scene
from synth.rendering.sensor import light_of

_DRAWN = 3
"""Geoms of groups below this are drawn; the others only collide."""
_FLOOR_M = 20.0
"""m; half the size of planes without a size."""
_GL_FROM_CV = np.diag([1.0, -1.0, -1.0])
_SENSOR_MM = 36.0
_LIGHT_LUX, _LIGHT_CANDELA = 3.0, 60.0
"""Brightness of a white light."""


@dataclass(frozen=True)
class _Piece:
    name: str  # Owner and number
    points: np.ndarray  # (n, 3) m, vertices of its mesh in the frame of its body
    faces: np.ndarray  # (m, 3) indices of vertices
    colour: np.ndarray  # RGBA


@dataclass(frozen=True)
class _Body:
    """A body that is drawn, in motion."""

    name: str
    places: np.ndarray  # (F, 3) m
    turns: np.ndarray  # (F, 4) quaternions, w last
    pieces: list[_Piece]


@dataclass(frozen=True)
class _SkinInMotion:
    """The mesh of a person, N vertices, and its B bones, world z up, m."""

    name: str
    points: np.ndarray  # (N, 3) in the bind pose
    normals: np.ndarray  # (N, 3) in the bind pose
    which: np.ndarray  # (N, 4) indices of the bones that move each vertex
    weights: np.ndarray  # (N, 4) their weights, largest first
    looks: dict[str, tuple[np.ndarray, np.ndarray]]  # RGBA and faces (m, 3) of each material
    bones: tuple[str, ...]  # (B,) names of the bones
    bind: np.ndarray  # (B, 4, 4) bones in the bind pose
    places: np.ndarray  # (F, B, 3) of bones
    turns: np.ndarray  # (F, B, 4) of bones, w last


@dataclass(frozen=True)
class _Light:
    """A light of the room, which shines along -z."""

    far: bool  # Whether it is directional
    place: np.ndarray  # (3,) m
    turn: np.ndarray  # (4,) quaternion, w last
    colour: list[float]  # RGB, 1 for the largest
    intensity: float  # lux of a directional light, candela of another


@dataclass(frozen=True)
class _SceneInMotion:
    """A clip's scene in F frames, world z up, m."""

    seconds: np.ndarray  # (F,) s
    bodies: list[_Body]  # All but people
    skins: list[_SkinInMotion]
    joints: dict[str, np.ndarray]  # Places (F, 3) of the true joints of all persons that are known in all frames
    rig: CameraRig  # The true cameras
    turned: np.ndarray  # (V, 4) turns of the cameras, w last: in both formats, they look along -z, y up
    lights: list[_Light]


@exporter("glb", images=False, skeleton="body25")
def export_glb(selection: Selection, out: Path) -> dict[str, Counter]:
    """glTF scene for each clip: room, props, people in motion, cameras, lights: `<split>/<clip>.glb`."""
    return selection.export(_write_glb, out)


@exporter("usd", images=False, skeleton="body25")
def export_usd(selection: Selection, out: Path) -> dict[str, Counter]:
    """USD scene for each clip, with full pinhole cameras: `<split>/<clip>.usdc`. It needs usd-core.

    Raises ValueError if usd-core is not installed.
    """
    try:
        import pxr  # noqa: F401
    except ImportError:
        raise ValueError("format=usd needs usd-core: pip install 'dmae-synth[usd]'") from None
    return selection.export(_write_usd, out)


def _scene(task: ClipTask) -> _SceneInMotion:
    clip, state = task.load(), load_state(task.folder)
    model = rebuilt_scene(clip, state, painted=False).model
    data, qpos = mujoco.MjData(model), state.qpos[:: task.every]
    places, turns = np.empty((len(qpos), model.nbody, 3)), np.empty((len(qpos), model.nbody, 4))
    persons, seconds = Skin(model).persons, np.arange(len(qpos)) * task.every / clip.fps
    bones = [np.empty((len(qpos), *skin.bind.shape)) for skin in persons]
    for frame, each in enumerate(qpos):
        data.qpos[:] = each
        mujoco.mj_kinematics(model, data)
        places[frame], turns[frame] = data.xpos, data.xquat[:, [1, 2, 3, 0]]
        for skin, moved in zip(persons, bones, strict=True):
            moved[frame] = skin.bones(data, seconds[frame])
    assert clip.truth is not None
    xyz = convert(clip.truth, task.skeleton).xyz[:: task.every].astype(np.float64)
    tracks = {
        f"person{person}: {joint}": xyz[:, person, number]
        for person in range(xyz.shape[1])
        for number, joint in enumerate(task.skeleton.joints)
    }
    pieces, turns, rig = _pieces(model, persons), continuous(turns), clip.rig
    turned = Rotation.from_matrix(rig.cam_from_world[:, :3, :3].swapaxes(1, 2) @ _GL_FROM_CV).as_quat()
    return _SceneInMotion(
        seconds,
        [_Body(model.body(body).name, places[:, body], turns[:, body], pieces[body]) for body in sorted(pieces)],
        [_skin(model, skin, moved) for skin, moved in zip(persons, bones, strict=True)],
        {name: place for name, place in tracks.items() if np.isfinite(place).all()},
        rig,
        turned,
        [_light(model, light) for light in range(model.nlight) if model.light_bodyid[light] == 0],
    )


def _light(model: mujoco.MjModel, light: int) -> _Light:
    far, colour = model.light_type[light] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, model.light_diffuse[light]
    turn = Rotation.align_vectors([model.light_dir[light]], [[0, 0, -1.0]])[0].as_quat()
    strength = float(colour.max())
    intensity = strength * (_LIGHT_LUX if far else _LIGHT_CANDELA)
    return _Light(far, model.light_pos[light], turn, (colour / max(strength, 1e-9)).tolist(), intensity)


def _skin(model: mujoco.MjModel, skin: SkinOfPerson, bones: np.ndarray) -> _SkinInMotion:
    """Return the mesh of a person, from the meshes of its geoms, whose common vertices become one."""
    rows = [np.concatenate([skin.rest, skin.which, skin.weights], axis=1)]
    rigid = [geom for geom in _of_person(model, skin) if geom not in skin.geoms]
    for geom in rigid:
        points, _ = _mesh(model, geom)
        bone = int(model.geom_bodyid[geom] - skin.segments[0])
        turn = skin.bind[bone, :, :3] @ Rotation.from_quat(model.geom_quat[geom], scalar_first=True).as_matrix()
        each = np.zeros((len(points), rows[0].shape[1]))
        each[:, :3] = points @ turn.T + skin.bind[bone, :, :3] @ model.geom_pos[geom] + skin.bind[bone, :, 3]
        normals = model.mesh_normal[model.mesh_normaladr[model.geom_dataid[geom]] :][: len(points)]
        each[:, 3:6] = normals @ turn.T
        each[:, 6], each[:, 6 + MOST_BONES] = bone, 1
        rows.append(each)
    vertices_of_all, number = np.unique(np.concatenate(rows), axis=0, return_inverse=True)
    points, normals, which, weights = np.split(vertices_of_all, [3, 6, 6 + MOST_BONES], axis=1)
    looks, first = {}, 0
    for geom in [*skin.geoms.tolist(), *rigid]:
        vertices, faces = _mesh(model, geom)
        colour, material = _look(model, geom)
        before = looks.get(material, (colour, np.empty((0, 3), int)))[1]
        looks[material] = colour, np.concatenate([before, number.reshape(-1)[first + faces]])
        first += len(vertices)
    # The bind pose stands on the floor, below the first place of the pelvis.
    shift = np.append(bones[0, 0, :2, 3], -points[:, 2].min())
    bind = np.tile(np.eye(4), (len(skin.bind), 1, 1))
    bind[:, :3] = skin.bind
    bind[:, :3, 3] += shift
    turns = Rotation.from_matrix(bones[..., :3].reshape(-1, 3, 3)).as_quat().reshape(*bones.shape[:2], 4)
    return _SkinInMotion(
        skin.name, points + shift, normals, np.where(weights > 0, which, 0).astype(int), weights, looks,
        skin.bone_names, bind, bones[..., 3], continuous(turns),
    )  # fmt: skip


def _of_person(model: mujoco.MjModel, skin: SkinOfPerson) -> list[int]:
    drawn = (model.geom_group < _DRAWN) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    return np.flatnonzero(drawn & np.isin(model.geom_bodyid, skin.segments)).tolist()


def _mesh(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = model.mesh_vert[first : first + count]
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return points, model.mesh_face[first : first + count]


def _look(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, str]:
    """Return RGBA of a geom as light, which both formats state, and a name for it."""
    material = model.geom_matid[geom]
    if material >= 0:
        rgba, name = model.mat_rgba[material], model.mat(material).name
    else:
        rgba = model.geom_rgba[geom]
        name = "colour " + " ".join(f"{share:.3g}" for share in rgba)
    return np.append(light_of(rgba[:3]), rgba[3]), name


def _pieces(model: mujoco.MjModel, persons: Sequence[SkinOfPerson]) -> dict[int, list[_Piece]]:
    """Return what is drawn of a model, but for people, by index of the body; 0 is the world, which does not move."""
    kinds, people = mujoco.mjtGeom, {geom for skin in persons for geom in _of_person(model, skin)}
    found: dict[int, list[_Piece]] = defaultdict(list)
    for geom in np.flatnonzero(model.geom_group < _DRAWN).tolist():
        if geom in people:
            continue
        kind, size = model.geom_type[geom], model.geom_size[geom]
        if kind == kinds.mjGEOM_MESH:
            points, faces = _mesh(model, geom)
        elif kind == kinds.mjGEOM_PLANE:
            x, y = np.where(size[:2] > 0, size[:2], _FLOOR_M)
            points, faces = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
        else:
            if kind == kinds.mjGEOM_BOX:
                shape = trimesh.creation.box(2 * size)
            elif kind == kinds.mjGEOM_CYLINDER:
                shape = trimesh.creation.cylinder(size[0], 2 * size[1])
            elif kind == kinds.mjGEOM_CAPSULE:
                shape = trimesh.creation.capsule(2 * size[1], size[0])
            else:
                shape = trimesh.creation.icosphere(radius=1)
                shape.apply_scale(size if kind == kinds.mjGEOM_ELLIPSOID else size[0])
            points, faces = shape.vertices, shape.faces
        turn = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
        colour, _ = _look(model, geom)
        body = int(model.geom_bodyid[geom])
        name = model.geom(geom).name or f"{model.body(body).name}/{geom}"
        found[body].append(_Piece(name, turn.apply(points) + model.geom_pos[geom], np.asarray(faces), colour))
    return found


# glTF

_BONE_PARENTS = (*PARENTS, *(SEGMENTS.index(bone.partition(" ")[0]) for bone in BONE_NAMES[len(PARENTS) :]))
"""For each of `BONE_NAMES`, the one that it is attached to: a segment, or -1 for the pelvis. Parents come first."""


def _parents(count: int) -> tuple[int, ...]:
    """Return the bone that each bone is attached to; cloth that hangs is attached to the pelvis."""
    return _BONE_PARENTS + (0,) * (count - FIRST_NODE)


def _within_parents(places: np.ndarray, turns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places (F, B, 3) and turns (F, B, 4) of bones relative to their parents, from those in the world."""
    own, of_parent = places.copy(), turns.copy()
    for bone, parent in enumerate(_parents(places.shape[1])):
        if parent >= 0:
            back = Rotation.from_quat(turns[:, parent]).inv()
            own[:, bone] = back.apply(places[:, bone] - places[:, parent])
            of_parent[:, bone] = (back * Rotation.from_quat(turns[:, bone])).as_quat()
    return own, continuous(of_parent)


def _write_glb(task: ClipTask) -> Counter:
    scene = _scene(task)
    file = GltfFile(scene.seconds)
    y_up = file.add("nodes", name="z up", rotation=[-(0.5**0.5), 0, 0, 0.5**0.5], children=[])
    file.json["scenes"][0]["nodes"].append(y_up)
    children = file.json["nodes"][y_up]["children"]
    for body in scene.bodies:
        node = file.add(
            "nodes", name=body.name, translation=body.places[0].tolist(), rotation=body.turns[0].tolist(), children=[]
        )
        if np.ptp(body.places, axis=0).any() or np.ptp(body.turns, axis=0).any():
            file.animate(node, "translation", body.places)
            file.animate(node, "rotation", body.turns)
        children.append(node)
    for node, body in zip(list(children), scene.bodies, strict=True):
        for piece in body.pieces:
            attributes = {"POSITION": file.accessor(piece.points, "VEC3", target=VERTICES, bounds=True)}
            primitives = [_primitive(file, attributes, piece.faces, piece.name, piece.colour)]
            mesh = file.add("meshes", name=piece.name, primitives=primitives)
            file.json["nodes"][node]["children"].append(file.add("nodes", name=f"{piece.name} mesh", mesh=mesh))
    for skin in scene.skins:
        children.append(_add_skin(file, skin))
    for name, place in scene.joints.items():
        node = file.add("nodes", name=name, translation=place[0].tolist())
        file.animate(node, "translation", place)
        children.append(node)
    children += _add_cameras(file, scene.rig, scene.turned)
    children += _add_lights(file, scene.lights)
    write_atomic(task.file("glb"), file.data())
    return Counter(clips=1, persons=len(scene.skins))


def _primitive(file: GltfFile, attributes: dict[str, int], faces: np.ndarray, name: str, colour: np.ndarray) -> dict:
    """Return the primitive of faces (m, 3) between points with these attributes, in a material of its own."""
    indices = file.accessor(faces.reshape(-1), "SCALAR", INT, INDICES)
    look = {"baseColorFactor": colour.tolist(), "metallicFactor": 0, "roughnessFactor": 0.8}
    material = file.add("materials", name=name, pbrMetallicRoughness=look, doubleSided=True)
    return {"attributes": attributes, "indices": indices, "material": material}


def _add_skin(file: GltfFile, skin: _SkinInMotion) -> int:
    """Add a person, and return the node of its pelvis. The node of its mesh stands beside all others in the scene."""
    bones, places, turns = [], *_within_parents(skin.places, skin.turns)
    for bone, parent in enumerate(_parents(len(skin.bones))):
        node = file.add(
            "nodes", name=f"{skin.name}/{skin.bones[bone]}",
            translation=places[0, bone].tolist(), rotation=turns[0, bone].tolist(),
        )  # fmt: skip
        file.animate(node, "translation", places[:, bone])
        file.animate(node, "rotation", turns[:, bone])
        if parent >= 0:
            file.json["nodes"][bones[parent]].setdefault("children", []).append(node)
        bones.append(node)
    # Bones alone place a mesh with a skin, so its points are already y up.
    attributes = {
        "POSITION": file.accessor(skin.points @ WORLD_Y_UP.T, "VEC3", target=VERTICES, bounds=True),
        "NORMAL": file.accessor(skin.normals @ WORLD_Y_UP.T, "VEC3", target=VERTICES),
        "JOINTS_0": file.accessor(skin.which, "VEC4", BYTE, VERTICES),
        "WEIGHTS_0": file.accessor(skin.weights, "VEC4", target=VERTICES),
    }
    primitives = [_primitive(file, attributes, faces, name, colour) for name, (colour, faces) in skin.looks.items()]
    binds = np.linalg.inv(skin.bind)
    binds[:, :3, :3] = binds[:, :3, :3] @ WORLD_Y_UP.T
    # Matrices are stored column by column.
    unbend = file.accessor(binds.swapaxes(1, 2).reshape(-1, 16), "MAT4")
    mesh = file.add("meshes", name=skin.name, primitives=primitives)
    number = file.add("skins", name=skin.name, joints=bones, inverseBindMatrices=unbend)
    file.json["scenes"][0]["nodes"].append(file.add("nodes", name=skin.name, mesh=mesh, skin=number))
    return bones[0]


def _add_cameras(file: GltfFile, rig: CameraRig, turned: np.ndarray) -> list[int]:
    """Add cameras, with K, distortion and size as extras, and return their nodes."""
    file.json["cameras"], nodes = [], []
    for view, name in enumerate(rig.names):
        (width, height), K = rig.size[view].tolist(), rig.K[view]
        lens = {"yfov": float(2 * np.arctan(height / 2 / K[1, 1])), "aspectRatio": width / height, "znear": 0.01}
        about = {"K": K.tolist(), "dist": rig.dist[view].tolist(), "size": [width, height]}
        camera = file.add("cameras", name=name, type="perspective", perspective=lens, extras=about)
        place, turn = rig.centers[view].tolist(), turned[view].tolist()
        nodes.append(file.add("nodes", name=f"camera {name}", camera=camera, translation=place, rotation=turn))
    return nodes


def _add_lights(file: GltfFile, lights: Sequence[_Light]) -> list[int]:
    """Add lights, by an extension of glTF, and return their nodes."""
    given, nodes = [], []
    for number, light in enumerate(lights):
        kind = "directional" if light.far else "point"
        given.append({"name": f"light {number}", "type": kind, "color": light.colour, "intensity": light.intensity})
        place, turn = light.place.tolist(), light.turn.tolist()
        extension = {"KHR_lights_punctual": {"light": number}}
        nodes.append(file.add("nodes", name=f"light {number}", translation=place, rotation=turn, extensions=extension))
    if given:
        file.json |= {
            "extensionsUsed": ["KHR_lights_punctual"],
            "extensions": {"KHR_lights_punctual": {"lights": given}},
        }
    return nodes


# USD


def _write_usd(task: ClipTask) -> Counter:
    from pxr import Gf, UsdGeom, UsdLux

    scene = _scene(task)
    file = _UsdFile(task.file("usdc"), scene.seconds)
    bodies = [file.unused("/scene", body.name) for body in scene.bodies]
    for path, body in zip(bodies, scene.bodies, strict=True):
        file.move(UsdGeom.Xform.Define(file.stage, path), body.places, body.turns)
    for path, body in zip(bodies, scene.bodies, strict=True):
        for piece in body.pieces:
            mesh = file.mesh(file.unused(path, piece.name), piece.points, piece.faces)
            mesh.CreateDisplayColorAttr([Gf.Vec3f(*piece.colour[:3].tolist())])
    for skin in scene.skins:
        _define_skin(file, skin)
    for name, places in scene.joints.items():
        joint = UsdGeom.Xform.Define(file.stage, file.unused("/scene", name))
        joint.GetPrim().SetDisplayName(name)
        file.move(joint, places)
    for view in range(len(scene.rig)):
        _define_camera(file, scene.rig, view, scene.turned[view])
    for number, each in enumerate(scene.lights):
        kind = UsdLux.DistantLight if each.far else UsdLux.SphereLight
        light = kind.Define(file.stage, file.unused("/scene", f"light_{number}"))
        light.CreateColorAttr(Gf.Vec3f(*each.colour))
        light.CreateIntensityAttr(each.intensity)
        file.move(light, each.place[None], each.turn[None])
    file.stage.GetRootLayer().Save()
    return Counter(clips=1, persons=len(scene.skins))


class _UsdFile:
    """A USD file under construction, z up, m, with `/scene` as its root."""

    def __init__(self, path: Path, seconds: np.ndarray):
        from pxr import Usd, UsdGeom

        self.stage, self._used = Usd.Stage.CreateNew(str(path)), set()
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        self.stage.SetTimeCodesPerSecond(1 / (seconds[1] - seconds[0]) if len(seconds) > 1 else 25.0)
        self.stage.SetStartTimeCode(0)
        self.stage.SetEndTimeCode(len(seconds) - 1)
        self.stage.SetDefaultPrim(UsdGeom.Xform.Define(self.stage, "/scene").GetPrim())

    def unused(self, above: str, name: str) -> str:
        """Return a path that was not returned before."""
        from pxr import Tf

        plain = found = f"{above}/{Tf.MakeValidIdentifier(name)}"
        while found in self._used:
            found = f"{plain}_{len(self._used)}"
        self._used.add(found)
        return found

    def move(self, prim, places: np.ndarray, turns: np.ndarray | None = None) -> None:
        """Give a prim places (F, 3), and turns (F, 4), w last; one that stands still has a single sample."""
        from pxr import Gf, Usd

        move = prim.AddTranslateOp()
        turn = prim.AddOrientOp() if turns is not None else None
        still = np.ptp(places, axis=0).max() == 0 and (turns is None or np.ptp(turns, axis=0).max() == 0)
        for frame in range(1 if still else len(places)):
            at = Usd.TimeCode.Default() if still else frame
            move.Set(Gf.Vec3d(*places[frame].tolist()), at)
            if turn is not None and turns is not None:
                *vector, w = turns[frame].tolist()
                turn.Set(Gf.Quatf(w, *vector), at)

    def mesh(self, path: str, points: np.ndarray, faces: np.ndarray):
        """Define a mesh of points (n, 3) and triangles (m, 3)."""
        from pxr import UsdGeom, Vt

        mesh = UsdGeom.Mesh.Define(self.stage, path)
        mesh.CreatePointsAttr(_vectors(points))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(faces.ravel(), np.int32)))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        return mesh


def _vectors(rows: np.ndarray):
    from pxr import Vt

    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rows, np.float32))


def _define_skin(file: _UsdFile, skin: _SkinInMotion) -> None:
    from pxr import Gf, Tf, UsdGeom, UsdSkel, Vt

    root = file.unused("/scene", skin.name)
    UsdSkel.Root.Define(file.stage, root)
    skeleton = UsdSkel.Skeleton.Define(file.stage, f"{root}/skeleton")
    motion = UsdSkel.Animation.Define(file.stage, f"{root}/motion")
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().AddTarget(motion.GetPath())
    bones = [Tf.MakeValidIdentifier(bone) for bone in skin.bones]
    # Matrices of USD multiply rows.
    bind = Vt.Matrix4dArray([Gf.Matrix4d(each.T.tolist()) for each in skin.bind])
    skeleton.CreateJointsAttr(bones)
    skeleton.CreateBindTransformsAttr(bind)
    skeleton.CreateRestTransformsAttr(bind)
    motion.CreateJointsAttr(bones)
    motion.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1)] * len(bones)))
    places, turns = motion.CreateTranslationsAttr(), motion.CreateRotationsAttr()
    for frame in range(len(skin.places)):
        places.Set(_vectors(skin.places[frame]), frame)
        turns.Set(Vt.QuatfArray([Gf.Quatf(w, *vector) for *vector, w in skin.turns[frame].tolist()]), frame)
    mesh = file.mesh(f"{root}/mesh", skin.points, np.concatenate([faces for _, faces in skin.looks.values()]))
    mesh.CreateNormalsAttr(_vectors(skin.normals))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    of_faces = [np.tile(colour[:3], (len(faces), 1)) for colour, faces in skin.looks.values()]
    mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.uniform).Set(_vectors(np.concatenate(of_faces)))
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().AddTarget(skeleton.GetPath())
    binding.CreateJointIndicesPrimvar(False, MOST_BONES).Set(skin.which.ravel().tolist())
    binding.CreateJointWeightsPrimvar(False, MOST_BONES).Set(skin.weights.ravel().tolist())


def _define_camera(file: _UsdFile, rig: CameraRig, view: int, turn: np.ndarray) -> None:
    from pxr import Gf, UsdGeom, Vt

    (width, height), K = rig.size[view].tolist(), rig.K[view]
    camera = UsdGeom.Camera.Define(file.stage, file.unused("/scene", f"camera_{rig.names[view]}"))
    focal, pixel = _SENSOR_MM * K[0, 0] / width, _SENSOR_MM / width
    # Focal length, apertures and offsets have the same unit; pixels that are not square become another aperture.
    camera.CreateFocalLengthAttr(focal)
    camera.CreateHorizontalApertureAttr(_SENSOR_MM)
    camera.CreateVerticalApertureAttr(height * pixel * K[0, 0] / K[1, 1])
    camera.CreateHorizontalApertureOffsetAttr((width / 2 - 0.5 - K[0, 2]) * pixel)
    camera.CreateVerticalApertureOffsetAttr((K[1, 2] - height / 2 + 0.5) * pixel * K[0, 0] / K[1, 1])
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000))
    for key, values in (("size", rig.size[view]), ("K", K.ravel()), ("dist", rig.dist[view])):
        camera.GetPrim().SetCustomDataByKey(key, Vt.DoubleArray(values.astype(float).tolist()))
    file.move(camera, rig.centers[view][None], turn[None])
