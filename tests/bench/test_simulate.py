"""Time to make labels, compared with the engine calls that they contain."""

import time

import mujoco
import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from dmae.data.rng import Stream, generator
from synth.errors import FailedSimulation
from synth.labels.visibility import joint_visibility
from synth.motion.config import MotionConfig
from synth.physics import simulation
from synth.physics.simulation import simulate
from synth.rigs.config import RigConfig
from synth.rigs.rig import make_rig
from synth.scene.config import SceneConfig
from synth.scene.sampling import SampledScene, sample_scene

pytestmark = pytest.mark.bench

APART = SceneConfig(persons=[4, 4])
TOUCHING = SceneConfig(persons=[4, 4], gathering=0.2, clearance=[0.2, 0.3])
REPEATS = 3


class Calls:
    """Calls of one engine function: how often, and how long when made again from the same states, s."""

    def __init__(self, monkeypatch, name: str):
        self._real, self._made, self._model = getattr(mujoco, name), [], None
        monkeypatch.setattr(mujoco, name, self._note)

    def _note(self, model, data, *rest):
        state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        self._made.append((state, rest))
        self._model = model
        self._real(model, data, *rest)

    def __len__(self) -> int:
        return len(self._made)

    def bare(self) -> float:
        data, spent = mujoco.MjData(self._model), 0.0
        for state, rest in self._made:
            mujoco.mj_setState(self._model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
            if rest:
                mujoco.mj_kinematics(self._model, data)
            start = time.perf_counter()
            self._real(self._model, data, *rest)
            spent += time.perf_counter() - start
        return spent


class Clock:
    """Seconds spent in the parts of making a clip; the least of some repeats of each."""

    def __init__(self):
        self._spent = {}

    def time(self, part: str, function, *arguments, **options):
        start = time.perf_counter()
        made = function(*arguments, **options)
        spent = time.perf_counter() - start
        self._spent[part] = min(spent, self._spent.get(part, np.inf))
        return made

    def __getitem__(self, part: str) -> float:
        return self._spent[part]


def see(made, rig):
    return joint_visibility(made.model, made.qpos, made.joints, made.depth, made.geom_ids, rig, made.bodies)


def drawn(scene: SceneConfig) -> tuple[int, SampledScene, CameraRig]:
    """The first clip that succeeds, of a rig of five cameras: its number, scene and cameras."""
    for clip in range(20):
        rig = make_rig(RigConfig(), rng=generator(0, clip, Stream.CAMERAS))
        try:
            found = sample_scene(scene, MotionConfig(), seed=0, clip=clip)
            simulate(found.spec, rig, found.motions, painted=False)
        except FailedSimulation:
            continue
        return clip, found, rig
    raise FailedSimulation("none of 20 clips succeeds")


@pytest.mark.parametrize("scene", [APART, TOUCHING], ids=["apart", "touching"])
def test_labels_of_four_people_in_five_views(scene, monkeypatch):
    clip, (spec, motions), rig = drawn(scene)
    clock, run = Clock(), simulation._run
    monkeypatch.setattr(simulation, "_run", lambda *given: clock.time("simulating", run, *given))
    for _ in range(REPEATS):
        clock.time("sampling", sample_scene, scene, MotionConfig(), seed=0, clip=clip)
        made = clock.time("the rest", simulate, spec, rig, motions, painted=False)
        clock.time("visibility", see, made, rig)
    with monkeypatch.context() as patch:
        steps, rays = Calls(patch, "mj_step"), Calls(patch, "mj_multiRay")
        see(simulate(spec, rig, motions, painted=False), rig)
    step, ray = (min(calls.bare() for _ in range(REPEATS)) for calls in (steps, rays))
    simulating, seeing = clock["simulating"], clock["visibility"]
    preparing = clock["sampling"] + clock["the rest"] - simulating
    whole = preparing + simulating + seeing
    frames, quality = len(made.qpos), made.quality
    print(f"\n{frames} frames, of which in contact {quality['contact_frames']}; s:")
    print(f"  {len(steps)} calls of mj_step {step:.3f}, {len(rays)} mj_multiRay {ray:.3f}")
    print(f"  preparing {preparing:.3f}, simulating {simulating:.3f}, visibility {seeing:.3f}")
    print(f"  simulating / mj_step {simulating / step:.2f}, visibility / mj_multiRay {seeing / ray:.2f}")
    print(f"  preparing / simulating {preparing / simulating:.2f}")
    print(f"  (simulating + visibility) / both {(simulating + seeing) / (step + ray):.2f}")
    print(f"  all / both {whole / (step + ray):.2f}, {frames / whole:.0f} frames/s")
