"""Make a table of the paper."""

from pathlib import Path

from dmae.evaluation.paper_tables.codes import codes_table
from dmae.evaluation.paper_tables.config import TableConfig
from dmae.evaluation.paper_tables.fusion import fusion_table
from dmae.evaluation.paper_tables.interactions import interaction_table
from dmae.evaluation.paper_tables.recording import actor_table, camera_table

_MAKERS = {1: actor_table, 2: camera_table, 3: interaction_table, 4: fusion_table, 5: codes_table}


def make_table(config: TableConfig, out: Path) -> dict:
    """Return a table of the paper, see `dmae.evaluation.paper_tables.table.paper_table`.

    Args:
        config: The number of the table and its data.
        out: Folder for models: a training that was interrupted is continued, one that is finished is not repeated.

    Raises:
        ValueError: the data does not fit the table (no truth, another skeleton, or more or fewer clips than it is
            about), or the folder holds models of other data or options.
    """
    return _MAKERS[config.number](config, out)
