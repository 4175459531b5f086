"""Compare a detector and simulated detectors with the same truth on the same clips."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from dmae.formats.reading import DataConfig, load
from dmae.parallel import in_parallel
from dmae.progress import progress
from synth.detector.config import DetectorConfig
from synth.detector.fitting.fit import redetect
from synth.recognition.error_tables import numbers
from synth.recognition.observations import DetectorObservations, observe, pooled


def study(
    folders: Sequence[Path], simulated: Mapping[str, DetectorConfig], seed: int = 0, workers: int = 1
) -> dict[str, dict]:
    """Measure the errors of the detections in clips, and of simulated detectors on the same clips.

    Args:
        folders: Folders of data sets or clips with truth and visibility labels.
        simulated: Simulated detectors by name.
        seed: Seed of the simulated detectors.
        workers: Processes; -1 for one per core.

    Returns:
        The tables of each detector, by its name, see `synth.recognition.error_tables.numbers`. The detector of the
        clips is first.

    Raises:
        FileNotFoundError: there are no clips.
        ValueError: a clip has no truth or labels, or the clips come from several detectors.
    """
    tasks = []
    for folder in folders:
        clips = load(DataConfig("clip", str(folder)))
        tasks += [(clips.folders[i], dict(simulated), seed) for i in range(len(clips))]
    done = list(progress(in_parallel(_study_clip, tasks, workers), "measuring", len(tasks)))
    names = {next(iter(found)) for found in done}
    if len(names) > 1:
        raise ValueError(f"expected clips of one detector, found {', '.join(sorted(names))}")
    return {name: numbers(pooled([found[name] for found in done])) for name in done[0]}


def _study_clip(folder: Path, simulated: Mapping[str, DetectorConfig], seed: int) -> dict[str, DetectorObservations]:
    clip = load(DataConfig("clip", str(folder)))[0]
    own = f"{clip.provenance.get('detector', 'detections')} (measured)"
    return {own: observe(clip)} | {name: observe(redetect(clip, config, seed)) for name, config in simulated.items()}
