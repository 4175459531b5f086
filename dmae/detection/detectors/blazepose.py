"""BlazePose: people are searched in windows of an image, then followed in regions of their own."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dmae.data.skeleton import BLAZEPOSE33
from dmae.detection.detectors.landmarks import (
    Network,
    Person,
    Region,
    clearness,
    confidence,
    corrected_torso,
    disagreement,
    find_person,
    larger_region,
    painted_over,
    part_of,
    pyramid_of,
    same_torso,
)
from dmae.detection.pipeline import body_radius
from dmae.detection.registry import PoseDetectorConfig, pose_detector

_GRIDS = ((28, 2), (14, 2), (7, 6))  # Grids of anchors: number of cells in a row, and number of anchors in a cell
_MIN_SCORE = 0.5
_MIN_PRESENCE = 0.5  # Smallest probability that a region holds a person
_MAX_OVERLAP = 0.3  # Smallest intersection over union of two boxes of one person
_SHARES, _LARGEST, _SHRINK = (1.0, 0.6, 0.35), 1.5, 0.6
"""Sides of the windows in videos, relative to the longer side of the image. In photographs: the largest side, for
bodies that the border cuts off, and the ratio of the sides that follow 1."""
_SMALLEST_PX, _SMALLEST = 240, 0.12
"""Side at which no smaller windows of photographs follow, px and relative to the longer side. In a window of 240 px
people of 60 px are found."""
_STEP = 0.5  # Largest step from window to window, relative to the side of a window
_BODY_ENDS, _BODY_HALF_WIDTH = 0.9, 0.3
"""Extent of a body from the middle of its hips, relative to the radius of the circle around the body."""
_SAME_HIPS = 0.15  # Boxes of one body: distance of the hips relative to the radius
_SAME_PLACE, _SAME_SIZE = 0.35, 1.6
"""Two regions of one person: distance of the centres relative to the radius, and ratio of the sizes."""


@dataclass(frozen=True)
class Candidate:
    """A region that may show a person."""

    region: Region  # The square around the body
    score: float  # From 0 to 1


def shares_of(config: PoseDetectorConfig, width: int, height: int) -> tuple[float, ...]:
    """Return the sides of the windows in which an image is searched, relative to its longer side."""
    if config.windows is not None:
        return tuple(config.windows)
    if not config.photographs:
        return _SHARES
    shares = [_LARGEST, 1.0]
    while shares[-1] > max(_SMALLEST, _SMALLEST_PX / max(width, height)):
        shares.append(_SHRINK * shares[-1])
    return tuple(shares)


def windows_of(width: int, height: int, shares: tuple[float, ...]) -> list[Region]:
    """Return square windows that cover an image.

    Args:
        width: px.
        height: px.
        shares: Sides of the windows relative to the longer side of the image; 1 is the whole image.
    """
    found = []
    for share in shares:
        side = share * max(width, height)
        lefts, tops = _starts(width, side), _starts(height, side)
        found += [Region.upright(left, top, side) for top in tops for left in lefts]
    return found


def _starts(length: float, side: float) -> list[float]:
    """Return where windows begin, px. A window that is longer than the image is centred on it."""
    if side >= length:
        return [(length - side) / 2]
    count = int(np.ceil((length - side) / (_STEP * side))) + 1
    return np.linspace(0, length - side, count).tolist()


def find_candidates(
    network: Network, pyramid: list[np.ndarray], windows: Iterable[Region], without: Sequence[Person] = ()
) -> list[Candidate]:
    """Return the candidates in windows of an image, best first, each person once.

    Args:
        network: BlazePose's first network.
        pyramid: The image (H, W, 3) uint8 and its smaller copies.
        without: People that are painted over first.
    """
    height, width = pyramid[0].shape[:2]
    found = [
        candidate
        for window in windows
        for candidate in _in_window(network, pyramid, window, without)
        if not _is_cut(candidate.region, window, width, height)
    ]
    kept: list[Candidate] = []
    for candidate in sorted(found, key=lambda each: -each.score):
        if not any(same_region(candidate.region, each.region) for each in kept):
            kept.append(candidate)
    return kept


def same_region(a: Region, b: Region) -> bool:
    """Return whether two regions are of one person."""
    ratio = a.side / b.side
    near = np.hypot(*(a.centre - b.centre)) < _SAME_PLACE * max(a.radius, b.radius)
    return bool(near and 1 / _SAME_SIZE < ratio < _SAME_SIZE)


@cache
def anchors() -> np.ndarray:
    """Return the centres (2254, 2) of the anchors, from 0 to 1."""
    grids = []
    for cells, number in _GRIDS:
        y, x = np.mgrid[:cells, :cells] + 0.5
        grids.append(np.repeat(np.stack([x, y], -1).reshape(-1, 2) / cells, number, axis=0))
    return np.concatenate(grids)


def _in_window(
    network: Network, pyramid: list[np.ndarray], window: Region, without: Sequence[Person]
) -> list[Candidate]:
    pixels = painted_over(window.cut(pyramid, network.size), window, without).astype(np.float32) / 127.5 - 1
    values, logits = network(pixels, "Identity", "Identity_1")
    scores = 1 / (1 + np.exp(-np.clip(logits[:, 0].astype(np.float64), -100, 100)))
    likely = scores >= _MIN_SCORE
    if not likely.any():
        return []
    values = values[likely].reshape(-1, 6, 2).astype(np.float64) / network.size
    # Centre, size and four points; all but the size are relative to the anchor.
    values[:, [0, 2, 3, 4, 5]] += anchors()[likely][:, None]
    candidates = []
    for merged, score in _merged(values, scores[likely]):
        hip, top = window.to_image(merged[2:4])
        if (region := Region.around(hip, top)) is not None:
            candidates.append(Candidate(region, score))
    return candidates


def _merged(values: np.ndarray, scores: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Weighted suppression of boxes (n, 6, 2), centre, size and points: the mean by score of each best box and its
    overlaps."""
    low, high = values[:, 0] - values[:, 1] / 2, values[:, 0] + values[:, 1] / 2
    area, found = np.prod(np.maximum(high - low, 0), -1), []
    left = np.argsort(-scores, kind="stable")
    while len(left):
        best = left[0]
        overlap = np.minimum(high[left], high[best]) - np.maximum(low[left], low[best])
        both = np.prod(np.maximum(overlap, 0), -1)
        same = both > _MAX_OVERLAP * np.maximum(area[left] + area[best] - both, 1e-12)
        same &= _same_body(values[left], values[best])
        same[0] = True
        group = left[same]
        found.append((np.average(values[group], axis=0, weights=scores[group]), float(scores[best])))
        left = left[~same]
    return found


