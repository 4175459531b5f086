"""Mapping files, which rename the joints and markers of a recording."""

from pathlib import Path

from dmae.files.contents import read_text
from dmae.files.structured import parse_yaml

_MOST_BYTES = 1 << 20


def read_mapping(path: Path) -> dict[str, str]:
    """Read a YAML file of lines `their name: our name`.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file has other content, or a value that is no name.
    """
    if not path.is_file():
        raise FileNotFoundError(f"motion.mapping: no such file {path}")
    try:
        mapping = parse_yaml(read_text(path, _MOST_BYTES))
    except ValueError as error:
        raise ValueError(f"{path}: expected YAML lines `their name: our name`: {error}") from error
    if not isinstance(mapping, dict) or not mapping:
        raise ValueError(f"{path}: expected YAML lines `their name: our name`, found {type(mapping).__name__}")
    wrong = [f"{theirs!r}: {ours!r}" for theirs, ours in mapping.items() if not isinstance(ours, str)]
    if wrong:
        raise ValueError(f"{path}: expected a name after each colon, found {', '.join(wrong)}")
    return {str(theirs): ours for theirs, ours in mapping.items()}


def renamed(names: tuple[str, ...], mapping: dict[str, str], known: set[str], path: Path) -> tuple[str, ...]:
    """Return names, replaced where a mapping contains them.

    Raises:
        ValueError: the mapping has none of the names, or maps two of them to the same name.
    """
    if not mapping:
        return names
    there = [theirs for theirs in names if theirs in mapping]
    if not there:
        raise ValueError(
            f"{path}: expected a name of motion.mapping, which has {', '.join(mapping)}; found {', '.join(names)}"
        )
    meant = [mapping[theirs] for theirs in there if mapping[theirs] in known]
    twice = sorted({ours for ours in meant if meant.count(ours) > 1})
    if not meant or twice:
        raise ValueError(
            f"{path}: expected motion.mapping to map one of {', '.join(names)} to each of our names, found "
            + (f"several for {', '.join(twice)}" if twice else f"none for {', '.join(sorted(known))}")
        )
    return tuple(mapping.get(theirs, theirs) for theirs in names)
