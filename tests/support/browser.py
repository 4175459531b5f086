"""Headless Chromium for tests of pages."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def find_chromium() -> str | None:
    """Return the path of a Chromium: of CHROMIUM in the environment, or else of the system's; None without one."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
    return os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, names)), None)


@contextmanager
def opened(
    browser, path: Path, *, width: int = 1280, dark: bool = False, player: bool = True, before: str = ""
) -> Iterator:
    """Open a page, after the script `before`; then check that it raised, logged and asked of the network nothing."""
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme="dark" if dark else "light", reduced_motion="reduce"
    )
    page = context.new_page()
    page.complaints = complaints = []
    page.set_default_timeout(10_000)
    page.add_init_script(before)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on(
        "request",
        lambda request: None if request.url.startswith(("file:", "data:", "blob:")) else complaints.append(request.url),
    )
    page.goto(path.as_uri())
    if player:
        page.wait_for_selector("#player[data-frame]")
    yield page
    context.close()
    assert complaints == []
