"""What can I do? The verbs of `synth`: typed functions of configurations, presets, folders and clips."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmae.command_line.options import Command, Preset
from dmae.command_line.presets import checked_preset, is_preset
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.resources import FUNCTION
from dmae.data.rng import Stream, generator
from dmae.data.store import clip_folders, load_clip
from dmae.data.typed import check_arguments, fields_meant, with_changes
from dmae.detection.registry import PoseDetectorConfig
from dmae.nearest import unknown
from dmae.parallel import in_parallel, running_on
from dmae.viewing.config import ShowConfig
from synth.cli import SYNTH
from synth.datasets.config import GenerateConfig, RenderConfig
from synth.detector.config import DetectorConfig, ErrorReference, Limits
from synth.errors import FailedSimulation
from synth.interactions.registry import InteractionConfig
from synth.motion.config import MotionConfig
from synth.planning.config import PlanConfig
from synth.rendering.config import ImagingConfig
from synth.rigs.config import RigConfig, listed_rig
from synth.scene.config import SceneConfig

if TYPE_CHECKING:
    import numpy as np

    from synth.datasets.forecast import Forecast
    from synth.datasets.motion_comparison import Difference
    from synth.datasets.verify import Problem
    from synth.detector.comparison import Row
    from synth.detector.fitting import Fit
    from synth.physics.body_state import BodyState
    from synth.planning.plan import CameraPlan
    from synth.recognition.realism import Rate

_GROUPS = ("scene", "rig", "motion", "interaction", "detector")
"""Options that presets set."""


@check_arguments
def preset(group: str, name: str | Path, **changes: object) -> Any:
    """Return a group of options as a preset sets it, with some of them changed.

        synth.generate(rig=synth.preset("rig", "studio5", size=[640, 480]))

    Args:
        group: `scene`, `rig`, `motion`, `interaction` or `detector`.
        name: Name of the preset, as on the command line; or the file of your own, `.../detector/mine.yaml`.
        changes: Fields of the configuration that differ. A dictionary changes some fields of a nested configuration.

    Raises:
        ValueError: there is no such preset, with the nearest name; or the file is no preset, with the reason.

    Examples:
        >>> office = synth.preset("scene", "office", seconds=4)
        >>> office.arena, office.seconds
        ('office', 4.0)
    """
    if group not in _GROUPS:
        raise ValueError(f"group={group!r}: expected one of {', '.join(_GROUPS)}")
    return with_changes(getattr(_composed("generate", {group: name}), group), changes)


def _composed(command: str, presets: dict[str, str | Path]) -> Any:
    """Return the configuration of a command with presets."""
    found = SYNTH.commands[command]
    return found.composed({group: _preset(found, group, name) for group, name in presets.items()})


def _preset(command: Command, group: str, name: str | Path) -> Preset:
    if is_preset(group, name):
        return checked_preset(command, group, Path(name))
    known = command.presets_of(group)
    if group in ("interaction", "motion") and FUNCTION.fullmatch(str(name)):
        return Preset("", {"kind": str(name)})
    if name not in known:
        recorded = f"; files are synth.preset('motion', 'recorded', path={str(name)!r})"
        given = recorded if group == "motion" and Path(name).exists() else ""
        raise ValueError(f"{group}={name}: {unknown('preset', str(name), sorted(known))}{given}")
    return known[str(name)]


def _configured(command: str, config: Any, given: dict[str, Any]) -> Any:
    """Return a configuration, by default a command's, with changes. Presets are given by their names; cameras
    also by themselves, or by their file."""
    given = {name: value for name, value in given.items() if value is not None}
    rig = given.get("rig")
    if isinstance(rig, CameraRig):
        given["rig"] = listed_rig(rig)
    elif isinstance(rig, str | Path) and Path(rig).suffix and not is_preset("rig", rig):
        given["rig"] = RigConfig(path=str(rig))
    presets = {name: given.pop(name) for name in _GROUPS if isinstance(given.get(name), str | Path)}
    if config is None:
        config = _composed(command, presets)
    else:
        given |= {name: preset(name, value) for name, value in presets.items()}
    of_scene = {"seconds", "persons"} - vars(config).keys() if hasattr(config, "scene") else set()
    for name in given.keys() - vars(config).keys() - of_scene:
        raise TypeError(f"{command}: no option {name}; {fields_meant(type(config), name, of_scene)}")
    if scene := {name: given.pop(name) for name in of_scene & given.keys()}:
        given["scene"] = replace(given.get("scene", config.scene), **scene)
    return with_changes(config, given)


@check_arguments
def generate(
    config: GenerateConfig | None = None,
    *,
    clips: int | None = None,
    seed: int | None = None,
    seconds: float | None = None,
    persons: Sequence[int] | None = None,
    scene: SceneConfig | str | None = None,
    rig: RigConfig | CameraRig | str | Path | None = None,
    motion: MotionConfig | str | None = None,
    interaction: InteractionConfig | str | None = None,
    detector: DetectorConfig | str | None = None,
    workers: int | None = None,
    out: str | Path | None = None,
    **options: object,
) -> Iterator[Clip]:
    """Simulate clips with exact truth, one after the other.

        for clip in synth.generate(clips=8, scene="office", seconds=4, seed=7): ...
        for clip in synth.generate(persons=[4, 4], rig=RigConfig(ring=RingConfig(views=8)), out="runs/ring"): ...
        for clip in synth.generate(GenerateConfig(scene=SceneConfig(seconds=4), clips=8)): ...

    Args:
        config: All options; by default those of `synth generate`. The other arguments change it.
        clips: Number of clips.
        seed: Seed of the data set. Clip k depends only on `seed` and k. 0 is a valid seed.
        seconds: Length of each clip, s.
        persons: Least and greatest number of people.
        scene: Room, props, people: a configuration, or the name of a preset, by default `office`.
        rig: Cameras: a configuration, a `dmae.CameraRig`, a calibration file, or the name of a preset, by default
            `shelf`.
        motion: How people move: a configuration, or the name of a preset, by default `procedural`.
        interaction: What people do together: a configuration, or the name of a preset, by default `none`.
        detector: Errors of the 2D detector: a configuration, or the name of a preset, by default `shelf_openpose`.
        workers: Processes; -1 for one per core.
        out: Folder of a data set. It is made or completed as by `synth generate`, and the clips are read from it. By
            default the clips are made in memory and have no images.
        options: Other fields of `GenerateConfig`, as `images=["rgb"]`, `quality="draft"`, `occlusion`.

    Yields:
        Clips of F frames, V views and P persons: `truth`, detections, visibility and occluders. A clip that fails with
        every seed is left out, with a warning that gives the reason.

    Raises:
        ValueError: an option cannot be met, or `out` holds a data set of another configuration.
        FailedSimulation: no clip could be made.

    Examples:
        >>> clips = list(synth.generate(clips=2, seconds=1, seed=7))
        >>> [len(clip) for clip in clips]
        [25, 25]
        >>> again = next(synth.generate(clips=1, seconds=1, seed=7))
        >>> np.array_equal(clips[0].truth.xyz, again.truth.xyz)
        True
    """
    from synth.datasets.clip import check
    from synth.datasets.generate import generate as generate_data_set

    config = _configured("generate", config, {
        "clips": clips, "seed": seed, "seconds": seconds, "persons": persons, "scene": scene, "rig": rig,
        "motion": motion, "interaction": interaction, "detector": detector, "workers": workers, **options,
    })  # fmt: skip
    if out is not None:
        generate_data_set(replace(config, out=str(out)))
        return (load_clip(folder) for folder in clip_folders(Path(out)))
    if config.kinds:
        raise ValueError(f"images={list(config.kinds)}: images are written to a folder; give out=...")
    check(config)
    return _in_memory(config)


def _in_memory(config: GenerateConfig) -> Iterator[Clip]:
    with running_on(config.backend):
        made = in_parallel(_clip_or_failure, ((config, index) for index in config.numbers), config.workers)
    failed = 0
    for index, result in zip(config.numbers, made, strict=True):
        if isinstance(result, Clip):
            yield result
            continue
        failed += 1
        if failed == len(config.numbers):
            raise result
        warnings.warn(f"clip {index:06d} failed and is left out: {result}", stacklevel=2)


def _clip_or_failure(config: GenerateConfig, index: int) -> Clip | FailedSimulation:
    from synth.datasets.clip import generate_clip

    try:
        return generate_clip(config, index)
    except FailedSimulation as failure:
        return failure


@check_arguments
def forecast(config: GenerateConfig | None = None, *, out: str | Path = "runs/data", **options: object) -> Forecast:
    """Forecast the time and the disk space of `generate` from a few short clips, which are deleted afterwards.

    Args:
        config: All options; by default those of `synth generate`.
        out: Folder of the data set. Existing clips in it are not counted.
        options: Arguments of `generate`, as `clips=100`, `images=["rgb", "ids"]`.

    Returns:
        The numbers of `clips`, `frames` and `images` to be made, the time in `seconds` and the size in `megabytes`.

    Raises:
        ValueError: an option cannot be met.

    Examples:
        >>> found = synth.forecast(clips=2, seconds=1, persons=[1, 1])
        >>> found.clips, found.frames
        (2, 50)
    """
    from synth.datasets.forecast import forecast as forecast_data_set

    return forecast_data_set(replace(_configured("generate", config, options), out=str(out)))


@check_arguments
def render(
    data: str | Path,
    config: RenderConfig | None = None,
    *,
    out: str | Path,
    images: Sequence[str] | None = None,
    quality: str | None = None,
    rgb: str | None = None,
    rig: RigConfig | CameraRig | str | Path | None = None,
    imaging: ImagingConfig | None = None,
    first: int | None = None,
    clips: int | None = None,
    workers: int | None = None,
) -> Iterator[Clip]:
    """Render clips again: as other images, at another quality, or with other cameras. Nothing is simulated.

        for clip in synth.render("runs/data", images=["rgb", "flow"], quality="high", out="runs/high"): ...
        for clip in synth.render("runs/data", rig=RigConfig(ring=RingConfig(views=8)), out="runs/ring"): ...

    Args:
        data: Data set that `generate` made, or one clip of it.
        config: All options; by default those of `synth render`. The other arguments change it.
        out: Folder of the data set that is made or completed.
        images: Kinds of images, or `all`.
        quality: `draft`, `standard` or `high`.
        rgb: Files of colour images: `h264`, `png` or `jpeg`.
        rig: Other cameras, as for `generate`. Visibility and detections are then made for these
            cameras as well.
        imaging: Light and camera of colour images.
        first: Number of the first clip that is rendered, by default 0.
        clips: Number of clips that are rendered, by default all from `first` on.
        workers: Processes; -1 for one per core.

    Yields:
        Clips with images, and with all labels.

    Raises:
        FileNotFoundError: there is no clip, or it contains no body state.
        ValueError: an option cannot be met, or `out` contains something else.

    Examples:
        >>> ring = synth.RigConfig(ring=synth.RingConfig(views=2, focal=90, size=[96, 72]))
        >>> for clip in synth.generate(clips=1, seconds=0.1, persons=[1, 1], rig=ring, out="walks"): pass
        >>> clip = next(synth.render("walks", quality="draft", images=["rgb", "flow"], out="seen"))
        >>> clip.images.kinds
        ('rgb', 'flow')
        >>> clip.images.at("flow", "ring0", 0).shape
        (72, 96, 2)
    """
    from synth.datasets.render import render as render_data_set

    given = {"images": images, "quality": quality, "rgb": rgb, "imaging": imaging, "rig": rig, "workers": workers}
    given |= {"first": first, "clips": clips}
    config = _configured("render", config or RenderConfig(), given | {"data": str(data), "out": str(out)})
    render_data_set(config)
    return (load_clip(folder) for folder in clip_folders(Path(out)))


@check_arguments
def body_state(clip: str | Path) -> BodyState:
    """Read the state of the bodies of a simulated clip: pose, shape, forces, contacts, actions.

    Args:
        clip: Folder of the clip.

    Raises:
        FileNotFoundError: the clip has no body state, because it was not simulated.
        ValueError: the file is malformed.

    Examples:
        >>> for clip in synth.generate(clips=1, seconds=0.2, persons=[1, 1], out="walks"): pass
        >>> state = synth.body_state("walks/000000")
        >>> state.rotations.shape, len(state.action_names) > 0
        ((5, 1, 16, 4), True)
    """
    from synth.physics.body_state import load_state

    return load_state(Path(clip))


@check_arguments
def verify(path: str | Path, *, fast: bool = False) -> list[Problem]:
    """Check that the clips of a data set, or one clip, are complete and correct.

    Args:
        path: Folder of a clip, or of a data set with its manifest.
        fast: Compare only the sizes of files, and the contents of JSON files with their checksums.

    Returns:
        The problems: clip, check, and description of each; an empty list if there are none.

    Raises:
        FileNotFoundError: there is neither a clip nor a data set.

    Examples:
        >>> for clip in synth.generate(seconds=1, clips=2, seed=7, out="walks"): pass
        >>> synth.verify("walks")
        []
    """
    from synth.datasets.verify import verify as verify_data_set

    return verify_data_set(Path(path), fast=fast).problems


@check_arguments
def contact_sheet(clip: Clip, out: str | Path, *, frames: int = 4, width: int = 480) -> None:
    """Draw a clip in its room as a PNG: some frames, all views, each true joint in the colour of its occluder.

    Args:
        clip: The clip. If it has poses, these are drawn, as by `dmae.show`.
        out: The PNG file.
        frames: Number of frames, evenly spread over the clip, one row each.
        width: Width of a view, px.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> synth.contact_sheet(clip, "sheet.png", frames=1, width=320)
        >>> Path("sheet.png").stat().st_size > 10_000
        True
    """
    from dmae.viewing.overlay import LayersConfig, chosen_layers
    from dmae.viewing.show import write_sheet

    write_sheet(clip, Path(out), chosen_layers(clip, LayersConfig()), rows=frames, width=width, rooms=_rooms(clip))


@check_arguments
def show(clip: Clip, out: str | Path, config: ShowConfig | None = None) -> list[Path]:
    """Draw a clip in its room: a contact sheet, a video, a recording for Rerun.

    Args:
        clip: Any clip. A clip that was not simulated is drawn without a room.
        out: Folder of the files.
        config: As for `dmae.show`.

    Returns:
        The files: `sheet.png`, `clip.mp4`, `clip.rrd`.

    Raises:
        ValueError: there is no such camera, or Rerun is not installed.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> files = synth.show(clip, "drawings", dmae.ShowConfig(frames=1, width=240, cameras=["0", "2"]))
        >>> [file.name for file in files]
        ['sheet.png']
    """
    from dmae.viewing.show import show_clip

    return show_clip(clip, Path(out), config or ShowConfig(), _rooms)


def _rooms(clip: Clip) -> list[np.ndarray] | None:
    from synth.rendering.rooms import draw_rooms

    return draw_rooms(clip) if not clip.has_images and "spec" in clip.provenance else None


@check_arguments
def compare(real: Clip, sim: Iterable[Clip], *, limits: Limits | None = None, workers: int = 1) -> list[Row]:
    """Compare the detections of a recording with those of its simulation.

    Args:
        real: The recording, with three cameras or more.
        sim: Simulated clips. Detections of the recording are converted to their skeleton.
        limits: Greatest differences allowed, as `synth.Limits(miss=0.05)`; by default those of `synth compare`.
        workers: Processes; -1 for one per core.

    Returns:
        One row per statistic: `what`, the values `real` and `sim`, their `distance`, and `exceeded`, which is True if
        the distance is above the limit.

    Raises:
        ValueError: no person can be measured in the recording or in the simulation, or their skeletons have no joint
            in common.

    Examples:
        >>> one, other = synth.generate(seconds=1, clips=2, seed=7)
        >>> rows = synth.compare(one, [other])
        >>> rows[0].what
        'missed: nose'
    """
    from synth.detector import comparison
    from synth.detector.statistics import measure, measure_all, on_skeleton

    clips = list(sim)
    if not clips:
        raise ValueError("sim: expected one clip or more, found none")
    with comparison.speaking_of("real"):
        recorded = measure(on_skeleton(real, clips[0].detections.skeleton))
    with comparison.speaking_of("sim"):
        simulated = measure_all(clips, len(clips), workers)
    return comparison.compare(recorded, simulated, limits or Limits())


@check_arguments
def compare_motion(
    real: str | Path | Iterable[Clip], sim: Iterable[Clip], *, takes: Sequence[str] = ("*",), longest: float = 10.0
) -> list[Difference]:
    """Compare recorded with generated motion.

    Args:
        real: A take (BVH, ASF/AMC, AMASS-style npz, C3D) or a folder of takes; or clips, of which the captured poses
            are used, or the truth if nothing was captured.
        sim: Simulated clips; their truth is used.
        takes: Only takes with a file name (without suffix) that matches one of these; `*` and `?` are wildcards.
        longest: Longer takes, and people of longer clips, count as this long, s: by frames spread over all of it.

    Returns:
        One difference per quantity, such as a speed or an angle: quantiles of both, and the Wasserstein and
        Kolmogorov-Smirnov distances, with those between halves of the recordings for comparison.

    Raises:
        FileNotFoundError: there are no takes.
        ValueError: there are no people to measure, or frame rates differ.

    Examples:
        >>> one, other = synth.generate(seconds=1, clips=2, seed=7)
        >>> differences = synth.compare_motion([one], [other])
        >>> bool(max(each.ks for each in differences) <= 1)
        True
    """
    from synth.datasets import motion_comparison as motions

    simulated = motions.tracks_of(((clip.id, clip) for clip in sim), captured=False)
    if isinstance(real, str | Path):
        recorded, _ = motions.take_tracks(Path(real), simulated[0].fps, takes)
    else:
        recorded = motions.tracks_of(((clip.id, clip) for clip in real), captured=True)
    motions.same_rate(recorded, simulated, "the recordings", "the simulated clips")
    samples = (motions.measure(tracks, longest) for tracks in (recorded, simulated))
    return motions.compare(*samples, rng=generator(0, 0, Stream.VALIDATION))


@check_arguments
def fit_detector(
    recording: Clip,
    clips: Sequence[Clip],
    *,
    start: DetectorConfig | None = None,
    truth: ErrorReference | str = ErrorReference.others,
    rounds: int = 8,
    seed: int = 0,
    workers: int = 1,
) -> Fit:
    """Fit the simulated detector to a recording.

    Args:
        recording: The recording with the detections to imitate. Those of other skeletons than BODY_25, which the
            simulated detector has, are converted.
        clips: Simulated clips of a scene similar to the recording's, seen by its cameras.
        start: Start of the fit; options that the recording does not determine keep its values.
        truth: Reference for the detections of both: `others`, the other views, or `annotated`, their truth.
        rounds: Number of simulations.
        seed: Seed of the detector.
        workers: Processes; -1 for one per core.

    Returns:
        `config`, the detector; `undetermined`, the options that the recording does not determine, with reasons;
        `statistics` of the clips with its detections. `synth.detector.fitting.preset_yaml` returns it as a preset.

    Raises:
        ValueError: the recording cannot be measured, or the clips have no visibility or another skeleton.

    Examples:
        >>> recording, *clips = synth.generate(seconds=1, clips=2, seed=7)
        >>> fit = synth.fit_detector(recording, clips, rounds=1)
        >>> sorted(vars(fit))
        ['config', 'statistics', 'undetermined']
    """
    from dmae.data.skeleton import BODY25
    from synth.detector.fitting import fit
    from synth.detector.statistics import measure, on_skeleton

    if not clips:
        raise ValueError("clips: expected one simulated clip or more, found none")
    reference = ErrorReference(truth)
    how: dict[str, Any] = {"rounds": rounds, "seed": seed, "workers": workers, "reference": reference}
    real = measure(on_skeleton(recording, BODY25), reference)
    return fit(real, clips, start or DetectorConfig(), **how)


@check_arguments
def realism(
    path: str | Path,
    *,
    extra_data: Sequence[str | Path] = (),
    detector: str = "blazepose",
    every: int = 1,
    workers: int = 1,
) -> list[Rate]:
    """Run a detector on rendered images of fully visible people, and measure its detection rate and joint errors.

    A person is used if at least 80 % of the joints are visible, or hidden only by the person's own body.

    Args:
        path: Data set with colour images, or a clip.
        extra_data: More data sets for the same table.
        detector: `blazepose`, or `package.module:function`.
        every: Number of frames from one examined image of a camera to the next.
        workers: Processes; -1 for one per core.

    Returns:
        Rows: first all people, then groups by room, clothing, direction, posture, distance, size, contrast and joint.
        Each row has the number of `people`, the share that is `found`, and `near`, the share of their visible joints
        with an error within 5 % of the height of the body.

    Raises:
        FileNotFoundError: there are no clips.
        ValueError: a clip has no truth, no labels or no colour images.

    Examples:
        >>> clip = next(synth.generate(seconds=0.1, clips=1, persons=[1, 1], out="walks"))
        >>> seen = next(synth.render("walks", quality="draft", images=["rgb"], out="seen"))
        >>> rows = synth.realism("seen", every=5)
        >>> rows[0].heading, rows[0].people > 0
        ('all', True)
    """
    from synth.recognition.realism import judge, rates

    return rates(judge((path, *extra_data), PoseDetectorConfig(name=detector), every, workers))


@check_arguments
def detector_errors(
    path: str | Path,
    *,
    extra_data: Sequence[str | Path] = (),
    simulated: Sequence[str] = ("shelf_openpose", "hrnet_like"),
    seed: int = 0,
    workers: int = 1,
) -> dict[str, dict]:
    """Measure the errors of a detector and of simulated detectors against the truth, by the occluder of a joint.

    Args:
        path: Data set or clip with truth and detections, as written by `dmae detect clip=...`.
        extra_data: More data sets for the same table.
        simulated: Presets of the simulated detector that are run on the same clips: names, or YAML files.
        seed: Seed of the simulated detectors.
        workers: Processes; -1 for one per core.

    Returns:
        Results by name of the detector, first the detector of the clips: rows of `joints` by occluder, depth margin,
        size, crowding, direction and kind; rows of `people`; and the numbers of `images`, `ghosts` and `duplicates`.

    Raises:
        FileNotFoundError: there are no clips.
        ValueError: a clip has no truth or labels, the clips come from several detectors, or there is no such preset.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7, out="walks"))
        >>> found = synth.detector_errors("walks", simulated=["clean"])
        >>> row = found["clean"]["joints"][0]
        >>> row["group"], row["missed"]
        ('visible', 0.0)
    """
    from synth.recognition.detector_errors import study

    return study((path, *extra_data), simulated, seed, workers)


@check_arguments
def plan(
    config: PlanConfig | None = None,
    *,
    arena: str | Path | None = None,
    views: Sequence[int] | None = None,
    persons: Sequence[int] | None = None,
    seconds: float | None = None,
    detector: DetectorConfig | str | None = None,
    seed: int | None = None,
    workers: int | None = None,
    out: str | Path | None = None,
    **options: object,
) -> CameraPlan:
    """Plan where to mount cameras in a room, and measure the capture of simulated people for each number of cameras.

        mount = MountConfig(ceiling=False)
        plan = synth.plan(arena="room.xml", views=[4, 8], persons=[1, 4], mount=mount, out="runs/plan")
        clips = synth.generate(rig=RigConfig(path="runs/plan/cameras_4.toml"))

    Args:
        config: All options; by default those of `synth plan`. The other arguments change it.
        arena: Room of `scenes/`, or path of an MJCF file; by default the room of `scene`, which is `office`.
        views: Least and greatest number of cameras; by default 4 and 6.
        persons: Least and greatest number of people; by default the numbers of `scene`.
        seconds: Length of the simulated clips, s.
        detector: Errors of the 2D detector: a configuration, or the name of a preset, by default `shelf_openpose`.
        seed: Seed of people and detector; 0 is a valid seed.
        workers: Processes; -1 for one per core.
        out: Folder of the page, the rigs and the lists to print, which must not exist or be empty; by default nothing
            is written.
        options: Other fields of `PlanConfig`: `mount`, `lens`, `search`, `scene`, `motion`, `interaction`, `rig`.

    Returns:
        `rigs`, one for each number of cameras. `plan[4]` is the one with four cameras, with its `rig`, its `figures`
        (PCP, error, joints not measured, identities confused, each with an interval), `worth` (the gain from each
        camera), and `floor` (the coverage of the floor).

    Raises:
        ValueError: the room has no walls to mount cameras on, heights are outside the room, there are fewer places than
            cameras, or `out` is not empty.
        FailedSimulation: people could not be simulated in the room.

    Examples:
        >>> search = synth.SearchConfig(clips=1, frames=2, check_clips=2)
        >>> small = {"mount": synth.MountConfig(places=12), "search": search, "seconds": 0.4}
        >>> found = synth.plan(arena="studio", views=[2, 3], persons=[1, 1], **small)
        >>> len(found[3].rig), len(found[3].worth), sorted(found[3].figures)
        (3, 3, ['error', 'idf1', 'missing', 'pcp', 'switches'])
    """
    from synth.planning.page import write_plan
    from synth.planning.plan import make_plan

    given: dict[str, Any] = {"arena": None if arena is None else str(arena), "views": views, "persons": persons}
    given |= {"seconds": seconds, "detector": detector, "seed": seed, "workers": workers}
    config = _configured("plan", config, given | options)
    return make_plan(config) if out is None else write_plan(config, Path(out))
