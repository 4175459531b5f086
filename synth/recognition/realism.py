"""What a real detector finds of people in plain sight: their appearance, crops, rates, and a sheet of the worst."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from dmae.data.clip import Clip, Detections2D
from dmae.data.conversion import convert, convert_detections
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip
from dmae.detection.pipeline import make_detector
from dmae.detection.registry import ImageDetector, PoseDetectorConfig
from dmae.numerics.body import body_heading
from dmae.parallel import in_parallel
from dmae.progress import progress
from synth.detector.parts import KINDS
from synth.detector.simulated_detector import body25_columns
from synth.scene.spec import SceneSpec

STATURE = 1.7
"""Height of a body if its clip does not state it, m."""
_FACING, _AWAY = np.radians(60), np.radians(120)
_BENT = np.radians(45)
_SEATED = 0.6
"""Height of the hips above the feet below which a person counts as seated, relative to the length of the leg."""
_INDEX = {joint: i for i, joint in enumerate(BODY25.joints)}


@dataclass(frozen=True)
class Sightings:
    """The P people of a clip in its V views, in F frames."""

    xy: np.ndarray  # (F, V, P, 25, 2) true joints of BODY25, px; NaN behind the camera
    visibility: np.ndarray  # (F, V, P, 25) `Visibility`
    depth_margin: np.ndarray  # (F, V, P, 25) distance in depth between a hidden joint and its occluder, m
    # (F, V, P) height that the body would have if it stood upright at its distance, px; NaN behind the camera
    height: np.ndarray
    distance: np.ndarray  # (F, V, P) distance from the camera to the hips, m
    # (F, V, P) angle between the direction to the camera and the direction that the body faces, rad, 0 to pi
    turned: np.ndarray
    bent: np.ndarray  # (F, P) True where the trunk leans by more than 45 degrees
    seated: np.ndarray  # (F, P) True where the hips are as low as on a chair. This includes crouching.

    @property
    def visible(self) -> np.ndarray:
        """(F, V, P, 25) True for visible joints."""
        return self.visibility == Visibility.VISIBLE

    @property
    def unobstructed(self) -> np.ndarray:
        """(F, V, P, 25) True for joints that are visible or hidden only by the person's own body."""
        return self.visibility <= Visibility.HIDDEN_BY_SELF

    @property
    def direction(self) -> np.ndarray:
        """(F, V, P) text: direction of the body towards the camera, sideways, or away from it."""
        return np.select([self.turned < _FACING, self.turned > _AWAY], ["facing", "away"], "sideways")

    @property
    def posture(self) -> np.ndarray:
        """(F, P) text: upright, bent or seated."""
        return np.select([self.bent, self.seated], ["bent", "seated"], "upright")

    @property
    def crowding(self) -> np.ndarray:
        """(F, V, P) distance in the image from hips to the nearest other hips, in heights; inf for a person alone."""
        hips = self.xy[..., _INDEX["mid_hip"], :]
        apart = np.linalg.norm(hips[..., :, None, :] - hips[..., None, :, :], axis=-1)
        people = np.arange(apart.shape[-1])
        apart[..., people, people] = np.inf
        return np.where(np.isnan(apart), np.inf, apart).min(-1, initial=np.inf) / self.height


def sightings(clip: Clip) -> Sightings:
    """Return the appearance of the people of a clip in its views.

    Raises ValueError if the clip has no truth, or no visibility labels.
    """
    if clip.truth is None or clip.occlusion is None or clip.occlusion.depth_margin is None:
        raise ValueError(f"clip {clip.id!r}: expected truth and labels of visibility, as synth generate makes them")
    columns = body25_columns(clip.truth)
    xyz = convert(clip.truth, BODY25).xyz.astype(np.float64)
    rig = clip.actual_rig
    xy, depth = rig.project(xyz)
    hips = xyz[:, :, _INDEX["mid_hip"]]
    depth = np.where(depth[..., _INDEX["mid_hip"]] > 0, depth[..., _INDEX["mid_hip"]], np.nan)
    focal = rig.focal
    sight = rig.centers[:, None] - hips[:, None]
    heading = body_heading(xyz, BODY25)[:, None]
    turned = np.abs(np.angle(np.exp(1j * (heading - np.arctan2(sight[..., 1], sight[..., 0])))))
    trunk = xyz[:, :, _INDEX["neck"]] - hips
    lean = np.arccos(np.clip(trunk[..., 2] / np.maximum(np.linalg.norm(trunk, axis=-1), 1e-6), -1, 1))
    hip, knee, ankle = (xyz[:, :, BODY25.index(f"l_{part}", f"r_{part}")] for part in ("hip", "knee", "ankle"))
    leg = (np.linalg.norm(hip - knee, axis=-1) + np.linalg.norm(knee - ankle, axis=-1)).max(-1)
    hips_over_feet = (hip[..., 2].mean(-1) - ankle[..., 2].min(-1)) / np.maximum(leg, 1e-6)
    scene = scene_of(clip)
    statures = [person.body.stature for person in scene.persons] if scene else [STATURE] * xyz.shape[1]
    return Sightings(
        xy=xy,
        visibility=clip.occlusion.visibility[..., columns],
        depth_margin=clip.occlusion.depth_margin[..., columns],
        height=np.array(statures) * focal[:, None] / depth,
        distance=np.linalg.norm(sight, axis=-1),
        turned=turned,
        bent=lean > _BENT,
        seated=hips_over_feet < _SEATED,
    )


