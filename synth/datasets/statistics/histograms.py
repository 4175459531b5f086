"""Counts and histograms of clips. They can be added over a data set with constant memory."""

from collections import Counter
from dataclasses import dataclass, field, fields
from functools import reduce
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip
from dmae.data.labels import Visibility
from dmae.data.store import clip_folders, load_clip
from dmae.numerics.body import body_heading
from dmae.parallel import in_parallel
from dmae.progress import progress
from synth.datasets.splits import SplitBy, identities
from synth.datasets.statistics.contacts import ClipContacts, clip_contacts
from synth.physics.body_state import FILE as STATE
from synth.physics.body_state import load_state

MOST_CAMERAS = 32
"""Greatest number of cameras in a histogram."""


@dataclass(frozen=True)
class BinnedQuantity:
    """A quantity with a histogram.

    Attributes:
        name: Key in the results.
        meaning: Description for readers.
        unit: Unit of the edges.
        edges: (N + 1,) edges of the bins. Values beyond the ends count in the first and the last bin.
    """

    name: str
    meaning: str
    unit: str
    edges: np.ndarray


QUANTITIES = {
    each.name: each
    for each in (
        BinnedQuantity("persons_in_picture", "persons in a picture", "", np.arange(-0.5, 13)),
        BinnedQuantity("visible_views", "cameras that see a joint", "", np.arange(-0.5, MOST_CAMERAS + 1)),
        BinnedQuantity("distance", "distance of a person from a camera", "m", np.arange(0, 15.5, 0.5)),
        BinnedQuantity(
            "azimuth", "camera around a person, 0 in front, 90 to the left", "degrees", np.arange(-180, 181, 15)
        ),
        BinnedQuantity("elevation", "camera above the level of a person's hips", "degrees", np.arange(-90, 91, 7.5)),
        BinnedQuantity("box_height", "height of a person in a picture", "px", np.arange(0, 1201, 40)),
        BinnedQuantity("visible_share", "share of a person's pixels that is visible", "", np.linspace(0, 1, 21)),
        BinnedQuantity("hip_speed", "speed of the hips", "m/s", np.arange(0, 4.05, 0.1)),
        BinnedQuantity("wrist_speed", "speed of the wrists", "m/s", np.arange(0, 8.2, 0.2)),
        BinnedQuantity("stature", "height of persons", "m", np.arange(1.0, 2.11, 0.05)),
    )
}


@dataclass
class Statistics:
    """Counts of some clips, for the J joints of the skeleton's first part. `+` adds two of them.

    Attributes:
        joints: Names of the J joints.
        counts: `clips`, `clips_without_truth`, `frames`, `pictures`, `seconds`, and clips by number of persons,
            `persons=3`, and of cameras, `cameras=5`.
        causes: (J, 7) numbers of joints in views, by `Visibility`.
        histograms: Counts in the bins of each of `QUANTITIES`, by its name.
        occluders: Number of hidden joints by occluder: `self`, `person`, or the name of an object.
        scenes: Number of clips by arena, interaction, and kind of motion: `arena=office`.
        contacts: `ClipContacts` of each clip with body states, by interaction.
        persons: Names of persons, from `synth.datasets.splits`.
        takes: Names of takes, from `synth.datasets.splits`.
        rigs: Names of rigs, from `synth.datasets.splits`.
    """

    joints: tuple[str, ...] = ()
    counts: Counter = field(default_factory=Counter)
    causes: np.ndarray | None = None
    histograms: dict[str, np.ndarray] = field(default_factory=dict)
    occluders: Counter = field(default_factory=Counter)
    scenes: Counter = field(default_factory=Counter)
    contacts: dict[str, tuple[ClipContacts, ...]] = field(default_factory=dict)
    persons: set[str] = field(default_factory=set)
    takes: set[str] = field(default_factory=set)
    rigs: set[str] = field(default_factory=set)

    def __add__(self, other: "Statistics") -> "Statistics":
        """Return the sum of both counts.

        Raises:
            ValueError: the clips have different skeletons.
        """
        if self.joints and other.joints and self.joints != other.joints:
            raise ValueError(f"expected clips of one skeleton, found joints {self.joints} and {other.joints}")
        together = {each.name: (getattr(self, each.name), getattr(other, each.name)) for each in fields(self)}
        names, kinds = self.histograms | other.histograms, self.contacts | other.contacts
        return Statistics(
            joints=self.joints or other.joints,
            causes=_sum(*together["causes"]),
            contacts={kind: self.contacts.get(kind, ()) + other.contacts.get(kind, ()) for kind in kinds},
            histograms={name: _sum(self.histograms.get(name), other.histograms.get(name)) for name in names},
            **{name: one + two for name, (one, two) in together.items() if isinstance(one, Counter)},
            **{name: one | two for name, (one, two) in together.items() if isinstance(one, set)},
        )


def _sum(one: np.ndarray | None, two: np.ndarray | None) -> np.ndarray | None:
    return two if one is None else one if two is None else one + two


