"""The demo goes from an empty folder to a page."""

import json

import pytest

from dmae.commands import demo
from dmae.commands.config import DemoCommand


@pytest.mark.slow
def test_the_demo_makes_a_page(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    demo.run(DemoCommand(workers=1), tmp_path / "demo,2")
    printed = capsys.readouterr().out
    assert "[8/8] report" in printed and "report.html; what the steps printed" in printed
    assert (tmp_path / "demo,2/report.html").is_file()
    results = json.loads((tmp_path / "demo,2/scores/scores.json").read_text())["results"]
    assert [result["method"] for result in results] == ["measured", "linear", "dmae", "model"]
    assert len(printed.splitlines()) < 30
    page = (tmp_path / "demo,2/report.html").read_text()
    hidden = [f"{result['mean']['hidden']['mpjpe']:.0f}\N{NO-BREAK SPACE}mm" for result in results[1:]]
    assert "What to look at: press Play." in page
    assert f"{hidden[1]} with these weights, {hidden[2]} with the network" in page
