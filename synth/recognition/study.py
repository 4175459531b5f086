"""The study: a detector and simulated ones on the same clips, held against the same truth."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from dmae.formats.reading import DataConfig, load
from dmae.parallel import in_parallel
from dmae.progress import progress
from synth.detector.config import DetectorConfig
from synth.detector.fitting import redetect
from synth.recognition.error_tables import numbers
from synth.recognition.observations import DetectorObservations, observe, pooled


def study(
    folders: Sequence[Path], simulated: Mapping[str, DetectorConfig], seed: int = 0, workers: int = 1
) -> dict[str, dict]:
    """Measure the detections of clips, and those that simulated detectors make on them.

    Args:
        folders: Of data sets or clips with truth and labels of visibility.
        simulated: Simulated detectors by name.
        seed: Of these.
        workers: Processes; -1 for one per core.

    Returns:
        By name of the detector its tables, see `synth.recognition.error_tables.numbers`; that of the clips comes first.

    Raises:
        FileNotFoundError: there are no clips.
        ValueError: a clip has no truth or labels, or the clips are of several detectors.
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
