"""Chromium on the page of a dashboard, at the size of a phone and of a desk, and what a test does there."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import pytest
from dashboard_rig import Served
from live_rig import Up
from playwright.sync_api import Browser, Locator, Page, ViewportSize, expect, sync_playwright

__all__ = [
    "SIZES",
    "Fingers",
    "chromium",
    "click",
    "close_panels",
    "colour_at",
    "drag_on_map",
    "logged_in",
    "open_panel",
    "opened",
    "placed",
    "points_of",
    "violations",
]

SIZES = {"phone": ViewportSize(width=390, height=844), "desk": ViewportSize(width=1440, height=900)}
WAIT = 20.0
"""Longest wait for what the page shows, s."""
ROBOT = "lab/r1"
CONFIG = ("building", "--start-anew", "--shadow", "avoider=improved_vfh", "--set", "navigation.drive=false")


class Driven(NamedTuple):
    """A robot that is up, and its dashboard."""

    robot: Up
    site: Served

    def url(self, right: Any = "operate") -> str:
        """Address that logs a browser in with a right."""
        return f"{self.site.server.url}/#token={self.site.dashboard.sessions.tokens[right]}"


@contextmanager
def chromium() -> Iterator[Browser]:
    """Debian's Chromium; the test is skipped without one."""
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("needs Chromium")
    expect.set_options(timeout=WAIT * 1000)
    with sync_playwright() as playwright:
        # Its sandbox refuses to run for root, as in a container.
        browser = playwright.chromium.launch(executable_path=program, chromium_sandbox=os.getuid() != 0)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def opened(browser: Browser, size: str, theme: Any = "light") -> Iterator[Page]:
    """An empty page; an error of its scripts, or what its security policy refuses, fails the test."""
    faults: list[str] = []
    context = browser.new_context(
        viewport=SIZES[size], color_scheme=theme, has_touch=size == "phone", reduced_motion="reduce"
    )
    context.set_default_timeout(WAIT * 1000)
    page = context.new_page()
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda line: faults.append(line.text) if "Content Security Policy" in line.text else None)
    try:
        yield page
    finally:
        context.close()
    assert faults == []


@contextmanager
def logged_in(browser: Browser, url: str, size: str, theme: Any = "light") -> Iterator[Page]:
    """The page of a dashboard, logged in by the address with its token, with the robot's pose shown."""
    with opened(browser, size, theme) as page:
        page.goto(url)
        expect(page.locator("#ages")).to_contain_text("pose")
        expect(page.locator("#stop-state")).not_to_have_text("no connection")
        yield page


def click(page: Page, name: str, role: Any = "button") -> None:
    """Click what has this name for a screen reader."""
    page.get_by_role(role, name=name, exact=True).click()


def open_panel(page: Page, name: str) -> Locator:
    """Open a panel, and return it."""
    if page.locator("#panel").is_hidden():
        click(page, "Panels")
    click(page, name, "tab")
    panel = page.get_by_role("tabpanel", name=name)
    expect(panel).to_be_visible()
    return panel


def close_panels(page: Page) -> None:
    """Close the panels, so that the whole map is visible."""
    if page.locator("#panel").is_visible():
        click(page, "Panels")


def drag_on_map(page: Page, x: float, y: float, dx: float = 0.0, dy: float = 0.0) -> None:
    """Press on the map at pixels from its middle, drag by pixels, and release."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2 + x, box["y"] + box["height"] / 2 + y
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=4)
    page.mouse.up()


def points_of(page: Page) -> tuple[float, ...]:
    """x and y, m, and heading, degrees if given, of the point that a tool has placed last."""
    return tuple(float(number) for number in re.findall(r"-?\d+\.?\d*", page.locator("#draft-text").inner_text())[:3])


def placed(page: Page, *drag: float) -> tuple[float, ...]:
    """x and y, m, and heading, degrees, of a goal that is placed by pixels from the middle, and not sent."""
    click(page, "Goal")
    drag_on_map(page, *drag)
    found = points_of(page)
    click(page, "Goal")
    return found


def colour_at(page: Page, x: float, y: float) -> list[int]:
    """Colour of the map in the next frame, at pixels from its middle."""
    found: list[int] = page.evaluate(
        """([x, y]) => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
            const map = document.getElementById("map");
            done([...map.getContext("2d").getImageData(map.width / 2 + x, map.height / 2 + y, 1, 1).data]);
        })))""",
        [x, y],
    )
    return found


class Fingers:
    """Two fingers on the map of a phone, at pixels from its middle."""

    def __init__(self, page: Page) -> None:
        self._session = page.context.new_cdp_session(page)
        box = page.locator("#map").bounding_box()
        assert box is not None
        self._middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def at(self, event: str, *places: tuple[float, float]) -> None:
        """Touch, move or lift."""
        x, y = self._middle
        points = [{"x": x + dx, "y": y + dy, "id": number} for number, (dx, dy) in enumerate(places)]
        self._session.send("Input.dispatchTouchEvent", {"type": event, "touchPoints": points})


def violations(page: Page, part: str | None = None) -> list[str]:
    """What axe-core finds on the page or a part of it, by the rules of WCAG 2.2 A and AA and its best practices."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page, part).response["violations"]
    return [f"{rule['id']}: {node['html'][:160]}" for rule in found for node in rule["nodes"]]
