"""Take the pictures of the dashboard, docs/pictures/dashboard-*.png, with Debian's Chromium and without a screen.

    uv run --group test python docs/pictures/dashboard.py

It starts the robots that it shows in a runtime folder of its own. It takes some minutes, most of them for kernels.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Browser, Page, ViewportSize, expect, sync_playwright

HERE = Path(__file__).resolve().parent
DESK, PHONE = ViewportSize(width=1280, height=800), ViewportSize(width=390, height=844)
PAPER = ("paper", "--shadow", "avoider=vff,vfh")
BUILDING = ("building", "--start-anew", "--set", "navigation.drive=false")
START = 300_000.0
"""Longest start of a robot, with kernels that are compiled, ms."""


@contextmanager
def dashboard(*config: str) -> Iterator[str]:
    """A robot that is up, with a dashboard on a free port; the operator's address."""
    command = [sys.executable, "-m", "navloom"]
    with tempfile.TemporaryDirectory(prefix="nl") as folder:
        around = {**os.environ, "NAVLOOM_RUNTIME_DIR": folder, "NAVLOOM_STATE_DIR": folder}
        robot = subprocess.Popen([*command, "up", *config], env=around, stderr=subprocess.DEVNULL)
        server = subprocess.Popen([*command, "dashboard", "--port", "0"], env=around, stderr=subprocess.PIPE, text=True)
        assert server.stderr is not None
        try:
            yield next(found[1] for line in server.stderr if (found := re.search(r"operators: (\S+)", line)))
        finally:
            for process in (server, robot):
                process.terminate()
                process.wait()


@contextmanager
def shown(browser: Browser, url: str, size: ViewportSize, theme: Any) -> Iterator[Page]:
    """The page of a robot that is there."""
    context = browser.new_context(viewport=size, color_scheme=theme, reduced_motion="reduce", has_touch=size == PHONE)
    page = context.new_page()
    page.goto(url)
    expect(page.locator("#ages")).to_contain_text("pose", timeout=START)
    yield page
    context.close()


def take(page: Page, name: str) -> None:
    """Keep the page as a picture with few colours."""
    with Image.open(io.BytesIO(page.screenshot())) as found:
        found.convert("RGB").quantize(128).save(HERE / f"dashboard-{name}.png", optimize=True)


def press(page: Page, name: str, role: Any = "button") -> None:
    """Press what has this name."""
    page.get_by_role(role, name=name, exact=True).click()


def place(page: Page, x: float, y: float, dx: float = 0.0, dy: float = 0.0) -> None:
    """Press on the map at pixels from its middle, and drag by pixels."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2 + x, box["y"] + box["height"] / 2 + y
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=4)
    page.mouse.up()


def drive(page: Page, *points: tuple[float, ...]) -> None:
    """Send the robot to points of the map, in pixels from its middle."""
    press(page, "Goal")
    for point in points:
        place(page, *point)
    press(page, "Drive there")
    expect(page.locator("#state")).to_have_text("driving")


def panel(page: Page, name: str) -> None:
    """Open a panel."""
    press(page, "Panels")
    press(page, name, "tab")


def paper(browser: Browser, url: str) -> None:
    """The paper's avoider and two others, compared while the robot drives round the obstacle."""
    with shown(browser, url, DESK, "light") as page:
        panel(page, "Compare")
        expect(page.locator("#ages")).to_contain_text("map", timeout=60_000)
        press(page, "Follow the robot")
        for _ in range(3):
            press(page, "Zoom in")
        expect(page.locator("#drives")).to_contain_text("avoider", timeout=60_000)
        page.wait_for_timeout(3000)  # the strip shows how the avoiders answer the obstacle
        expect(page.locator("#why")).to_be_empty()
        take(page, "compare")


def building(browser: Browser, url: str) -> None:
    """The other panels, on a robot with a laser and a map."""
    with shown(browser, url, DESK, "dark") as page:
        press(page, "Goal")
        place(page, 100, 60)
        place(page, 130, -150, -70, 0)
        take(page, "goal")
    with shown(browser, url, PHONE, "light") as page:
        drive(page, (100.0, -40.0, -40.0, 0.0))
        page.wait_for_timeout(2500)
        take(page, "phone")
        press(page, "Cancel goal")
        page.wait_for_timeout(4500)  # until the sentence about it is gone
        panel(page, "Drive")
        page.locator("#stick").focus()
        page.keyboard.down("q")
        expect(page.locator("#drives")).to_have_text("an operator drives")
        page.wait_for_timeout(1000)
        take(page, "drive")
        page.keyboard.up("q")
        press(page, "Hand back")
    with shown(browser, url, PHONE, "dark") as page:
        page.keyboard.press("Space")
        expect(page.locator("#state")).to_have_text("STOPPED")
        page.wait_for_timeout(4500)
        take(page, "stop")
        press(page, "Resume")
    with shown(browser, url, DESK, "light") as page:
        panel(page, "Parameters")
        page.locator("summary", has_text="avoider dwa").click()
        take(page, "parameters")


def main() -> None:
    """Take all of them."""
    program = shutil.which("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, chromium_sandbox=os.getuid() != 0)
        for config, pictures in ((PAPER, paper), (BUILDING, building)):
            with dashboard(*config) as url:
                pictures(browser, url)


if __name__ == "__main__":
    main()
