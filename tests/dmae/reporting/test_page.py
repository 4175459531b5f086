"""Tables as text."""

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from dmae.data.clip import Poses3D, Source
from dmae.data.images import Images, write_image
from dmae.evaluation.report.page import scores_section
from dmae.reporting.figures import COMPLETED, gaps_figure, telling_frame, views_figure
from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Moment, Table, counted, print_tables
from tests.support.clips import full_clip


@pytest.fixture
def completed():
    """A clip of two T-poses whose second person's arm is completed in frames 4 to 6, most of it in frame 5."""
    clip = full_clip()
    source = np.full(clip.truth.xyz.shape[:3], Source.MEASURED)
    source[4:7, 1, 3] = Source.COMPLETED
    source[5, 1, 4] = Source.COMPLETED
    return replace(clip, poses=Poses3D(clip.truth.skeleton, clip.truth.xyz, source))


def scores(errors):
    """Scores of two methods with the given errors by length of gap."""
    gaps = [{"frames": "1-5", "hidden": 10, "filled": 10 if e else 0, "mpjpe": e, "stated": 0} for e in errors]
    mean = {
        "pcp": 90.0,
        "pck": {"recall": 99.0, "precision": 50.0},
        "shares": {"absent": 1.0, "measured": 90.0, "denoised": 0.0, "completed": 9.0},
        "mpjpe": {"all": 40.0, "measured": 30.0, "completed": 80.0},
        "hidden": {"recall": 80.0, "mpjpe": 80.0},
        "identity_switches": 0.0,
        "gaps": gaps,
    }
    result = {"views": 4, "mean": mean, "worst": {"pcp": 80.0, "cameras": [0, 1]}}
    return {
        "recording": "made-up",
        "skeleton": "shelf14",
        "results": [{"method": "linear", **result}, {"method": "hold", **result}],
    }


def red_lines(axes):
    return [line for line in axes.lines if line.get_color() == COMPLETED and len(line.get_xdata()) == 2]


def test_only_bones_with_a_completed_end_are_red(completed):
    figure = views_figure(completed, 4)
    view = figure.axes[0]
    elbow = completed.poses.skeleton.index("r_elbow")[0]
    adjacent = sum(elbow in bone for bone in completed.poses.skeleton.bones)
    assert len(red_lines(view)) == adjacent
    assert not red_lines(views_figure(completed, 0).axes[0])


def test_columns_of_a_picture_are_even(completed):
    figure = views_figure(completed, 0)
    figure.draw_without_rendering()
    width = figure.axes[0].get_position().width
    lefts = np.array(sorted({round(panel.get_position().x0, 6) for panel in figure.axes}))
    assert len(lefts) == 4 and np.ptp(np.diff(lefts)) < 0.005 and np.diff(lefts).min() > width
    assert lefts[0] == pytest.approx(1 - lefts[-1] - width, abs=0.005)
    labels = [label for panel in figure.axes for label in (*panel.get_yticklabels(), *panel.get_xticklabels())]
    assert labels and min(label.get_window_extent().x0 for label in labels if label.get_text()) >= 0


def test_joints_are_drawn_where_the_camera_sees_them(completed):
    dots = [line for line in views_figure(completed, 0).axes[2].lines if line.get_marker() == "."]
    drawn = np.concatenate([np.stack(line.get_data(), -1) for line in dots])
    pixels, _ = completed.rig.project(completed.poses.xyz[:1])
    np.testing.assert_allclose(np.sort(drawn[:, 0]), np.sort(pixels[0, 2].reshape(-1, 2)[:, 0]), rtol=1e-6)


