"""Surfaces of people in T-pose."""

from typing import NamedTuple

import mujoco
import numpy as np
import pytest

from synth.people import mjcf, outfit
from synth.people.body import SEGMENTS, Body
from synth.people.clothing import PersonLooks
from synth.people.skinning import Skin
from synth.people.surface import bare_body


class Posed(NamedTuple):
    """A part of a surface in T-pose, world, with the soles on the floor at the origin."""

    segment: str
    material: str
    vertices: np.ndarray
    faces: np.ndarray


def in_t_pose(body: Body, looks: PersonLooks, *, naked: bool = False) -> list[Posed]:
    bare = bare_body(body)
    with pytest.MonkeyPatch.context() as patch:
        if naked:
            patch.setattr(mjcf, "parts", lambda *_: outfit._split(outfit._bare_sheet(bare), "skin", bare, body))
        spec = mujoco.MjSpec()
        mjcf.add_person(spec, 0, body, looks, position=(0, 0, body.hip_height), rng=None)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    Skin(model).apply(data)
    found = []
    for geom in np.flatnonzero(model.geom_group != mjcf.HIDDEN_GROUP):
        segment, material = model.geom(geom).name.split("/")[1:]
        mesh = model.geom_dataid[geom]
        vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
        places = data.geom_xpos[geom] + vertices @ data.geom_xmat[geom].reshape(3, 3).T
        found.append(Posed(segment, material.rstrip("0123456789"), places, faces))
    assert {part.segment for part in found} == set(SEGMENTS)
    return found
