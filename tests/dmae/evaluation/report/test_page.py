import json
import re
from dataclasses import replace

import numpy as np
import pytest

import dmae
from dmae.data.conversion import convert
from dmae.data.images import Images
from dmae.data.skeleton import COCO17
from dmae.evaluation.report import page as report_page
from dmae.evaluation.report.page import angles_section, write_clips_report
from dmae.formats.poses import SOURCE_WORDS
from tests.support.animals import dog_clip
from tests.support.clips import full_clip
from tests.support.reported_clips import completed_clip


def players(path):
    return json.loads(re.search(r'id="clips">(.*?)</script>', path.read_text(), re.DOTALL).group(1))


def test_long_clips_are_shown_around_their_worst_frame(tmp_path, monkeypatch):
    monkeypatch.setattr(report_page, "MOST_FRAMES", 8)
    write_clips_report(tmp_path / "report.html", [completed_clip()])
    (shown,) = players(tmp_path / "report.html")
    assert (shown["first"], shown["frames"]) == (6, 8)
    assert "The clip is long: the player shows frames 6 to 13 of 30." in shown["notes"]
    text = (tmp_path / "report.html").read_text()
    inside = re.findall(r'data-frame="(\d+)"', text)
    assert inside and all(6 <= int(frame) < 14 for frame in inside)


def test_of_many_clips_the_worst_are_in_the_player_and_all_in_the_table(tmp_path, monkeypatch):
    monkeypatch.setattr(report_page, "MOST_CLIPS", 2)
    bad = completed_clip()
    good = replace(bad, id="good", poses=bad.truth)
    clips = [good, replace(bad, id="bad"), replace(good, id="also good"), replace(bad, id="worse")]
    clips.append(replace(good, id="uncaptured", poses=None))
    dmae.report(clips, tmp_path / "report.html", title="Five")
    assert [each["id"] for each in players(tmp_path / "report.html")] == ["bad", "worse"]
    text = (tmp_path / "report.html").read_text()
    assert "<h1>Five</h1>" in text and "The player contains 2 of them" in text
    assert all(each.id in text for each in clips)
    assert "5 clips: 150 frames" in text and "1 clip is not captured yet" in text


def test_clips_with_one_id_are_told_apart(tmp_path):
    clip, page = completed_clip(), tmp_path / "report.html"
    found = write_clips_report(page, [replace(clip, id="walk"), replace(clip, id="walk").select(frames=range(20))])
    assert [each.id for each in found] == [each["id"] for each in players(page)] == ["walk", "walk (2)"]
    assert set(re.findall(r'data-clip="(.*?)"', page.read_text())) == {"walk", "walk (2)"}


def test_people_and_sources_have_the_names_of_files(tmp_path):
    write_clips_report(tmp_path / "report.html", [completed_clip()])
    text = (tmp_path / "report.html").read_text()
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in text.split("Doubtful joints of")[1].split("<tr")[2:6]]
    assert all(row[1] in ("P1", "P2") and row[6] in SOURCE_WORDS.values() for row in rows)
    assert all(re.fullmatch(r"[1-4] / [04]", row[7]) for row in rows)


def test_images_that_are_gone_are_said_to_be(tmp_path):
    clip = replace(full_clip(), images=Images(tmp_path / "gone", full_clip().rig.names, tuple(range(12)), ("rgb",)))
    dmae.report(clip, tmp_path / "report.html")
    (shown,) = players(tmp_path / "report.html")
    assert shown["notes"][-1].startswith("The images of cameras cam0, cam1, cam2, cam3 cannot be read")


def test_a_data_set_without_clips_is_a_page(tmp_path):
    dmae.report([], tmp_path / "report.html", scores=[])
    assert "This data set has no clip" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize("lost", ["truth", "poses"])
def test_joints_at_infinity_do_not_break_the_page(tmp_path, lost):
    clip = completed_clip()
    xyz = getattr(clip, lost).xyz.copy()
    xyz[3, 0, 2] = np.inf
    dmae.report(replace(clip, **{lost: replace(getattr(clip, lost), xyz=xyz)}), tmp_path / "report.html")
    assert players(tmp_path / "report.html")[0]["frames"] == 30


def test_angles_that_a_skeleton_does_not_show_are_said_and_not_drawn():
    """Without feet each person had an empty panel of ankles, from -0.04 to 0.04 degrees."""
    clip = completed_clip()
    without = replace(clip, poses=convert(clip.poses, COCO17))
    (section,) = angles_section(without, slice(0, 30))
    assert [len(figure.figure.axes) for figure in section.figures] == [2] * clip.poses.xyz.shape[1]
    assert "No joints of coco17 show ankles here." in section.text
    (section,) = angles_section(clip, slice(0, 30))
    assert {len(figure.figure.axes) for figure in section.figures} == {3} and "No joints" not in section.text


def test_joint_angles_are_drawn_for_each_person_of_one_clip(tmp_path):
    clip = completed_clip()
    write_clips_report(tmp_path / "one.html", [clip])
    page = (tmp_path / "one.html").read_text()
    assert "<h2>Joint angles</h2>" in page
    persons = clip.poses.xyz.shape[1]
    assert page.count("with one standard deviation on both sides.</figcaption>") == persons
    clips = [clip, replace(clip, id="b")], [replace(clip, fps=0.5)], [dog_clip(20)]
    for others in clips:
        write_clips_report(tmp_path / "others.html", others)
        assert "Joint angles" not in (tmp_path / "others.html").read_text()
