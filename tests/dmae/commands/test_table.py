"""`dmae table`."""

import json

from dmae.data.store import save_clip
from tests.support.commands import dmae
from tests.support.scored_clips import seen


def test_a_table_is_written_as_json_and_markdown_and_printed(tmp_path):
    save_clip(seen(), tmp_path / "walkers")
    done = dmae(tmp_path, "table", "number=1", "data=walkers", "size=small", "out=tables")
    assert done.returncode == 0, done.stderr
    table = json.loads((tmp_path / "tables/table_1.json").read_text())
    text = (tmp_path / "tables/table_1.md").read_text()
    for row in table["rows"]:
        assert row["name"] in text
        assert row["name"] in done.stdout
    assert done.stdout.rstrip().endswith("tables/table_1.json\ntables/table_1.md")
    assert sorted(path.name for path in (tmp_path / "tables").iterdir()) == [
        "config.yaml", "table_1.json", "table_1.md"
    ]  # fmt: skip
