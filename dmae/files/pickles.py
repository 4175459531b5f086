"""Values in pickles, read without unpickling: a pickle is a program, and no program from others is run.

The opcodes are decoded by `pickletools`, which runs none of them. A small stack machine interprets the opcodes with
which NumPy and Python write containers, texts, numbers and arrays of numbers, and builds these values itself. The
functions that NumPy's pickles call are compared by name and never looked up.

`pickle.Unpickler` with its own `find_class` refuses functions as well, but neither its memory nor its time has a bound:
seven bytes state a place in the memo for which it allocates gigabytes, and tuples within each other as a key of a
dictionary, 200 bytes, are hashed for minutes.
"""

import io
import pickletools
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np

MOST_DEPTH = 32
"""Largest depth of nested containers."""
_MOST_STACK = 100_000
_EXPANSION, _LEAST_LIMIT = 20, 1_000_000
"""Values that a file may contain, with repeated containers counted each time: the first number per byte, or the
second if that is more."""
_MOST_EMPTY = 100_000  # Largest length of an axis of an array if another axis has length zero
_MODULES = ("numpy.core.multiarray", "numpy._core.multiarray")
_GLOBALS = {
    ("numpy", "dtype"): "dtype",
    ("numpy", "ndarray"): "ndarray",
    ("_codecs", "encode"): "encode",
    ("__builtin__", "bytes"): "bytes",
    **{(module, name): name for module in _MODULES for name in ("_reconstruct", "scalar")},
}
_CODES = {"b1", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8", "O8"}
_PUSHED = {
    *("INT", "LONG", "BININT", "BININT1", "BININT2", "LONG1", "LONG4", "FLOAT", "BINFLOAT", "STRING", "BINSTRING"),
    *("SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8", "BINBYTES", "SHORT_BINBYTES"),
    "BINBYTES8",
}  # fmt: skip
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False, "EMPTY_TUPLE": ()}


@dataclass(frozen=True)
class _Global:
    """A function that a pickle names. It is only compared, never called."""

    name: str


@dataclass
class _Type:
    """A type of array elements. NumPy's pickles state its byte order after creating it."""

    code: str
    order: str = "|"

    def dtype(self) -> np.dtype:
        return np.dtype(object if self.code == "O8" else f"{self.order}{self.code}")


@dataclass
class _Unfilled:
    """An array before its shape and contents are stated, and its places in the memo."""

    places: list[int]


def pickled_values(data: bytes):
    """Return the content of a pickle: dictionaries, lists, tuples, texts, bytes, numbers, arrays. Nothing is run.

    Raises ValueError if it is malformed, refers to anything else, or contains more values than its size justifies.
    """
    try:
        with warnings.catch_warnings(action="ignore"):  # warnings about invalid escape sequences
            value = _interpret(data)
    except (IndexError, KeyError, TypeError, OverflowError, AttributeError) as error:
        raise ValueError(f"its pickle is damaged: {error}") from None
    if _expanded(value, {}, 0)[0] > max(_LEAST_LIMIT, _EXPANSION * len(data)):
        raise ValueError("the same containers occur in it too often")
    return value


def _interpret(data: bytes):
    """Return the value that the opcodes of a pickle leave on the stack."""
    stack: list = []
    below: list[list] = []  # The stacks below the marks
    memo: dict[int, object] = {}
    opcodes: Iterator[tuple[pickletools.OpcodeInfo, Any, Any]] = pickletools.genops(io.BytesIO(data))
    for opcode, argument, position in opcodes:
        match opcode.name:
            case name if name in _PUSHED:
                stack.append(argument)
            case name if name in _CONSTANTS:
                stack.append(_CONSTANTS[name])
            case "EMPTY_LIST":
                stack.append([])
            case "EMPTY_DICT":
                stack.append({})
            case "MARK":
                below.append(stack)
                stack = []
            case "LIST":
                items, stack = stack, below.pop()
                stack.append(items)
            case "TUPLE":
                items, stack = stack, below.pop()
                stack.append(tuple(items))
            case "DICT":
                items, stack = stack, below.pop()
                stack.append(_dictionary(items))
            case "TUPLE1" | "TUPLE2" | "TUPLE3" as name:
                count = int(name[-1])
                if len(stack) < count:
                    raise ValueError("its pickle is damaged: a tuple lacks items")
                stack[-count:] = [tuple(stack[-count:])]
            case "APPEND":
                item = stack.pop()
                _expect(stack[-1], list).append(item)
            case "APPENDS":
                items, stack = stack, below.pop()
                _expect(stack[-1], list).extend(items)
            case "SETITEM":
                item = [stack.pop(-2), stack.pop()]
                _expect(stack[-1], dict).update(_dictionary(item))
            case "SETITEMS":
                items, stack = stack, below.pop()
                _expect(stack[-1], dict).update(_dictionary(items))
            case "PUT" | "BINPUT" | "LONG_BINPUT" | "MEMOIZE" as name:
                place = len(memo) if name == "MEMOIZE" else argument
                memo[place] = stack[-1]
                if isinstance(stack[-1], _Unfilled):
                    stack[-1].places.append(place)
            case "GET" | "BINGET" | "LONG_BINGET":
                stack.append(memo[argument])
            case "GLOBAL":
                stack.append(_named(*argument.split(" ", 1)))
            case "STACK_GLOBAL":
                stack.append(_named(stack.pop(-2), stack.pop()))
            case "REDUCE":
                arguments = stack.pop()
                stack.append(_call(stack.pop(), arguments))
            case "BUILD":
                state = stack.pop()
                stack[-1] = _built(stack[-1], state, memo)
            case "POP":
                stack.pop()
            case "POP_MARK":
                stack = below.pop()
            case "PROTO" | "FRAME":
                pass
            case "STOP":
                break
            case name:
                raise ValueError(f"it requests the operation {name}, which is not read")
        if len(stack) > _MOST_STACK or len(below) > 2 * MOST_DEPTH:
            raise ValueError(f"it has too many values within each other at byte {position}")
    if len(stack) != 1 or below:
        raise ValueError("its pickle is cut short")
    return stack[0]


