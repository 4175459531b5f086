"""Overrides held against the options of a command before anything heavy is imported; each mistake is one line.

The line names what the user probably meant: the nearest command, option, preset or choice.
"""

import re
from collections.abc import Collection, Iterable
from difflib import SequenceMatcher, get_close_matches
from itertools import pairwise
from pathlib import Path

from dmae.command_line.options import REQUIRED, Group, Option

_CONFUSED = {"clip": "data", "data": "clip"}
"""Options that one command has under the first name, and another command under the second."""


def nearest(word: str, words: Iterable[str]) -> str | None:
    """Return the most similar of some words; None if none is similar."""
    found = get_close_matches(word, list(words), 1, 0.6)
    return found[0] if found else None


def suggestion(word: str, words: Iterable[str], what: str = "there are") -> str:
    """Return the text for an unknown word: the nearest known words, or all of them if none is near."""
    words = list(words)
    near = nearest(word, words)
    return f"did you mean {near}?" if near else f"{what} {', '.join(words)}"


def choices(value: str, known: Iterable[str]) -> str:
    """Return the text for an unknown choice: the nearest one, and all of them."""
    near = nearest(value, known)
    return f"did you mean {near}? There are {', '.join(known)}" if near else f"there are {', '.join(known)}"


def like(options: Group, key: str) -> str:
    """Return the text for an unknown option: the option with the same last name, or else the most similar one."""
    keys = [member.key for member in options.walk() if not key.startswith(f"{member.key}.")]
    if _CONFUSED.get(key) in keys:
        return f"did you mean {_CONFUSED[key]}?"
    last = key.rpartition(".")[2]
    same = [each for each in keys if each.rpartition(".")[2] == last]
    if len(same) > 1:
        same = [nearest(key, same) or ""] if nearest(key, same) else same
    if len(same) == 1:
        return f"did you mean {same[0]}?"
    if same:
        return f"did you mean one of {', '.join(same[:6])}?"
    lasts = {each.rpartition(".")[2]: each for each in reversed(keys)}
    similar = {near: SequenceMatcher(None, key, near).ratio() for near in [nearest(key, keys)] if near}
    similar |= {lasts[near]: SequenceMatcher(None, last, near).ratio() for near in [nearest(last, lasts)] if near}
    if similar:
        return f"did you mean {max(similar, key=similar.get)}?"
    return f"there are {', '.join(member.key for member in options.members)}"


def meant(options: Group, word: str, required: Iterable[str] = ()) -> str:
    """Return the text for a word without `=`: the option of this or a similar name, or else one that takes a path.

    The first of the options that must be given probably has the word as its value.
    """
    keys = [member.key for member in options.walk()]
    if near := word if word in keys else nearest(word, keys):
        return f", as in {near}=..."
    value_of = next((key for key in (*required, "clip", "data") if key in keys), None)
    return f", as in {value_of}={word}" if value_of else ""


_OVERRIDE = re.compile(
    r"(?P<prefix>\+\+|\+|~)?(?P<key>[^=@]+)(?P<package>@[^=]*)?(?P<equals>=)?(?P<value>.*)", re.DOTALL
)
_NUMBER = re.compile(r"[-+]?(\d[\d_]*\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(inf|nan)", re.IGNORECASE)
_EXPECTED = {"whole number": re.compile(r"[-+]?\d[\d_]*"), "number": _NUMBER}
FUNCTION = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
"""`package.module:function`, which registries accept in addition to their own names."""
_BOOLEANS = {"true", "false", "yes", "no", "on", "off", "1", "0"}
FLAGS = (
    "--cfg", "-c", "--resolve", "--package", "-p", "--run", "-r", "--multirun", "-m", "--info", "-i", "--config-dir",
    "-cd", "--shell-completion", "-sc", "--hydra-help",
)  # fmt: skip
_WITH_VALUE = ("--cfg", "-c", "--package", "-p", "--config-dir", "-cd")
PRESET_FLAGS = ("--config-dir", "-cd")
_LOOKING = ("--cfg", "-c", "--info", "-i", "--shell-completion", "-sc", "--hydra-help")
"""Flags with which nothing is run, so that nothing need be given."""