def _same_body(values: np.ndarray, best: np.ndarray) -> np.ndarray:
    """Return (n,) True for boxes (n, 6, 2) with hips near those of another box (6, 2), and a similar size.

    Boxes of two people overlap where one stands in front of the other; their mean would fit neither.
    """
    radius, own = (np.maximum(np.hypot(*(each[..., 3, :] - each[..., 2, :]).T), 1e-6) for each in (values, best))
    apart = np.hypot(*(values[:, 2] - best[2]).T)
    return (apart < _SAME_HIPS * own) & (np.abs(np.log(radius / own)) < np.log(_SAME_SIZE))


def _is_cut(region: Region, window: Region, width: int, height: int) -> bool:
    """Return whether a window cuts a body inside the image; the smaller body that is then found often looks right."""
    across = np.array([-region.up[1], region.up[0]])
    body = np.array(
        [
            region.centre + region.radius * (along * region.up + aside * across)
            for along in (-_BODY_ENDS, _BODY_ENDS)
            for aside in (-_BODY_HALF_WIDTH, _BODY_HALF_WIDTH)
        ]
    )
    low, high = np.maximum(body.min(0), 0), np.minimum(body.max(0), (width, height))
    start = window.centre - window.side / 2
    return bool((low < start).any() or (high > start + window.side).any())


# A person that is expected at a place, because other cameras see it there

_HIPS, _SHOULDERS = BLAZEPOSE33.index("l_hip", "r_hip"), BLAZEPOSE33.index("l_shoulder", "r_shoulder")
_LARGER = 1.05
"""Radius of the region, relative to the largest distance of an expected joint from the hips. It leaves room for the
top of the head, which is not a joint."""
_SIDES = (1.0, 1.15, 1.3, 0.87)
"""Sides of the regions that are tried, relative to the region of the expected joints. Which region the network needs
depends on hair, clothes and what else is near."""
_CLEAR_THERE = 0.3  # Smallest mean confidence of the joints of a person that is expected at a place
_NEAR, _OTHER = 0.12, 0.15
"""Largest median distance of the joints from the expected places, and smallest one from the joints of another person,
relative to the radius. In rendered views, 391 results were this near; their largest median error was 0.11 of the
person's height."""
_SURE = 0.08  # No other region is tried after a result this near


