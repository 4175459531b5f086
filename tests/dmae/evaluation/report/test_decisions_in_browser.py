"""Decisions that a reader takes on the page, in headless Chromium."""

import pytest

from dmae.evaluation.report.page import write_clips_report
from dmae.evaluation.review import DECISIONS, load_decisions, rank_doubts
from tests.support.browser import opened
from tests.support.reported_clips import completed_clip

pytestmark = pytest.mark.browser


def test_decisions_on_doubtful_joints_are_saved_as_commands_read_them(browser, tmp_path):
    clip, path = completed_clip(), tmp_path / "report.html"
    write_clips_report(path, [clip])
    with opened(browser, path) as page:
        save = page.locator("button.save")
        assert save.is_disabled()
        choices = page.locator("select.verdict")
        assert choices.count() == 40
        choices.nth(0).select_option("blank")
        choices.nth(3).select_option("hand_back")
        assert save.text_content() == "Save decisions.json (2 of 40 decided)"
        with page.expect_download() as download:
            save.click()
        download.value.save_as(tmp_path / DECISIONS)
    ranking = rank_doubts(clip)
    assert load_decisions(tmp_path, clip.poses) == (ranking[0].decision("blank"), ranking[3].decision("hand_back"))