def scene_of(clip: Clip) -> SceneSpec | None:
    """Return the scene of a simulated clip; None for a recording."""
    return SceneSpec.of(clip) if clip.provenance.get("spec") else None


# Run a detector on crops of single people. Each crop is around the true position; no other information is given.

UNOBSTRUCTED = 0.8
"""A person is in plain sight if at least this share of the joints is visible, or hidden only by the person's own
body."""
NEAR = 0.05
"""Greatest error of a joint that counts as near its true position, as a fraction of the height of the body."""
_MATCHED = 0.2
"""A detection belongs to the person that its joints are nearest to, if the median error of the visible joints is below
this fraction of the height. Of two people side by side, one could otherwise count as found by the joints of the other.
"""
SIDES = (1.3, 1.6, 2.0)
"""Sides of the crops, relative to the longer side of the box around the joints. Wider crops are tried if the person is
not found in narrower ones."""
_AROUND_JOINTS = 1.15
"""Side of the square around a body relative to that around its joints."""
_LEAST = 40
"""Least height of a person, px. Smaller people are left out."""
_BLACK = np.zeros((64, 64, 3), np.uint8)


@dataclass(frozen=True)
class Crop:
    """One person in one image."""

    # frame, view, person: Indices in the clip
    frame: int
    view: int
    person: int
    found: bool  # Whether the detector found the person
    taken: bool  # Whether it did not, but found another person of the image in the crop
    error: np.ndarray  # (25,) error of each joint, relative to the height; NaN where it was not reported
    counted: np.ndarray  # (25,) True for visible joints that the detector's skeleton has
    xy: np.ndarray  # (25, 2) detected joints, px of the whole image; NaN where not detected
    corner: tuple[int, int]  # (x, y) corner of the crop in the image, px
    side: int  # Side of the crop, px
    dark: bool  # Whether a dark body is in front of a dark background

    @property
    def near(self) -> int:
        """The number of counted joints near their true positions."""
        with np.errstate(invalid="ignore"):
            return int((self.counted & (self.error < NEAR)).sum())


def crops(clip: Clip, seen: Sightings, detector: ImageDetector, every: int = 1) -> Iterator[Crop]:
    """Yield each person in plain sight, in each frame that is used.

    The detector gets a black image before each crop, so that it keeps no state of the previous one.

    Raises ValueError if the clip has no colour images.
    """
    if clip.images is None or not clip.has_images:
        raise ValueError(f"clip {clip.id!r} has no colour images; make it with images=rgb")
    chosen = in_plain_sight(seen)
    for frame in range(0, len(clip), every):
        for view, name in enumerate(clip.rig.names):
            people = np.flatnonzero(chosen[frame, view])
            if len(people):
                image = clip.images.at("rgb", name, frame)
            for person in people:
                yield found_in(image, seen, (frame, view, int(person)), detector)


def in_plain_sight(seen: Sightings) -> np.ndarray:
    """Return (F, V, P) True for people in plain sight who are large enough for a detector."""
    with np.errstate(invalid="ignore"):
        return (seen.unobstructed.mean(-1) >= UNOBSTRUCTED) & (seen.height >= _LEAST)


def found_in(image: np.ndarray, seen: Sightings, place: tuple[int, int, int], detector: ImageDetector) -> Crop:
    """Return the result for the person at a frame, view and person, in an image (H, W, 3) uint8 RGB of that view."""
    shape = (1, 1, 1, len(detector.skeleton))
    everything = Detections2D(detector.skeleton, np.zeros((*shape, 2)), np.ones(shape))
    reported = ~np.isnan(convert_detections(everything, BODY25).score.ravel())
    for wide in SIDES:
        crop = _looked_for(image, seen, place, detector, seen.visible[place] & reported, wide)
        if crop.found:
            break
    return crop


def cut(image: np.ndarray, corner: tuple[int, int], side: int) -> np.ndarray:
    """Return a square crop (side, side, 3) of an image. It is black outside the image."""
    left, top = corner
    shift = np.array([[1.0, 0.0, left], [0.0, 1.0, top]])
    return cv2.warpAffine(image, shift, (side, side), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)


