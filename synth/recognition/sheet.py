"""An image of the people with the worst detections: the crop of each, with true and detected joints."""

from collections.abc import Sequence

import cv2
import numpy as np

from dmae.data.skeleton import BODY25
from dmae.formats.reading import DataConfig, load
from synth.recognition.crops import cut
from synth.recognition.meter import Judged
from synth.recognition.sightings import sightings

_TILE, _LINE = 200, 16
_TRUE, _FOUND, _PAPER, _INK = (60, 220, 90), (240, 60, 50), (22, 25, 30), (233, 236, 240)


def worst(judged: Sequence[Judged], count: int) -> list[Judged]:
    """Return at most `count` people: first people that were not found, then those with the fewest near joints."""
    return sorted(judged, key=lambda each: (each.crop.found, each.crop.near / max(each.crop.counted.sum(), 1)))[:count]


def draw_sheet(judged: Sequence[Judged], columns: int = 6) -> np.ndarray:
    """Return an image (H, W, 3) uint8 RGB with one tile per person: true joints in green, detected joints in red."""
    tiles = {}
    for folder in dict.fromkeys(each.clip for each in judged):
        clip = load(DataConfig("clip", str(folder)))[0]
        seen = sightings(clip)
        for each in judged:
            if each.clip == folder:
                crop = each.crop
                picture = clip.images.at("rgb", clip.rig.names[crop.view], crop.frame)
                true = seen.xy[crop.frame, crop.view, crop.person]
                tiles[id(each)] = _tile(cut(picture, crop.corner, crop.side), each, true)
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
                ends = [tuple(int(v) for v in np.round(places[i])) for i in (a, b)]
                cv2.line(tile, *ends, colour, 1, cv2.LINE_AA)
    tile[_TILE:] = _PAPER
    words = f"{crop.near} of {crop.counted.sum()} near" if crop.found else "not found"
    text = f"{words}, {each.groups['direction']}, {each.groups['posture']}"
    cv2.putText(tile, text, (3, _TILE + 12), cv2.FONT_HERSHEY_SIMPLEX, 0.33, _INK, 1, cv2.LINE_AA)
    return tile
