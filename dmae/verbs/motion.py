"""Motion and cameras: capture, complete, train, triangulate, and calibrate."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dmae.calibration.config import RefineConfig
from dmae.commands.config import PretrainCommand
from dmae.completion.config import DELAY, SMOOTHING, TrainConfig, check_delay
from dmae.data.array_fields import as_numbers
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.data.store import load_clip
from dmae.data.typed import check_arguments
from dmae.detection.registry import PoseDetectorConfig
from dmae.numerics import filling
from dmae.reconstruction import pipeline, triangulation
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.diagnosis import explain_capture
from dmae.reconstruction.triangulation import Points
from dmae.verbs.recordings import configured, detect_in

if TYPE_CHECKING:
    from dmae.calibration.doctor import Diagnosis
    from dmae.calibration.refinement import Refined
    from dmae.completion.complete import Completer


@check_arguments
def capture(
    clip: Clip, config: CaptureConfig | str | None = None, *, fill: str = "none", smooth: float = 0.0
) -> Poses3D:
    """Reconstruct the people of a clip in 3D from its 2D detections (Adaptive Triangulation).

    Args:
        clip: V views, at least 2.
        config: Thresholds and steps, or the name of a preset of `dmae capture`, as `paper`.
        fill: How joints on which fewer than two cameras agree are filled: a completion method of `dmae capture`, or
            `none`.
        smooth: Length of a light smoothing after that, s; 0 for none.

    Returns:
        (F, P, J, 3) m, world; each person is a track. A joint that fewer than `config.th_v` views agree on is NaN and
        `Source.ABSENT`; measured joints have a covariance. If nobody is found and a likely cause is, a warning says it.

    Raises:
        ValueError: the clip has a single camera, or there is no such method.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> poses = dmae.capture(clip)
        >>> poses.xyz.shape == (len(clip), *poses.xyz.shape[1:])
        True
        >>> bool((poses.views[poses.source == dmae.Source.MEASURED] >= 2).all())
        True
    """
    from dmae.completion.methods import find_method

    chosen = configured("capture", config)
    poses = pipeline.capture(clip, chosen)
    if not poses.xyz.shape[1]:
        for suggestion in explain_capture(clip, chosen).suggestions:
            warnings.warn(f"clip {clip.id!r}: no person was captured: {suggestion}", stacklevel=3)
    if fill != "none":
        poses = find_method(fill).load()(poses, clip.fps)
    return filling.smooth(poses, clip.fps, smooth)


@check_arguments
def complete(
    poses: Poses3D,
    fps: float,
    *,
    weights: str | Path | None = None,
    denoise: bool | None = None,
    reject: bool = True,
    smooth: float = SMOOTHING,
    online: bool = False,
    delay: float = DELAY,
) -> Poses3D:
    """Predict the joints on which fewer than two cameras agree, and mark them `Source.COMPLETED`; smooth the others.

    `denoise=False, reject=False, smooth=0` changes no measured joint.

    Args:
        poses: Captured poses (F, P, J).
        fps: Their frames per second; another rate than the model's is resampled.
        weights: Folder that `dmae train` wrote, or `paper` for the paper's network, which does not complete small toes
            and heels; by default the weights that come with the package.
        denoise: Also move joints that fewer than three views measured; they become `Source.DENOISED`. By default True
            if the weights were trained for it.
        reject: First remove joints that two views measured and that the frames before and after contradict.
        smooth: Length of a light smoothing at the end, s; 0 for none. Joints that it moves become `Source.DENOISED`.
        online: Complete each frame from the frames up to `delay` seconds after it, as during a recording.
        delay: s.

    Returns:
        Poses of the same shape; of weights that turn poses into another skeleton, on that one. Completed joints have a
        covariance, which is NaN (unknown) more than 0.2 s from any measurement of the person, and of the paper's
        network. Persons are completed only between their first and their last measurement. Joints of poses that were
        completed or smoothed before stay as they are.

    Raises:
        FileNotFoundError: the weights do not exist, or there are none for this skeleton.
        ValueError: the skeletons have no joint in common, fps is not positive, poses are not in m, `smooth` is
            negative, or `delay` is given without `online`.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> captured = dmae.capture(clip)
        >>> full = dmae.complete(captured, fps=clip.fps)
        >>> bool((full.source == dmae.Source.ABSENT).sum() < (captured.source == dmae.Source.ABSENT).sum())
        True
        >>> filled = dmae.complete(captured, fps=clip.fps, denoise=False, reject=False, smooth=0)
        >>> bool(np.array_equal(filled.xyz[captured.measured], captured.xyz[captured.measured]))
        True
    """
    from dmae.completion.complete import keep_smoothed
    from dmae.online.completion import complete_online

    check_delay(delay, online)
    completer_for = completer(poses.skeleton, weights=weights, denoise=denoise, reject=reject, smooth=smooth)
    done = complete_online(completer_for, poses, fps, delay) if online else completer_for(poses, fps)
    return keep_smoothed(done, poses)


@check_arguments
def completer(
    skeleton: Skeleton | str,
    *,
    weights: str | Path | None = None,
    denoise: bool | None = None,
    reject: bool = True,
    smooth: float = SMOOTHING,
) -> Completer:
    """Load a model once, to complete many clips with it, or the frames of `OnlineCapture`.

    Args:
        skeleton: Skeleton of the poses to complete, or its name.
        weights, denoise, reject, smooth: As for `complete`.

    Returns:
        A function of poses and frames per second that completes the poses.

    Raises:
        FileNotFoundError: the weights do not exist, or there are none for this skeleton.
        ValueError: the files of the weights are malformed, or the model was not trained to denoise.

    Examples:
        >>> complete = dmae.completer("body25")
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> complete(dmae.capture(clip), clip.fps).skeleton.name
        'body25'
    """
    from dmae.completion.complete import completers

    return completers(weights, denoise=denoise, reject=reject, smooth=smooth)(get_skeleton(skeleton))


@check_arguments
def train(
    clips: Iterable[Clip],
    out: str | Path,
    config: TrainConfig | str | None = None,
    *,
    validation_data: Iterable[Clip] = (),
    extra_data: Iterable[Clip] = (),
) -> Path:
    """Train a completion model, or continue one that was interrupted.

    Args:
        clips: Clips with truth. If a clip also has `poses`, the model learns to complete those captured poses.
        out: Folder of the model.
        config: Network, examples and steps, as `dmae.TrainConfig(max_minutes=10)`, or the name of a preset, as `paper`.
            The fields `data` and `out` are not used.
        validation_data: Clips to validate and calibrate on; by default some of `clips` are held back.
        extra_data: Further clips; `examples.replay` is the share of examples that are drawn from them.

    Returns:
        The folder, which `complete(weights=...)` takes.

    Raises:
        ValueError: there is nothing to learn from, two clips share an id, or the folder contains another training.

    Examples:
        >>> clips = list(synth.generate(seconds=1, clips=2, seed=7))
        >>> folder = dmae.train(clips, "model", dmae.TrainConfig(learning=dmae.LearningConfig(steps=2, epoch=2)))
        >>> captured = dmae.capture(clips[0])
        >>> dmae.complete(captured, clips[0].fps, weights=folder).xyz.shape == captured.xyz.shape
        True
    """
    from dmae.completion.training import train as run

    return run(configured("train", config), clips, Path(out), validation_data, extra_data)


@check_arguments
def pretrain(out: str | Path, config: PretrainCommand | None = None) -> Path:
    """Simulate people with your motion, cameras and detector, and train a model on them, as `dmae pretrain`.

    Args:
        out: Folder of the data sets, the model and its scores. The same call continues an interrupted one.
        config: Motion, cameras, detector and amount. The field `out` is not used.

    Returns:
        The folder of the model, which `complete(weights=...)` takes; `train` can fine-tune it (`TrainConfig.init`).

    Raises:
        FileNotFoundError: there is no such motion, calibration or preset.

    Examples:
        >>> small = dmae.PretrainCommand(rig="ring", clips=2, seconds=1, steps=2, views=[5])
        >>> from contextlib import redirect_stdout
        >>> with redirect_stdout(None):  # the steps are printed
        ...     model = dmae.pretrain("own", small)
        >>> (model / "MODEL_CARD.md").is_file()
        True
    """
    from dmae.commands.pretrain import run

    run(config or PretrainCommand(), Path(out))
    return Path(out) / "model"


@check_arguments
def card(weights: str | Path, *, command: str, scores: Iterable[str | Path] = ()) -> str:
    """Describe trained weights: training data and scores.

    Args:
        weights: Folder that `train`, or `dmae train`, wrote.
        command: The command line, or the name of a script, that makes these weights and their data.
        scores: Folders of scores of these weights, written by `dmae evaluate`.

    Returns:
        The card as Markdown, as `dmae pretrain` writes it to `MODEL_CARD.md` in the folder of the weights.

    Raises:
        FileNotFoundError: a file of the weights or scores is missing.
        ValueError: scores belong to other weights.

    Examples:
        >>> clips = list(synth.generate(seconds=1, clips=2, seed=7))
        >>> folder = dmae.train(clips, "model", dmae.TrainConfig(learning=dmae.LearningConfig(steps=2, epoch=2)))
        >>> print(dmae.card(folder, command="python train.py").splitlines()[0])
        # D-MAE for body25
    """
    from dmae.completion.weights import model_card

    return model_card(Path(weights), [Path(folder) for folder in scores], command)


@check_arguments
def triangulate(rig: CameraRig, xy: np.ndarray, confidence: np.ndarray | None = None) -> Points:
    """Triangulate points robustly from pixels of several cameras.

    Args:
        rig: V cameras.
        xy: (F, V, ..., 2) px as detected, lens distortion included, the first that `rig.project` returns; NaN where a
            view does not see the point. F is the number of frames, or of any points.
        confidence: (F, V, ...) from 0 to 1; by default 1.

    Returns:
        `xyz` (F, ..., 3) m, world, NaN where fewer than two views agree; `cov` (F, ..., 3, 3) m^2; `used` (F, ..., V)
        True for the views that agree; `residual` (F, ...) px.

    Raises:
        ValueError: the arrays do not fit the rig.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> xy, _ = clip.rig.project(clip.truth.xyz)  # (F, V, P, J, 2)
        >>> points = dmae.triangulate(clip.rig, xy)
        >>> points.xyz.shape == clip.truth.xyz.shape
        True
        >>> bool(np.nanmax(np.abs(points.xyz - clip.truth.xyz)) < 1e-4)
        True
    """
    if isinstance(xy, tuple):
        raise ValueError("xy: expected an array, found a tuple; rig.project returns xy and depth, give the first")
    xy = as_numbers("xy", xy)
    if xy.ndim < 3 or xy.shape[1] != len(rig) or xy.shape[-1] != 2:
        raise ValueError(f"rig of {len(rig)} cameras: expected xy (F, {len(rig)}, ..., 2) px, found shape {xy.shape}")
    confidence = np.ones(xy.shape[:-1]) if confidence is None else as_numbers("confidence", confidence)
    if confidence.shape != xy.shape[:-1]:
        raise ValueError(f"confidence: expected shape {xy.shape[:-1]}, one for each pixel, found {confidence.shape}")
    return triangulation.triangulate(rig, np.moveaxis(rig.undistort(xy), 1, -2), np.moveaxis(confidence, 1, -1))


@check_arguments
def doctor(clip: Clip, *, max_offset: int = 50) -> Diagnosis:
    """Find faults of a calibration by comparing the detections of its cameras.

    Args:
        clip: F frames of V cameras; only cameras and detections are read.
        max_offset: Largest time offset between two cameras that is tried, in frames, in both directions.

    Returns:
        `findings`, each with fault, cameras, evidence and remedy, in the order to correct them; empty if nothing is
        wrong. `pairs`: how well every two cameras agree. Printed, it is the findings in words.

    Raises:
        ValueError: `max_offset` is negative.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.doctor(clip).findings
        ()
    """
    from dmae.calibration.doctor import diagnose

    return diagnose(clip, max_offset=max_offset)


@check_arguments
def calibrate(clip: Clip, refine: RefineConfig | None = None) -> Refined:
    """Refine the calibration of a clip by the people in it: bundle adjustment over their joints and bones.

    Args:
        clip: F frames of V cameras; only cameras and detections are read.
        refine: What may change (`dmae.calibration.config.RefineConfig`); by default the extrinsics of
            the cameras that clearly differ from their calibration.

    Returns:
        `rig`, the cameras; `offset` and `drift` of their clocks; `covariance`; `changes`, corrections by camera.

    Raises:
        ValueError: there are too few cameras or people, or `refine` names a camera that does not exist.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> refined = dmae.calibrate(clip)
        >>> refined.rig.names == clip.rig.names
        True
    """
    from dmae.calibration.refinement import refine as run

    return run(clip, refine or RefineConfig())


@check_arguments
def run(
    source: str | Path | Clip,
    calibration: str | Path | CameraRig | None = None,
    *,
    detector: str = "blazepose",
    capture: CaptureConfig | str | None = None,
    weights: str | Path | None = None,
    fps: float | None = None,
    offsets: Sequence[int | str] | None = None,
    frames: Sequence[int] | None = None,
    export: Sequence[str] | None = None,
    workers: int = 1,
    out: str | Path | None = None,
) -> Clip:
    """Turn the videos of calibrated cameras, or the images of a clip, into people in 3D: detect, capture, complete.

        clip = dmae.run("session/videos", "session/calibration.toml", workers=4, out="runs/session")

    Args:
        source: As for `detect`, or the folder of a clip with colour images.
        calibration: As for `detect`; with `out` a file, not cameras.
        detector, fps, offsets, frames, workers: As for `detect`.
        capture: How people are reconstructed, or the name of a preset of `dmae capture`, as `paper`.
        weights: As for `complete`.
        export: Formats of the poses that are written to `out`; by default TRC.
        out: Folder of what `dmae run` writes: clips of each step, a report, poses in each format. None: nothing is
            written. The same call continues one that was interrupted.

    Returns:
        A clip with the detections and, as `poses`, the completed people (F, P, J, 3) m, world.

    Raises:
        FileNotFoundError: there are no videos, or no such weights.
        ValueError: as in `detect`; there are fewer than two cameras; `out` is given for a clip or cameras in memory, or
            `export` without `out`.

    Examples:
        >>> clip = next(synth.generate(seconds=0.1, clips=1, persons=[1, 1], out="walks"))
        >>> seen = next(synth.render("walks", quality="draft", images=["rgb"], out="seen"))
        >>> found = dmae.run(seen.select(views=[0, 2]))
        >>> len(found.poses.xyz) == len(seen)
        True
    """
    from dmae.commands import run as command
    from dmae.commands.config import RunCommand

    if out is None and export is not None:
        raise ValueError("export=...: formats are written to a folder; give out=..., or leave export out")
    if out is not None and isinstance(source, Clip):
        raise ValueError("out=...: save the clip first with dmae.save, and give its folder as the source")
    if out is not None and isinstance(calibration, CameraRig):
        raise ValueError("out=...: expected the file of the calibration, from which the same call can continue")
    given = load_clip(Path(source)) if calibration is None and not isinstance(source, Clip) else source
    if isinstance(given, Clip) and len(given.rig) < 2:
        raise ValueError(f"clip {given.id!r}: capture needs at least 2 cameras, found {len(given.rig)}")
    if out is None:
        clip = detect_in(given, calibration, detector, fps, offsets, frames, None, workers, least=2)
        captured = pipeline.capture(clip, configured("capture", capture))
        poses = complete(captured, clip.fps, weights=weights)
        return replace(clip, poses=poses)
    config = RunCommand(
        videos=None if calibration is None else str(source),
        clip=str(source) if calibration is None else None,
        calibration=None if calibration is None else str(calibration),
        detector=PoseDetectorConfig(name=detector),
        capture=configured("capture", capture),
        weights=None if weights is None else str(weights),
        fps=fps,
        offsets=None if offsets is None else list(offsets),
        frames=None if frames is None else list(frames),
        export=["trc"] if export is None else list(export),
        workers=workers,
    )
    command.run(config, Path(out))
    return load_clip(Path(out) / "completed")
