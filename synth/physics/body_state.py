"""The state of people's bodies in a clip: pose, shape, forces, contacts and actions; in memory and on disk."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import mujoco
import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from dmae.data.array_fields import set_array, short_repr
from dmae.data.typed import decode
from dmae.files.contents import write_atomic
from synth.people.body import SEGMENTS, Body, landmarks, segment_origins

FORMAT = 1
FILE = "state.safetensors"
"""The file in a clip's folder that contains the state."""
_JOINTS = len(SEGMENTS)


@dataclass(frozen=True)
class BodyState:
    """The state of P people in F frames. Joints of bodies are in the order of `synth.people.body.SEGMENTS`."""

    qpos: np.ndarray  # (F, nq) float64, MuJoCo's state of the whole scene, from which images are rendered
    root: np.ndarray  # (F, P, 3) float32 mid point of the hip joints, m, world
    # (F, P, 16, 4) float32 quaternions, w first: of the pelvis in the world, of others in their parent
    rotations: np.ndarray
    # (F, P, 17, 3) float32. First the force at the pelvis that carries the body, N, world: people need no balance, and
    # contacts bear only part of their weight. Then the torques at the joints, N m, each in the axes of its segment;
    # the torque at the pelvis acts from outside, too.
    forces: np.ndarray
    shapes: tuple[Body, ...]  # The proportions of each person
    actions: np.ndarray  # (F, P) int16 action of each person, as index into `action_names`
    # Names of actions. For an interaction it is its name, for a recording the take and its time.
    action_names: tuple[str, ...]
    contact_frame: np.ndarray  # (C,) int32 frame of each contact of a person in which a force acts, sorted
    contact_between: np.ndarray  # (C, 2) int16 index into `contact_names` of the two parts that touch
    contact_names: tuple[str, ...]  # `person<p>/<segment>`, or names of objects
    contact_point: np.ndarray  # (C, 3) float32 m, world
    # (C, 3) float32 N, world, that the first part exerts on the second. Standing feet are also held by a force that is
    # no contact: see `synth.physics.controller`.
    contact_force: np.ndarray
    contact_depth: np.ndarray  # (C,) float32 m, overlap; below 0 where only cloth touches

    __repr__ = short_repr

    def __post_init__(self):
        set_array(self, "qpos", np.float64, ("F", "nq"))
        people = len(self.qpos), len(self.shapes)
        set_array(self, "root", np.float32, (*people, 3))
        set_array(self, "rotations", np.float32, (*people, _JOINTS, 4))
        set_array(self, "forces", np.float32, (*people, 1 + _JOINTS, 3))
        set_array(self, "actions", np.int16, people)
        set_array(self, "contact_frame", np.int32, ("C",))
        contacts = len(self.contact_frame)
        set_array(self, "contact_between", np.int16, (contacts, 2))
        set_array(self, "contact_point", np.float32, (contacts, 3))
        set_array(self, "contact_force", np.float32, (contacts, 3))
        set_array(self, "contact_depth", np.float32, (contacts,))


def save_state(state: BodyState, folder: Path) -> None:
    """Write a state into the folder of its clip, atomically."""
    values = {name: getattr(state, name) for name in BodyState.__dataclass_fields__}
    arrays = {name: np.ascontiguousarray(value) for name, value in values.items() if isinstance(value, np.ndarray)}
    words = {
        "format": FORMAT,
        "segments": SEGMENTS,
        "action_names": state.action_names,
        "contact_names": state.contact_names,
        "shapes": [asdict(shape) for shape in state.shapes],
    }
    # A single entry, because safetensors writes several entries in arbitrary order.
    write_atomic(Path(folder) / FILE, save(arrays, {"state": json.dumps(words)}))


def load_state(folder: Path) -> BodyState:
    """Read the state of a clip from its folder.

    Raises:
        FileNotFoundError: the clip has no state: it was not simulated.
        ValueError: the file is malformed, or of another format version.
    """
    path = Path(folder) / FILE
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such file. Clips that `synth generate` makes hold the state of bodies; make this one again"
        )
    try:
        with safe_open(path, "np") as file:
            words = json.loads((file.metadata() or {}).get("state", "{}"))
            if words.get("format") != FORMAT:
                raise ValueError(f"expected a state of format {FORMAT}, found format {words.get('format')!r}")
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        return BodyState(
            **arrays,
            shapes=tuple(decode(Body, shape) for shape in words["shapes"]),
            action_names=tuple(words["action_names"]),
            contact_names=tuple(words["contact_names"]),
        )
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None


# Positions of the labelled joints, in simulated states and in reference motions


def joint_positions(model: mujoco.MjModel, qpos: np.ndarray, bodies: list[Body]) -> np.ndarray:
    """Return (F, P, 39, 3) joints of `SKELETON` in the states (F, nq), m, world."""
    data = mujoco.MjData(model)
    ids = moved_with(model, bodies)
    points = np.stack([landmarks(body)[1] for body in bodies])
    joints = np.empty((len(qpos), *points.shape))
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        joints[frame] = data.xpos[ids] + (data.xmat[ids].reshape(*ids.shape, 3, 3) @ points[..., None])[..., 0]
    return joints


def moved_with(model: mujoco.MjModel, bodies: list[Body]) -> np.ndarray:
    """Return the (P, 39) index of the model's body with which each joint of each person moves."""
    return np.array(
        [
            [model.body(f"person{p}/{SEGMENTS[segment]}").id for segment in landmarks(body)[0]]
            for p, body in enumerate(bodies)
        ]
    )


def reference_joints(body: Body, root: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Return (F, 39, 3) joints of `SKELETON`, m, world, in a motion with root (F, 3) and rotations (F, 16, 3, 3)."""
    segments, points, _ = landmarks(body)
    return segment_origins(body, root, rotations)[:, segments] + (rotations[:, segments] @ points[..., None])[..., 0]
