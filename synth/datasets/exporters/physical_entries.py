"""Physical labels as entries of a person in a picture: contacts, ground reaction, and points on the surface."""

from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.labels import Visibility
from dmae.formats.labelled_images.pictures import PersonLabel, Picture
from synth.labels.people_contacts import ContactSource
from synth.labels.physical_labels import FILE, PhysicalLabels, load_physical_labels

KEYS = (
    "contacts", "weight", "ground_reaction", "centre_of_pressure", "residual", "surface_keypoints",
    "surface_visibility", "surface_hidden_by",
)  # fmt: skip
"""Keys of an entry. Each kind of physical labels has some of them."""


class PhysicalEntries:
    """The entries of one clip. Entries are empty if the clip has no physical labels.

    Args:
        folder: Folder of the clip.
        rig: True cameras of the clip.
    """

    def __init__(self, folder: Path, rig: CameraRig):
        self._labels = load_physical_labels(folder) if (folder / FILE).is_file() else PhysicalLabels()
        self._rig = rig
        contacts = self._labels.contacts
        self._persons = None if contacts is None else contacts.persons

    def of(self, picture: Picture, person: PersonLabel) -> dict:
        """Return the entry of a person in a picture, with the known keys of `KEYS`."""
        found = {}
        if self._labels.contacts is not None:
            found["contacts"] = self._contacts(picture.frame, person.person)
        if (forces := self._labels.forces) is not None:
            at = picture.frame, person.person
            found |= {"weight": round(float(forces.weights[person.person]), 2)}
            found |= {
                name: [_known(values, digits) for values in getattr(forces, name)[at]]
                for name, digits in (("ground_reaction", 2), ("centre_of_pressure", 4), ("residual", 2))
            }
        if self._labels.surface is not None:
            found |= self._surface(picture, person.person)
        return found

    def _contacts(self, frame: int, person: int) -> list[dict]:
        """Return the contacts of a person in a frame, with the forces that act on the person."""
        contacts, found = self._labels.contacts, []
        first, last = np.searchsorted(contacts.frame, (frame, frame + 1))
        for number in range(first, last):
            for side in (1, 0):
                if self._persons[number, side] != person:
                    continue
                part, other = (contacts.names[contacts.between[number, each]] for each in (side, 1 - side))
                force = contacts.force[number] * (1 if side else -1)
                found.append(
                    {
                        "part": part.partition("/")[2],
                        "with": other,
                        "xyz": _known(contacts.point[number], 4),
                        "force": _known(force, 2),
                        "depth": round(float(contacts.depth[number]), 4),
                        "source": ContactSource(contacts.source[number]).name.lower(),
                    }
                )
        return found

    def _surface(self, picture: Picture, person: int) -> dict:
        surface, frame, view = self._labels.surface, picture.frame, picture.view
        xy = self._rig[view : view + 1].project(surface.xyz[frame, person][None])[0][0, 0]
        codes = surface.visibility[frame, view, person]
        flags = np.select([codes == Visibility.VISIBLE, codes <= Visibility.HIDDEN_BY_OBJECT], [2, 1], 0)
        points = np.where(flags[:, None] > 0, xy, 0).round(2).tolist()
        return {
            "surface_keypoints": [v for (x, y), flag in zip(points, flags.tolist(), strict=True) for v in (x, y, flag)],
            "surface_visibility": codes.tolist(),
            "surface_hidden_by": surface.hidden_by[frame, view, person].tolist(),
        }


def _known(values: np.ndarray, digits: int) -> list[float] | None:
    """Return rounded numbers as a list; None if one is NaN, because JSON has no NaN."""
    return None if np.isnan(values).any() else [round(value, digits) for value in values.tolist()]
