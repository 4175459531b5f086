"""Find the data files of the project: next to the packages in a checkout, inside the packages in a wheel."""

from pathlib import Path


def resource_folder(package: str, name: str) -> Path:
    """Return the folder `configs` of `dmae` or `scenes` of `synth`; FileNotFoundError in a damaged installation."""
    root = Path(__file__).parents[2]
    places = [root / package / f"_{name}", root / name]
    for place in places:
        if place.is_dir():
            return place
    raise FileNotFoundError(f"the installation lacks its {name}: looked at {places[0]} and {places[1]}")
