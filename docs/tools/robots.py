"""Measure people retargeted to robots: `docs/results/robots.json`; draw `docs/images/robots.jpg`.

    python docs/tools/robots.py              # two clips of each of four interactions: 5 minutes
    python docs/tools/robots.py clips=1 keep=runs/robots       # and keep the clips
    python docs/tools/robots.py clips=0 keep=runs/robots       # draw kept clips, measure nothing
    python docs/tools/robots.py clips=0 keep=runs/robots video=runs/robots.mp4     # and a video of them: minutes

Robots are played back in MuJoCo, with the model's own meshes and collision shapes:

- slide: speed over the floor of heel and tip of a sole, between two frames in which the person's foot stands flat;
- contact: distance between collision shapes of two robots in frames in which the simulated hand of one person presses
  on the hand, arm or trunk of another; below 0 where they overlap;
- overlap: how deep any shape of one robot is in any shape of another;
- speed: angles between two frames; limits: angles beyond the model's ranges, speeds beyond those of the motors;
- cost: frames a second of CPU time on one core, for each person.

The same clips are also retargeted from joints alone, as of captured people, whose contacts nobody knows.
"""

import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import cv2
import mujoco
import numpy as np
from provenance import measured

import synth
from dmae.data.conversion import convert
from dmae.data.images import write_video
from dmae.data.json_values import json_text
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip
from dmae.formats.retargeting import RobotMotion, find_model, load_robot, retarget, speeds
from dmae.progress import progress
from synth.datasets.exporters.robots import hand_contacts
from synth.physics.body_state import BodyState, load_state
from synth.rendering.opengl import find_backend, make_context

ROOT = Path(__file__).parents[2]
FILE, PICTURE = (ROOT / "docs" / name for name in ("results/robots.json", "images/robots.jpg"))
KINDS = ("handshake", "hug", "pass_box", "dance")
SEED, SECONDS = 7, 6
SIZE = (480, 300)
COLUMNS = [
    "interaction", "contacts", "clips", "feet stand, % of the time", "slide, cm/s: 95 % below", "most",
    "angle from frame to frame, rad: most", "share of motors' speed, %: most", "beyond limits",
    "frames with contact", "within 3 cm, %", "distance, cm: median", "95 % below", "overlap, cm: 95 % below", "most",
    "frames/s",
]  # fmt: skip
PARTS = {
    "hand": ["{}_wrist_yaw_link"], "forearm": ["{}_elbow_link", "{}_wrist_pitch_link", "{}_wrist_yaw_link"],
    "upper_arm": ["{}_shoulder_yaw_link", "{}_elbow_link"],
    "trunk": ["torso_link", "pelvis"],
}  # fmt: skip
"""Bodies of the robot whose collision shapes stand for a part."""


def main(clips: int, keep: str | None, video: str | None) -> None:
    with nullcontext(keep) if keep else tempfile.TemporaryDirectory() as folder:
        for kind in KINDS if clips else ():
            scene = synth.preset("scene", "studio", persons=[2, 2])
            alone = synth.preset("interaction", kind, bystanders=0)
            list(
                synth.generate(
                    scene=scene, seconds=SECONDS, interaction=alone, clips=clips, seed=SEED, out=Path(folder, kind)
                )
            )
        found = {kind: clip_folders(Path(folder, kind))[: clips or None] for kind in KINDS}
        model = load_robot()
        if clips:
            tasks = [(kind, known) for known in (True, False) for kind in KINDS]
            rows = [
                _measure(kind, known, found[kind], model) for kind, known in progress(tasks, "measuring", len(tasks))
            ]
            table = {"command": f"python docs/tools/robots.py clips={clips}", "columns": COLUMNS, "rows": rows}
            FILE.write_text(json_text({"measured": measured("mujoco", "mink", "mjlab"), "tables": {"robots": table}}))
        _draw({kind: _moved(folders[0], model, True) for kind, folders in found.items()}, video)


