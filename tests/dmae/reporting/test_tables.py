"""Tables as text."""

from dmae.reporting.tables import Table, print_tables


def test_a_pipe_gets_every_cell_in_full(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    wide = Table("wide", ("method", *(f"column {i}" for i in range(30))), [["x", *["1234.5"] * 30]])
    print_tables([wide])
    assert capsys.readouterr().out.count("1234.5") == 30
