"""The page of two robots, each started by its own `navloom up`, in one world."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import pytest
from dashboard_rig import Served, frames, served
from live_rig import EMPTY, Up, up
from page_rig import click, close_panels, colour_at, logged_in, open_panel, placed
from playwright.sync_api import Browser, expect


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Up, Up]]:
    """r1 at the origin, and r2 2 m ahead of it."""
    folder = tmp_path_factory.mktemp("robots")
    for name, x in (("r1", 0.0), ("r2", 2.0)):
        place = EMPTY.replace("start = { x = 0.0,", f"start = {{ x = {x},")
        (folder / f"{name}.toml").write_text(f'[robot]\nname = "{name}"\n{place}')
    with up(str(folder / "r1.toml")) as first:
        second = Up(Path(), [str(folder / "r2.toml")], first.environment)
        try:
            for one in (first, second):
                one.wait_for("every node is there")
            yield first, second
        finally:
            second.end()


@pytest.fixture(scope="module")
def site(robots: tuple[Up, Up], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with (
        patch.dict(os.environ, robots[0].environment),
        served(tmp_path_factory.mktemp("recordings"), "lab/r1", "lab/r2") as made,
    ):
        yield made


def test_each_robot_is_drawn_for_the_other_with_its_footprint_where_it_is(browser: Browser, site: Served) -> None:
    url = f"{site.server.url}/#token={site.dashboard.sessions.tokens['operate']}"
    with site.browser("view").socket("/ws/lab/r1") as frame:
        (member,) = frames(frame, "members")[0]["members"]
    assert (member["name"], round(member["x"], 1), len(member["footprint"])) == ("lab/r2", 2.0, 4)
    with logged_in(browser, url, "desk") as page:
        click(page, "Follow the robot")
        left, right = placed(page, -100, 0), placed(page, 100, 0)
        metre = 200.0 / (right[0] - left[0])
        # Beside its arrow, within the footprint.
        with_it = colour_at(page, 2.0 * metre - 0.2 * metre, 0.2 * metre)
        panel = open_panel(page, "Layers")
        panel.get_by_role("button", name="Other robots").click()
        close_panels(page)
        assert colour_at(page, 2.0 * metre - 0.2 * metre, 0.2 * metre) != with_it


def test_the_chosen_robot_is_the_one_that_is_stopped(browser: Browser, site: Served, robots: tuple[Up, Up]) -> None:
    url = f"{site.server.url}/#token={site.dashboard.sessions.tokens['operate']}"
    with logged_in(browser, url, "phone") as page:
        page.locator("#robot").select_option("lab/r2")
        expect(page.locator("#stop-state")).to_have_text("ready")
        page.locator("#stop").click()
        expect(page.locator("#state")).to_have_text("STOPPED")
        page.locator("#robot").select_option("lab/r1")
        expect(page.locator("#stop-state")).to_have_text("ready")
        expect(page.locator("#state")).to_have_text("no goal")
        latched = [robots[0].json("status", "--robot", name)["gate_status"]["latched"] for name in ("r1", "r2")]
        assert latched == [False, True]