def find_expected(
    network: Network, pyramid: list[np.ndarray], expected: np.ndarray, known: Sequence[np.ndarray]
) -> Person | None:
    """Return the person at an expected place; None if the network finds no one there, or a known person.

    Of several regions around the place, that with the result nearest to the expected joints counts. If all fail, they
    are tried again with the known people painted over.

    Args:
        network: BlazePose's second network.
        pyramid: The image and its smaller copies.
        expected: (33, 2) px; NaN where unknown.
        known: Joints (33, 2) px of each known person; NaN where absent.
    """
    hip, shoulder = expected[_HIPS].mean(0), expected[_SHOULDERS].mean(0)
    radius = _LARGER * float(body_radius(expected, BLAZEPOSE33))
    along = shoulder - hip
    region = Region.around(hip + 0.5, hip + 0.5 + radius * along / max(float(np.hypot(*along)), 1e-6))
    if region is None:
        return None
    others = [_painted(xy) for xy in known]
    for without in ((), others) if others else ((),):
        best, nearest = None, _NEAR * radius
        for side in _SIDES:
            person = find_person(network, pyramid, replace(region, side=side * region.side), without)
            apart = _apart(person.xy, expected)
            if (
                apart < nearest
                and person.presence >= _MIN_PRESENCE
                and clearness(person) >= _CLEAR_THERE
                and all(_apart(person.xy, xy) > _OTHER * radius for xy in known)
            ):
                best, nearest = person, apart
                if apart < _SURE * radius:
                    break
        if best is not None:
            return best
    return None


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """Return the median distance between joints of two people, px; infinite if they have none in common."""
    distance = np.linalg.norm(a - b, axis=-1)
    return float(np.nanmedian(distance)) if np.isfinite(distance).any() else np.inf


def _painted(xy: np.ndarray) -> Person:
    """Return a known person as it is painted over: absent joints are put in its middle."""
    nothing = np.zeros(len(xy))
    return Person(np.where(np.isnan(xy), np.nanmean(xy, 0), xy), nothing, nothing, 1.0, None)


# The people in the images of one camera

_PASSES = 3  # Passes of the second network on a new person, each on the region that the previous pass found
_RETRIES = 5  # Number of images in which a lost person is searched at its last place, and a candidate is examined again
_SETTLED, _STEADY = 0.06, 0.1
"""Largest distance between the results of two passes for one person, relative to the torso.

In regions without a person, or with two people, the distance is larger. Presence alone is unreliable where people
overlap or leave the image: with it, windows found 93 % of the people in full view, and 9 of 81 other regions were
mistaken for people. With this agreement the figures are 93 % and 3."""
_FAINT = 0.3  # Smallest presence in a pass if the passes agree
_CLEAR = 0.42  # Smallest mean confidence of the joints of a person
_MOST_PASSES, _CERTAIN, _ALIKE, _LEAST_INSIDE = 4, 0.9, 0.08, 11
"""In photographs: number of passes; smallest presence in two passes, and largest median distance between their joints
relative to the radius of the body, with which a person is accepted although its torso moved; smallest number of joints
inside of the image. Seen from an end, as of people who sit, a torso is short, and its agreement says little.

Of 79 regions at people in 34 photographs, agreement of torsos accepts 46, this one 61; of 119 others, 2 and 1."""
_SHIFTS = (-0.4, 0.4)
"""Offsets of the searches next to a region that contains parts of two people, relative to its radius."""
_NARROWER = 0.8  # Side of the regions of these searches, relative to the first region
_CROWD = (1.6, 2.4)
"""Sides of the windows around people, relative to their regions. Other people are searched there, with these people
painted over."""
_CLEARER = 0.05
"""A newly found person replaces a followed one if the mean confidence of the joints is higher by this much."""
_DROP = 0.12  # A followed person is searched again if the mean confidence falls by this much below its usual value
_JUMP = 0.25  # Movement from one image to the next, relative to the torso, after which a second pass checks the person
_FULL_SEARCHES = 3
"""Number of first images that are searched in all windows. Later images are searched in some windows, in turn."""
_DOUBTED = 0.6
"""Mean confidence of joints below which a followed person is compared with the result of a search at its place."""
_CHECKED = 5  # Number of images after which a second pass checks a followed person
_MEMORY = 0.9  # Weight of the previous value in the running mean of the confidence, per image
_STRAYED = 0.2  # A followed person is given up if a second pass finds it farther away than this, relative to the torso
_LOOK_BACK, _LOOK_BACK_BYTES = 25, 100e6
"""Number of previous images in which a new person is searched, and largest memory that they take, bytes."""


