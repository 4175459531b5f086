"""Where the project's own data files are: beside the packages in a checkout, inside them in a wheel."""

from pathlib import Path


def resource_folder(package: str, name: str) -> Path:
    """The folder `configs` of `dmae` or `scenes` of `synth`.

    Raises:
        FileNotFoundError: neither place has it; the installation is broken.
    """
    root = Path(__file__).parent.parent
    places = [root / package / f"_{name}", root / name]
    for place in places:
        if place.is_dir():
            return place
    raise FileNotFoundError(f"the installation lacks its {name}: looked at {places[0]} and {places[1]}")
