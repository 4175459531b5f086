"""Motions of Unitree G1 robots: joint CSV in its two dialects, and data sets of LeRobot v3.

`dmae.formats.retargeting` makes the motions. A row of a CSV is a frame, and robots of one clip have the same frames:

- `unit=m`, of LAFAN1 retargeted by Unitree, mjlab and others: no header; base position, m; base quaternion, w last; 29
  angles, rad.
- `unit=cm`, of BONES-SEED: a header and the number of the frame; base position, cm; base rotation as extrinsic angles
  about x, y, z, degrees; 29 angles, degrees.

Neither states the frame rate.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.clip import Clip, Poses3D, Source, person_name, person_names
from dmae.files.contents import whole_folder, write_atomic, written
from dmae.formats.config import LengthUnit
from dmae.formats.poses import person_paths
from dmae.formats.registry import pose_writer
from dmae.formats.retargeting import RobotMotion, load_robot, retarget
from dmae.numerics.body import continuous


@pose_writer("g1", skeleton="body25", table=True, fills="all", needs=["mink"], extra="robots")
def write_g1(
    poses: Poses3D, clip: Clip, path: Path, *, unit: LengthUnit = LengthUnit.m, robot: str | None = None
) -> list[Path]:
    """Unitree G1 joint CSV, a file for each person: `unit=m` of mjlab and LAFAN1, `unit=cm` of BONES-SEED.

    Raises:
        ValueError: `unit` is mm, or a person cannot be retargeted.
        FileNotFoundError: there is no model of the robot.
    """
    if unit == LengthUnit.mm:
        raise ValueError("unit=mm: format=g1 is in m and radians (unit=m) or in cm and degrees (unit=cm)")
    motion, people = retarget(poses, clip.fps, load_robot(robot)), person_names(clip, poses.xyz.shape[1])
    return write_joint_csv(motion, path, unit, people)


def write_joint_csv(
    motion: RobotMotion, path: Path, unit: LengthUnit = LengthUnit.m, people: Sequence[str] | None = None
) -> list[Path]:
    """Write the motion of each robot, by default for persons P1, P2, ... Return the files."""
    files = person_paths(path, people or [person_name(person) for person in range(motion.qpos.shape[1])])
    for person, file in enumerate(files):
        qpos = motion.qpos[:, person]
        turn, lines = Rotation.from_quat(qpos[:, 3:7], scalar_first=True), []
        if unit == LengthUnit.m:
            rows = np.concatenate([qpos[:, :3], continuous(turn.as_quat()), qpos[:, 7:]], 1)
        else:
            axes = [f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ"]
            lines.append(",".join(["Frame", *axes, *(f"{joint}_dof" for joint in motion.joints)]))
            euler = np.unwrap(turn.as_euler("xyz", degrees=True), period=360, axis=0)
            rows = np.concatenate([100 * qpos[:, :3], euler, np.degrees(qpos[:, 7:])], 1)
        for frame, row in enumerate(rows.tolist()):
            number = [str(frame)] if unit != LengthUnit.m else []
            lines.append(",".join([*number, *(f"{value:.6f}" for value in row)]))
        write_atomic(file, written(lines))
    return files


# LeRobot v3, https://huggingface.co/docs/lerobot: episodes one after the other in Parquet files.

VERSION = "v3.0"
_FILE_FRAMES = 300_000  # Frames in a file, about 100 MB, the size that the format recommends
_FLAGS = ("left_foot_stands", "right_foot_stands", "left_hand_touches", "right_hand_touches")
_QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)


@dataclass(frozen=True)
class Episode:
    """One robot in one clip."""

    task: str  # What it does, in words
    joints: tuple[str, ...]  # Names of the n motors
    qpos: np.ndarray  # (F, 7 + n) base position, m, quaternion, w first, and angles, rad
    flags: np.ndarray  # (F, 4) whether each foot stands and each hand touches another person
    measured: np.ndarray  # (F, n) whether what determines an angle was measured


def episodes(motion: RobotMotion, task: str) -> list[Episode]:
    """Return the motions of a clip, person by person."""
    flags = np.concatenate([motion.standing, motion.touching], -1)
    measured = (motion.source == Source.MEASURED) | (motion.source == Source.DENOISED)
    people = range(motion.qpos.shape[1])
    return [Episode(task, motion.joints, motion.qpos[:, p], flags[:, p], measured[:, p]) for p in people]


@pose_writer("lerobot", folder=True, skeleton="body25", fills="all", needs=["mink", "pyarrow"], extra="robots")
def write_lerobot(poses: Poses3D, clip: Clip, path: Path, *, robot: str | None = None) -> None:
    """LeRobot v3 data set of Unitree G1 robots: an episode for each person.

    Raises:
        ValueError: a person cannot be retargeted.
        FileNotFoundError: there is no model of the robot.
    """
    motion = retarget(poses, clip.fps, load_robot(robot))
    with whole_folder(Path(path)) as folder:
        write_episodes(folder, episodes(motion, clip.id), clip.fps)


def write_episodes(folder: Path, given: Sequence[Episode], fps: float) -> None:
    """Write a data set. `observation.state` has base and angles, `action` the angles of the next frame.

    The base quaternion has w last. Robots of one clip are consecutive episodes with the same frames.

    Raises ValueError if pyarrow is not installed.
    """
    import pandas as pd

    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise ValueError("format=lerobot needs pyarrow: pip install 'dmae-synth[robots]'") from None
    tasks = list(dict.fromkeys(each.task for each in given))
    starts = np.cumsum([0, *(len(each.qpos) for each in given)]).tolist()
    files = [start // _FILE_FRAMES for start in starts[:-1]]
    columns = [_columns(each, number, tasks.index(each.task), starts[number], fps) for number, each in enumerate(given)]
    features = _features(given[0].joints)
    for part in ("meta/episodes/chunk-000", "data/chunk-000"):
        (folder / part).mkdir(parents=True)
    for file in set(files):
        own = _joined([each for each, place in zip(columns, files, strict=True) if place == file])
        parquet.write_table(_table(own, features), folder / f"data/chunk-000/file-{file:03d}.parquet")
    rows = [
        {
            "episode_index": number,
            "tasks": [each.task],
            "length": len(each.qpos),
            "data/chunk_index": 0,
            "data/file_index": files[number],
            "dataset_from_index": starts[number],
            "dataset_to_index": starts[number + 1],
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            **pd.json_normalize({"stats": _stats(columns[number])}, sep="/").iloc[0],
        }
        for number, each in enumerate(given)
    ]
    parquet.write_table(pa.Table.from_pylist(rows), folder / "meta/episodes/chunk-000/file-000.parquet")
    # The index of the table of tasks is the text.
    index = pd.Index(tasks, name="task")
    pd.DataFrame({"task_index": range(len(tasks))}, index).to_parquet(folder / "meta/tasks.parquet")
    write_atomic(folder / "meta/stats.json", json.dumps(_stats(_joined(columns)), indent=1))
    info = {
        "codebase_version": VERSION,
        "robot_type": "unitree_g1",
        "total_episodes": len(given),
        "total_frames": starts[-1],
        "total_tasks": len(tasks),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": int(fps) if fps == int(fps) else fps,
        "splits": {"train": f"0:{len(given)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }
    write_atomic(folder / "meta/info.json", json.dumps(info, indent=1))


def _features(joints: tuple[str, ...]) -> dict[str, dict]:
    """Return what the columns hold, in their order: their type, their shape, and the names of a vector's numbers."""
    vectors = {
        "observation.state": ("x", "y", "z", "qx", "qy", "qz", "qw", *joints),
        "action": joints,
        "observation.contact": _FLAGS,
        "observation.measured": joints,
    }
    numbers = {
        "timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64",
        "task_index": "int64",
    }  # fmt: skip
    return {
        **{name: {"dtype": "float32", "shape": [len(names)], "names": list(names)} for name, names in vectors.items()},
        **{name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in numbers.items()},
    }


