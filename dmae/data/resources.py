"""Find the data files of the project: next to the packages in a checkout, inside the packages in a wheel."""

import re
from pathlib import Path
from typing import TypeVar

from dmae.nearest import unknown

T = TypeVar("T")


def resource_folder(package: str, name: str) -> Path:
    """Return the folder `configs` of `dmae` or `scenes` of `synth`; FileNotFoundError in a damaged installation."""
    root = Path(__file__).parents[2]
    places = [root / package / f"_{name}", root / name]
    for place in places:
        if place.is_dir():
            return place
    raise FileNotFoundError(f"the installation lacks its {name}: looked at {places[0]} and {places[1]}")


def read_preset(kind: type[T], group: str, name: str) -> T:
    """Return a configuration as the preset `configs/GROUP/NAME.yaml` of the package, or a YAML file, sets it.

    Raises ValueError, with the nearest name, if there is no such preset, or the file is none; FileNotFoundError.
    """
    from dmae.data.typed import decode
    from dmae.files.structured import read_yaml  # it loads NumPy, which `--help` does not need

    files = {file.stem: file for file in (resource_folder("dmae", "configs") / group).glob("*.yaml")}
    file = files.get(name, Path(name))
    if not file.suffix:
        raise ValueError(f"{group}={name}: {unknown('preset', name, sorted(files))}, or a YAML file")
    if not file.is_file():
        raise FileNotFoundError(f"{group}={name}: no such file")
    values = read_yaml(file) or {}
    check_data(file, group, values)
    return decode(kind, values, str(file))


FUNCTION = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
"""`package.module:function`, which registries accept in addition to their own names."""


def check_data(file: Path, key: str, value: object) -> None:
    """Raise ValueError if a value in the file of a preset, which people share, names a function, or is filled in."""
    if isinstance(value, dict):
        for name, member in value.items():
            check_data(file, f"{key}.{name}", member)
    elif isinstance(value, list):
        for place, member in enumerate(value):
            check_data(file, f"{key}[{place}]", member)
    elif isinstance(value, str) and "${" in value:
        raise ValueError(f"{file}: {key}: a preset holds values; {value!r:.60} would be filled in from elsewhere")
    elif isinstance(value, str) and FUNCTION.fullmatch(value):
        raise ValueError(f"{file}: {key}: a preset cannot name a function, {value!r:.60}; name it in the command line")
