"""Overrides held against the options of a command before anything heavy is imported; each mistake is one line.

The line names what the user probably meant: the nearest option, preset or choice. Values are read by Hydra's own
parser.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmae.command_line.options import Group, Option
from dmae.data.resources import FUNCTION
from dmae.data.typed import REQUIRED
from dmae.nearest import choices, nearest

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override

_CONFUSED = {"clip": "data", "data": "clip"}
"""Options that one command has under the first name, and another command under the second."""
_FLAGS = {
    "-cd": "--config-dir", "-c": "--cfg", "-p": "--package", "-i": "--info",
    "-m": "--multirun", "--resolve": "--resolve",
}  # fmt: skip
"""Hydra's flags that are taken, by their short forms."""
_ALONE = ("--multirun", "--resolve")
"""Flags that no value follows."""
_LOOKING = {"--cfg", "--info"}
"""Flags with which nothing is run, so that nothing need be given."""


def split_flags(arguments: Iterable[str]) -> tuple[list[str], list[Path], list[str]]:
    """Return Hydra's flags in full, with their values; the folders of `--config-dir`; and the overrides.

    Raises ValueError if there is no such flag.
    """
    flags, folders, overrides, rest = [], [], [], iter(arguments)
    for argument in rest:
        if not argument.startswith("-"):
            overrides.append(argument)
            continue
        name, equals, value = argument.partition("=")
        flag = _FLAGS.get(name, name)
        if flag in _ALONE:
            flags.append(flag)
        elif flag in _FLAGS.values():
            if not equals and not (value := next(rest, "")):
                raise ValueError(f"{name}: expected a value after it")
            if flag == "--config-dir":
                folders.append(Path(value))
            else:
                flags += [flag, value]
        else:
            # Without their dashes, which would make an option such as `--clips` similar to `--help`.
            near = nearest(name.lstrip("-"), [each.lstrip("-") for each in ("--help", *_FLAGS.values())])
            usual = "options are given as key=value, and the usual flags are --help, -m, --config-dir and --cfg"
            raise ValueError(f"{name}: no such flag; {f'did you mean --{near}?' if near else usual}")
    return flags, folders, overrides


def checked(options: Group, overrides: Iterable[str], flags: Collection[str] = (), presets: bool = False) -> list[str]:
    """Return overrides as Hydra takes them: what is short for something is written out.

    Raises ValueError, with the nearest, for a mistyped option, preset, choice or value; and for an option that has to
    be given and is not, unless nothing is run, or `presets` of the user may give it.
    """
    sweep = "--multirun" in flags
    taken = [each for override in overrides for each in _checked(options, override, sweep)]
    missing = required(options, {override.lstrip("+").partition("=")[0] for override in taken})
    if missing and not presets and _LOOKING.isdisjoint(flags):
        wanted = (option for option in map(options.find, missing) if option)
        texts = (f"{option.key}=... ({option.meaning.partition('. ')[0].strip(' .')})" for option in wanted)
        raise ValueError(f"expected {', '.join(texts)}; --help lists all options")
    return taken


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


