"""Motion of people: capture, complete, train, describe a model, triangulate."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.numerics import filling
from dmae.public.arguments import checked
from dmae.public.options import composed
from dmae.reconstruction import pipeline, triangulation
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.triangulation import Points

if TYPE_CHECKING:
    from dmae.completion.complete import Completer


@checked
def capture(
    clip: Clip, config: CaptureConfig | str | None = None, *, fill: str = "none", smooth: float = 0.0
) -> Poses3D:
    """Reconstruct the people of a clip in 3D from its 2D detections (Adaptive Triangulation).

    Args:
        clip: V views, at least 2.
        config: Thresholds and steps, or the name of a preset of `dmae capture`, for example "tight".
        fill: How joints that no camera measured are filled: a completion method of `dmae capture`, or `none`.
        smooth: Length of a light smoothing after that, s; 0 for none.

    Returns:
        (F, P, J, 3) m, world; each person is a track. A joint that fewer than `config.th_v` views agree on is NaN and
        `Source.ABSENT`; measured joints have a covariance.

    Raises:
        ValueError: the clip has a single camera, or there is no such preset.
        KeyError: there is no such method.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> poses = dmae.capture(clip)
        >>> poses.xyz.shape == (len(clip), *poses.xyz.shape[1:])
        True
        >>> bool((poses.views[poses.source == dmae.Source.MEASURED] >= 2).all())
        True
    """
    from dmae.completion.methods import METHODS

    if isinstance(config, str):
        if "=" in config:
            raise ValueError(f"config={config!r}: expected a preset, as 'tight', or dmae.CaptureConfig with options")
        config = composed("capture", f"capture={config}").capture
    poses = pipeline.capture(clip, config or CaptureConfig())
    if fill != "none":
        poses = METHODS[fill](poses, clip.fps)
    return filling.smooth(poses, clip.fps, smooth)


@checked
def complete(
    poses: Poses3D,
    fps: float,
    *,
    weights: str | Path | None = None,
    denoise: bool | None = None,
    reject: bool = True,
    smooth: float = 0.1,
    online: bool = False,
    delay: float = 0.28,
) -> Poses3D:
    """Predict the joints that no camera measured, and mark them `Source.COMPLETED`.

    Args:
        poses: Captured poses (F, P, J).
        fps: Their frames per second; another rate than the model's is resampled.
        weights: Folder that `dmae train` wrote; by default the weights that come with the package.
        denoise: Also move joints that fewer than three views measured; they become `Source.DENOISED`. By default True
            if the weights were trained for it.
        reject: First remove joints that two views measured and that the frames before and after contradict.
        smooth: Length of a light smoothing at the end, s; 0 for none. Joints that it moves become `Source.DENOISED`.
        online: Complete each frame from the frames up to `delay` seconds after it, as during a recording.
        delay: s.

    Returns:
        Poses of the same shape. Completed joints have a covariance, which is NaN (unknown) more than 0.2 s from any
        measurement of the person. Persons are completed only between their first and their last measurement.

    Raises:
        FileNotFoundError: the weights do not exist, or there are none for this skeleton.
        ValueError: the skeletons have no joint in common, fps is not positive, or `smooth` is negative.

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
    from dmae.online.completion import complete_online

    completer_for = completer(poses.skeleton, weights=weights, denoise=denoise, reject=reject, smooth=smooth)
    return complete_online(completer_for, poses, fps, delay) if online else completer_for(poses, fps)


@checked
def completer(
    skeleton: Skeleton,
    *,
    weights: str | Path | None = None,
    denoise: bool | None = None,
    reject: bool = True,
    smooth: float = 0.1,
) -> Completer:
    """Load a model once, to complete many clips with it, or the frames of `OnlineCapture`.

    Args:
        skeleton: Skeleton of the poses to complete.
        weights: As for `complete`.
        denoise: As for `complete`.
        reject: As for `complete`.
        smooth: As for `complete`.

    Returns:
        A function of poses and frames per second that completes the poses.

    Raises:
        FileNotFoundError: the weights do not exist, or there are none for this skeleton.
        ValueError: the files of the weights are malformed, or the model was not trained to denoise.

    Examples:
        >>> complete = dmae.completer(dmae.get_skeleton("body25"))
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> complete(dmae.capture(clip), clip.fps).skeleton.name
        'body25'
    """
    return _loaded(weights and str(weights), denoise, reject, smooth)(skeleton)


