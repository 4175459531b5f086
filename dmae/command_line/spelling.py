"""Overrides held against the options of a command before anything heavy is imported; each mistake is one line.

The line names what the user probably meant: the nearest command, option, preset or choice. Values are read with Hydra's
own parser.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from difflib import SequenceMatcher, get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmae.command_line.options import REQUIRED, Group, Option

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override

_CONFUSED = {"clip": "data", "data": "clip"}
"""Options that one command has under the first name, and another command under the second."""
FUNCTION = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
"""`package.module:function`, which registries accept in addition to their own names."""
_FLAGS = {
    "--cfg": True, "-c": True, "--package": True, "-p": True, "--config-dir": True, "-cd": True, "--resolve": False,
    "--run": False, "-r": False, "--multirun": False, "-m": False, "--info": False, "-i": False,
    "--shell-completion": False, "-sc": False, "--hydra-help": False,
}  # fmt: skip
"""Hydra's flags that are taken, and whether a value follows."""
_LOOKING = {"--cfg", "-c", "--info", "-i", "--shell-completion", "-sc", "--hydra-help"}
"""Flags with which nothing is run, so that nothing need be given."""


def nearest(word: str, words: Iterable[str]) -> str | None:
    """Return the most similar of some words, in any case of letters; None if none is similar."""
    folded = {each.lower(): each for each in words}
    return next((folded[each] for each in get_close_matches(word.lower(), folded, 1)), None)


def suggestion(word: str, words: Collection[str]) -> str:
    """Return the text for an unknown word: the nearest one, or all of them if none is near."""
    near = nearest(word, words)
    return f"did you mean {near}?" if near else f"there are {', '.join(words)}"


def choices(value: str, known: Collection[str]) -> str:
    """Return the text for an unknown choice: the nearest one, and all of them."""
    near = nearest(value, known)
    return f"did you mean {near}? There are {', '.join(known)}" if near else f"there are {', '.join(known)}"


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


def like(options: Group, key: str) -> str:
    """Return the text for an unknown option: the option with the same last name, or else the most similar one.

    If what precedes a dot is a group, options of this group come first. They are listed if none is very similar,
    with the options of the same last name in other groups.
    """
    keys = [member.key for member in options.walk() if not key.startswith(f"{member.key}.")]
    if _CONFUSED.get(key) in keys:
        return f"did you mean {_CONFUSED[key]}?"
    group = key.rpartition(".")[0]
    while group and not any(each.startswith(f"{group}.") for each in keys):
        group = group.rpartition(".")[0]
    last = key.removeprefix(f"{group}.")
    inside = [each.removeprefix(f"{group}.") for each in keys if group and each.startswith(f"{group}.")]
    similar = _similar(last, inside) if inside else _similar(key, keys)
    sure = [each for each in similar if _sure(each, last)]
    if meant := [f"{group}.{each}" for each in sure] if inside else similar:
        return f"did you mean {'one of ' * (len(meant) > 1)}{', '.join(meant[:6])}?"
    found = options.find(group) if inside else options
    members = found.members if isinstance(found, Group) else ()
    listed = ", ".join(each.key + ".*" * (bool(inside) and isinstance(each, Group)) for each in members)
    elsewhere = ", ".join([each for each in keys if each.rpartition(".")[2] == last][:6])
    return f"there are {listed}" + f"; elsewhere there is {elsewhere}" * bool(elsewhere)


def _similar(key: str, keys: Sequence[str]) -> list[str]:
    """Return the options with the last name of `key`, the most similar of them if it is near, or else a similar one."""
    last = key.rpartition(".")[2]
    if same := [each for each in keys if each.rpartition(".")[2] == last]:
        return [near] if (near := nearest(key, same)) else same
    lasts = {each.rpartition(".")[2]: each for each in reversed(keys)}
    named = [each for each in get_close_matches(last, lasts) if _sure(each, last)]
    found = [*filter(None, (nearest(key, keys), *(lasts[each] for each in named[:1])))]
    return sorted(found, key=lambda each: -max(_ratio(key, each), _ratio(last, each.rpartition(".")[2])))[:1]


def _sure(known: str, given: str) -> bool:
    return known.endswith(given) or sorted(known) == sorted(given) or _ratio(known, given) > 0.75


def _ratio(a: str, b: str) -> float:
    return SequenceMatcher(None, a, b).ratio()


def meant(options: Group, word: str, required: Iterable[str] = ()) -> str:
    """Return the text for a word without `=`: the option of this or a similar name, or else one that takes a path.

    The first of the options that must be given probably has the word as its value.
    """
    keys = [member.key for member in options.walk()]
    if near := word if word in keys else nearest(word, keys):
        return f", as in {near}=..."
    value_of = next((key for key in (*required, "videos", "clip", "data") if key in keys), None)
    return f", as in {value_of}={word}" if value_of else ""