def split_flags(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Hydra's flags, with their values, and the overrides; ValueError if there is no such flag."""
    flags, overrides, rest = [], [], iter(arguments)
    for argument in rest:
        if not argument.startswith("-"):
            overrides.append(argument)
            continue
        name, equals, _ = argument.partition("=")
        if name not in FLAGS:
            near = nearest(name, ("--help", *FLAGS))
            usual = "options are given as key=value, and the usual flags are --help, -m, --config-dir and --cfg"
            raise ValueError(f"{name}: no such flag; {f'did you mean {near}?' if near else usual}")
        flags.append(argument)
        if name in _WITH_VALUE and not equals:
            value = next(rest, None)
            if value is None:
                raise ValueError(f"{name}: expected a value after it")
            flags.append(value)
    return flags, overrides


def flag_values(flags: list[str], *names: str) -> list[str]:
    """The values that flags of these names were given."""
    found = [flag.partition("=")[2] for flag in flags if flag.partition("=")[0] in names and "=" in flag]
    return found + [value for flag, value in pairwise(flags) if flag in names]


def without_flags(flags: list[str], *names: str) -> list[str]:
    """Return the flags without those of these names, and without their values."""
    kept, skip = [], False
    for flag in flags:
        if not skip and flag.partition("=")[0] not in names:
            kept.append(flag)
        skip = not skip and flag in names
    return kept


def check(options: Group, overrides: list[str], flags: list[str]) -> None:
    """Raise ValueError for a mistyped option, preset, choice or type, or a missing option, with the nearest."""
    sweep = "-m" in flags or "--multirun" in flags
    given = [_check(options, override, sweep) for override in overrides]
    looking = any(flag.partition("=")[0] in _LOOKING for flag in flags)
    if looking or flag_values(flags, *PRESET_FLAGS):
        return
    if missing := required(options, set(given)):
        texts = (f"{key}=... ({options.find(key).meaning.partition('. ')[0].strip(' .')})" for key in missing)
        raise ValueError(f"expected {', '.join(texts)}; --help lists all options")


def required(options: Group, given: Collection[str] = ()) -> list[str]:
    """Options that have to be given, and are not; of a preset that has to be chosen nothing else is asked."""
    missing = []
    for member in options.members:
        if isinstance(member, Group) and member.preset == REQUIRED and member.key not in given:
            missing.append(member.key)
        elif isinstance(member, Group):
            missing += required(member, given)
        elif member.default == REQUIRED and member.key not in given:
            missing.append(member.key)
    return missing


def _check(options: Group, override: str, sweep: bool) -> str:
    """Check one override; the key that it gives."""
    match = _OVERRIDE.fullmatch(override)
    key, value, prefix = match["key"].strip(), match["value"], match["prefix"]
    if key.split(".")[0].split("/")[0] == "hydra":
        return key
    if not match["equals"] and prefix != "~":
        raise ValueError(f"{override}: expected key=value{meant(options, key, required(options))}")
    found = options.find(key)
    if found is None:
        parent = options.find(key.rpartition(".")[0])
        if isinstance(parent, Option) and parent.keyed:
            return key  # an entry of a dictionary
        raise ValueError(f"{key}: no such option; {like(options, key)}")
    if prefix == "+":
        raise ValueError(f"{override}: there is an option {key}; leave out the +")
    if prefix == "~":
        raise ValueError(f"{override}: options cannot be removed; give {key} another value")
    values = _elements(value)
    if len(values) > 1 and not sweep:
        raise ValueError(
            f"{override}: several values are tried in turn with -m; a list is written as {key}=[a,b], a text "
            f"with commas in quotes within quotes, as \"{key}='a,b'\""
        )
    for each in values:
        if any(sign in each for sign in "$("):
            continue  # an interpolation, or Hydra's syntax of a sweep
        if isinstance(found, Group):
            _check_preset(found, each)
        else:
            _check_value(found, each)
    return key


def _check_preset(group: Group, value: str) -> None:
    if not group.presets:
        names = ", ".join(member.key for member in group.members)
        raise ValueError(f"{group.key}={value}: expected one of its options: {names}")
    if value.strip("'\"") not in group.presets:
        by_path = f"{group.key}.path"
        file = f"; a file is {by_path}={value}" if Path(value).suffix and group.find(by_path) else ""
        raise ValueError(f"{group.key}={value}: no such choice; {choices(value, group.presets)}{file}")


def _check_value(option: Option, value: str) -> None:
    value = value.strip()
    if option.keyed:
        return
    if value == "null":
        if not option.optional:
            raise ValueError(f"{option.key}=null: expected {_expected(option)}")
        return
    bracketed = value.startswith("[") and value.endswith("]")
    # One choice is short for a list of it: see `expand_lists`.
    if option.many != bracketed and not (option.many and option.choices):
        raise ValueError(f"{option.key}={value}: expected {_expected(option)}")
    for each in _elements(value[1:-1]) if bracketed else [value]:
        plain = each.strip().strip("'\"")
        if option.kind == "text" and ":" in plain:
            continue  # module:function of a user
        # A user's module:function is checked when it is imported.
        if option.choices and plain not in option.choices and ":" not in plain:
            raise ValueError(f"{option.key}={value}: {_no(option, plain, bracketed)}; {choices(plain, option.choices)}")
        pattern = _EXPECTED.get(option.kind)
        wrong_number = pattern and not pattern.fullmatch(plain)
        if wrong_number or (option.kind == "true or false" and plain.lower() not in _BOOLEANS):
            raise ValueError(f"{option.key}={value}: expected {_expected(option)}")


def _no(option: Option, value: str, listed: bool) -> str:
    name = option.key.rpartition(".")[2]
    return f"no {'axis' if name == 'axes' else name.removesuffix('s')} {value!r}" if listed else "no such choice"


def _expected(option: Option) -> str:
    if option.choices:
        one = f"one of {', '.join(option.choices)}"
        return f"a list, as {option.key}=[{','.join(option.choices[:2])}]" if option.many else one
    if option.many:
        return f"a list{f' of {option.kind}s' if 'number' in option.kind else ''}, as {option.key}=[...]"
    return option.kind if option.kind in ("true or false", "text") else f"a {option.kind}"


def _elements(text: str) -> list[str]:
    """Parts of a text between commas that are in no bracket or quotes."""
    parts, depth, quote = [""], 0, ""
    for sign in text:
        if quote:
            quote = "" if sign == quote else quote
        elif sign in "'\"":
            quote = sign
        depth += (sign in "[({") - (sign in "])}")
        if sign == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += sign
    return [part for part in parts if part.strip()]


def expand_lists(options: Group, overrides: list[str]) -> list[str]:
    """`images=rgb` is short for `images=[rgb]`, where the option is a list of choices."""
    expanded = []
    for override in overrides:
        key, _, value = override.partition("=")
        option, values = options.find(key), _elements(value)
        listed = (
            isinstance(option, Option) and option.many and option.choices and not any("[" in each for each in values)
        )
        expanded.append(f"{key}={','.join(f'[{each}]' for each in values)}" if listed and values else override)
    return expanded


def expand_data(options: Group, overrides: list[str]) -> list[str]:
    """`data=<folder>` is short for `data=<its format> data.path=<folder>`.

    Raises ValueError, which lists the formats, if it is neither a format nor a folder.
    """
    data = options.find("data")
    if not isinstance(data, Group) or not data.presets:
        return overrides
    expanded = []
    for override in overrides:
        key, _, value = override.partition("=")
        if key != "data" or not value or set(value.split(",")) <= data.presets.keys():
            expanded.append(override)
            continue
        folders = [each.strip().strip("'\"") for each in _elements(value)]
        if len(folders) == 1 and FUNCTION.fullmatch(folders[0]):
            expanded += ["data=clip", f"data.name={value}"]
            continue
        for folder in folders:
            if not (Path(folder).exists() or "$" in folder or "(" in folder):
                raise ValueError(f"data={folder}: neither a folder nor a format; {choices(folder, data.presets)}")
        expanded += ["data=clip", "data.name=null", f"data.path={value}"]
    return expanded


def expand_names(options: Group, overrides: list[str]) -> list[str]:
    """`detector=onnx` is short for `detector.name=onnx`, where the group has a name and no presets."""
    groups = {each.key for each in options.walk() if isinstance(each, Group) and not each.presets}
    named = {key for key in groups if isinstance(options.find(f"{key}.name"), Option)}
    return [re.sub("=", ".name=", each, count=1) if each.partition("=")[0] in named else each for each in overrides]
