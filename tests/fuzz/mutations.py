"""Changes of files: bits, lengths, numbers, and the structure of JSON, YAML, TOML and XML."""

import copy
import json
import re
import struct
from collections.abc import Callable

import numpy as np

from tests.fuzz.containers import unpacked

NUMBERS = [
    "0", "-1", "1", "2", "0.5", "-0.0", "1e-320", "1e-30", "1e5", "1e9", "1e18", "-1e18", "1e308", "-1e308", "1e400",
    "nan", "NaN", "inf", "-inf", "Infinity", ".inf", ".nan", "65536", "2147483647", "2147483648", "4294967296",
    "9223372036854775807", "99999999999999999999999", "1" * 400, "0x10", "1_0", "1e", "--1", "3.7", "300",
]  # fmt: skip
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_EXTREMES = [
    *(struct.pack(f"<{kind}", value) for kind, value in (
        ("H", 0xFFFF), ("H", 0x8000), ("I", 0xFFFFFFFF), ("I", 0x7FFFFFFF), ("I", 0x40000000), ("I", 1), ("Q", 2**63),
        ("Q", 2**40), ("f", np.inf), ("f", np.nan), ("f", 3e38), ("f", -1e30), ("f", 1e-40), ("d", np.inf),
        ("d", np.nan), ("d", 1e308), ("d", 1e18), ("d", 1e-320), ("d", 0.0),
    )),
    *(struct.pack(f">{kind}", value) for kind, value in (("H", 65534), ("I", 2**32 - 2), ("I", 60_000), ("Q", 2**62))),
]  # fmt: skip
_VALUES = [
    None, "", "x", "..", "/etc/x", 0, -1, 1.5, 1e308, 2**70, True, [], {}, [[]], [1], {"a": 1}, float("nan"),
    float("inf"),
]  # fmt: skip
_BOMBS = [
    "[" * 5000, "{" * 5000, '{"a":' * 3000, "&a [*a, *a]", "(" * 3000, "<a>" * 3000, "9" * 6000, "a." * 3000,
    "-\n" * 3000,
]  # fmt: skip

Change = Callable[[bytes, np.random.Generator], bytes]


_INSIDE = 0.7
"""Share of the changes of a file that packs others which are made inside."""


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Return the data with one to three changes; those of archives and the like are mostly made inside."""
    packed = unpacked(data)
    if packed and any(packed[0]) and rng.random() < _INSIDE:
        pieces, pack = packed
        chosen = rng.choice([place for place, piece in enumerate(pieces) if piece])
        return pack([_changed_bytes(piece, rng) if place == chosen else piece for place, piece in enumerate(pieces)])
    return _changed_bytes(data, rng)


def _changed_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    text = _is_text(data)
    changes = [_flip, _cut, _repeat, _remove, _overwrite, _insert, _extreme]
    if text:
        changes = [_flip, _cut, _repeat, _remove, _insert, *[_number] * 5, *[_line] * 2, _bomb, *[_tree] * 5]
    for _ in range(rng.integers(1, 4) if rng.random() < 0.4 else 1):
        data = changes[rng.integers(len(changes))](data, rng)
    return data


def _is_text(data: bytes) -> bool:
    try:
        return "\0" not in data[:4000].decode(errors="strict" if len(data) <= 4000 else "ignore")
    except UnicodeDecodeError:
        return False


def _span(data: bytes, rng) -> tuple[int, int]:
    start = int(rng.integers(len(data) + 1))
    return start, min(start + int(2 ** rng.uniform(0, 8)), len(data))


def _flip(data, rng):
    changed = bytearray(data)
    for place in rng.integers(max(len(data), 1), size=rng.integers(1, 9)) if data else ():
        changed[place] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _cut(data, rng):
    return data[: int(rng.integers(len(data) + 1))]


def _repeat(data, rng):
    start, end = _span(data, rng)
    return data[:start] + data[start:end] * int(rng.integers(2, 200)) + data[end:]


def _remove(data, rng):
    start, end = _span(data, rng)
    return data[:start] + data[end:]


def _overwrite(data, rng):
    start, end = _span(data, rng)
    return data[:start] + bytes([(0, 255, 127, 128)[rng.integers(4)]]) * (end - start) + data[end:]


def _insert(data, rng):
    start = int(rng.integers(len(data) + 1))
    return data[:start] + rng.bytes(int(rng.integers(1, 40))) + data[start:]


def _extreme(data, rng):
    """Put a number that is an extreme of its kind; near the beginning, where headers are, every other time."""
    value = _EXTREMES[rng.integers(len(_EXTREMES))]
    end = min(len(data), 600) if rng.random() < 0.5 else len(data)
    start = int(rng.integers(max(end - len(value), 0) + 1))
    start -= start % (1 if rng.random() < 0.3 else min(len(value), 4))
    return data[:start] + value + data[start + len(value) :]


def _number(data, rng):
    text = data.decode(errors="surrogateescape")
    found = list(_NUMBER.finditer(text))
    if not found:
        return _flip(data, rng)
    place = found[rng.integers(len(found))]
    text = text[: place.start()] + NUMBERS[rng.integers(len(NUMBERS))] + text[place.end() :]
    return text.encode(errors="surrogateescape")


def _line(data, rng):
    lines = data.split(b"\n")
    one, other = (int(place) for place in rng.integers(len(lines), size=2))
    match int(rng.integers(4)):
        case 0:
            lines[one:one] = [lines[other]]
        case 1:
            del lines[one]
        case 2:
            lines[one], lines[other] = lines[other], lines[one]
        case 3:
            words = lines[one].split(b" ")
            words[int(rng.integers(len(words)))] = [b"", b"x", b"-", b":", b'"'][rng.integers(5)]
            lines[one] = b" ".join(words)
    return b"\n".join(lines)


def _bomb(data, rng):
    start = int(rng.integers(len(data) + 1))
    return data[:start] + _BOMBS[rng.integers(len(_BOMBS))].encode() + data[start:]


def _tree(data, rng):
    """Change a value, a key, or the order of a JSON tree; of JSON lines, in one of them; of others, a line."""
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        lines = data.split(b"\n")
        place = int(rng.integers(len(lines)))
        try:
            tree = json.loads(lines[place])
        except (ValueError, RecursionError):
            return _line(data, rng)
        lines[place] = json.dumps(_changed(tree, rng)).encode()
        return b"\n".join(lines)
    return json.dumps(_changed(tree, rng)).encode()


def _changed(tree, rng):
    tree = copy.deepcopy(tree)
    places = []

    def visit(node):
        for key in node if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ():
            places.append((node, key))
            visit(node[key])

    visit(tree)
    if not places:
        return _VALUES[rng.integers(len(_VALUES))]
    node, key = places[rng.integers(len(places))]
    match int(rng.integers(6)):
        case 0:
            del node[key]
        case 1 if isinstance(node, dict):
            node[str(_VALUES[rng.integers(len(_VALUES))])] = node.pop(key)
        case 2 if isinstance(node[key], list):
            node[key] = node[key] * int(rng.integers(0, 4))
        case 3:
            other, place = places[rng.integers(len(places))]
            node[key] = copy.deepcopy(other.get(place) if isinstance(other, dict) else other[place : place + 1])
        case _:
            node[key] = _VALUES[rng.integers(len(_VALUES))]
    return tree
