"""Published rows: figures of others, each with its source and its protocol, from `published.toml` in the same
folder."""

import tomllib
from importlib.resources import files

_SECOND_HAND = "figures from a secondary source, not from the publication itself"
_REQUIRED = {"table", "name", "data", "protocol", "source", "values"}
_OPTIONAL = {"note", "second_hand"}


def published_rows(number: int) -> list[dict]:
    """Return the published rows of a table.

    Args:
        number: Of the table.

    Returns:
        In the order of the file: `name`, `data` (what it was scored on), `protocol`, `source`, `note`, and `values` by
        the key of the column.

    Raises:
        ValueError: a row has other keys than it may have, or lacks one.
    """
    text = files(__package__).joinpath("published.toml").read_text(encoding="utf-8")
    rows = tomllib.loads(text)["row"]
    for row in rows:
        if unfit := (set(row) - _OPTIONAL) ^ _REQUIRED:
            raise ValueError(f"published.toml, {row.get('name')!r}: unknown or missing {sorted(unfit)}")
    return [_with_note(row) for row in rows if row["table"] == number]


def _with_note(row: dict) -> dict:
    notes = [row.get("note", ""), _SECOND_HAND if row.get("second_hand") else ""]
    return {key: row[key] for key in ("name", "data", "protocol", "source", "values")} | {
        "note": "; ".join(filter(None, notes))
    }
