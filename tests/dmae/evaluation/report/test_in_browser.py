"""The page of the report as a person uses it, in headless Chromium."""

import base64
import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from dmae.data.store import load_clip, save_clip
from dmae.evaluation.report.findings import rank_doubts
from dmae.evaluation.report.page import write_clips_report
from dmae.evaluation.review import DECISIONS, load_decisions, save_decisions
from dmae.formats.config import DataConfig
from dmae.formats.reading import Clips
from tests.support.browser import opened
from tests.support.reported_clips import completed_clip, grey_of, with_images

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return with_images(completed_clip(), tmp_path_factory.mktemp("images"))


@pytest.fixture(scope="module")
def path(clip, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_clips_report(path, [clip])
    return path


def frame_of(page) -> int:
    return int(page.get_attribute("#player", "data-frame"))


def at_frame(page, frame: int) -> None:
    """Wait until the motion, and the camera's image under its drawing, are of this frame."""
    page.wait_for_selector(f'#player[data-frame="{frame}"]')
    page.wait_for_selector(f'#view[data-frame="{frame}"]')


def pixels(page, canvas: str) -> np.ndarray:
    """(height, width, 4) of a canvas, blue first."""
    url = page.evaluate("(id) => document.getElementById(id).toDataURL()", canvas)
    return decoded(url)


def decoded(url: str) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(base64.b64decode(url.partition(",")[2]), np.uint8), cv2.IMREAD_UNCHANGED)


def colours(image: np.ndarray) -> int:
    return len(np.unique(image.reshape(-1, 4).view(np.uint32)))


def test_the_image_and_the_motion_are_of_the_same_frame(browser, path):
    with opened(browser, path) as page:
        at_frame(page, 0)
        for frame in (1, 2):
            page.keyboard.press("ArrowRight")
            at_frame(page, frame)
        for frame in (17, 3, 29):
            page.evaluate(f"""() => {{ const range = document.getElementById("frame"); range.value = {frame};
                range.dispatchEvent(new Event("input")); }}""")
            at_frame(page, frame)
            assert abs(int(pixels(page, "view")[5, 5, 0]) - grey_of(frame)) <= 3
        assert page.inner_text("#time") == "frame 29 of 0–29 · 1.16 s"


def test_it_plays_to_the_end_and_pauses(browser, path):
    with opened(browser, path) as page:
        page.select_option("#speed", "0.5")
        page.click("#play")
        page.wait_for_selector('#player[data-playing="true"]')
        assert page.inner_text("#play") == "Pause"
        page.wait_for_selector('#player[data-frame="29"][data-playing="false"]')
        assert page.inner_text("#play") == "Play"
        page.select_option("#speed", "0.1")
        page.click("#play")
        page.wait_for_selector('#player:not([data-frame="29"]):not([data-frame="0"])')
        shown, url = page.evaluate(
            '() => { const view = document.getElementById("view"); return [view.dataset.frame, view.toDataURL()]; }'
        )
        assert abs(int(decoded(url)[5, 5, 0]) - grey_of(int(shown))) <= 3
        page.click("#play")
        page.wait_for_selector('#player[data-playing="false"]')


def test_the_keyboard_does_everything(browser, path):
    with opened(browser, path) as page:
        for key, frame in (("End", 29), ("ArrowLeft", 28), ("Home", 0), ("n", 10), ("ArrowRight", 11), ("w", 10)):
            page.keyboard.press(key)
            page.wait_for_selector(f'#player[data-frame="{frame}"]')
        page.keyboard.press("Shift+ArrowRight")
        page.wait_for_selector('#player[data-frame="29"]')
        page.keyboard.press("f")
        assert page.input_value("#follow") == "0"
        page.keyboard.press("c")
        assert page.input_value("#camera") == "1"
        page.keyboard.press("Home")
        page.keyboard.press(" ")
        page.wait_for_selector('#player[data-playing="true"]')


def test_keys_scroll_the_page_where_the_player_is_out_of_sight(browser, path):
    with opened(browser, path) as page:
        page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
        page.keyboard.press("ArrowRight")
        page.keyboard.press(" ")
        page.wait_for_timeout(60)
        assert (frame_of(page), page.get_attribute("#player", "data-playing")) == (0, "false")


def test_a_browser_that_cannot_open_the_player_says_so(browser, path):
    with opened(browser, path, before="delete window.DecompressionStream", player=False) as page:
        page.wait_for_selector("text=This browser cannot open the player")
        assert page.locator("table").first.is_visible()