def _checked(options: Group, override: str, sweep: bool) -> list[str]:
    """Check one override, and return what it stands for.

    `detector=onnx` is short for `detector.name=onnx`, `interaction=mine:greet` for `interaction.kind=mine:greet`,
    `images=rgb` for `images=[rgb]`, and `data=<folder>` for
    `data=clip data.path=<folder>`.
    """
    if "=" not in override and not override.startswith("~"):
        raise ValueError(f"{override}: expected key=value{_meant(options, override.lstrip('+'))}")
    key, _, value = override.partition("=")
    found = options.find(key)
    if isinstance(found, Group) and value and not found.presets and isinstance(options.find(f"{key}.name"), Option):
        return _checked(options, f"{key}.name={value}", sweep)
    kind = options.find(f"{key}.kind")
    if isinstance(found, Group) and FUNCTION.fullmatch(value) and isinstance(kind, Option):
        return _checked(options, f"{kind.key}={value}", sweep)
    read = _read(override, found, sweep)
    key, override = read.key_or_group, str(read.input_line)
    if re.split("[./]", key)[0] == "hydra":
        return [override]
    found = _option_of(options, read)
    values = _values(read, found, sweep)
    if key == "data" and isinstance(found, Group) and not {str(each) for _, each in values} <= found.presets.keys():
        return _recordings(found, override.partition("=")[2], [str(each) for _, each in values])
    if any(isinstance(each, str) and "${" in each for _, each in values):
        return [override]  # an interpolation
    for text, each in values:
        if isinstance(found, Group):
            _check_preset(found, text, str(each))
        else:
            _check_value(found, text, each)
    one = isinstance(found, Option) and (found.may_be_one or (found.keyed and found.many))
    if one and values and not any(each is None or isinstance(each, list) for _, each in values):
        return [f"{key}={','.join(f'[{text}]' for text, _ in values)}"]
    return [override]


def _read(override: str, found: Option | Group | None, sweep: bool) -> Override:
    """Read an override, with quotes around texts that Hydra cannot read without: `out='Füße (1)'`, `cameras=[a,'é']`.

    A text or a path with commas is one, unless several values are tried in turn.
    """
    text = found.key == "data" if isinstance(found, Group) else found and found.kind == "text" and not found.many
    one = bool(text) and not sweep
    read = _parsed(override)
    if read is None or (one and read.is_sweep_override()):
        read = _parsed(_quoted(override, one))
    if read is None:
        raise ValueError(f"{override}: cannot be read; look at its quotes and brackets")
    return read


def _parsed(override: str) -> Override | None:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    try:
        return OverridesParser.create().parse_override(override)
    except HydraException:
        return None


def _quoted(override: str, one: bool) -> str:
    """Return an override with its text in quotes, or, unless it is `one`, those texts between commas that need them.

    Texts that begin with quotes or brackets, or have interpolations, stay as they are.
    """
    from hydra.core.override_parser.types import Quote, QuotedString

    key, _, value = override.partition("=")
    listed = value.startswith("[") and value.endswith("]") and not one
    texts = [value] if one else value[listed : len(value) - listed].split(",")
    if any(re.match(r"\s*['\"[{]", text) or "${" in text for text in texts):
        return override
    for place, text in enumerate(texts):
        if one or not _parsed(f"key={text}"):
            texts[place] = QuotedString(text.strip(), Quote.single).with_quotes()
    return f"{key}={'[' * listed}{','.join(texts)}{']' * listed}"


def _option_of(options: Group, read: Override) -> Option | Group:
    """Return the option that an override sets; an entry of a dictionary as an option of its own, without a default."""
    key, override = read.key_or_group, read.input_line
    found = options.find(key)
    if found is None:
        place, _, name = key.rpartition(".")
        dictionary = options.find(place)
        if isinstance(dictionary, Option) and dictionary.keyed:
            if isinstance(dictionary.default, dict) and dictionary.default and name not in dictionary.default:
                raise ValueError(f"{key}: no such option; {choices(name, dictionary.default)}")
            return replace(dictionary, key=key, default=None)
        raise ValueError(f"{key}: no such option; {like(options, key)}")
    if read.is_add():
        raise ValueError(f"{override}: there is an option {key}; leave out the +")
    if read.is_delete():
        raise ValueError(f"{override}: options cannot be removed; give {key} another value")
    return found


