"""Forecast the time and the disk space of a data set from a few short clips, which are deleted afterwards."""

import heapq
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dmae.data.clip import Clip
from dmae.data.store import load_clip, save_clip
from dmae.files.checksums import clip_checksum, write_checksums
from dmae.files.structured import read_json
from dmae.parallel import in_parallel, process_count, running_on
from dmae.progress import duration, progress
from dmae.reporting.tables import counted
from synth.datasets.clip import check, check_target, clip_id, simulate_clip
from synth.datasets.config import GenerateConfig, OcclusionConfig, RenderConfig
from synth.datasets.generate import limit_threads
from synth.errors import FailedSimulation, until_success
from synth.physics.body_state import BodyState, save_state
from synth.physics.simulation import rebuilt_scene
from synth.rendering.renderer import Renderer, render_images
from synth.rendering.sensor import Sensor
from synth.scene.sampling import count_people

_SHORT, _LONG = 0.24, 2.0
"""Lengths of the test clips, s. The difference gives the cost of a frame, the rest is the fixed cost of a clip."""
_IMAGES = 5
"""Greatest number of frames that are rendered."""
_PART = 5
"""At most one clip in so many, and one frame in so many, is made for a forecast, but one clip at least."""
_SEARCHES = 4
"""Greatest number of clips for which the search for a target occlusion is timed, in addition to the first clip."""
_MANY_FRAMES, _MANY_RENDERED = 4000, 200
"""Total numbers of frames, without and with images, above which a forecast is made. A forecast takes a few seconds."""


@dataclass(frozen=True)
class Forecast:
    """The remaining work for a data set."""

    clips: int  # Number of clips to make, without existing clips that only lack images
    frames: int  # Number of frames of all clips
    images: int  # Number of images. An image is one view of one frame, in all requested kinds of images.
    seconds: float  # Estimated time with the requested number of processes, s
    megabytes: float  # Estimated disk space, MB

    def __str__(self) -> str:
        images = f", {counted(self.images, 'image')}" if self.images else ""
        took = duration(self.seconds)
        made = f"{counted(self.clips, 'clip')}, {counted(self.frames, 'frame')}{images}"
        return f"{made}: about {took}, {self.megabytes:,.0f} MB"


class ImageCost(NamedTuple):
    """The cost of the images of a clip: time, s, for the clip and for each frame, and size, bytes, of all frames."""

    clip_seconds: float = 0.0
    frame_seconds: float = 0.0
    bytes: float = 0.0


def is_long(config: GenerateConfig) -> bool:
    """Return whether a data set is large enough to justify the time of a forecast."""
    frames = len(config.numbers) * config.scene.frames
    return frames > _MANY_FRAMES or (bool(config.kinds) and frames > _MANY_RENDERED)