def test_toggles_and_orbit_change_what_is_drawn(browser, path):
    with opened(browser, path) as page:
        page.keyboard.press("n")
        at_frame(page, 10)
        before = {canvas: pixels(page, canvas) for canvas in ("world", "view")}
        for canvas in before:
            assert colours(before[canvas]) > 20, f"{canvas} is blank"
        red = {name: _reds(image) for name, image in before.items()}
        assert min(red.values()) > 20
        page.uncheck("#show-completed")
        page.wait_for_timeout(100)
        assert max(_reds(pixels(page, canvas)) for canvas in before) < min(red.values()) / 4
        page.check("#show-completed")
        for name in ("truth", "measured", "detections", "cameras", "image", "uncertainty"):
            page.wait_for_timeout(60)
            before = pixels(page, "world"), pixels(page, "view")
            page.click(f"#show-{name}")
            page.wait_for_timeout(60)
            after = pixels(page, "world"), pixels(page, "view")
            assert any((x != y).any() for x, y in zip(before, after, strict=True)), name
        before = pixels(page, "world")
        page.hover("#world")
        page.mouse.down()
        page.mouse.move(300, 500)
        page.mouse.up()
        page.wait_for_timeout(60)
        assert (pixels(page, "world") != before).any()


def _reds(image: np.ndarray) -> int:
    b, g, r = (image[..., channel].astype(int) for channel in range(3))
    return int(((r > 180) & (g < 60) & (b < 70)).sum())


def test_a_moment_opens_in_the_player(browser, path):
    with opened(browser, path) as page:
        first = page.locator(".moment").first
        assert first.inner_text() == "10"
        first.focus()
        page.keyboard.press("Enter")
        at_frame(page, 10)
        assert page.input_value("#follow") == "1"
        assert "P2: completed r_elbow, r_wrist" in page.inner_text("#status")


def test_tables_sort_by_click_and_by_keyboard(browser, path):
    with opened(browser, path) as page:
        table = page.locator("table", has=page.locator("caption", has_text="By joint")).first
        column = lambda: [float(text) for text in table.locator("td:nth-child(3)").all_inner_texts()]  # noqa: E731
        original = column()
        head = table.locator("th:nth-child(3) button")
        head.click()
        assert column() == sorted(original)
        head.press("Enter")
        assert column() == sorted(original, reverse=True)
        assert table.locator("th:nth-child(3)").get_attribute("aria-sort") == "descending"
        head.click()
        assert column() == original


@pytest.mark.parametrize("dark", [False, True])
def test_a_phone_in_light_and_dark_needs_no_sideways_scrolling(browser, path, dark):
    with opened(browser, path, width=390, dark=dark) as page:
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        background = "getComputedStyle(document.body).backgroundColor"
        colours = {"dark": "rgb(20, 24, 29)", "light": "rgb(255, 255, 255)"}
        assert page.evaluate(background) == colours["dark" if dark else "light"]
        page.click("#theme")
        assert page.evaluate(background) == colours["light" if dark else "dark"]


def test_the_images_of_upright_phones_leave_the_buttons_in_the_window(browser, clip, tmp_path):
    upright = replace(clip, rig=replace(clip.rig, size=clip.rig.size[:, ::-1]), images=None)
    write_clips_report(tmp_path / "report.html", [upright])
    with opened(browser, tmp_path / "report.html") as page:
        top, bottom = page.evaluate(
            "[byId('player').getBoundingClientRect().top, byId('play').getBoundingClientRect().bottom]"
        )
        assert bottom - top < page.viewport_size["height"]


def test_paper_shows_the_player_without_controls(browser, path):
    with opened(browser, path) as page:
        page.emulate_media(media="print")
        assert not page.is_visible("#play") and not page.is_visible("#theme")
        assert page.is_visible("#world") and page.is_visible("#legend")


def test_numbers_arrive_whole_and_cameras_project_as_ours_do(browser, clip, tmp_path):
    """Poses within their millimetre, pixels within a tenth: with pinholes, rational lenses, a fisheye."""
    rig = clip.rig
    dist = np.zeros((4, 8))
    dist[1] = (-0.2, 0.08, 1e-3, -2e-3, 0.01, 0.1, 0.02, 0.01)
    dist[2, :4] = (0.02, -0.01, 3e-3, -1e-3)
    bent = CameraRig(rig.names, rig.K + [[0, 2.0, 0], [0] * 3, [0] * 3], dist, rig.cam_from_world, rig.size,
                     fisheye=[False, False, True, False])  # fmt: skip
    there = clip.poses.source.copy()
    there[3, 0, 4] = 0
    poses = clip.poses.without(there == 0)
    clip = replace(clip, rig=bent, poses=poses, images=None)
    write_clips_report(tmp_path / "report.html", [clip])
    with opened(browser, tmp_path / "report.html") as page:
        points, pixel, detected = page.evaluate("""async () => {
            const clip = await unpackedClip(JSON.parse(document.getElementById("clips").textContent)[0]);
            const joints = [...clip.poses.joints.keys()], frames = [...Array(clip.frames).keys()];
            const points = frames.map((f) => [0, 1].map((p) => joints.map((j) => clip.poses.point(f, p, j))));
            const inView = (camera) => points[7].map((all) => all.map((point) => projected(camera, point)));
            const detection = (v) => [0, 1].map((d) => joints.map((j) => clip.detections.point(7, v, d, j)));
            const pixel = clip.cameras.map(inView), detected = [0, 1, 2, 3].map(detection);
            return [points, pixel, detected];
        }""")
    assert points[3][0][4] is None
    points[3][0][4] = [np.nan] * 3
    np.testing.assert_allclose(np.array(points, float), poses.xyz, atol=6e-4)
    ours, depth = bent.project(np.array(points)[7:8])
    np.testing.assert_allclose(np.array(pixel), np.concatenate([ours[0], depth[0][..., None]], -1), atol=0.1)
    found = np.array([[[point or (np.nan, np.nan) for point in person] for person in view] for view in detected])
    given = clip.detections.xy[7]
    for view in range(4):  # the order of detections says nothing
        same = [np.nansum(np.abs(found[view] - given[view][order])) for order in ([0, 1], [1, 0])]
        assert min(same) < 0.3 * given[view].size
        assert np.isnan(found[view]).sum() == np.isnan(given[view]).sum()