def split_flags(arguments: Iterable[str]) -> tuple[list[str], list[Path], list[str]]:
    """Return Hydra's flags, with their values; the folders of `--config-dir`; and the overrides.

    Raises ValueError if there is no such flag.
    """
    flags, folders, overrides, rest = [], [], [], iter(arguments)
    for argument in rest:
        name, equals, value = argument.partition("=")
        if not argument.startswith("-"):
            overrides.append(argument)
            continue
        if name not in _FLAGS:
            # Without their dashes, which would make an option such as `--clips` similar to `--help`.
            flags_of = {flag.lstrip("-"): flag for flag in ("--help", *_FLAGS)}
            near = flags_of.get(nearest(name.lstrip("-"), flags_of) or "")
            usual = "options are given as key=value, and the usual flags are --help, -m, --config-dir and --cfg"
            raise ValueError(f"{name}: no such flag; {f'did you mean {near}?' if near else usual}")
        if _FLAGS[name] and not equals and not (value := next(rest, "")):
            raise ValueError(f"{name}: expected a value after it")
        if name in ("--config-dir", "-cd"):
            folders.append(Path(value))
        else:
            flags += [name, value] if value else [name]
    return flags, folders, overrides


def sweeps(flags: Collection[str]) -> bool:
    """Return whether flags make Hydra try several values in turn."""
    return not {"-m", "--multirun"}.isdisjoint(flags)


def checked(options: Group, overrides: Iterable[str], flags: Collection[str] = (), presets: bool = False) -> list[str]:
    """Return overrides as Hydra takes them: what is short for something is written out.

    Raises ValueError, with the nearest, for a mistyped option, preset, choice or value; and for an option that has to
    be given and is not, unless nothing is run or `presets` of the user may give it.
    """
    sweep = sweeps(flags)
    overrides = [override if sweep else _one_text(options, override) for override in overrides]
    overrides = [each for override in overrides for each in _expanded(options, _quoted(override))]
    taken = [_checked(options, override, sweep) for override in overrides]
    missing = required(options, {override.lstrip("+").partition("=")[0] for override in overrides})
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


def _read(override: str) -> Override:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    try:
        return OverridesParser.create().parse_override(override)
    except HydraException:
        raise ValueError(f"{override}: cannot be read; look at its quotes and brackets") from None


def _one_text(options: Group, override: str) -> str:
    """Return an override with quotes around a text or a path with commas, which Hydra would try in turn."""
    key, _, value = override.partition("=")
    found = options.find(key)
    text = isinstance(found, Option) and found.kind == "text" and not found.many
    path = key == "data" and isinstance(found, Group) and Path(value).exists()
    if "," not in value or not (text or path) or re.match(r"\s*['\"[{]", value) or "${" in value:
        return override
    return f"{key}={_in_quotes(value)}"


def _quoted(override: str) -> str:
    """Return an override with quotes around texts that Hydra cannot read without: `out='Füße (1)'`, `cameras=[a,'é']`.

    Texts that begin with quotes or brackets, or have interpolations, stay as they are.
    """
    key, _, value = override.partition("=")
    listed = value.startswith("[") and value.endswith("]")
    texts = (value[1:-1] if listed else value).split(",")
    if not value or _readable(override) or any(re.match(r"\s*['\"[{]", text) or "${" in text for text in texts):
        return override
    for number, text in enumerate(texts):
        if not _readable(f"key={text}"):
            texts[number] = _in_quotes(text.strip())
    return f"{key}={'[' * listed}{','.join(texts)}{']' * listed}"


def _in_quotes(text: str) -> str:
    # Backslashes are text unless they stand before a quote.
    text = re.sub(r"(\\*)'", r"\1\1\'", text)
    return "'" + re.sub(r"(\\+)$", r"\1\1", text) + "'"


def _readable(override: str) -> bool:
    try:
        return bool(_read(override))
    except ValueError:
        return False


def _values(override: Override) -> list[tuple[str, object]]:
    """Return the values that are tried in turn, as typed and as read; none where they need Hydra's configuration."""
    if not override.is_sweep_override():
        return [(str(override.input_line).partition("=")[2], override.value())]
    each = override.sweep_string_iterator() if override.is_choice_sweep() else ()
    return [(text, _read(f"{override.key_or_group}={text}").value()) for text in each]


