"""The people in the pictures of one camera: searched in windows, then followed in regions of their own."""

import numpy as np

from dmae.detection.blazepose.candidates import find_candidates, same_region
from dmae.detection.blazepose.landmarks import Person, find_person, same_torso
from dmae.detection.blazepose.models import Network
from dmae.detection.blazepose.regions import Region, pyramid_of
from dmae.detection.registry import PoseDetectorConfig

_PASSES = 2
"""Of the second network on a new person, each on the region that the one before found."""
_RETRIES = 3
"""Pictures after a person was lost in which people are searched at once."""


class PeopleDetector:
    """Find the people in pictures that come in order."""

    def __init__(self, config: PoseDetectorConfig):
        self._config = config
        self._finder, self._joints = Network("pose_detection"), Network("pose_landmark_full")
        self._regions: list[Region] = []
        self._wait = self._retries = 0

    def __call__(self, picture: np.ndarray) -> list[Person]:
        """Return the people of the next picture (H, W, 3) uint8, RGB."""
        pyramid = pyramid_of(np.ascontiguousarray(picture))
        followed = [find_person(self._joints, pyramid, region) for region in self._regions]
        people = self._distinct(followed)
        if len(people) < len(followed):
            self._retries = _RETRIES
        if self._wait <= 0 or self._retries > 0:
            self._retries, self._wait = self._retries - 1, self._config.search_every
            people = self._distinct([*people, *self._new(pyramid, people)])
        self._wait -= 1
        self._regions = [person.region for person in people]
        return people

    def _new(self, pyramid: list[np.ndarray], people: list[Person]) -> list[Person]:
        """Search people that are not among those found already."""
        found = []
        for candidate in find_candidates(self._finder, pyramid, tuple(self._config.windows)):
            known = [person.region for person in (*people, *found)]
            if any(same_region(candidate.region, region) for region in known):
                continue
            region, person = candidate.region, None
            for _ in range(_PASSES):
                person = find_person(self._joints, pyramid, region)
                if not self._is_person(person):
                    break
                region = person.region
            if self._is_person(person):
                found.append(person)
        return found

    def _is_person(self, person: Person) -> bool:
        return person.presence >= self._config.min_presence and person.region is not None

    def _distinct(self, people: list[Person]) -> list[Person]:
        """Return those that are persons, each once: of duplicates the one in plainest sight."""
        kept: list[Person] = []
        for person in sorted(people, key=lambda each: -each.presence * each.visibility.mean()):
            if self._is_person(person) and not any(same_torso(person, other) for other in kept):
                kept.append(person)
        return kept