def _looked_for(
    image: np.ndarray,
    seen: Sightings,
    place: tuple[int, int, int],
    detector: ImageDetector,
    counted: np.ndarray,
    wide: float,
) -> Crop:
    frame, view, person = place
    true, height = seen.xy[place], seen.height[place]
    low, high = np.nanmin(true, 0), np.nanmax(true, 0)
    side = max(round(wide * float((high - low).max())), _LEAST)
    left, top = np.round((low + high) / 2 - side / 2)
    corner = (int(left), int(top))
    square = cut(image, corner, side)
    if hasattr(detector, "in_boxes"):
        # A model of a user is told where the person is. Otherwise BlazePose's finder would decide who is found.
        box = [*(low + high) / 2 - corner + 0.5, _AROUND_JOINTS * (high - low).max()]
        xy, score = detector.in_boxes(square, np.array([box]))
    else:
        detector(_BLACK)
        xy, score = detector(square)
    shape = (1, 1, len(xy), len(detector.skeleton))
    found = Detections2D(detector.skeleton, np.reshape(xy, (*shape, 2)), np.reshape(score, shape))
    places = convert_detections(found, BODY25).xy[0, 0].astype(np.float64) + corner
    off = np.linalg.norm(places[:, None] - seen.xy[frame, view], axis=-1) / height  # (detections, people, 25)
    belongs = _median(off).argmin(-1) == person
    medians = _median(np.where(counted, off[:, person], np.nan))
    best = min(range(len(places)), key=lambda i: (not belongs[i], medians[i]), default=-1)
    is_found = bool(best >= 0 and belongs[best] and medians[best] < _MATCHED)
    others = np.delete(_median(off), person, 1)
    absent = np.full(len(BODY25), np.nan)
    return Crop(
        *place,
        found=is_found,
        taken=bool(not is_found and (others < _MATCHED).any()),
        error=off[best, person] if is_found else absent,
        counted=counted,
        xy=places[best] if best >= 0 else np.stack([absent, absent], -1),
        corner=corner,
        side=side,
        dark=_is_dark(square, true - corner, counted, low - corner, high - corner),
    )


def _median(off: np.ndarray) -> np.ndarray:
    """Return the medians along the last axis, without NaN; inf where all are NaN."""
    return np.nanmedian(np.where(np.isnan(off).all(-1, keepdims=True), np.inf, off), -1)


_BODY_DARK, _BEHIND_DARK = 70, 100
"""Greatest median brightness, 0 to 255, of a dark body and of a dark background."""


