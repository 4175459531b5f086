"""Check that the shapes of arrays agree."""


def check_shapes(what: str, values: object, shapes: dict[str, tuple[int, ...]]) -> None:
    """Check the shapes of the arrays of an object.

    Raises:
        ValueError: an array has another shape; the message names it.
    """
    for name, shape in shapes.items():
        found = getattr(values, name).shape
        if found != shape:
            raise ValueError(f"{what}: expected {name} of shape {shape}, found {found}")