def measure(data: Path | list[Path], *, workers: int = 1) -> Statistics:
    """Return the statistics of data sets, or of clips.

    Args:
        data: One folder, or several.
        workers: Processes; -1 for one per core.

    Raises:
        FileNotFoundError: there is neither a clip nor a data set.
        ValueError: a clip is damaged, or clips have different skeletons.
    """
    each = data if isinstance(data, list) else [data]
    folders = [folder for path in each for folder in clip_folders(Path(path))]
    found = in_parallel(_measure_clip, ((folder,) for folder in folders), workers)
    return reduce(Statistics.__add__, progress(found, "reading clips", len(folders)), Statistics())


def _measure_clip(folder: Path) -> Statistics:
    clip = load_clip(folder)
    spec = clip.provenance.get("spec")
    found = measure_clip(clip)
    found.rigs.add(*identities(folder, SplitBy.rig))
    if spec:
        found.persons |= identities(folder, SplitBy.person)
        found.takes |= identities(folder, SplitBy.motion)
    if spec and (folder / STATE).is_file():
        kind = spec.get("interaction", {}).get("kind", "none")
        found.contacts[kind] = (clip_contacts(load_state(folder)),)
    return found


def measure_clip(clip: Clip) -> Statistics:
    """Return the statistics of one clip."""
    views = len(clip.rig)
    found = Statistics(counts=Counter(clips=1, frames=len(clip), pictures=views * len(clip)))
    found.counts[f"cameras={views}"] += 1
    found.counts["seconds"] += len(clip) / clip.fps
    spec = clip.provenance.get("spec")
    if spec:
        together = spec.get("interaction", {}).get("kind", "none")
        for key in (f"arena={spec['arena']}", f"motion={spec['motion']['kind']}", f"interaction={together}"):
            found.scenes[key] += 1
        _add(found, "stature", [person["body"]["stature"] for person in spec["persons"]])
    if clip.truth is None:
        found.counts["clips_without_truth"] += 1
        return found
    found.counts[f"persons={clip.truth.xyz.shape[1]}"] += 1
    _measure_people(clip, found)
    if clip.occlusion is not None:
        _measure_occlusion(clip, found)
    return found


def _add(found: Statistics, name: str, values) -> None:
    edges = QUANTITIES[name].edges
    values = np.asarray(values, np.float64).ravel()
    values = np.clip(values[np.isfinite(values)], edges[0], edges[-1])
    found.histograms[name] = np.histogram(values, edges)[0]


def _measure_people(clip: Clip, found: Statistics) -> None:
    """Add to `found` the positions of people relative to the cameras, and their motion."""
    rig = clip.rig if clip.true_rig is None else clip.true_rig
    part = clip.truth.skeleton.parts[0]
    xyz = clip.truth.xyz[:, :, : len(part)].astype(np.float64)
    hips = xyz[:, :, part.index("l_hip", "r_hip")].mean(2)
    towards = rig.centers[:, None] - hips[:, None]
    level = np.linalg.norm(towards[..., :2], axis=-1)
    _add(found, "distance", np.linalg.norm(towards, axis=-1))
    _add(found, "elevation", np.degrees(np.arctan2(towards[..., 2], level)))
    around = np.arctan2(towards[..., 1], towards[..., 0]) - body_heading(xyz, part)[:, None]
    _add(found, "azimuth", np.degrees((around + np.pi) % (2 * np.pi) - np.pi))
    _add(found, "hip_speed", np.linalg.norm(np.diff(hips, axis=0), axis=-1) * clip.fps)
    wrists = xyz[:, :, part.index("l_wrist", "r_wrist")]
    _add(found, "wrist_speed", np.linalg.norm(np.diff(wrists, axis=0), axis=-1) * clip.fps)
    xy, _ = rig.project(xyz)
    inside = rig.inside(xy)
    _add(found, "persons_in_picture", inside.any(-1).sum(-1))
    y = xy[..., 1]
    high = np.where(inside, y, -np.inf).max(-1) - np.where(inside, y, np.inf).min(-1)
    _add(found, "box_height", np.where(inside.any(-1), high, np.nan))


def _measure_occlusion(clip: Clip, found: Statistics) -> None:
    part = clip.truth.skeleton.parts[0]
    found.joints = part.joints
    code = clip.occlusion.visibility[..., : len(part)]
    found.causes = np.stack([(code == cause).sum((0, 1, 2)) for cause in Visibility], -1)
    there = (code != Visibility.ABSENT).any(1)
    _add(found, "visible_views", np.where(there, (code == Visibility.VISIBLE).sum(1), np.nan))
    if clip.occlusion.amodal_pixels is not None:
        _add(found, "visible_share", clip.occlusion.visible_fraction)
    found.occluders["self"] += int((code == Visibility.HIDDEN_BY_SELF).sum())
    found.occluders["person"] += int((code == Visibility.HIDDEN_BY_PERSON).sum())
    if clip.occlusion.occluder is not None:
        by = clip.occlusion.occluder[..., : len(part)][code == Visibility.HIDDEN_BY_OBJECT]
        for index, count in enumerate(np.bincount(by[by >= 0], minlength=len(clip.occlusion.objects)).tolist()):
            # Names of props begin with their number in the scene, for example 0/drum.
            found.occluders[clip.occlusion.objects[index].rpartition("/")[2]] += count
