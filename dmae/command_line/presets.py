"""Presets of users, found by `--config-dir` or given as files: data that people share, checked before it is used.

Hydra would take more from such a file than options: where a value goes, files to write, functions to call, variables of
the environment. So Hydra is not given the folder, but checked values.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from dmae.command_line.options import Command, Group, Option, Preset
from dmae.command_line.spelling import like
from dmae.data.json_values import merged
from dmae.data.resources import check_data
from dmae.files.contents import read_text
from dmae.files.structured import parse_yaml

_NAME = re.compile(r"[\w-]+")
_MOST_BYTES = 1 << 20


def read_presets(command: Command, folder: Path) -> dict[str, dict[str, Preset]]:
    """Return the presets of a command's groups in `folder/<group>/<name>.yaml`, by group and name.

    Raises ValueError if there is no such folder, or a file is no preset, or is called like one of the package; the
    message names it and the option, and says what a preset can hold.
    """
    if not folder.is_dir():
        raise ValueError(f"--config-dir {folder}: no such folder")
    return {
        group: {file.stem: checked_preset(command, group, file) for file in sorted((folder / group).glob("*.yaml"))}
        for group in command.presets
    }


def is_preset(key: str, value: object) -> bool:
    """Return whether a value is the file of a preset, `<key>/<name>.yaml` in any folder."""
    path = Path(str(value))
    return path.suffix == ".yaml" and path.absolute().parent.name == key and path.is_file()


def own_presets(
    command: Command, options: Group, folders: Sequence[Path], overrides: Iterable[str]
) -> tuple[dict[str, dict[str, Preset]], list[str]]:
    """Return the presets in folders and those given as files, and overrides with the names of these.

    `detector=mine/detector/fog.yaml` becomes `detector=fog`. An option that is not a group, as `dmae pretrain rig=...`,
    gets the file in `folders` where a name is given. Raises ValueError as `read_presets`.
    """
    own: dict[str, dict[str, Preset]] = {}
    for folder in folders:
        for key, presets in read_presets(command, folder).items():
            own[key] = own.get(key, {}) | presets
    taken = []
    for override in overrides:
        key, equals, value = override.partition("=")
        found, values = options.find(key), value.split(",")
        for place, each in enumerate(values):
            if isinstance(found, Group) and found.presets and is_preset(key, each):
                own.setdefault(key, {})[Path(each).stem] = checked_preset(command, key, Path(each))
                values[place] = Path(each).stem
            elif isinstance(found, Option) and _NAME.fullmatch(each):
                files = [folder / key / f"{each}.yaml" for folder in folders]
                values[place] = str(next((file for file in files if file.is_file()), each))
        taken.append(f"{key}{equals}{','.join(values)}")
    return own, taken


def checked_preset(command: Command, group: str, file: Path) -> Preset:
    """Return the checked preset of a file. It may begin with presets of the package, as `defaults: [terrible]`."""
    options, shipped = command.options(), command.presets_of(group)
    if file.stem in shipped:
        raise ValueError(
            f"{file}: {group}={file.stem} is a preset of the package, and would be used; give the file another name"
        )
    if not _NAME.fullmatch(file.stem):
        raise ValueError(f"{str(file)!r}: expected a preset's name of letters, digits, - and _")
    text = read_text(file, _MOST_BYTES)
    try:
        values = parse_yaml(text)
    except ValueError as error:
        raise ValueError(f"{file}: expected YAML, {error}") from None
    values = {} if values is None else values
    if not isinstance(values, dict):
        raise ValueError(f"{file}: expected options of {group}, found {values!r:.60}")
    above = values.pop("defaults", [])
    if not isinstance(above, list) or any(name not in ("_self_", *shipped) for name in above):
        raise ValueError(f"{file}: defaults: expected a list of presets of {group}, found {above!r:.60}")
    _check(options, file, group, values)
    made: dict[str, object] = {}
    for name in above if "_self_" in above else [*above, "_self_"]:
        own = Preset("", values) if name == "_self_" else shipped[name]
        made = merged(made, own.values if own.whole else {group: own.values})
    return Preset(Preset.of(text, None).meaning, made, whole=True)


def _check(options: Group, file: Path, key: str, value) -> None:
    """Refuse what is no option of the group; types of values are checked when the configuration is composed."""
    found = options.find(key)
    if found is None:
        raise ValueError(f"{file}: {key}: no such option; {like(options, key)}")
    if not isinstance(found, Group):
        check_data(file, key, value)
        return
    if not isinstance(value, dict):
        raise ValueError(f"{file}: {key}: expected its options, found {value!r:.60}")
    for name, member in value.items():
        _check(options, file, f"{key}.{name}", member)