def _values(read: Override, found: Option | Group, sweep: bool) -> list[tuple[str, Any]]:
    """Return the values that are tried in turn, as typed and as read; none where they are a range or a pattern."""
    override = str(read.input_line)
    if not read.is_sweep_override():
        return [(override.partition("=")[2], read.value())]
    if not sweep:
        number = isinstance(found, Option) and found.kind == "number" and not found.many
        if number and re.fullmatch(r"[^=]+=[+-]?\d+,\d+", override):
            raise ValueError(f"{override}: expected a number with a decimal point, {override.replace(',', '.')}")
        raise ValueError(
            f"{override}: several values are tried in turn with -m; a list is written as {read.key_or_group}=[a,b], "
            f"a text with commas in quotes within quotes, as \"{read.key_or_group}='a,b'\""
        )
    if not isinstance(listed := getattr(read.value(), "list", None), list):
        return []
    texts = list(read.sweep_string_iterator()) if listed else []
    return [(text, each.value()) for text in texts if (each := _parsed(f"key={text}"))]


def _recordings(data: Group, value: str, folders: list[str]) -> list[str]:
    """Return the overrides that `data=<folder>` or `data=package.module:function` is short for."""
    if FUNCTION.fullmatch(folders[0]):
        return ["data=clip", f"data.name={value}"]
    for folder in sorted(folders, key=lambda each: each in data.presets):
        if not (Path(folder).exists() or "${" in folder):
            similar = f"; {choices(folder, data.presets)}"
            if "/" in folder or nearest(folder, [entry.name for entry in Path().iterdir()]):
                similar = f"{similar_path(folder)} Formats are {', '.join(data.presets)}"
            raise ValueError(f"data={folder}: neither a folder nor a format{similar}")
    return ["data=clip", "data.name=null", f"data.path={value}"]


def _check_preset(group: Group, text: str, value: str) -> None:
    if not group.presets:
        names = ", ".join(member.key for member in group.members)
        raise ValueError(f"{group.key}={text}: expected one of its options: {names}")
    if value not in group.presets:
        hint, by_path = "", f"{group.key}.path"
        if Path(value).suffix == ".yaml":
            found = (
                f"this one is in no folder {group.key}"
                if Path(value).exists()
                else f"there is no such file{similar_path(value).rstrip('.')}"
            )
            hint = f"; a file of a preset is <folder>/{group.key}/<name>.yaml, {found}"
        elif not Path(value).suffix and not Path(value).exists() and not nearest(value, group.presets):
            hint = f"; one of yours is <folder>/{group.key}/{value}.yaml, with --config-dir=<folder>"
        if (Path(value).suffix or Path(value).exists()) and group.find(by_path):
            hint += f"; a {'folder' if Path(value).is_dir() else 'file'} is {by_path}={text}"
        raise ValueError(f"{group.key}={text}: no such choice; {choices(value, group.presets)}{hint}")


def _check_value(option: Option, text: str, value: Any) -> None:
    from omegaconf import BooleanNode, FloatNode, IntegerNode
    from omegaconf.errors import ValidationError

    if value is None and option.optional:
        return
    if isinstance(option.default, dict):
        if not isinstance(value, dict):
            entry = f"{option.key}.{next(iter(option.default), '<name>')}"
            raise ValueError(f"{option.key}={text}: expected its entries, as {entry}=...")
        for name, each in value.items():
            _check_value(replace(option, key=f"{option.key}.{name}", default=None), str(each), each)
        return
    listed, wrong = isinstance(value, list), ValueError(f"{option.key}={text}: expected {_expected(option, text)}")
    one = option.may_be_one or (option.keyed and option.many)
    if value is None or isinstance(value, dict) or (option.many != listed and not one):
        raise wrong
    node: Any = {"whole number": IntegerNode, "number": FloatNode, "true or false": BooleanNode}.get(option.kind)
    for each in value if listed else [value]:
        # A user's module:function is checked when it is imported; a folder of weights is a method as well.
        own = ":" in str(each) or (option.key == "methods" and (Path(str(each)) / "model.json").is_file())
        if option.choices and str(each) not in option.choices and not own:
            name = option.key.rpartition(".")[2]
            noun = "axis" if name == "axes" else name.removesuffix("s")
            no = f"no {noun} {each!r}" if listed else "no such choice"
            raise ValueError(
                f"{option.key}={text}: {no}; {option.instead.get(str(each)) or choices(str(each), option.choices)}"
            )
        try:
            if node:
                node(each)
        except ValidationError:
            raise wrong from None