@lru_cache(maxsize=4)
def _loaded(weights: str | None, denoise: bool | None, reject: bool, smooth: float):
    from dmae.completion.complete import completers

    return completers(weights and Path(weights), denoise=denoise, reject=reject, smooth=smooth)


@checked
def train(
    clips: Iterable[Clip],
    out: str | Path,
    *overrides: str,
    validation_data: Iterable[Clip] = (),
    extra_data: Iterable[Clip] = (),
) -> Path:
    """Train a completion model, or continue one that was interrupted.

    Args:
        clips: Clips with truth. If a clip also has `poses`, the model learns to complete those captured poses.
        out: Folder of the model.
        overrides: Options as on the command line: `"max_minutes=10"`, `"model=paper"`.
        validation_data: Clips to validate and calibrate on; by default some of `clips` are held back.
        extra_data: Further clips; `examples.replay` is the share of examples that are drawn from them.

    Returns:
        The folder, which `complete(weights=...)` takes.

    Raises:
        ValueError: there is nothing to learn from, two clips share an id, the folder contains another training, or an
            option is unknown.

    Examples:
        >>> clips = list(synth.generate(seconds=1, clips=2, seed=7))
        >>> folder = dmae.train(clips, "model", "learning.steps=2", "learning.epoch=2")
        >>> captured = dmae.capture(clips[0])
        >>> dmae.complete(captured, clips[0].fps, weights=folder).xyz.shape == captured.xyz.shape
        True
    """
    from dmae.completion.training import train as run

    return run(composed("train", *overrides), clips, Path(out), validation_data, extra_data)


def card(weights: str | Path, *, command: str, scores: Iterable[str | Path] = ()) -> str:
    """Describe trained weights: training data and scores.

    Args:
        weights: Folder that `train`, or `dmae train`, wrote.
        command: The command line, or the name of a script, that makes these weights and their data.
        scores: Folders of scores of these weights, written by `dmae evaluate`.

    Returns:
        The card as Markdown; `dmae card` writes it to `MODEL_CARD.md` in the folder of the weights.

    Raises:
        FileNotFoundError: a file of the weights or scores is missing.
        ValueError: scores belong to other weights.

    Examples:
        >>> clips = list(synth.generate(seconds=1, clips=2, seed=7))
        >>> folder = dmae.train(clips, "model", "learning.steps=2", "learning.epoch=2")
        >>> print(dmae.card(folder, command="python train.py").splitlines()[0])
        # D-MAE for body25
    """
    from dmae.completion.weights import model_card

    return model_card(Path(weights), [Path(folder) for folder in scores], command)


@checked
def triangulate(rig: CameraRig, xy: np.ndarray, confidence: np.ndarray) -> Points:
    """Triangulate points robustly from pixels of several cameras.

    Args:
        rig: V cameras.
        xy: (..., V, 2) px as detected, lens distortion included; NaN where a view does not see the point.
        confidence: (..., V) from 0 to 1.

    Returns:
        `xyz` (..., 3) m, world, NaN where fewer than two views agree; `cov` (..., 3, 3) m^2; `used` (..., V) True for
        the views that agree; `residual` (...) px.

    Raises:
        ValueError: the arrays do not fit the rig.

    Examples:
        >>> rig = next(synth.generate(seconds=1, clips=1, seed=7)).rig
        >>> xy, _ = rig.project(np.array([[0.3, 0.2, 1.1]]))
        >>> points = dmae.triangulate(rig, xy, np.ones((1, len(rig))))
        >>> points.xyz.round(4)
        array([[0.3, 0.2, 1.1]])
    """
    xy = np.asarray(xy, np.float64)
    if xy.shape[-2:] != (len(rig), 2):
        raise ValueError(f"rig of {len(rig)} cameras: expected xy (..., {len(rig)}, 2) px, found shape {xy.shape}")
    return triangulation.triangulate(rig, rig.undistort(xy), confidence)
