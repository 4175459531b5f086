"""The robot that people are retargeted to."""

from itertools import product

import mujoco
import numpy as np
import pytest

from dmae.formats.retargeting import find_model


def needs_robot() -> None:
    """Skip a test where mink or the model of the robot is absent."""
    pytest.importorskip("mink", reason="mink, of the extra `robots`, is not installed")
    try:
        find_model()
    except FileNotFoundError as error:
        pytest.skip(str(error))


class TwoRobots:
    """Two robots in one model of MuJoCo, with their collision shapes."""

    def __init__(self):
        scene = mujoco.MjSpec()
        for person in range(2):
            spec = mujoco.MjSpec.from_file(str(find_model()))
            for each in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH] + list(spec.meshes):
                spec.delete(each)
            scene.attach(spec, prefix=f"{person}/", frame=scene.worldbody.add_frame())
        self.model = scene.compile()
        self.data = mujoco.MjData(self.model)

    def gap(self, qpos: np.ndarray, one: str = "", two: str = "") -> float:
        """Return the distance, m, of the shapes of the first robot's body `one` and the second's `two`, or of all."""
        self.data.qpos[:] = qpos.ravel()
        mujoco.mj_kinematics(self.model, self.data)
        names = [self.model.body(body).name for body in self.model.geom_bodyid]
        sides = ([g for g, name in enumerate(names) if name.startswith(start)] for start in (f"0/{one}", f"1/{two}"))
        return min(mujoco.mj_geomDistance(self.model, self.data, *pair, 1.0, None) for pair in product(*sides))
