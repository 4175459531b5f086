"""Realism: results of a real detector on rendered images, and errors of detectors by the occluder of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from synth.recognition.realism import Rate


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
        >>> clip = next(synth.generate("scene.seconds=0.2", clips=1, seed=7, out="walks"))
        >>> seen = next(synth.render("walks", "quality=draft", "images=[rgb]", out="seen"))
        >>> rows = synth.realism("seen", every=5)
        >>> rows[0].heading, rows[0].people > 0
        ('all', True)
    """
    from dmae.detection.registry import PoseDetectorConfig
    from synth.recognition.realism import judge, rates

    folders = [Path(each) for each in (path, *extra_data)]
    return rates(judge(folders, PoseDetectorConfig(name=detector), every, workers))


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
        size, crowding, direction and kind; rows of `people`; and the numbers of `pictures`, `ghosts` and `duplicates`.

    Raises:
        FileNotFoundError: there are no clips.
        ValueError: a clip has no truth or labels, the clips come from several detectors, or there is no such preset.

    Examples:
        >>> clip = next(synth.generate("scene.seconds=1", clips=1, seed=7, out="walks"))
        >>> found = synth.detector_errors("walks", simulated=["clean"])
        >>> row = found["clean"]["joints"][0]
        >>> row["group"], row["missed"]
        ('visible', 0.0)
    """
    from synth.detector.fitting import load_preset
    from synth.recognition.detector_errors import study

    presets = {Path(name).stem: load_preset(name) for name in simulated}
    return study([Path(each) for each in (path, *extra_data)], presets, seed, workers)
