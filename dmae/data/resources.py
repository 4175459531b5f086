"""Find the data files of the project: next to the packages in a checkout, inside the packages in a wheel."""

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
    """Return a configuration as the preset `configs/GROUP/NAME.yaml` of the package sets it.

    Raises ValueError, with the nearest name, if there is no such preset.
    """
    from dmae.data.typed import decode
    from dmae.files.structured import read_yaml  # it loads NumPy, which `--help` does not need

    files = {file.stem: file for file in (resource_folder("dmae", "configs") / group).glob("*.yaml")}
    if name not in files:
        raise ValueError(f"{group}={name}: {unknown('preset', name, sorted(files))}")
    return decode(kind, read_yaml(files[name]) or {})