@dataclass(frozen=True)
class _Followed:
    """A followed person: its current detection, and its usual mean confidence."""

    person: Person
    usual: float

    @property
    def region(self) -> Region:
        """Where the next image is searched."""
        assert self.person.region is not None
        return self.person.region

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

    def __call__(self, image: np.ndarray) -> list[Person]:
        """Return the people of the next image (H, W, 3) uint8, RGB."""
        if self._config.photographs:
            self._number, self._followed, self._lost = 0, [], []
            self._before.clear()
        self._size = image.shape[:2]
        pyramid = pyramid_of(np.ascontiguousarray(image))
        people, lost = self._follow(pyramid)
        self._new: list[Person] = []
        waiting, self._lost = self._lost, [(region, _RETRIES) for region in lost]
        for region, tries in waiting:
            again = self._settled(pyramid, region, [each.person for each in people])
            if not self._add(people, again) and tries > 1:
                self._lost.append((region, tries - 1))
        height, width = self._size
        windows = windows_of(width, height, shares_of(self._config, width, height))
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

    def expected(self, image: np.ndarray, expected: np.ndarray, known: np.ndarray) -> list[Person]:
        """Return the people of an image (H, W, 3) at expected places (n, 33, 2) px that are not known (D, 33, 2) px."""
        pyramid, found, others = pyramid_of(np.ascontiguousarray(image)), [], list(known)
        for places in expected:
            person = find_expected(self._joints, pyramid, places, others)
            if person is not None:
                found.append(person)
                others.append(person.xy)
        return found

    def _follow_back(self, person: Person) -> Iterator[int]:
        """Follow a new person back through the previous images, as long as it is found with certainty and not known
        there.

        It is added to them, and bodies that are parts of it are removed. Yield how many images back each one is.
        """
        for ago, (pyramid, known) in enumerate(reversed(self._before), 1):
            assert person.region is not None
            there = self._person(pyramid, person.region)
            if there.region is None or _known(there, known) or disagreement(there, person) > _JUMP:
                return
            found = self._confirmed(pyramid, there)
            if found is None or _known(found, known):
                return
            known[:] = [*(each for each in known if not part_of(each, found)), found]
            yield ago
            person = found

    def _follow(self, pyramid: list[np.ndarray]) -> tuple[list[_Followed], list[Region]]:
        """Return the people of the previous image at their current places, and the regions of lost people."""
        seen = [(self._person(pyramid, each.region), each) for each in self._followed]
        people: list[_Followed] = []
        lost: list[Region] = []
        for number, (person, before) in enumerate(sorted(seen, key=lambda pair: -clearness(pair[0]))):
            others = [each.person for each in people]
            if _known(person, others):
                # The region moved to another person: search its own person with the other one painted over.
                person = self._person(pyramid, before.region, others)
            if person.region is None or _known(person, others):
                lost.append(before.region)
                continue
            jumped = disagreement(before.person, person) > _JUMP
            if jumped or (self._number + number) % _CHECKED == 0 or person.presence < _MIN_PRESENCE:
                again = self._person(pyramid, person.region)
                limit = _STRAYED if person.presence >= _MIN_PRESENCE else _STEADY
                if disagreement(person, again) > limit or clearness(person) < _CLEAR:
                    lost.append(before.region)
                    continue
            if clearness(person) < before.usual - _DROP:
                person = self._again(pyramid, person, others)
            people.append(before.now(person))
        return people, lost

    def _again(self, pyramid: list[np.ndarray], person: Person, others: Sequence[Person]) -> Person:
        """Search a person again around its place, and return the clearer of the two detections."""
        assert person.region is not None
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
            if any(same_region(region, each.region) for each in clear):
                continue
            if not self._add(people, self._settled(pyramid, region)):
                failed.append(region)
        for region in failed:
            across = np.array([-region.up[1], region.up[0]])
            for shift in _SHIFTS:
                beside = replace(
                    region, centre=region.centre + shift * region.radius * across, side=_NARROWER * region.side
                )
                if not any(same_region(beside, each.region) for each in people):
                    self._add(people, self._confirmed(pyramid, self._settled(pyramid, beside)))

    def _search_crowds(self, pyramid: list[np.ndarray], people: list[_Followed]) -> None:
        """Add people near others, of whom the first network finds only the most prominent one in a window.

        In the first images the search is around all people, later around one person per image, in turn.
        """
        looked = 0
        while looked < len(people):
            found = [each.person for each in people]
            windows = [_around(each.region, share) for each in people[looked:] for share in _CROWD]
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

        The second network fits a body into the region: where legs are hidden, body and region would shrink from image
        to image.
        """
        person = find_person(self._joints, pyramid, region, without)
        if (larger := larger_region(person)) is None:
            return person
        again = find_person(self._joints, pyramid, larger, without)
        sure = again.presence >= _MIN_PRESENCE and again.region is not None
        return again if sure and part_of(person, again) else person

    def _settled(self, pyramid: list[np.ndarray], region: Region, without: Sequence[Person] = ()) -> Person | None:
        """Return the person in a region if two passes agree on it, otherwise None."""
        person, most = None, 0.0
        for _ in range(_MOST_PASSES if self._config.photographs else _PASSES):
            before, person = person, self._person(pyramid, region, without)
            if person.region is None:
                return None
            most = max(most, person.presence)
            if before is not None and disagreement(before, person) < _SETTLED:
                there = person.presence >= _MIN_PRESENCE or most >= _FAINT
                return person if there and self._clear(person) >= _CLEAR else None
            if before is not None and self._config.photographs and self._alike(before, person):
                return person
            region = person.region
        return None

    def _clear(self, person: Person) -> float:
        """Return the mean confidence of the joints of a person; in photographs, of the joints inside of the image."""
        if not self._config.photographs:
            return clearness(person)
        height, width = self._size
        inside = ((person.xy >= -0.5) & (person.xy <= (width - 0.5, height - 0.5))).all(-1)
        return float(confidence(person)[inside].mean()) if inside.sum() >= _LEAST_INSIDE else 0.0

    def _alike(self, a: Person, b: Person) -> bool:
        """Return whether two passes are certain of a person and agree on most of its joints."""
        assert b.region is not None
        apart = float(np.median(np.hypot(*(a.xy - b.xy).T))) / b.region.radius
        return min(a.presence, b.presence) >= _CERTAIN and apart < _ALIKE and self._clear(b) >= _CLEAR

    def _confirmed(self, pyramid: list[np.ndarray], found: Person | None) -> Person | None:
        """Return a person that the first network missed, if it is certain and is also found in the unpainted image."""
        if found is None or found.region is None:
            return None
        again = self._person(pyramid, found.region)
        sure = min(found.presence, again.presence) >= _MIN_PRESENCE and again.region is not None
        return again if sure and disagreement(found, again) < _STEADY and self._clear(again) >= _CLEAR else None


def _known(person: Person, others: Sequence[Person]) -> bool:
    return any(same_torso(person, other) or part_of(person, other) for other in others)


def _around(region: Region, share: float) -> Region:
    side = share * region.side
    left, top = region.centre - side / 2
    return Region.upright(left, top, side)


@pose_detector("blazepose")
def blazepose(config: PoseDetectorConfig) -> "BlazePose":
    """MediaPipe's BlazePose, which comes with the package: 33 joints, several people, about 20 ms for each."""
    return BlazePose(config)