def forecast(config: GenerateConfig) -> Forecast:
    """Forecast the time and the disk space of a data set, or of its missing clips and images.

    Short pieces of a clip with the median number of people are made in the requested number of processes, and a few
    images rendered. With `occlusion.target`, the searches for a few scenes are timed, and the pieces have any scene.
    Nothing is written to `config.out`. The forecast takes about a quarter of the time of six clips, half of that of
    three. Raises as `generate`.
    """
    searched, config = config, replace(config, occlusion=OcclusionConfig())
    rig = check(config)
    to_make, to_render = _missing(config)
    search = _search_seconds(searched, to_make) if searched.occlusion.target else 0.0
    indices, frames = sorted([*to_make, *to_render]), config.scene.frames
    if not indices:
        return Forecast(0, 0, 0, 0.0, 0.0)
    how = config.scene, config.interaction
    people = {index: max(1, count_people(*how, seed=config.seed, clip=index)) for index in indices}
    median = sorted(people.values())[len(people) // 2]
    usual = [index for index in indices if people[index] == median]
    limit_threads(config.workers)
    with running_on(config.backend):
        processes = process_count(config.workers)
        # As many processes as in the real run, because they share memory and caches. The first task of each process is
        # not measured.
        measured = max(1, min(processes, len(indices) // _PART))
        first = in_parallel(_first_success, [(config, usual, _SHORT)] * measured, config.workers)
        parts = chain(first, in_parallel(_measure, [(config, usual)] * measured, config.workers))
        costs = list(progress(parts, "estimating the time", 2 * measured))[measured:]
    clip_seconds, frame_seconds, clip_bytes, frame_bytes, *of_images = np.mean(costs, axis=0)
    cost = ImageCost(*of_images)
    # Labels are in proportion to people; images are not.
    labels, rendering = clip_seconds + frames * frame_seconds + search, cost.clip_seconds + frames * cost.frame_seconds
    seconds = [rendering + (labels * people[index] / median if index in to_make else 0) for index in indices]
    size = sum(people[index] for index in to_make) / median * (clip_bytes + frames * frame_bytes)
    size += len(indices) * cost.bytes
    images = len(indices) * frames * len(rig) if config.kinds else 0
    took = makespan(seconds, processes)
    return Forecast(len(to_make), frames * len(to_make), images, float(took), float(size) / 1e6)


def makespan(seconds: list[float], workers: int) -> float:
    """Return the time at which the last task ends, s, if each task is started by the first free process."""
    ends = [0.0] * max(1, workers)
    for each in seconds:
        heapq.heappush(ends, heapq.heappop(ends) + each)
    return max(ends)


def _search_seconds(config: GenerateConfig, indices: Sequence[int]) -> float:
    """Return the mean time of the search for a scene that meets the target, s."""
    groups = [range(min(config.clips, 3)), *([index] for index in indices[2 * _PART :: 2 * _PART][:_SEARCHES])]
    start = time.perf_counter()
    check_target(config, groups[0])
    for group in groups[1:]:
        with suppress(FailedSimulation):
            check_target(config, group)
    return (time.perf_counter() - start) / len(groups)


def _missing(config: GenerateConfig) -> tuple[list[int], list[int]]:
    to_make, to_render = [], []
    for index in config.numbers:
        path = Path(config.out) / clip_id(index, config.prefix) / "clip.json"
        if not path.is_file():
            to_make.append(index)
            continue
        if lacks_images(path, config.kinds):
            to_render.append(index)
    return to_make, to_render


def lacks_images(path: Path, kinds: Sequence[str]) -> bool:
    """Return whether a clip, given by its `clip.json`, lacks some of these kinds of images."""
    images = read_json(path).get("images") or {"kinds": ()}
    return not set(kinds) <= set(images["kinds"])


def _measure(config: GenerateConfig, indices: list[int]) -> tuple[float, ...]:
    """Return time, s, and size, bytes, of a clip, each fixed and by frame, and the fields of `ImageCost`."""
    whole = len(config.numbers) * config.scene.seconds
    length = min(config.scene.seconds, _LONG, max(2 * _SHORT, whole / _PART))
    with tempfile.TemporaryDirectory() as folder:
        short = _timed(config, indices, min(_SHORT, length / 2), Path(folder) / "short")
        long = _timed(config, indices, length, Path(folder) / "long")
        images = ImageCost()
        if config.kinds:
            images = image_cost(config, long.clip, long.state, config.scene.frames, Path(folder) / "images")
    few, more = len(short.clip), max(1, len(long.clip) - len(short.clip))
    frame_seconds = max(0.0, (long.seconds - short.seconds) / more)
    frame_bytes = (long.bytes - short.bytes) / more
    clip_seconds, clip_bytes = max(0.0, short.seconds - few * frame_seconds), short.bytes - few * frame_bytes
    return clip_seconds, frame_seconds, clip_bytes, frame_bytes, *images


class _TimedClip(NamedTuple):
    """A clip with its states, the time that it took, s, and the size of its files, bytes."""

    clip: Clip
    state: BodyState
    seconds: float
    bytes: int


def _timed(config: GenerateConfig, indices: list[int], seconds: float, folder: Path) -> _TimedClip:
    """Make a clip of `seconds`."""
    start = time.perf_counter()
    clip, state = _first_success(config, indices, seconds)
    save_clip(clip, folder)
    save_state(state, folder)
    # The real run reads a clip again for its images, and its files for their checksums.
    load_clip(folder)
    write_checksums(folder)
    clip_checksum(folder)
    return _TimedClip(clip, state, time.perf_counter() - start, bytes_in(folder))


def _first_success(config: GenerateConfig, indices: list[int], seconds: float) -> tuple:
    """Make clips in order until one succeeds, and return it."""
    short = replace(config, scene=replace(config.scene, seconds=seconds))
    return until_success(lambda number: simulate_clip(short, indices[number]), len(indices) - 1)


def image_cost(
    config: GenerateConfig | RenderConfig, clip: Clip, state: BodyState, frames: int, folder: Path
) -> ImageCost:
    """Measure what images of `frames` frames cost, by rendering all views of one frame and of a few frames."""
    few = min(_IMAGES, len(clip), max(2, frames // _PART))
    rig = clip.actual_rig
    start = time.perf_counter()
    scene = rebuilt_scene(clip, state)
    with Renderer(scene.model, scene.geom_ids, rig, config.quality, config.imaging) as renderer:
        renderer.image(state.qpos[0], 0, config.kinds)
        begun, took, sizes = time.perf_counter() - start, [], []
        for count in (1, few):
            start = time.perf_counter()
            how: dict = {"kinds": config.kinds, "rgb": config.rgb.value}
            how["sensors"] = [Sensor(config.imaging, 0, 0, view) for view in range(len(rig))]
            images = render_images(renderer, state.qpos[:count], rig, folder / str(count), clip.fps, **how).images
            took.append(time.perf_counter() - start)
            sizes.append({kind: bytes_in(images.folder / kind) for kind in images.kinds})
    between = max(1, few - 1)
    frame_seconds = (took[1] - took[0]) / between if few > 1 else took[0]
    size = 0.0
    for kind in config.kinds:
        first, each = sizes[0][kind], (sizes[1][kind] - sizes[0][kind]) / between
        # A video has one keyframe per second; the frames between store differences.
        firsts = ceil(frames / max(1, round(clip.fps))) if images.path(kind, rig.names[0]).suffix == ".mp4" else 1
        size += firsts * first + (frames - firsts) * max(0.0, each)
    return ImageCost(begun + max(0.0, took[0] - frame_seconds), frame_seconds, size)


def bytes_in(folder: Path) -> int:
    """Return the size of all files in a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