def _named(module, name) -> _Global:
    """Return a function by name, if it is one that NumPy's pickles call."""
    if not (isinstance(module, str) and isinstance(name, str) and (module, name) in _GLOBALS):
        raise ValueError(f"it requests {module}.{name}, which is not loaded")
    return _Global(_GLOBALS[module, name])


def _built(target, state, memo: dict[int, object]):
    """Return a type of elements with its byte order, or an array with its contents, which also goes into the memo."""
    if isinstance(target, _Type):
        _, order, *parts = _expect(state, tuple)
        if order not in ("<", ">", "|", "=") or parts[:3] != [None] * 3:
            raise ValueError("it holds an array of elements that are no numbers")
        target.order = order
        return target
    if isinstance(target, _Unfilled):
        array = _array(*_expect(state, tuple)[1:])
        memo.update(dict.fromkeys(target.places, array))
        return array
    raise ValueError(f"it sets the attributes of a {type(target).__name__}, which is not read")


def _call(function, arguments):
    """Return the result of one of the functions that NumPy's pickles name."""
    name = function.name if isinstance(function, _Global) else type(function).__name__
    match name, arguments:
        case "dtype", (str(code), *_) if code in _CODES:
            return _Type(code)
        case "_reconstruct", (_Global("ndarray"), *_):
            return _Unfilled([])
        case "scalar", (_Type() as kind, bytes(data)) if kind.code != "O8":
            return np.frombuffer(data, kind.dtype(), 1)[0]
        case "encode", (str(text), *_):
            return text.encode("latin1")
        case "bytes", ():
            return b""
    raise ValueError(f"it requests {name} of {type(arguments).__name__}, which is not read")


def _array(shape, kind, fortran, contents) -> np.ndarray:
    if not (isinstance(shape, tuple) and len(shape) <= 16 and all(type(n) is int and n >= 0 for n in shape)):
        raise ValueError("it holds an array without a shape")
    count = prod(shape)
    if count == 0 and max(shape) > _MOST_EMPTY:
        raise ValueError(f"it holds an empty array of shape {shape}")
    dtype = _expect(kind, _Type).dtype()
    if dtype.hasobject:
        if len(_expect(contents, list)) != count:
            raise ValueError(f"it holds an array of shape {shape} with {len(contents)} elements")
        array = np.empty(count, object)
        for place, item in enumerate(contents):
            array[place] = item
    else:
        if isinstance(contents, str):  # a string of Python 2
            contents = contents.encode("latin1")
        if len(_expect(contents, bytes)) != count * dtype.itemsize:
            raise ValueError(f"it holds an array of shape {shape} and {dtype} with {len(contents)} bytes")
        array = np.frombuffer(contents, dtype).astype(dtype.newbyteorder("="))
    return array.reshape(shape, order="F" if fortran else "C")


def _dictionary(items: list) -> dict:
    if len(items) % 2:
        raise ValueError("its pickle is damaged: a key lacks its value")
    keys, values = items[::2], items[1::2]
    for key in keys:
        # Larger integers can be chosen to have the same hash, which makes dictionaries slow.
        if not (isinstance(key, str | bytes) or (isinstance(key, int | np.integer) and abs(int(key)) < 1 << 60)):
            raise ValueError(f"it holds a dictionary with a key of type {type(key).__name__}")
    for key, value in zip(keys, values, strict=True):
        if isinstance(value, np.ndarray) and value.dtype.hasobject:
            raise ValueError(f"it holds a dictionary with an array of objects as {key!r:.40}, expected numbers")
    return dict(zip(keys, values, strict=True))


def _expect(value, kind: type):
    if not isinstance(value, kind):
        raise ValueError(f"its pickle is damaged: expected {kind.__name__}, found {type(value).__name__}")
    return value


def _expanded(value, known: dict[int, tuple[int, int]], depth: int) -> tuple[int, int]:
    """Return the number of values in a value, and their depth; repeated containers, visited once, count each time."""
    if depth > MOST_DEPTH:
        raise ValueError(f"it has containers within each other deeper than {MOST_DEPTH}")
    if isinstance(value, _Global | _Type | _Unfilled):
        raise ValueError(f"it holds a bare {type(value).__name__.strip('_').lower()}")
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return 1 + value.size, 0
    if not isinstance(value, dict | list | tuple | np.ndarray):
        return 1, 0
    if id(value) not in known:
        items = value.values() if isinstance(value, dict) else value.flat if isinstance(value, np.ndarray) else value
        of_items = [_expanded(item, known, depth + 1) for item in items]
        count, deepest = sum(count for count, _ in of_items), max((deep for _, deep in of_items), default=0)
        known[id(value)] = 1 + count, 1 + deepest
    count, deepest = known[id(value)]
    if depth + deepest > MOST_DEPTH:
        raise ValueError(f"it has containers within each other deeper than {MOST_DEPTH}")
    return count, deepest
