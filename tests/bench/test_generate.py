"""Time of rendering compared with its engine calls, the gain from workers, and the memory they need."""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path

import mujoco
import pytest

from dmae.data.images import KINDS
from synth.datasets.clip import generate_clip
from synth.datasets.config import GenerateConfig
from synth.datasets.generate import generate
from synth.errors import FailedSimulation
from synth.motion.config import MotionConfig
from synth.physics.simulation import simulate
from synth.rendering.config import ImageQuality
from synth.rendering.opengl import find_backend
from synth.rendering.renderer import Renderer, render_images
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_scene
from tests.support.scenes import RIG

pytestmark = pytest.mark.bench

ENGINE = ("mjv_updateScene", "mjr_render", "mjr_readPixels")
MOST_MEMORY = 2**30
CLIPS = 100


@pytest.mark.parametrize("quality", list(ImageQuality), ids=lambda quality: quality.name)
@pytest.mark.parametrize("kinds", [("rgb",), KINDS], ids=["rgb", "all"])
def test_rendering_of_four_people(quality, kinds, tmp_path, monkeypatch):
    if not find_backend():
        pytest.skip("no OpenGL works here")
    spec = sample_scene(SceneConfig(persons=[4, 4], seconds=0.4), MotionConfig(), seed=0, clip=0).spec
    made = simulate(spec, RIG)
    engine = dict.fromkeys(ENGINE, 0.0)

    def timed(name, call):
        def call_and_time(*arguments):
            start = time.perf_counter()
            call(*arguments)
            engine[name] += time.perf_counter() - start

        return call_and_time

    for name in ENGINE:
        monkeypatch.setattr(mujoco, name, timed(name, getattr(mujoco, name)))
    start = time.perf_counter()
    with Renderer(made.model, made.geom_ids, RIG, quality) as renderer:
        starting = time.perf_counter() - start
        # The first image is when textures and meshes are handed over.
        renderer.image(made.qpos[0], 0)
        engine.update(dict.fromkeys(ENGINE, 0.0))
        start = time.perf_counter()
        for view in range(len(RIG)):
            for state in made.qpos:
                renderer.image(state, view, kinds)
        rendering, called = time.perf_counter() - start, dict(engine)
        start = time.perf_counter()
        render_images(renderer, made.qpos, RIG, tmp_path, spec.fps, kinds)
        whole = time.perf_counter() - start
    views = len(made.qpos) * len(RIG)
    spent = {"rendering": rendering, "with files written": whole, **called}
    print(f"\n{quality.name}, {'+'.join(kinds)}: rendering {rendering / sum(called.values()):.2f} x the engine's calls")
    print("  ms a view:", ", ".join(f"{name} {1000 * seconds / views:.1f}" for name, seconds in spent.items()))
    print(f"  starting {starting:.2f} s")


@pytest.mark.parametrize("quality", list(ImageQuality), ids=lambda quality: quality.name)
def test_ids_beside_colour(quality, tmp_path, monkeypatch):
    """CPU time of colour and ids, files and numbers of pixels included, as a ratio to colour alone."""
    if not find_backend():
        pytest.skip("no OpenGL works here")
    monkeypatch.setenv("LP_NUM_THREADS", "1")
    spec = sample_scene(SceneConfig(persons=[4, 4], seconds=0.4), MotionConfig(), seed=0, clip=0).spec
    made, rig = simulate(spec, RIG), RIG[:2]
    spent = {}
    for kinds in (("rgb",), ("rgb", "ids")):
        with Renderer(made.model, made.geom_ids, rig, quality) as renderer:
            renderer.image(made.qpos[0], 0, kinds)
            start = time.process_time()
            render_images(renderer, made.qpos, rig, tmp_path / "+".join(kinds), spec.fps, kinds)
            spent[kinds] = (time.process_time() - start) / (len(made.qpos) * len(rig))
    alone, both = spent.values()
    print(f"\n{quality.name}: colour {1000 * alone:.0f} ms a view, with ids {both / alone:.2f} x as much")


def test_workers(tmp_path, monkeypatch):
    """Needs a machine with four idle cores to mean anything."""
    # Mesa's rasteriser would let one worker take all cores.
    monkeypatch.setenv("LP_NUM_THREADS", "0")
    cores = len(os.sched_getaffinity(0))
    if cores < 4:
        pytest.skip(f"four workers need four cores, there are {cores}")

    def seconds(workers: int) -> float:
        scene, out = SceneConfig(persons=[2, 2], seconds=0.4), tmp_path / f"{workers}"
        config = GenerateConfig(
            str(out), clips=16, workers=workers, images=["rgb"], quality=ImageQuality.draft, scene=scene
        )
        start = time.perf_counter()
        generate(config)
        return time.perf_counter() - start

    # Processes are begun, and packages imported, before anything is timed; they are kept.
    short = SceneConfig(persons=[1, 1], seconds=0.2)
    generate(GenerateConfig(str(tmp_path / "warm"), clips=8, workers=4, scene=short))
    four, one = seconds(4), seconds(1)
    print(f"\n16 clips of 10 frames in 5 views: one worker {one:.1f} s, four {four:.1f} s, {one / four:.2f} x as fast")


def _memory_after(clip: int) -> int:
    """Bytes that this process holds once it has made a clip."""
    config = GenerateConfig(scene=SceneConfig(persons=[2, 2], seconds=0.4), retries=0)
    with suppress(FailedSimulation):
        generate_clip(config, clip)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def test_memory_of_a_worker():
    if not Path("/proc/self/statm").is_file():
        pytest.skip("memory is read from /proc")
    with ProcessPoolExecutor(1, get_context("spawn")) as worker:
        held = list(worker.map(_memory_after, range(CLIPS)))
    early, late = max(held[: CLIPS // 5]), max(held)
    print(f"\n{CLIPS} clips by one worker: {early / 2**20:.0f} MiB after a fifth of them, {late / 2**20:.0f} after all")
    assert late < MOST_MEMORY
    assert late < 1.1 * early, "memory is flat"