def test_a_name_never_becomes_markup_or_script(browser, clip, tmp_path):
    evil = "</script><script>window.hacked=1</script><img src=x onerror='window.hacked=2'>\u2028"
    rig = replace(clip.rig, names=(evil, *(f"{evil}{view}" for view in range(3))))
    hostile = replace(clip, id=evil, rig=rig, true_rig=None, images=None)
    write_clips_report(tmp_path / "report.html", [hostile, replace(hostile, id=evil + "2")], title=evil)
    with opened(browser, tmp_path / "report.html") as page:
        page.select_option("#clip", "1")
        page.wait_for_timeout(50)
        page.locator(".moment").last.click()
        assert page.evaluate("window.hacked") is None
        assert page.locator("img").count() == 0
        assert page.title().startswith("</script><script>")
        assert page.locator("#camera option").first.inner_text().startswith("</script><script>")


def test_a_script_that_got_into_the_page_would_not_run(browser, path):
    with opened(browser, path) as page:
        refused = page.evaluate("""() => new Promise((resolve) => {
            document.addEventListener("securitypolicyviolation", (event) => resolve(event.violatedDirective));
            const button = document.createElement("button");
            button.setAttribute("onclick", "window.hacked = 3");
            document.body.append(button);
            button.click();
        })""")
        assert refused.startswith("script-src") and page.evaluate("window.hacked") is None
        page.complaints.clear()


def test_clips_that_are_not_captured_not_filmed_or_empty_open(browser, clip, tmp_path):
    plain = replace(clip, images=None)
    for name, shown in {
        "uncaptured": replace(plain, id="a", poses=None),
        "detections alone": replace(plain, id="b", poses=None, truth=None, occlusion=None),
        "no people": replace(plain, id="c", poses=clip.poses.without(np.ones(clip.poses.source.shape, bool))),
        "one frame": replace(plain.select(frames=slice(0, 1)), id="d"),
    }.items():
        write_clips_report(tmp_path / "report.html", [shown])
        with opened(browser, tmp_path / "report.html") as page:
            assert colours(pixels(page, "view")) > 3, name
            page.keyboard.press("End")
            page.keyboard.press("n")
            page.keyboard.press("w")
            notes = page.inner_text("#notes") if page.is_visible("#notes") else ""
            assert ("Not captured yet: run dmae capture" in notes) == (shown.poses is None)
    write_clips_report(tmp_path / "report.html", [plain.select(frames=slice(0, 0))])
    with opened(browser, tmp_path / "report.html", player=False) as page:
        assert "It has no frames, so there is nothing to show." in page.inner_text(".summary")


def test_without_images_a_clock_plays(browser, clip, tmp_path):
    write_clips_report(tmp_path / "report.html", [replace(clip, images=None)])
    with opened(browser, tmp_path / "report.html") as page:
        page.click("#play")
        page.wait_for_selector('#player[data-frame="29"][data-playing="false"]')


def test_data_in_the_page_is_json(path):
    (found,) = re.findall(r'id="clips">(.*?)</script>', path.read_text(), re.DOTALL)
    assert json.loads(found)[0]["frames"] == 30


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


def test_a_later_page_keeps_earlier_decisions(browser, tmp_path):
    save_clip(completed_clip(), tmp_path / "clip")
    clip = load_clip(tmp_path / "clip")
    first, second, *_ = rank_doubts(clip)
    save_decisions(tmp_path / "clip", clip.poses, [first.decision("blank")])
    write_clips_report(tmp_path / "report.html", Clips(DataConfig(path=str(tmp_path / "clip"))))
    with opened(browser, tmp_path / "report.html") as page:
        page.locator("select.verdict").nth(0).select_option("accept")
        with page.expect_download() as download:
            page.locator("button.save").click()
        download.value.save_as(tmp_path / "clip" / DECISIONS)
    assert load_decisions(tmp_path / "clip", clip.poses) == (first.decision("blank"), second.decision("accept"))
