"""JSON, YAML and TOML as dictionaries, lists, texts and numbers, XML as elements; all nested to a bounded depth.

Python's parsers and PyYAML's safe loader read them. Repeated keys are refused, of which these keep the last, and so are
YAML's aliases and XML's entities, with which a kilobyte can expand to gigabytes.
"""

import json
import re
import tomllib
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from dmae.files.contents import read_text

MOST_DEPTH = 32
"""Largest depth of nested tables and lists."""
_MOST_YAML = 16 << 20  # Largest size of a YAML or TOML file, bytes
_MOST_JSON = 1 << 30
_TEXT = re.compile(rb'"(?:[^"\\]|\\.)*+"?+', re.DOTALL)
_NO_BRACKETS = bytes(set(range(256)) - set(b"[{]}"))
_DOTTED = re.compile(rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{MOST_DEPTH + 1}}}""")
_PLAIN = (str, int, float, bool, type(None))


def read_json(path: Path):
    """Read a JSON file.

    Raises FileNotFoundError, or ValueError with line and column if it is malformed or nested too deeply, or has a key
    twice.
    """
    text = read_text(path, _MOST_JSON)
    try:
        return parse_json(text)
    except ValueError as error:
        raise ValueError(f"{path}: expected JSON, {error}") from None


def parse_json(text: str):
    """Return the value of a JSON text; errors as in `read_json`, without the file."""
    # Brackets outside of texts. Counting them takes less time than walking through the values afterwards.
    brackets = np.frombuffer(_TEXT.sub(b"", text.encode(errors="replace")).translate(None, _NO_BRACKETS), np.uint8)
    depth = np.cumsum(np.where(np.isin(brackets, (ord("["), ord("{"))), 1, -1), dtype=np.int32)
    if depth.max(initial=0) > MOST_DEPTH:
        raise ValueError(f"it is nested deeper than {MOST_DEPTH}")
    return json.loads(text, object_pairs_hook=_unique)


def _unique(pairs: list[tuple]) -> dict:
    """Refuse repeated keys: `json` would keep only the last of two cameras with one name."""
    found = dict(pairs)
    if len(found) < len(pairs):
        count = Counter(key for key, _ in pairs)
        raise ValueError(f"key {next(key for key in count if count[key] > 1)!r} twice in an object")
    return found


def read_yaml(path: Path):
    """Read a YAML file; an empty one is None.

    Raises FileNotFoundError, or ValueError if it is malformed or nested too deeply, or has aliases, tags, or a key
    twice.
    """
    text = read_text(path, _MOST_YAML)
    try:
        return parse_yaml(text)
    except ValueError as error:
        raise ValueError(f"{path}: expected YAML, {error}") from None


def parse_yaml(text: str, *, texts: bool = False):
    """Return the value of a YAML text; errors as in `read_yaml`, without the file."""
    import yaml  # `--help` does not need it

    name = "BaseLoader" if texts else "SafeLoader"
    loader = getattr(yaml, f"C{name}", getattr(yaml, name))
    try:
        _check_events(yaml.parse(text, loader), yaml)
        made = loader(text)
        try:
            node = made.get_single_node()
            value = None if node is None else made.construct_document(node)
        finally:
            made.dispose()
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from None
    except (TypeError, AttributeError, OverflowError, RecursionError) as error:
        # PyYAML raises these itself, for example for a date in a 13th month.
        raise ValueError(f"a value cannot be read, {error}") from None
    if not texts:
        check_plain(value)
    return value


def _check_events(events, yaml) -> None:
    """Refuse aliases, too deep nesting and repeated keys before any value is built."""
    open_tables: list[list | None] = []  # for each: its keys, and whether a key is next; None for a list

    def next_value(key: str | None) -> None:
        table = open_tables[-1] if open_tables else None
        if table is None:
            return
        keys, is_key = table
        if is_key and key is not None:
            if key in keys:
                raise ValueError(f"key {key!r} twice in a table")
            keys.add(key)
        table[1] = not is_key

    for event in events:
        if isinstance(event, yaml.AliasEvent):
            raise ValueError(f"line {event.start_mark.line + 1}: aliases (*{event.anchor}) are not read; write it out")
        if isinstance(event, yaml.ScalarEvent):
            next_value(event.value)
        elif isinstance(event, yaml.CollectionStartEvent):
            next_value(None)
            open_tables.append([set(), True] if isinstance(event, yaml.MappingStartEvent) else None)
            if len(open_tables) > MOST_DEPTH:
                raise ValueError(f"line {event.start_mark.line + 1}: it is nested deeper than {MOST_DEPTH}")
        elif isinstance(event, yaml.CollectionEndEvent):
            open_tables.pop()


def read_toml(path: Path) -> dict:
    """Read a TOML file. Raises FileNotFoundError, or ValueError if it is malformed or nested too deeply."""
    text = read_text(path, _MOST_YAML)
    try:
        # The parser's memory grows with the square of their number.
        if _DOTTED.search(text):
            raise ValueError(f"it has a key of more than {MOST_DEPTH} parts")
        found = tomllib.loads(text)
        check_plain(found)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected TOML, {error}") from None
    return found


class _Elements(ElementTree.TreeBuilder):
    """Refuses document types, which are the only places for entities, and too deep nesting, as soon as they appear."""

    def __init__(self, most: int):
        super().__init__()
        self.depth, self.most = 0, most

    def doctype(self, name: str, *_) -> None:
        raise ValueError(f"it has a document type, {name}, which can define entities")

    def start(self, tag, attributes):
        self.depth += 1
        if self.depth > self.most:
            raise ValueError(f"it is nested deeper than {self.most}")
        return super().start(tag, attributes)

    def end(self, tag):
        self.depth -= 1
        return super().end(tag)


def parse_xml(text: str, most_depth: int = MOST_DEPTH) -> ElementTree.Element:
    """Return the root of an XML text. Raises ValueError if it is malformed or nested too deeply, or has entities."""
    parser = ElementTree.XMLParser(target=_Elements(most_depth))
    try:
        parser.feed(text)
        return parser.close()
    except ElementTree.ParseError as error:
        raise ValueError(str(error)) from None


def check_plain(value) -> None:
    """Raise ValueError unless a value consists of dictionaries, lists, texts, numbers and None, to a bounded depth."""
    layer = [value]
    for _ in range(MOST_DEPTH + 1):
        found = []
        for each in layer:
            if isinstance(each, dict):
                odd = next((key for key in each if not isinstance(key, _PLAIN)), None)
                if odd is not None:
                    raise ValueError(f"expected texts as keys, found {odd!r:.60}")
                found += each.values()
            elif isinstance(each, list):
                found += each
            elif not isinstance(each, _PLAIN):
                raise ValueError(
                    f"expected texts, numbers, lists and tables, found a {type(each).__name__}: {each!s:.60}"
                )
        if not found:
            return
        layer = found
    raise ValueError(f"it is nested deeper than {MOST_DEPTH}")
