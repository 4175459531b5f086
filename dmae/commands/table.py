"""`dmae table`: a table of the paper, published rows and rows measured here."""

from pathlib import Path

from dmae.data.json_values import json_text
from dmae.evaluation.config import TableConfig
from dmae.evaluation.paper_tables.layout import markdown, terminal_tables
from dmae.evaluation.paper_tables.tables import make_table
from dmae.files.contents import write_atomic
from dmae.reporting.tables import print_tables


def run(config: TableConfig, out: Path) -> None:
    table = make_table(config, out)
    path = out / f"table_{config.number}"
    write_atomic(path.with_suffix(".json"), json_text(table) + "\n")
    write_atomic(path.with_suffix(".md"), markdown(table))
    print_tables(terminal_tables(table))
    print(*table["footnotes"], path.with_suffix(".json"), path.with_suffix(".md"), sep="\n")