def _moved(folder: Path, model: mujoco.MjModel, known: bool) -> tuple[RobotMotion, BodyState, float, float]:
    """Return the robots of a clip, its state, its frame rate, and frames a second of CPU time for each person."""
    clip, state = load_clip(folder), load_state(folder)
    poses = convert(clip.truth, BODY25)
    start = time.process_time()
    motion = retarget(poses, clip.fps, model, hand_contacts(state) if known else None)
    return motion, state, clip.fps, motion.qpos.shape[0] * motion.qpos.shape[1] / (time.process_time() - start)


def _measure(kind: str, known: bool, folders: list[Path], model: mujoco.MjModel) -> list:
    low, high = model.jnt_range[1:].T
    fastest = np.array(list(speeds(model).values()))
    slides, stands, gaps, overlaps, rates, steps, shares, beyond = [], [], [], [], [], [], [], 0
    for number, folder in enumerate(folders):
        motion, state, fps, rate = _moved(folder, model, known)
        if number == 0:  # compiled functions are compiled in the first one
            rate = _moved(folder, model, known)[-1]
        angles = motion.qpos[..., 7:]
        step = np.abs(np.diff(angles, axis=0))
        beyond += int(((angles < low) | (angles > high)).sum() + (step * fps > fastest).sum())
        steps.append(step.max())
        shares.append((step * fps / fastest).max())
        slide = _slide(motion, model, fps)
        slides.append(slide[np.isfinite(slide)])
        stands.append(motion.standing.mean())
        gap, overlap = _gaps(motion, state)
        gaps.append(gap)
        overlaps.append(overlap)
        rates.append(rate)
    slide, gap = np.concatenate(slides), np.concatenate(gaps)
    given = "of the simulation" if known else "of joints alone"
    contact = [
        round(100 * (gap < 0.03).mean()),
        *((100 * np.percentile(gap, [50, 95])).round(1) + 0.0),
        *(100 * np.percentile(np.concatenate(overlaps), [95, 100])).round(1),
    ]
    return list(map(str, [
        kind, given, len(folders), round(100 * np.mean(stands)), *(100 * np.percentile(slide, [95, 100])).round(2),
        round(max(steps), 2), round(100 * max(shares)), beyond, len(gap), *contact, int(round(min(rates), -1)),
    ]))  # fmt: skip


def _slide(motion: RobotMotion, model: mujoco.MjModel, fps: float) -> np.ndarray:
    """Return speeds (F - 1, P, 2) of the faster end of each sole, m/s; NaN where the foot is not held."""
    data, ends = mujoco.MjData(model), np.empty((*motion.standing.shape, 2, 2))
    for frame, persons in enumerate(motion.qpos):
        for person, qpos in enumerate(persons):
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            for foot, side in enumerate(("left", "right")):
                body = data.body(f"{side}_ankle_roll_link")
                ends[frame, person, foot] = (
                    body.xpos + [(-0.05, 0, -0.035), (0.13, 0, -0.035)] @ body.xmat.reshape(3, 3).T
                )[:, :2]
    speed = fps * np.linalg.norm(np.diff(ends, axis=0), axis=-1).max(-1)
    return np.where(motion.standing[1:] & motion.standing[:-1], speed, np.nan)


