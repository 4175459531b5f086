"""Tables of the paper: published rows and measured rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path


def table(number: int, data: str | Path, out: str | Path, *overrides: str) -> dict:
    """Reproduce a table of the paper: published rows and rows measured here, with intervals.

    Args:
        number: Number of the table in the paper, 1 to 5.
        data: A recording with truth for tables 1, 2 and 4; a data set that `synth.generate` made for 3 and 5.
        out: Folder for trained models. A training that is already finished in it is not repeated.
        overrides: Options as on the command line: `"size=small"`, `"protocol=4da"`, `"extra_data=[more]"`.

    Returns:
        The table, as in `table_N.json`.

    Raises:
        ValueError: the data does not fit the table, `out` contains models of other data, or an option is unknown.

    Examples:
        >>> for clip in synth.generate(seconds=1, clips=1, seed=7, out="walks"): pass
        >>> made = dmae.table(2, "walks/000000", "table", "size=small")
        >>> sorted({row["origin"] for row in made["rows"]})
        ['measured here', 'not measured', 'published']
    """
    from dmae.evaluation.paper_tables.learned import make_table
    from dmae.formats.reading import recognise
    from dmae.public.options import composed

    config = composed("table", f"number={number}", *overrides)
    source = replace(config.data, path=str(data), name=recognise(Path(data)))
    return make_table(replace(config, data=source), Path(out))
