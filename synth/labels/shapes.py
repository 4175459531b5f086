"""Check that arrays fit together."""


def check_shapes(what: str, values: object, shapes: dict[str, tuple[int, ...]]) -> None:
    """Check the shapes of arrays that an object has.

    Raises:
        ValueError: one is of another shape; the message names it.
    """
    for name, shape in shapes.items():
        found = getattr(values, name).shape
        if found != shape:
            raise ValueError(f"{what}: expected {name} of shape {shape}, found {found}")
