"""GLB, the binary file of glTF 2.0: animated skeletons that Blender, game engines and browsers open.

Each person is a skin with a T-pose that faces z, y up, and a simple body; your own skeletons have a mesh of bones. A
red octahedron marks each joint that is not measured in the frame. A person that is absent has scale 0. This module
assembles the file itself, because no known library writes animated skins.
"""

import json
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.clip import Clip, Poses3D, Source, person_names
from dmae.files.contents import write_atomic
from dmae.formats.animation import Y_UP, JointRotations, joint_rotations, with_bodies
from dmae.formats.registry import pose_writer
from dmae.numerics.body import continuous

_COLOURS = ((0.12, 0.47, 0.71), (0.20, 0.63, 0.17), (0.42, 0.24, 0.60), (0.55, 0.34, 0.29), (0.09, 0.75, 0.81))
"""RGB colours of persons. None is red, because red marks joints that were not measured."""
_RED = (0.84, 0.15, 0.16)
_THICKNESS, _MARKER = 0.12, 0.045  # Thickness of a bone as a share of its length, and size of a red marker in m
_SIDES = 12  # Number of sides of a limb of the body
FLOAT, BYTE, INT = 5126, 5121, 5125
VERTICES, INDICES = 34962, 34963
"""Numbers of glTF: types of components, and targets of buffers."""
_CORNERS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
_FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])


@pose_writer("glb", table=True)
def write_glb(poses: Poses3D, clip: Clip, path: Path) -> None:
    """glTF animated skeletons, all persons in one file."""
    file = GltfFile(np.arange(len(poses.xyz)) / clip.fps)
    people = person_names(clip, poses.xyz.shape[1])
    red = file.mesh("not measured", _MARKER * _CORNERS, _FACES, _RED)
    for person, motion in with_bodies(poses.xyz.shape[1], partial(joint_rotations, poses, clip.fps)):
        if motion is None:
            continue
        source = np.full((len(poses.source), len(motion.joints)), Source.MEASURED)
        for node, joint in enumerate(motion.joints):
            if joint in poses.skeleton.joints:
                source[:, node] = poses.source[:, person, poses.skeleton.index(joint)[0]]
        there = (poses.source[:, person] != Source.ABSENT).any(-1)
        _add_person(file, motion, source, there, people[person], _COLOURS[person % len(_COLOURS)], red)
    write_atomic(path, file.data())


