"""Make a table of the paper."""

from dmae.evaluation.paper_tables.config import TableConfig
from dmae.evaluation.paper_tables.recording import actor_table, camera_table

_MAKERS = {1: actor_table, 2: camera_table}


def make_table(config: TableConfig) -> dict:
    """Return a table of the paper, see `dmae.evaluation.paper_tables.table.paper_table`.

    Raises:
        ValueError: the data does not fit the table: no truth, another skeleton, or several clips where the table is
            about one.
    """
    return _MAKERS[config.number](config)