def test_images_of_another_size_lie_under_the_joints(completed, tmp_path):
    for name, (width, height) in zip(completed.rig.names, completed.rig.size.tolist(), strict=True):
        write_image("rgb", tmp_path / "rgb" / name / "000000.png", np.zeros((height // 2, width // 2, 3), np.uint8))
    images = Images(tmp_path, completed.rig.names, (0,) * len(completed), ("rgb",), rgb="png")
    (image,) = views_figure(replace(completed, images=images), 0).axes[0].images
    width, height = completed.rig.size[0]
    assert image.get_extent() == pytest.approx((-0.5, width - 0.5, height - 0.5, -0.5))


def test_gaps_of_any_number_of_methods_are_drawn():
    (result, _) = scores([10.0])["results"]
    figure = gaps_figure({"results": [result | {"method": f"method {number}"} for number in range(9)]})
    assert len(figure.axes[0].lines) == 9


def test_the_frame_drawn_has_most_completed_joints_or_else_most_missing(completed):
    assert telling_frame(completed.poses) == 5
    lacking = np.zeros(completed.truth.source.shape, bool)
    lacking[3, 0, :5] = True
    assert telling_frame(completed.truth.without(lacking)) == 3


def test_a_clip_without_poses_cannot_be_drawn():
    with pytest.raises(ValueError, match="no poses"):
        views_figure(full_clip(), 0)


def test_gaps_that_nothing_filled_are_left_out_of_the_plot():
    (axes,) = gaps_figure(scores([20.0, None])).axes
    assert [line.get_label() for line in axes.lines] == ["linear", "hold"]
    np.testing.assert_equal(axes.lines[0].get_ydata(), [20.0, np.nan])
    assert axes.get_ylim()[0] == 0
    assert axes.get_ylim()[1] > 20


def test_the_page_is_complete_and_loads_nothing(tmp_path):
    page = tmp_path / "report.html"
    write_report(page, "A <title>", [scores_section(scores([20.0, 40.0]))], summary=["Two & three"])
    text = page.read_text()
    assert "A &lt;title&gt;" in text and "Two &amp; three" in text
    assert "Scores on made-up" in text
    assert text.count("<svg ") == 1
    assert not re.search(r"(src|href)=['\"](?!data:|#)", text)
    assert 'id="player"' not in text and "player.js" not in text


def test_lines_and_text_of_figures_follow_the_theme():
    drawn = str(CaptionedFigure('a "caption" <b>', gaps_figure(scores([20.0]))).markup)
    assert drawn.startswith('<svg role="img" aria-label="a &#34;caption&#34; &lt;b&gt;"')
    assert "currentColor" in drawn and "#000000" not in drawn


def test_figures_of_many_points_are_pixels():
    figure = Figure()
    figure.subplots().plot(*np.random.default_rng(0).normal(size=(2, 20_000)), ".")
    drawn = str(CaptionedFigure("points", figure).markup)
    assert drawn.startswith("<img") and len(drawn) < 300_000


def test_columns_of_numbers_stand_at_the_right_and_words_at_the_left(tmp_path):
    rows = [("a", "1.5", "-", "l_wrist", "a long sentence " * 4), ("b", "<2", "3 mm", "-", "short")]
    write_report(tmp_path / "page.html", "t", [Section("s", tables=[Table("c", "vwxyz", rows)])])
    classes = re.findall(r'<th scope="col" class="(\w*)">', (tmp_path / "page.html").read_text())
    assert classes == ["words", "", "", "words", "prose"]


def test_a_table_without_rows_says_none(tmp_path):
    write_report(tmp_path / "page.html", "t", [Section("s", tables=[Table("c", ("a", "b"), [])])])
    assert '<td colspan="2">none</td>' in (tmp_path / "page.html").read_text()


def test_paragraphs_are_parted_and_wide_figures_stand_alone(tmp_path):
    figures = [CaptionedFigure("wide", Figure(figsize=(9, 3))), CaptionedFigure("narrow", Figure(figsize=(5, 3)))]
    sections = [Section("one", "a\n\nb", figures=figures), Section("two", figures=figures[1:])]
    write_report(tmp_path / "page.html", "t", sections)
    text = (tmp_path / "page.html").read_text()
    assert '<p class="lead">a</p>' in text and '<p class="lead">b</p>' in text
    assert text.count('class="figures wide"') == 1 and text.count('class="figures"') == 1


def test_a_table_has_a_moment_for_each_row_or_none():
    with pytest.raises(ValueError, match="2 rows, but 1 moments"):
        Table("c", ("a",), [("1",), ("2",)], moments=[Moment("clip", 0)])


def test_a_pipe_gets_every_cell_in_full(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    wide = Table("wide", ("method", *(f"column {i}" for i in range(30))), [["x", *["1234.5"] * 30]])
    print_tables([wide])
    assert capsys.readouterr().out.count("1234.5") == 30


@pytest.mark.parametrize("columns", [20, 60, 110])
def test_a_narrow_terminal_wraps_cells_and_cuts_none(columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("FORCE_COLOR", "1")
    table = Table(
        "t", ("", "actor 1 (174 frames)", "from dmae: PCP"), [["a long name (of 2021)", "99.1 [98.0, 99.9]", "-0.1"]]
    )
    print_tables([table] * 2)
    printed = capsys.readouterr().out
    assert "…" not in printed
    for word in ("long", "(174", "dmae:", "PCP", "[98.0,", "2021)", "-0.1"):
        assert printed.count(word) == 2, printed


def test_one_thing_is_singular():
    assert [counted(number, "clip") for number in (0, 1, 2)] == ["0 clips", "1 clip", "2 clips"]
    assert [counted(number, "person", "people") for number in (1, 3)] == ["1 person", "3 people"]


def test_names_with_brackets_and_colons_are_printed_as_they_are(capsys):
    rows = [("left [take 2]", "1"), ("a[/b]", "2"), (":cat:", "3")]
    print_tables([Table("errors [mm] of [all]", ("camera [name]", "x"), rows)])
    printed = " ".join(capsys.readouterr().out.split())
    for text in ("errors [mm] of [all]", "camera [name]", *(name for name, _ in rows)):
        assert text in printed


def test_a_clip_without_frames_is_not_drawn(completed):
    with pytest.raises(ValueError, match="expected frames to draw, found none"):
        views_figure(completed.select(frames=range(0)))