def _is_dark(square: np.ndarray, joints: np.ndarray, visible: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether trunk and legs are dark, and the surroundings of the box around the joints are dark as well."""
    grey = square.mean(-1)
    trunk = BODY25.index("neck", "l_shoulder", "r_shoulder", "mid_hip", "l_hip", "r_hip", "l_knee", "r_knee")
    at = joints[[joint for joint in trunk if visible[joint]]]
    at = np.clip(np.round(at).astype(int), 0, len(grey) - 1)
    around = np.ones(grey.shape, bool)
    left, top = np.maximum(low - 0.1 * (high - low), 0).astype(int)
    right, bottom = np.ceil(high + 0.1 * (high - low)).astype(int)
    around[top:bottom, left:right] = False
    around &= square.any(-1)
    if not len(at) or not around.any():
        return False
    return bool(np.median(grey[at[:, 1], at[:, 0]]) < _BODY_DARK and np.median(grey[around]) < _BEHIND_DARK)


# The realism meter: detection rate and joint errors of a real detector on people in plain sight.

_WELL_VISIBLE = 0.8
_DISTANCES = (3.0, 5.0, 8.0)
_SIZES = (120.0, 200.0, 400.0)
_APART = (0.25, 0.5, 1.0)


@dataclass(frozen=True)
class Judged:
    """One person in one image, with its groups."""

    clip: Path  # Folder of the clip
    crop: Crop  # The result of the detector
    groups: dict[str, str]  # Group of the person under each heading, for example {"room": "office"}


@dataclass(frozen=True)
class Rate:
    """A row of the meter."""

    # heading, group: For example "room" and "office"
    heading: str
    group: str
    people: int  # Number of people in plain sight
    found: float | None  # Share of these people that were found
    joints: int  # Number of visible joints of the people that were found
    near: float | None  # Share of these joints with an error within 5 % of the height of the body
    # Median error of these joints, relative to the height. Like `found` and `near`, it is None without data.
    median: float | None


def judge(folders: Sequence[str | Path], config: PoseDetectorConfig, every: int = 1, workers: int = 1) -> list[Judged]:
    """Run a detector on each person in plain sight in the images of clips, every so many frames. Raises as
    `synth.realism`."""
    tasks = [(clip, config, every) for folder in folders for clip in clip_folders(Path(folder))]
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
    for kind in dict.fromkeys(KINDS):
        some = [replace(each.crop, counted=each.crop.counted & (kind == KINDS)) for each in judged]
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
    clip = load_clip(folder)
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
        groups["hat"], groups["bag"] = (each.kind if each else "none" for each in (looks.hat, looks.bag))
        groups["beard"] = looks.beard or "none"
    well, alone = seen.visible[place].mean() >= _WELL_VISIBLE, _is_alone(seen, crop)
    cut_off = (seen.visibility[place] == Visibility.OUTSIDE_IMAGE).any()
    groups |= {
        "visible": "80 % of the joints or more" if well else "fewer: the body hides its own",
        "company": "alone in the image" if alone else "others in the image",
        "nearest hips": _range(seen.crowding[place], _APART, "heights"),
        "border": "some joints are outside of the image" if cut_off else "whole in the image",
        "direction": str(seen.direction[place]),
        "posture": str(seen.posture[of_person]),
        "distance": _range(seen.distance[place], _DISTANCES, "m"),
        "size": _range(seen.height[place], _SIZES, "px"),
        "contrast": "dark before dark" if crop.dark else "other",
    }
    if not crop.found:
        groups["missed"] = "another person is found instead" if crop.taken else "nobody is found there"
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
    return (name, str(row.people), percent(row.found), str(row.joints), percent(row.near), percent(row.median))


HEAD = ("people in plain sight", "people", "found, %", "visible joints", f"within {NEAR:.0%} of the height, %",
        "median error, % of the height")  # fmt: skip
"""Headings of the columns of `described`."""


def percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"


# An image of the people with the worst detections: the crop of each, with true and detected joints.

_TILE, _LINE = 200, 16
_TRUE, _FOUND, _PAPER, _INK = (60, 220, 90), (240, 60, 50), (22, 25, 30), (233, 236, 240)


def worst(judged: Sequence[Judged], count: int) -> list[Judged]:
    """Return at most `count` people: first people that were not found, then those with the fewest near joints."""
    return sorted(judged, key=lambda each: (each.crop.found, each.crop.near / max(each.crop.counted.sum(), 1)))[:count]


def draw_sheet(judged: Sequence[Judged], columns: int = 6) -> np.ndarray:
    """Return an image (H, W, 3) uint8 RGB with one tile per person: true joints in green, detected joints in red."""
    tiles = {}
    for folder in dict.fromkeys(each.clip for each in judged):
        clip = load_clip(folder)
        seen = sightings(clip)
        assert clip.images is not None
        for each in judged:
            if each.clip == folder:
                crop = each.crop
                image = clip.images.at("rgb", clip.rig.names[crop.view], crop.frame)
                true = seen.xy[crop.frame, crop.view, crop.person]
                tiles[id(each)] = _tile(cut(image, crop.corner, crop.side), each, true)
    rows = [[tiles[id(each)] for each in judged[first : first + columns]] for first in range(0, len(judged), columns)]
    sheet = np.full((len(rows) * (_TILE + _LINE), columns * _TILE, 3), _PAPER, np.uint8)
    for y, row in enumerate(rows):
        for x, tile in enumerate(row):
            sheet[y * (_TILE + _LINE) : (y + 1) * (_TILE + _LINE), x * _TILE : (x + 1) * _TILE] = tile
    return sheet


def _tile(square: np.ndarray, each: Judged, true: np.ndarray) -> np.ndarray:
    crop, scale = each.crop, _TILE / each.crop.side
    shrinks = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    tile = np.full((_TILE + _LINE, _TILE, 3), _PAPER, np.uint8)
    tile[:_TILE] = cv2.resize(square, (_TILE, _TILE), interpolation=shrinks)
    for joints, colour in ((true, _TRUE), (crop.xy, _FOUND)):
        places = (joints - crop.corner + 0.5) * scale - 0.5
        for a, b in BODY25.bones:
            if np.isfinite(places[[a, b]]).all():
                start, end = np.round(places[[a, b]]).astype(int).tolist()
                cv2.line(tile, start, end, colour, 1, cv2.LINE_AA)
    tile[_TILE:] = _PAPER
    words = f"{crop.near} of {crop.counted.sum()} near" if crop.found else "not found"
    text = f"{words}, {each.groups['direction']}, {each.groups['posture']}"
    cv2.putText(tile, text, (3, _TILE + 12), cv2.FONT_HERSHEY_SIMPLEX, 0.33, _INK, 1, cv2.LINE_AA)
    return tile
