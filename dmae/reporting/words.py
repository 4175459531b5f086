"""Words for numbers of things."""


def counted(number: int, noun: str, plural: str = "") -> str:
    """Return "1 clip" or "2 clips"; the plural of `noun` ends in s unless it is given."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"
