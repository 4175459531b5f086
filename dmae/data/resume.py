"""Check folders of runs that can be resumed: settings are written at the first start, and compared at later starts."""

import json
from collections.abc import Collection
from pathlib import Path

from dmae.data.json_values import flat
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json

_LISTED = 8  # Largest number of settings that a message names


def claim_folder(path: Path, settings: dict, contents: str, may_differ: Collection[str] = (), remedy: str = "") -> None:
    """Write the settings of a run to JSON, or check that an earlier run in the same folder had the same ones.

    Settings and groups of settings that `may_differ` are not compared. Raises ValueError, which names `contents` ("a
    data set") and differences, and ends in a further `remedy`.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise ValueError(f"{path}: expected a file of settings, found something else; choose another folder for out")
    if not path.is_file():
        write_atomic(path, json.dumps(settings, indent=1))
        return
    content = read_json(path)
    if not isinstance(content, dict):
        raise ValueError(
            f"{path}: expected an object of settings, found {content!r:.60}; choose another folder for out"
        )
    wanted, found = flat(json.loads(json.dumps(settings))), flat(content)
    missing = object()
    compared = [key for key in wanted | found if key.partition(".")[0] not in may_differ]
    differing = sorted(key for key in compared if wanted.get(key, missing) != found.get(key, missing))
    if differing:
        more = f" and {len(differing) - _LISTED} more" if len(differing) > _LISTED else ""
        raise ValueError(
            f"{path.parent} holds {contents} of another configuration: {path.name} differs in "
            f"{', '.join(differing[:_LISTED])}{more}. Choose another folder for out, or remove this one"
            f"{remedy and f'; {remedy}'}"
        )