def _expanded(options: Group, override: str) -> list[str]:
    """`detector=onnx` is short for `detector.name=onnx`, `data=<folder>` for `data=clip data.path=<folder>`."""
    key, _, value = override.partition("=")
    group = options.find(key)
    if not isinstance(group, Group) or not value:
        return [override]
    if not group.presets and isinstance(options.find(f"{key}.name"), Option):
        return [f"{key}.name={value}"]
    values = [str(each) for _, each in _values(_read(override))]
    if key != "data" or set(values) <= group.presets.keys():
        return [override]
    if FUNCTION.fullmatch(values[0]):
        return ["data=clip", f"data.name={value}"]
    for folder in values:
        if not (Path(folder).exists() or "${" in folder):
            similar = f"; {choices(folder, group.presets)}"
            if "/" in folder or nearest(folder, [entry.name for entry in Path().iterdir()]):
                similar = f"{similar_path(folder)} Formats are {', '.join(group.presets)}"
            raise ValueError(f"data={folder}: neither a folder nor a format{similar}")
    return ["data=clip", "data.name=null", f"data.path={value}"]


def _checked(options: Group, override: str, sweep: bool) -> str:
    """Check one override. Return it; `images=rgb`, if the option is a list, as `images=[rgb]`."""
    from hydra.core.override_parser.types import OverrideType

    if "=" not in override and not override.startswith("~"):
        raise ValueError(f"{override}: expected key=value{meant(options, override.lstrip('+'), required(options))}")
    read = _read(override)
    key = read.key_or_group
    if re.split("[./]", key)[0] == "hydra":
        return override
    found = options.find(key)
    parent = options.find(key.rpartition(".")[0]) if found is None else None
    dictionary = parent if isinstance(parent, Option) and parent.keyed else None
    if found is None and dictionary is None:
        raise ValueError(f"{key}: no such option; {like(options, key)}")
    if found is not None and read.type == OverrideType.ADD:
        raise ValueError(f"{override}: there is an option {key}; leave out the +")
    if found is not None and read.type == OverrideType.DEL:
        raise ValueError(f"{override}: options cannot be removed; give {key} another value")
    if read.is_sweep_override() and not sweep:
        if isinstance(found, Option) and found.kind == "number" and re.fullmatch(r"[^=]+=[+-]?\d+,\d+", override):
            raise ValueError(f"{override}: expected a number with a decimal point, {override.replace(',', '.')}")
        raise ValueError(
            f"{override}: several values are tried in turn with -m; a list is written as {key}=[a,b], a text "
            f"with commas in quotes within quotes, as \"{key}='a,b'\""
        )
    if found is None:
        assert dictionary is not None
        return _in_lists(key, override, _values(read)) if dictionary.many and override.startswith(key) else override
    values = _values(read)
    for text, value in values:
        if isinstance(value, str) and "${" in value:
            return override  # an interpolation
        if isinstance(found, Group):
            _check_preset(found, text, str(value))
        else:
            _check_value(found, text, value)
    return _in_lists(key, override, values) if isinstance(found, Option) and found.may_be_one else override


def _in_lists(key: str, override: str, values: list) -> str:
    """Return an override with each value as a list of it; as it is if one is a list or nothing."""
    if not values or any(value is None or isinstance(value, list) for _, value in values):
        return override
    return f"{key}={','.join(f'[{text}]' for text, _ in values)}"


def _check_preset(group: Group, text: str, value: str) -> None:
    if not group.presets:
        names = ", ".join(member.key for member in group.members)
        raise ValueError(f"{group.key}={text}: expected one of its options: {names}")
    if value not in group.presets:
        hint, by_path = "", f"{group.key}.path"
        if Path(value).suffix == ".yaml":
            found = (
                "it is elsewhere" if Path(value).exists() else f"there is no such file{similar_path(value).rstrip('.')}"
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

    if option.keyed or (value is None and option.optional):
        return
    listed, wrong = isinstance(value, list), ValueError(f"{option.key}={text}: expected {_expected(option, text)}")
    if value is None or isinstance(value, dict) or (option.many != listed and not option.may_be_one):
        raise wrong
    node: Any = {"whole number": IntegerNode, "number": FloatNode, "true or false": BooleanNode}.get(option.kind)
    for each in value if listed else [value]:
        # A user's module:function is checked when it is imported.
        if option.choices and str(each) not in option.choices and ":" not in str(each):
            name = option.key.rpartition(".")[2]
            one = "axis" if name == "axes" else name.removesuffix("s")
            no = f"no {one} {each!r}" if listed else "no such choice"
            raise ValueError(f"{option.key}={text}: {no}; {choices(str(each), option.choices)}")
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