def _expected(option: Option, text: str) -> str:
    if option.choices:
        one = f"one of {', '.join(option.choices)}"
        return f"a list, as {option.key}=[{','.join(option.choices[:2])}]" if option.many else one
    if option.many:
        # An option that is nothing by default, as data.frames, is a range or a place rather than a list.
        default = option.default if isinstance(option.default, list | tuple) else ()
        example = ",".join(map(str, default)) or (text if default == [] and text.isdecimal() else "...")
        return f"a list{f' of {option.kind}s' if 'number' in option.kind else ''}, as {option.key}=[{example}]"
    return option.kind if option.kind in ("true or false", "text") else f"a {option.kind}"


def like(options: Group, key: str) -> str:
    """Return the text for an unknown option: the most similar ones of its group, by what follows the group or by their
    last names; or, if none is very similar, all of the group, and the options of this last name in other groups.
    """
    keys = [member.key for member in options.walk() if not key.startswith(f"{member.key}.")]
    if _CONFUSED.get(key) in keys:
        return f"did you mean {_CONFUSED[key]}?"
    group = key.rpartition(".")[0]
    while group and not any(each.startswith(f"{group}.") for each in keys):
        group = group.rpartition(".")[0]
    prefix = f"{group}." if group else ""
    inside = [each for each in keys if each.startswith(prefix)]
    rest = key.removeprefix(prefix) if group else key.rpartition(".")[2]
    similarities = [
        max(_similarity(rest, each.removeprefix(prefix)), _similarity(rest, each.rpartition(".")[2])) for each in inside
    ]
    if (best := max(similarities)) > 0.75:
        equal = [each for each, similarity in zip(inside, similarities, strict=True) if similarity == best]
        depth = min(each.count(".") for each in equal)
        meant = [each for each in equal if each.count(".") == depth]
        return f"did you mean {'one of ' * (len(meant) > 1)}{', '.join(meant[:6])}?"
    found = options.find(group) if group else options
    members = found.members if isinstance(found, Group) else ()
    listed = ", ".join(each.key + ".*" * (bool(group) and isinstance(each, Group)) for each in members)
    elsewhere = ", ".join([each for each in keys if each.rpartition(".")[2] == key.rpartition(".")[2]][:6])
    return f"there are {listed}" + f"; elsewhere there is {elsewhere}" * bool(elsewhere)


def _similarity(a: str, b: str) -> float:
    a, b = a.lower(), b.lower()
    ratio = SequenceMatcher(None, a, b).ratio()
    return max(ratio, 0.8) if sorted(a) == sorted(b) else ratio  # exchanged letters, as `dmi` of `dim`


def _meant(options: Group, word: str) -> str:
    """Return the text for a word without `=`: the option of this or a similar name, or else one that takes a path.

    The first of the options that must be given probably has the word as its value.
    """
    keys = [member.key for member in options.walk()]
    if near := word if word in keys else nearest(word, keys):
        return f", as in {near}=..."
    value_of = next((key for key in (*required(options), "videos", "clip", "data") if key in keys), None)
    return f", as in {value_of}={word}" if value_of else ""


def similar_path(path: str, words: Collection[str] = ()) -> str:
    """Return the text for a path that does not exist: the most similar name in the folder that does, or in `words`.

    It begins with ";" or "." and ends a sentence.
    """
    given = Path(path)
    there = next(folder for folder in given.parents if folder.exists())
    if not there.is_dir():
        return f"; {there} is a file."
    missing = given.relative_to(there).parts
    names = {entry.name: str(there / entry.name) for entry in there.iterdir()}
    names |= {word: word for word in words if given == Path(given.name)}
    if near := nearest(missing[0], names):
        return f"; did you mean {names[near]}?"
    return "." if len(missing) == 1 else f"; there is no folder {there / missing[0]}."
