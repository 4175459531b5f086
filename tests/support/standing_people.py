"""People of capsules that stand among objects, and cameras that look at them."""

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from synth.rigs.lenses import add_cameras

_PERSON = """
<body name="person{index}" pos="{x} {y} 0"><freejoint/>
  <geom type="capsule" fromto="0 0 .9 0 0 1.4" size=".16"/>
  <geom type="sphere" pos="0 0 1.65" size=".11"/>
  <geom type="capsule" fromto="0 .1 .07 0 .1 .85" size=".07"/>
  <geom type="capsule" fromto="0 -.1 .07 0 -.1 .85" size=".07"/>
  <geom type="capsule" fromto="0 .24 .8 0 .24 1.4" size=".05"/>
  <geom type="capsule" fromto="0 -.24 .8 0 -.24 1.4" size=".05"/>
</body>
"""
# Head, chest, left and right hand, left and right foot of a person at the origin, each in the middle of its limb.
POINTS = np.array([[0, 0, 1.65], [0, 0, 1.2], [0, 0.24, 0.8], [0, -0.24, 0.8], [0, 0.1, 0.07], [0, -0.1, 0.07]])
DEPTH = np.array([0.11, 0.16, 0.05, 0.05, 0.07, 0.07]) + 0.01


def looking_along_x(*centers) -> CameraRig:
    """Return level 640 x 480 cameras of 500 px focal length at the centres, looking along +x; image right is -y."""
    R = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    pose = np.tile(np.eye(4), (len(centers), 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = R, -np.array(centers, float) @ R.T
    K = np.tile([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], (len(centers), 1, 1))
    names = [f"c{i}" for i in range(len(centers))]
    return CameraRig(names, K, np.zeros((len(centers), 5)), pose, np.tile([640, 480], (len(centers), 1)))


def scene(rig: CameraRig, places: list, objects: str = "") -> tuple[mujoco.MjModel, np.ndarray, np.ndarray]:
    """Build people standing at places (x, y) on a floor among objects; each named geom is an object.

    Returns:
        model: The scene.
        ids: (ngeom,) owners of the geoms.
        points: (1, P, 6, 3) m, the people's `POINTS`.
    """
    bodies = "".join(_PERSON.format(index=i, x=x, y=y) for i, (x, y) in enumerate(places))
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><light pos="0 0 4"/><geom type="plane" size="9 9 .1" rgba=".5 .5 .5 1"/>'
        f"{objects}{bodies}</worldbody></mujoco>"
    )
    add_cameras(spec, rig)
    model = spec.compile()
    ids, objects = np.zeros(model.ngeom, np.uint16), 0
    for geom in range(model.ngeom):
        if model.geom(geom).name:
            ids[geom], objects = 256 + objects, objects + 1
        elif model.geom_bodyid[geom]:
            ids[geom] = model.geom_bodyid[geom]
    return model, ids, np.array([POINTS + np.array([x, y, 0]) for x, y in places])[None]