def _together(persons: int, floor: bool = False) -> mujoco.MjModel:
    """Return a model with several robots: their collision shapes; with a floor also what is drawn of them."""
    scene, robot = mujoco.MjSpec(), mujoco.MjSpec.from_file(str(find_model()))
    for geom in () if floor else list(robot.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
            robot.delete(geom)
    for mesh in () if floor else list(robot.meshes):
        robot.delete(mesh)
    for person in range(persons):
        scene.attach(robot.copy(), prefix=f"{person}/", frame=scene.worldbody.add_frame())
    if floor:
        scene.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], rgba=[0.5, 0.53, 0.58, 1])
        scene.add_texture(
            name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            rgb1=[0.93, 0.94, 0.96], width=64, height=64,
        )  # fmt: skip
        scene.worldbody.add_light(pos=[0, 0, 4], dir=[0, 0.2, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
        scene.visual.headlight.ambient = [0.25] * 3
        scene.visual.global_.offwidth, scene.visual.global_.offheight = SIZE
    return scene.compile()


def _gaps(motion: RobotMotion, state: BodyState) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance of two robots' parts for each contact of a hand in each frame, and overlap (F,), m."""
    model = _together(motion.qpos.shape[1])
    data, shapes = mujoco.MjData(model), defaultdict(list)
    for geom in range(model.ngeom):
        if model.geom_contype[geom]:
            shapes[model.body(model.geom_bodyid[geom]).name].append(geom)
    every = [[geom for name in shapes if name.startswith(f"{person}/") for geom in shapes[name]] for person in range(2)]
    found, overlaps, contacts = [], [], hand_contacts(state)

    def gap(one: list[int], two: list[int]) -> float:
        return min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a in one for b in two)

    for frame, qpos in enumerate(motion.qpos):
        data.qpos[:] = qpos.ravel()
        mujoco.mj_kinematics(model, data)
        overlaps.append(max(-gap(*every), 0))
        for each in contacts:
            if np.isfinite(each.point[frame]).all():
                hand, part = (
                    [g for body in PARTS[name] for g in shapes[f"{person}/{body.format(('left', 'right')[side])}"]]
                    for person, name, side in (
                        (each.person, "hand", each.side),
                        (each.other, each.part, each.other_side),
                    )
                )
                found.append(gap(hand, part))
    return np.array(found), np.array(overlaps)


def _draw(moved: dict[str, tuple], video: str | None) -> None:
    """Draw the moment of most contact of each clip, and a video of all of them."""
    backend = find_backend()
    if backend is None:
        sys.exit("no OpenGL works here: nothing is drawn")
    context = make_context(backend, *SIZE)
    stills = []
    for kind, (motion, *_) in moved.items():
        touching = motion.touching.sum((1, 2))
        most = np.flatnonzero(touching == touching.max())
        stills.append(_titled(next(_film(motion, motion.qpos[most[len(most) // 2], None])), kind))
    cv2.imwrite(str(PICTURE), _tiled(stills)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
    if video:
        # One after the other: they draw in one context.
        films = [list(_film(motion, motion.qpos)) for motion, *_ in moved.values()]
        frames = (_tiled(list(map(_titled, tiles, moved))) for tiles in zip(*films, strict=True))
        write_video(Path(video), frames, next(iter(moved.values()))[2])
    context.free()


def _tiled(images: list[np.ndarray]) -> np.ndarray:
    return np.vstack([np.hstack(images[:2]), np.hstack(images[2:])])


def _film(motion: RobotMotion, frames: np.ndarray) -> Iterator[np.ndarray]:
    """Yield an image (H, W, 3) of all robots for each of the frames (n, P, nq), seen from one place."""
    model = _together(motion.qpos.shape[1], floor=True)
    data = mujoco.MjData(model)
    option, camera, scene = mujoco.MjvOption(), mujoco.MjvCamera(), mujoco.MjvScene(model, 2000)
    option.geomgroup[3] = 0
    drawing = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, drawing)
    bases = motion.qpos[..., :2]
    camera.lookat[:] = (*bases.reshape(-1, 2).mean(0), 0.7)
    between = np.subtract(*bases[len(bases) // 2, :2])
    camera.distance, camera.elevation = 1.7 + 0.45 * np.ptp(bases.reshape(-1, 2), axis=0).max(), -12
    camera.azimuth = np.degrees(np.arctan2(between[1], between[0])) + 70
    image = np.empty((SIZE[1], SIZE[0], 3), np.uint8)
    for qpos in frames:
        data.qpos[:] = qpos.ravel()
        mujoco.mj_forward(model, data)
        mujoco.mjv_updateScene(model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
        area = mujoco.MjrRect(0, 0, *SIZE)
        mujoco.mjr_render(area, scene, drawing)
        mujoco.mjr_readPixels(image, None, area, drawing)
        yield image[::-1].copy()
    drawing.free()


def _titled(image: np.ndarray, kind: str) -> np.ndarray:
    place = (10, 22)
    return cv2.putText(
        image.copy(), kind.replace("_", " "), place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (20, 20, 20), 1, cv2.LINE_AA
    )


if __name__ == "__main__":
    options = dict(argument.split("=") for argument in sys.argv[1:])
    main(int(options.get("clips", 2)), options.get("keep"), options.get("video"))
