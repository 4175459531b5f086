"""The people in the images of one camera: searched in windows, then followed in regions of their own."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmae.detection.blazepose.candidates import find_candidates, same_region, windows_of
from dmae.detection.blazepose.confidence import clearness
from dmae.detection.blazepose.expected import find_expected
from dmae.detection.blazepose.landmarks import Person, disagreement, find_person, same_torso
from dmae.detection.blazepose.models import Network
from dmae.detection.blazepose.parts import larger_region, part_of
from dmae.detection.blazepose.regions import Region, pyramid_of
from dmae.detection.registry import PoseDetectorConfig

_PASSES = 3
"""Passes of the second network on a new person, each on the region that the previous pass found."""
_RETRIES = 5
"""Number of images in which a lost person is searched at its last place, and a candidate is examined again."""
_SETTLED, _STEADY = 0.06, 0.1
"""Largest distance between the results of two passes for one person, relative to the torso.

In regions without a person, or with two people, the distance is larger. Presence alone is unreliable where people
overlap or leave the image: with it, windows found 93 % of the people in full view, and 9 of 81 other regions were
mistaken for people. With this agreement the figures are 93 % and 3."""
_FAINT = 0.3
"""Smallest presence in a pass if the passes agree."""
_CLEAR = 0.42
"""Smallest mean confidence of the joints of a person."""
_SHIFTS = (-0.4, 0.4)
"""Offsets of the searches next to a region that contains parts of two people, relative to its radius."""
_NARROWER = 0.8
"""Side of the regions of these searches, relative to the first region."""
_CROWD = (1.6, 2.4)
"""Sides of the windows around people, relative to their regions. Other people are searched there, with these people
painted over."""
_CLEARER = 0.05
"""A newly found person replaces a followed one if the mean confidence of the joints is higher by this much."""
_DROP = 0.12
"""A followed person is searched again if the mean confidence falls by this much below its usual value."""
_JUMP = 0.25
"""Movement from one image to the next, relative to the torso, after which a second pass checks the person."""
_FULL_SEARCHES = 3
"""Number of first images that are searched in all windows. Later images are searched in some windows, in turn."""
_DOUBTED = 0.6
"""Mean confidence of joints below which a followed person is compared with the result of a search at its place."""
_CHECKED = 5
"""Number of images after which a second pass checks a followed person."""
_MEMORY = 0.9
"""Weight of the previous value in the running mean of the confidence, per image."""
_STRAYED = 0.2
"""A followed person is given up if a second pass finds it farther away than this, relative to the torso."""
_LOOK_BACK, _LOOK_BACK_BYTES = 25, 100e6
"""Number of previous images in which a new person is searched, and largest memory that they take, bytes."""


@dataclass(frozen=True)
class _Followed:
    """A followed person: its current detection, and its usual mean confidence."""

    person: Person
    usual: float

    def now(self, person: Person) -> "_Followed":
        """Return the followed person with its detection in the next image."""
        return _Followed(person, _MEMORY * self.usual + (1 - _MEMORY) * clearness(person))


class PeopleDetector:
    """Detector of the people in images that are given in order."""

    def __init__(self, config: PoseDetectorConfig, look_back: bool = False):
        """Args: look_back: Whether a new person is also searched in previous images, see `late`."""
        self._config, self._look_back = config, look_back
        self._finder, self._joints = Network("pose_detection"), Network("pose_landmark_full")
        self._followed: list[_Followed] = []
        self._lost: list[tuple[Region, int]] = []
        self._number = 0
        self._before: deque[tuple[list[np.ndarray], list[Person]]] = deque(maxlen=_LOOK_BACK)
        self.late: list[tuple[int, list[Person]]] = []
        """Earlier images in which people were found by the last image: number of images before, all people in it."""

    def __call__(self, picture: np.ndarray) -> list[Person]:
        """Return the people of the next image (H, W, 3) uint8, RGB."""
        pyramid = pyramid_of(np.ascontiguousarray(picture))
        people, lost = self._follow(pyramid)
        self._new: list[Person] = []
        waiting, self._lost = self._lost, [(region, _RETRIES) for region in lost]
        for region, tries in waiting:
            found = self._settled(pyramid, region, [each.person for each in people])
            if not self._add(people, found) and tries > 1:
                self._lost.append((region, tries - 1))
        height, width = picture.shape[:2]
        windows = windows_of(width, height, tuple(self._config.windows))
        if self._number >= _FULL_SEARCHES:
            # All windows are searched in turn, so that a person that appears is found soon.
            share = -(-len(windows) // self._config.search_every)
            start = self._number * share % len(windows)
            windows = (windows + windows)[start : start + share]
            windows += [_around(region, size) for region in lost for size in _CROWD]
        self._search(pyramid, people, windows)
        self._search_crowds(pyramid, people)
        self._number += 1
        self._followed = people
        found = [each.person for each in people]
        if self._look_back:
            new = [person for person in found if any(person is each for each in self._new)]
            changed = {ago for person in new for ago in self._follow_back(person)}
            self.late = [(ago, list(self._before[-ago][1])) for ago in sorted(changed)]
            while self._before and (len(self._before) + 1) * sum(level.nbytes for level in pyramid) > _LOOK_BACK_BYTES:
                self._before.popleft()
            self._before.append((pyramid, found))
        return found

    def expected(self, picture: np.ndarray, expected: np.ndarray, known: np.ndarray) -> list[Person]:
        """Return the people of an image (H, W, 3) at expected places (n, 33, 2) px that are not known (D, 33, 2) px."""
        pyramid, found, others = pyramid_of(np.ascontiguousarray(picture)), [], list(known)
        for places in expected:
            person = find_expected(self._joints, pyramid, places, others, self._config.min_presence)
            if person is not None:
                found.append(person)
                others.append(person.xy)
        return found

    def _follow_back(self, person: Person) -> Iterator[int]:
        """Follow a new person back through the previous images, until it is known there or not found with certainty.

        In each of these images it is added, and bodies that are parts of it are removed. Yield the numbers of images
        before the current one.
        """
        for ago, (pyramid, known) in enumerate(reversed(self._before), 1):
            found = self._person(pyramid, person.region)
            if found.region is None or _known(found, known) or disagreement(found, person) > _JUMP:
                return
            found = self._confirmed(pyramid, found)
            if found is None or _known(found, known):
                return
            known[:] = [*(each for each in known if not part_of(each, found)), found]
            yield ago
            person = found

    def _follow(self, pyramid: list[np.ndarray]) -> tuple[list[_Followed], list[Region]]:
        """Return the people of the previous image at their current places, and the regions of lost people."""
        seen = [(self._person(pyramid, each.person.region), each) for each in self._followed]
        people: list[_Followed] = []
        lost: list[Region] = []
        for number, (person, before) in enumerate(sorted(seen, key=lambda pair: -clearness(pair[0]))):
            others = [each.person for each in people]
            if _known(person, others):
                # The region moved to another person: search its own person with the other one painted over.
                person = self._person(pyramid, before.person.region, others)
            if person.region is None or _known(person, others):
                lost.append(before.person.region)
                continue
            jumped = disagreement(before.person, person) > _JUMP
            if jumped or (self._number + number) % _CHECKED == 0 or person.presence < self._config.min_presence:
                again = self._person(pyramid, person.region)
                limit = _STRAYED if person.presence >= self._config.min_presence else _STEADY
                if disagreement(person, again) > limit or clearness(person) < _CLEAR:
                    lost.append(before.person.region)
                    continue
            if clearness(person) < before.usual - _DROP:
                person = self._again(pyramid, person, others)
            people.append(before.now(person))
        return people, lost

    def _again(self, pyramid: list[np.ndarray], person: Person, others: Sequence[Person]) -> Person:
        """Search a person again around its place, and return the clearer of the two detections."""
        for candidate in find_candidates(self._finder, pyramid, [_around(person.region, _CROWD[0])], others):
            found = self._settled(pyramid, candidate.region)
            if found is not None and not _known(found, others) and clearness(found) > clearness(person) + _CLEARER:
                person = found
        return person

    def _search(self, pyramid: list[np.ndarray], people: list[_Followed], windows: list[Region]) -> None:
        """Add new people that are found in windows, and replace unclear people by clearer detections of them."""
        failed = []
        for candidate in find_candidates(self._finder, pyramid, windows):
            region = candidate.region
            clear = [each for each in people if clearness(each.person) >= _DOUBTED]
            if any(same_region(region, each.person.region) for each in clear):
                continue
            if not self._add(people, self._settled(pyramid, region)):
                failed.append(region)
        for region in failed:
            across = np.array([-region.up[1], region.up[0]])
            for shift in _SHIFTS:
                beside = replace(
                    region, centre=region.centre + shift * region.radius * across, side=_NARROWER * region.side
                )
                if not any(same_region(beside, each.person.region) for each in people):
                    self._add(people, self._confirmed(pyramid, self._settled(pyramid, beside)))

    def _search_crowds(self, pyramid: list[np.ndarray], people: list[_Followed]) -> None:
        """Add people near others. The first network misses them: in a window it finds only the most prominent person.

        In the first images the search is around all people, later around one person per image, in turn.
        """
        looked = 0
        while looked < len(people):
            found = [each.person for each in people]
            windows = [_around(person.region, share) for person in found[looked:] for share in _CROWD]
            if self._number >= _FULL_SEARCHES:
                windows = [windows[self._number % len(windows)]]
            looked = len(people)
            for candidate in find_candidates(self._finder, pyramid, windows, found):
                self._add(people, self._confirmed(pyramid, self._settled(pyramid, candidate.region, found)))
            if self._number >= _FULL_SEARCHES:
                return

    def _add(self, people: list[_Followed], found: Person | None) -> bool:
        """Add a person to others, unless they contain it at least as clearly; return whether there was a person."""
        if found is None:
            return False
        if any(part_of(found, each.person) for each in people):
            return True
        people[:] = [each for each in people if not part_of(each.person, found)]
        same = [i for i, each in enumerate(people) if same_torso(found, each.person)]
        if not same:
            people.append(_Followed(found, clearness(found)))
            self._new.append(found)
        elif len(same) == 1 and clearness(found) > clearness(people[same[0]].person) + _CLEARER:
            people[same[0]] = _Followed(found, clearness(found))
        return True

    def _person(self, pyramid: list[np.ndarray], region: Region, without: Sequence[Person] = ()) -> Person:
        """Return the person in a region. If its head is too large for its body, search a larger body around the head.

        The second network fits a body into the region. Where the hips or legs are hidden, it returns a body that is too
        small in a region that is too small, and the region shrinks from image to image.
        """
        person = find_person(self._joints, pyramid, region, without)
        if (larger := larger_region(person)) is None:
            return person
        again = find_person(self._joints, pyramid, larger, without)
        sure = again.presence >= self._config.min_presence and again.region is not None
        return again if sure and part_of(person, again) else person

    def _settled(self, pyramid: list[np.ndarray], region: Region, without: Sequence[Person] = ()) -> Person | None:
        """Return the person in a region if two passes agree on it, otherwise None."""
        person, most = None, 0.0
        for _ in range(_PASSES):
            before, person = person, self._person(pyramid, region, without)
            if person.region is None:
                return None
            most = max(most, person.presence)
            if before is not None and disagreement(before, person) < _SETTLED:
                there = person.presence >= self._config.min_presence or most >= _FAINT
                return person if there and clearness(person) >= _CLEAR else None
            region = person.region
        return None

    def _confirmed(self, pyramid: list[np.ndarray], found: Person | None) -> Person | None:
        """Return a person that the first network missed, if it is certain and is also found in the unpainted image."""
        if found is None:
            return None
        again = self._person(pyramid, found.region)
        sure = min(found.presence, again.presence) >= self._config.min_presence and again.region is not None
        return again if sure and disagreement(found, again) < _STEADY and clearness(again) >= _CLEAR else None


def _known(person: Person, others: Sequence[Person]) -> bool:
    return any(same_torso(person, other) or part_of(person, other) for other in others)


def _around(region: Region, share: float) -> Region:
    side = share * region.side
    return Region.upright(*(region.centre - side / 2), side)
