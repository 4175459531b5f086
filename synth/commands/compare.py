"""`synth compare`: compare simulated clips with recordings, by their detections or by their motion."""

import io
import json
import sys
from dataclasses import replace
from pathlib import Path

from dmae.data.rng import Stream, generator
from dmae.data.store import MANIFEST, clip_folders, load_clip
from dmae.files.contents import write_atomic
from dmae.reporting.tables import print_tables
from synth.commands.config import CompareBy, CompareCommand
from synth.datasets import motion_comparison as motion
from synth.datasets.config import MIN_SECONDS
from synth.detector import comparison as detections
from synth.detector.statistics import measure, measure_all, on_skeleton, read_recording


def run(config: CompareCommand, out: Path) -> None:
    """Print the comparison and write its page. Exit with status 1 if a limit for detections is exceeded.

    Raises FileNotFoundError, ValueError if there is nothing to measure, or skeletons differ; the message says where.
    """
    if config.by is CompareBy.motion:
        _compare_motion(config, out)
        return
    folders = clip_folders(Path(config.sim))
    with detections.speaking_of(f"real={config.real}"):
        recording = read_recording(Path(config.real), config.frames)
        real = measure(on_skeleton(recording, load_clip(folders[0]).detections.skeleton))
    with detections.speaking_of(f"sim={config.sim}"):
        sim = replace(measure_all(map(load_clip, folders), len(folders), config.workers), name=Path(config.sim).name)
    rows = detections.compare(real, sim, config.limits)
    print_tables([detections.table(rows)])
    detections.write_page(out / "compare.html", real, sim, rows)
    print(out / "compare.html")
    exceeded = [row.what for row in rows if row.exceeded]
    if exceeded:
        sys.exit(f"{len(exceeded)} limits are exceeded: {', '.join(exceeded)}")


def _compare_motion(config: CompareCommand, out: Path) -> None:
    path, left_out = Path(config.real), []
    if not path.exists():
        raise FileNotFoundError(f"real={path}: no such file or folder")
    simulated = motion.clip_tracks(Path(config.sim), captured=False)
    if (path / "clip.json").is_file() or (path / MANIFEST).is_file():
        recorded = motion.clip_tracks(path, captured=True)
    else:
        recorded, left_out = motion.take_tracks(path, simulated[0].fps, config.takes, config.motion)
    motion.same_rate(recorded, simulated, config.real, config.sim)
    short = [track for track in recorded + simulated if track.seconds < MIN_SECONDS]
    left_out += [f"{track.name}, of {track.seconds:.2f} s" for track in short]
    real, sim = (motion.measure(tracks, config.longest) for tracks in (recorded, simulated))
    differences = motion.compare(real, sim, rng=generator(0, 0, Stream.VALIDATION))
    figure, image = motion.draw(real, sim, differences), io.BytesIO()
    figure.savefig(image, format="png", dpi=110)
    write_atomic(out / "motion.png", image.getvalue())
    write_atomic(out / "motion.json", json.dumps(motion.numbers(real, sim, differences, left_out), indent=1))
    motion.write_page(out / "motion.html", real, sim, differences, figure, left_out)
    print_tables([motion.table(differences)])
    for line in left_out:
        print(f"left out: {line}")
    print(motion.largest_differences(differences))
    print(out / "motion.html")