def _columns(episode: Episode, number: int, task: int, start: int, fps: float) -> dict[str, np.ndarray]:
    """Return the columns of an episode; `start` is its first frame in the data set."""
    count, angles = len(episode.qpos), episode.qpos[:, 7:]
    quaternion = continuous(episode.qpos[:, [4, 5, 6, 3]])
    return {
        "observation.state": np.concatenate([episode.qpos[:, :3], quaternion, angles], 1).astype(np.float32),
        "action": np.concatenate([angles[1:], angles[-1:]]).astype(np.float32),
        "observation.contact": episode.flags.astype(np.float32),
        "observation.measured": episode.measured.astype(np.float32),
        "timestamp": (np.arange(count) / fps).astype(np.float32),
        "frame_index": np.arange(count),
        "episode_index": np.full(count, number),
        "index": np.arange(start, start + count),
        "task_index": np.full(count, task),
    }


def _table(columns: dict[str, np.ndarray], features: dict[str, dict]):
    """Return the columns as a table of pyarrow with the types that `features` states."""
    import pyarrow as pa

    number_types = {"float32": pa.float32(), "int64": pa.int64()}
    schema = pa.schema(
        (name, pa.list_(pa.float32(), *about["shape"]) if about["names"] else number_types[about["dtype"]])
        for name, about in features.items()
    )
    arrays = [
        pa.FixedSizeListArray.from_arrays(value.ravel(), value.shape[1]) if value.ndim == 2 else pa.array(value)
        for value in columns.values()
    ]
    return pa.table(arrays, schema=schema)


def _joined(columns: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {name: np.concatenate([each[name] for each in columns]) for name in columns[0]}


def _stats(values: dict[str, np.ndarray]) -> dict[str, dict[str, list]]:
    found = {}
    for name, value in values.items():
        table = np.asarray(value, np.float64).reshape(len(value), -1)
        quantiles = dict(
            zip((f"q{round(100 * q):02d}" for q in _QUANTILES), np.quantile(table, _QUANTILES, axis=0), strict=True)
        )
        stats = {"min": table.min(0), "max": table.max(0), "mean": table.mean(0), "std": table.std(0), **quantiles}
        found[name] = {key: each.tolist() for key, each in stats.items()} | {"count": [len(table)]}
    return found