class BlazePose:
    """An `ImageDetector`."""

    skeleton = BLAZEPOSE33

    def __init__(self, config: PoseDetectorConfig):
        self._people, self._size = PeopleDetector(config, look_back=True), (0, 0)

    def __call__(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self._size = image.shape[:2]
        return self._joints_of(self._people(image))

    def found_late(self) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Return earlier images in which people were found by the last image; see `ImageDetector`."""
        return [(ago, *self._joints_of(people)) for ago, people in self._people.late]

    def find_at(self, image: np.ndarray, expected: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the people at expected places; see `ImageDetector`."""
        self._size = image.shape[:2]
        return self._joints_of(self._people.expected(image, expected, known))

    def _joints_of(self, people: list[Person]) -> tuple[np.ndarray, np.ndarray]:
        if not people:
            return np.empty((0, len(self.skeleton), 2)), np.empty((0, len(self.skeleton)))
        xy = corrected_torso(np.stack([person.xy for person in people]))
        score = np.stack([confidence(person) for person in people])
        # A joint outside of the image was not seen: its place is a guess.
        height, width = self._size
        inside = np.all((xy >= -0.5) & (xy <= (width - 0.5, height - 0.5)), -1)
        return np.where(inside[..., None], xy, np.nan), np.where(inside, score, np.nan)