class GltfFile:
    """The content of a glTF file under construction: its JSON and its only buffer."""

    def __init__(self, times: np.ndarray):
        asset = {"version": "2.0", "generator": "dmae-synth"}
        self.json: dict = {"asset": asset, "scene": 0, "scenes": [{"nodes": []}]}
        self.json |= {name: [] for name in ("nodes", "meshes", "materials", "skins", "accessors", "bufferViews")}
        self.animation: dict = {"name": "motion", "channels": [], "samplers": []}
        self.buffer = bytearray()
        # A sampler needs at least one sample, and the smallest and largest time.
        self.times = self.accessor(times.astype(np.float32), "SCALAR", bounds=True) if len(times) else None

    def add(self, kind: str, **fields) -> int:
        self.json[kind].append(fields)
        return len(self.json[kind]) - 1

    def accessor(self, array: np.ndarray, type: str, component: int = FLOAT, target: int = 0, bounds=False) -> int:
        data = array.astype({FLOAT: "<f4", BYTE: "u1", INT: "<u4"}[component]).tobytes()
        part = {"buffer": 0, "byteOffset": len(self.buffer), "byteLength": len(data)}
        self.buffer += data + bytes(-len(data) % 4)
        view = self.add("bufferViews", **part, **({"target": target} if target else {}))
        limits = {}
        if bounds:
            rows = array.reshape(len(array), -1)
            limits = {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        return self.add("accessors", bufferView=view, componentType=component, count=len(array), type=type, **limits)

    def mesh(self, name: str, points: np.ndarray, faces: np.ndarray, colour, joints: np.ndarray | None = None) -> int:
        """Add a mesh of points (n, 3) and faces (m, 3), and return its index.

        If `joints` (n,) are given, each point moves with one joint of a skin.
        """
        material = {"baseColorFactor": [*colour, 1], "metallicFactor": 0, "roughnessFactor": 0.8}
        primitive = {"material": self.add("materials", name=name, pbrMetallicRoughness=material)}
        # Faces have flat shading, so each face has its own copies of its points. Those without an area, at the ends of
        # limbs, are left out: the format allows only normals of length 1.
        flat = points[faces].astype(np.float32)
        normals = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
        area = np.linalg.norm(normals, axis=-1)
        flat, normals, faces = flat[area > 0], normals[area > 0] / area[area > 0, None], faces[area > 0]
        attributes = {
            "POSITION": self.accessor(flat.reshape(-1, 3), "VEC3", target=VERTICES, bounds=True),
            "NORMAL": self.accessor(np.repeat(normals, 3, 0), "VEC3", target=VERTICES),
        }
        if joints is not None:
            bound = np.zeros((flat.shape[0] * 3, 4))
            bound[:, 0] = joints[faces].ravel()
            attributes["JOINTS_0"] = self.accessor(bound, "VEC4", BYTE, VERTICES)
            attributes["WEIGHTS_0"] = self.accessor(np.eye(4)[np.zeros(len(bound), int)], "VEC4", target=VERTICES)
        return self.add("meshes", name=name, primitives=[{"attributes": attributes, **primitive}])

    def animate(self, node: int, path: str, values: np.ndarray, step: bool = False) -> None:
        if self.times is None:
            return
        output = self.accessor(values, "VEC4" if path == "rotation" else "VEC3")
        sampler = {"input": self.times, "output": output, "interpolation": "STEP" if step else "LINEAR"}
        self.animation["samplers"].append(sampler)
        target = {"node": node, "path": path}
        self.animation["channels"].append({"sampler": len(self.animation["samplers"]) - 1, "target": target})

    def data(self) -> bytes:
        """Return the bytes of the file: header, JSON, buffer. The length of each is a multiple of four bytes."""
        content = {name: part for name, part in self.json.items() if part != []}
        if self.animation["channels"]:
            content["animations"] = [self.animation]
        if self.buffer:
            content["buffers"] = [{"byteLength": len(self.buffer)}]
        text = json.dumps(content, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = [(text, b"JSON")] + ([(bytes(self.buffer), b"BIN\0")] if self.buffer else [])
        body = b"".join(len(chunk).to_bytes(4, "little") + kind + chunk for chunk, kind in chunks)
        return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body


def _add_person(
    file: GltfFile, motion: JointRotations, source: np.ndarray, there: np.ndarray, name: str, colour, red: int
) -> None:
    offsets, root, turned = motion.y_up()
    quaternions = Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_quat().reshape(len(turned), -1, 4)
    nodes = [
        file.add("nodes", name=f"{name}: {joint}", translation=offset.tolist())
        for joint, offset in zip(motion.joints, offsets, strict=True)
    ]
    for joint, node in enumerate(nodes):
        marker = file.add("nodes", name=f"{name}: {motion.joints[joint]} not measured", mesh=red, scale=[0, 0, 0])
        children = [nodes[child] for child, parent in enumerate(motion.parents) if parent == joint]
        file.json["nodes"][node]["children"] = [*children, marker]
        file.animate(node, "rotation", continuous(quaternions[:, joint]))
        unmeasured = (source[:, joint] == Source.COMPLETED) | ((source[:, joint] == Source.ABSENT) & there)
        file.animate(marker, "scale", np.repeat(unmeasured[:, None].astype(float), 3, 1), step=True)
    file.animate(nodes[0], "translation", root)
    file.animate(nodes[0], "scale", np.repeat(there[:, None].astype(float), 3, 1), step=True)
    rest = motion.rest @ Y_UP.T
    bind = np.tile(np.eye(4), (len(nodes), 1, 1))
    bind[:, :3, 3] = -rest
    # Matrices are stored column by column.
    matrices = file.accessor(bind.swapaxes(1, 2).reshape(-1, 16), "MAT4")
    skin = file.add("skins", name=name, joints=nodes, skeleton=nodes[0], inverseBindMatrices=matrices)
    points, faces, bound = _body(rest, motion.joints) if "l_hip" in motion.joints else _bones(rest, motion.parents)
    mesh = file.mesh(name, points, faces, colour, bound)
    body = file.add("nodes", name=f"{name}: body", mesh=mesh, skin=skin)
    # Blender makes an armature of what is above the joints; the bodies of people without it share one.
    person = file.add("nodes", name=name, children=[nodes[0]])
    file.json["scenes"][0]["nodes"] += [person, body]


def _bones(rest: np.ndarray, parents: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return one octahedron per bone: points (6B, 3), faces (8B, 3), and the joint (6B,) that moves each point."""
    points, faces, joints = np.empty((0, 3)), np.empty((0, 3), int), np.empty(0, int)
    for joint, parent in enumerate(parents):
        if parent < 0:
            continue
        along = rest[joint] - rest[parent]
        across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        across *= _THICKNESS * np.linalg.norm(along) / max(float(np.linalg.norm(across)), 1e-9)
        axes = np.stack([across, np.cross(along, across) / max(float(np.linalg.norm(along)), 1e-9)])
        corners = rest[parent] + 0.2 * along + _CORNERS[:4, :2] @ axes
        faces = np.concatenate([faces, _FACES + len(points)])
        points = np.concatenate([points, corners, [rest[joint], rest[parent]]])
        joints = np.concatenate([joints, np.full(6, parent)])
    return points, faces, joints


_LIMBS = (
    ("shoulder", "elbow", (0.0, 0.16, 0.17, 0.13, 0.12)),
    ("elbow", "wrist", (0.0, 0.14, 0.15, 0.11, 0.09)),
    ("hip", "knee", (0.0, 0.19, 0.20, 0.15, 0.13)),
    ("knee", "ankle", (0.0, 0.13, 0.15, 0.11, 0.09)),
)
"""Bones of limbs and their radius along them as shares of their length."""
_TRUNK = ((-0.16, 0.0, 0.0), (-0.14, 0.75, 0.55), (0.02, 1.0, 0.62), (0.35, 0.82, 0.52), (0.75, 1.02, 0.62),
          (0.97, 0.90, 0.45), (1.06, 0.35, 0.33), (1.22, 0.30, 0.32))  # fmt: skip
"""Rings of the trunk and neck: height between hips and shoulders, half breadth and half depth, as shares of the height
and of half of the mean breadth of hips and shoulders."""


def _body(rest: np.ndarray, joints: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a simple body around rest positions (N, 3), as `_bones` does; parts without joints are left out."""
    at = dict(zip(joints, rest, strict=True))
    node = {joint: number for number, joint in enumerate(joints)}
    tubes = []
    for side in ("l_", "r_"):
        for start, end, radii in _LIMBS:
            if {side + start, side + end} <= at.keys():
                along = at[side + end] - at[side + start]
                round_ = np.array(radii) * np.linalg.norm(along)
                places = at[side + start] + np.array([-0.08, 0.0, 0.3, 0.8, 1.05])[:, None] * along
                tubes.append((places, round_, round_, along, [node[side + start]] * 5))
        if {side + "ankle", side + "big_toe"} <= at.keys():
            ankle, toe = at[side + "ankle"], at[side + "big_toe"]
            flat = np.array([ankle[0], toe[1], toe[2]])
            places = np.stack([flat * (1, 1, 0) + (0, 0, ankle[2] + share * (toe[2] - ankle[2]))
                               for share in (-0.35, -0.3, 0.0, 0.6, 1.0, 1.05)])  # fmt: skip
            places[:, 1] += 0.015
            long = abs(toe[2] - ankle[2])
            wide, high = long * np.array([0, 0.18, 0.22, 0.26, 0.2, 0]), long * np.array([0, 0.12, 0.2, 0.14, 0.1, 0])
            tubes.append((places, wide, high, np.array([0, 0, 1.0]), [node[side + "ankle"]] * 6))
    if {"l_hip", "r_hip", "l_shoulder", "r_shoulder", "spine"} <= at.keys():
        hips, shoulders = ((at[f"l_{part}"] + at[f"r_{part}"]) / 2 for part in ("hip", "shoulder"))
        half = np.mean([np.linalg.norm(at[f"l_{part}"] - at[f"r_{part}"]) / 2 for part in ("hip", "shoulder")])
        height, wide, deep = np.array(_TRUNK).T
        places = hips + height[:, None] * (shoulders - hips)
        on = [node["mid_hip" if share < 0.2 else "spine"] for share in height]
        tubes.append((places, half * 1.15 * wide, half * 1.15 * deep, shoulders - hips, on))
        if "head" in at:
            tall = np.linalg.norm(shoulders - hips)
            turn = np.linspace(0, np.pi, 8)
            places = at["head"] + tall * np.stack([0 * turn, 0.19 - 0.24 * np.cos(turn), 0.05 + 0 * turn], -1)
            tubes.append((places, 0.155 * tall * np.sin(turn), 0.19 * tall * np.sin(turn), np.array([0, 1.0, 0]),
                          [node["head"]] * 8))  # fmt: skip
    points, faces, bound, first = [], [], [], 0
    for places, wide, deep, along, on in tubes:
        ring = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
        across = np.array([1.0, 0, 0]) if abs(along[0]) < 0.7 * np.linalg.norm(along) else np.array([0, 0, 1.0])
        other = np.cross(along, across) / np.linalg.norm(np.cross(along, across))
        points.append((places[:, None] + wide[:, None, None] * np.cos(ring)[:, None] * across
                       + deep[:, None, None] * np.sin(ring)[:, None] * other).reshape(-1, 3))  # fmt: skip
        for row in range(len(places) - 1):
            a = first + row * _SIDES + np.arange(_SIDES)
            b = first + row * _SIDES + (np.arange(_SIDES) + 1) % _SIDES
            quads = [np.stack([a, b, b + _SIDES], -1), np.stack([a, b + _SIDES, a + _SIDES], -1)]
            # Faces look outwards.
            faces += [face if np.dot(np.cross(across, other), along) > 0 else face[:, ::-1] for face in quads]
        bound.append(np.repeat(on, _SIDES))
        first += len(points[-1])
    return np.concatenate(points), np.concatenate(faces), np.concatenate(bound)
