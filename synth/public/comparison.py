"""Compare simulated clips with recordings: detections and motion. Fit the simulated detector to a recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dmae.data.clip import Clip
from dmae.data.rng import Stream, generator
from dmae.public.arguments import checked

if TYPE_CHECKING:
    from synth.datasets.motion_comparison import Difference
    from synth.detector.comparison import Limits, Row
    from synth.detector.config import DetectorConfig
    from synth.detector.fitting import Fit


@checked
def compare(real: Clip, sim: Iterable[Clip], *, limits: Limits | None = None, workers: int = 1) -> list[Row]:
    """Compare the detections of a recording with those of its simulation.

    Args:
        real: The recording, with three cameras or more.
        sim: Simulated clips, with the same skeleton.
        limits: Greatest differences allowed; by default those of `synth compare`.
        workers: Processes; -1 for one per core.

    Returns:
        One row per statistic: `what`, the values `real` and `sim`, their `distance`, and `exceeded`, which is True if
        the distance is above the limit.

    Raises:
        ValueError: no person can be measured in the recording or in the simulation, or their skeletons differ.

    Examples:
        >>> one, other = synth.generate("scene.seconds=1", clips=2, seed=7)
        >>> rows = synth.compare(one, [other])
        >>> [row.distance for row in synth.compare(one, [one]) if row.exceeded]
        []
    """
    from synth.detector import comparison
    from synth.detector.statistics import measure, measure_all

    clips = list(sim)
    return comparison.compare(measure(real), measure_all(clips, len(clips), workers), limits or comparison.Limits())


@checked
def compare_motion(
    real: str | Path | Iterable[Clip], sim: Iterable[Clip], *, takes: Sequence[str] = ("*",), longest: float = 10.0
) -> list[Difference]:
    """Compare recorded with generated motion.

    Args:
        real: A take (BVH, ASF/AMC, AMASS-style npz, C3D) or a folder of takes; or clips, of which the captured poses
            are used, or the truth if nothing was captured.
        sim: Simulated clips; their truth is used.
        takes: Only takes with a file name (without suffix) that matches one of these; `*` and `?` are wildcards.
        longest: Longest part of a take, or of a person of a clip, that is used, s.

    Returns:
        One difference per quantity, such as a speed or an angle: quantiles of both, and the Wasserstein and
        Kolmogorov-Smirnov distances, with those between halves of the recordings for comparison.

    Raises:
        FileNotFoundError: there are no takes.
        ValueError: there are no people to measure, or frame rates differ.

    Examples:
        >>> one, other = synth.generate("scene.seconds=1", clips=2, seed=7)
        >>> differences = synth.compare_motion([one], [other])
        >>> bool(max(each.ks for each in differences) <= 1)
        True
    """
    from synth.datasets import motion_comparison as motion_realism
    from synth.datasets.motion_comparison import same_rate, take_tracks, tracks_of

    simulated = tracks_of(((clip.id, clip) for clip in sim), captured=False)
    if isinstance(real, str | Path):
        recorded, _ = take_tracks(Path(real), simulated[0].fps, takes)
    else:
        recorded = tracks_of(((clip.id, clip) for clip in real), captured=True)
    same_rate(recorded, simulated, "the recordings", "the simulated clips")
    samples = (motion_realism.measure(tracks, longest) for tracks in (recorded, simulated))
    return motion_realism.compare(*samples, rng=generator(0, 0, Stream.VALIDATION))


@checked
def fit_detector(
    recording: Clip,
    clips: Sequence[Clip],
    *,
    start: DetectorConfig | None = None,
    truth: str = "others",
    rounds: int = 8,
    seed: int = 0,
    workers: int = 1,
) -> Fit:
    """Fit the simulated detector to a recording.

    Args:
        recording: The recording with the detections to imitate.
        clips: Simulated clips of a scene similar to the recording's, seen by its cameras.
        start: Start of the fit; options that the recording does not determine keep its values.
        truth: Reference for the detections of the recording: `others`, the other views, or `annotated`, its truth.
        rounds: Number of simulations.
        seed: Seed of the detector.
        workers: Processes; -1 for one per core.

    Returns:
        `config`, the detector; `undetermined`, the options that the recording does not determine, with reasons;
        `statistics` of the clips with its detections. `synth.detector.fitting.preset_yaml` returns it as a preset.

    Raises:
        ValueError: the recording cannot be measured, or the clips have no visibility or another skeleton.

    Examples:
        >>> recording, *clips = synth.generate("scene.seconds=1", clips=2, seed=7)
        >>> fit = synth.fit_detector(recording, clips, rounds=1)
        >>> sorted(vars(fit))
        ['config', 'statistics', 'undetermined']
    """
    from synth.detector.config import DetectorConfig
    from synth.detector.fitting import fit
    from synth.detector.statistics import ErrorReference, measure

    statistics = measure(recording, ErrorReference(truth))
    return fit(statistics, clips, start or DetectorConfig(), rounds=rounds, seed=seed, workers=workers)
