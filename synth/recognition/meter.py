"""The realism meter: detection rate and joint errors of a real detector on people in plain sight."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip
from dmae.data.skeleton import BODY25
from dmae.detection.pipeline import make_detector
from dmae.detection.registry import PoseDetectorConfig
from dmae.formats.reading import DataConfig, load
from dmae.parallel import in_parallel
from dmae.progress import progress
from synth.detector.parts import kind_of
from synth.recognition.crops import NEAR, SIDES, Crop, crops
from synth.recognition.sightings import Sightings, scene_of, sightings

_WELL_VISIBLE = 0.8
_DISTANCES = (3.0, 5.0, 8.0)
_SIZES = (120.0, 200.0, 400.0)


@dataclass(frozen=True)
class Judged:
    """One person in one image, with its groups.

    Attributes:
        clip: Folder of the clip.
        crop: The result of the detector.
        groups: Group of the person under each heading, for example {"room": "office"}.
    """

    clip: Path
    crop: Crop
    groups: dict[str, str]


@dataclass(frozen=True)
class Rate:
    """A row of the meter.

    Attributes:
        heading, group: For example "room" and "office".
        people: Number of people in plain sight.
        found: Share of these people that were found.
        joints: Number of visible joints of the people that were found.
        near: Share of these joints with an error within 5 % of the height of the body.
        median: Median error of these joints, relative to the height. Like `found` and `near`, it is None without data.
    """

    heading: str
    group: str
    people: int
    found: float | None
    joints: int
    near: float | None
    median: float | None


def judge(folders: Sequence[Path], config: PoseDetectorConfig, every: int = 1, workers: int = 1) -> list[Judged]:
    """Run a detector on each person in plain sight in the images of clips.

    Args:
        folders: Folders of data sets or clips with truth and colour images.
        config: The detector.
        every: Number of frames from one used frame to the next.
        workers: Processes; -1 for one per core.

    Raises:
        FileNotFoundError: there are no clips.
        ValueError: a clip has no truth, no labels or no colour images.
    """
    tasks = []
    for folder in folders:
        clips = load(DataConfig("clip", str(folder)))
        tasks += [(clips.folders[i], config, every) for i in range(len(clips))]
    done = in_parallel(_judge_clip, tasks, workers)
    return [one for some in progress(done, "looking at people", len(tasks)) for one in some]


def rates(judged: Iterable[Judged]) -> list[Rate]:
    """Return the rows: first all people, then each group by heading, then each kind of joint."""
    judged = list(judged)
    rows = [_rate("all", "", [each.crop for each in judged])]
    for heading in dict.fromkeys(heading for each in judged for heading in each.groups):
        values = sorted({each.groups[heading] for each in judged if heading in each.groups}, key=_order)
        rows += [
            _rate(heading, value, [each.crop for each in judged if each.groups.get(heading) == value])
            for value in values
        ]
    kinds = np.array([kind_of(joint) for joint in BODY25.joints])
    for kind in dict.fromkeys(kinds):
        some = [replace(each.crop, counted=each.crop.counted & (kinds == kind)) for each in judged]
        row = _rate("joint", str(kind), [crop for crop in some if crop.counted.any()])
        rows += [row] if row.joints else []
    return rows


def _rate(heading: str, group: str, some: Sequence[Crop]) -> Rate:
    found = [crop for crop in some if crop.found]
    joints = sum(int(crop.counted.sum()) for crop in found)
    error = np.concatenate([crop.error[crop.counted] for crop in found]) if found else np.empty(0)
    error = error[~np.isnan(error)]
    return Rate(
        heading,
        group,
        len(some),
        len(found) / len(some) if some else None,
        joints,
        sum(crop.near for crop in found) / joints if joints else None,
        float(np.median(error)) if len(error) else None,
    )


def _order(value: str) -> tuple:
    """Return the sort key of a group: ranges are sorted by their first number, other groups by name."""
    first = value.split()[0].split("-")[0]
    return (float(first), "") if first.replace(".", "").isdigit() else (float("inf"), value)


def _judge_clip(folder: Path, config: PoseDetectorConfig, every: int) -> list[Judged]:
    clip = load(DataConfig("clip", str(folder)))[0]
    seen = sightings(clip)
    detector = make_detector(replace(config, windows=[1.0], search_every=1))
    return [Judged(folder, crop, _groups(clip, seen, crop)) for crop in crops(clip, seen, detector, every)]


def _groups(clip: Clip, seen: Sightings, crop: Crop) -> dict[str, str]:
    place, of_person = (crop.frame, crop.view, crop.person), (crop.frame, crop.person)
    scene, groups = scene_of(clip), {}
    if scene is not None:
        looks = scene.persons[crop.person].looks
        groups["room"] = Path(scene.arena).stem
        groups["shirt"] = looks.top.pattern
        groups["sleeves"] = "long" if looks.top.long else "short"
        groups["trousers"] = "long" if looks.bottom.long else "short"
    well, alone = seen.visible[place].mean() >= _WELL_VISIBLE, _is_alone(seen, crop)
    groups |= {
        "visible": "80 % of the joints or more" if well else "fewer: the body hides its own",
        "company": "alone in the picture" if alone else "others in the picture",
        "direction": str(seen.direction[place]),
        "posture": str(seen.posture[of_person]),
        "distance": _range(seen.distance[place], _DISTANCES, "m"),
        "size": _range(seen.height[place], _SIZES, "px"),
        "contrast": "dark before dark" if crop.dark else "other",
    }
    return groups | ({"both": "80 % of the joints or more, alone"} if well and alone else {})


def _is_alone(seen: Sightings, crop: Crop) -> bool:
    """Return whether the narrowest crop of the person contains no joint of another person."""
    people = seen.xy[crop.frame, crop.view]
    own, others = people[crop.person], np.delete(people, crop.person, 0)
    low, high = np.nanmin(own, 0), np.nanmax(own, 0)
    with np.errstate(invalid="ignore"):
        inside = np.abs(others - (low + high) / 2) < SIDES[0] / 2 * (high - low).max()
    return not inside.all(-1).any()


def _range(value: float, edges: Sequence[float], unit: str) -> str:
    number = int(np.searchsorted(edges, value))
    low = 0 if number == 0 else edges[number - 1]
    return f"{low:g}-{edges[number]:g} {unit}" if number < len(edges) else f"{low:g} {unit} or more"


def described(row: Rate) -> tuple[str, ...]:
    """Return the cells of a row: group, people, found, joints, near, median."""
    name = f"{row.heading}: {row.group}" if row.group else row.heading
    return (name, str(row.people), _percent(row.found), str(row.joints), _percent(row.near), _percent(row.median))


HEAD = ("people in plain sight", "people", "found, %", "visible joints", f"within {NEAR:.0%} of the height, %",
        "median error, % of the height")  # fmt: skip
"""Headings of the columns of `described`."""


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"
