"""A browser, and a live robot with a dashboard, which the tests of a module share."""

from __future__ import annotations

import os
from collections.abc import Iterator
from unittest.mock import patch

import pytest
from dashboard_rig import served
from live_rig import up
from page_rig import CONFIG, ROBOT, SIZES, Driven, chromium, logged_in
from playwright.sync_api import Browser, Page


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium. Not for the whole session: while it runs, no other test of the process could start an event loop."""
    with chromium() as made:
        yield made


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driven]:
    """A robot in a room with a door, with a laser, a localizer that can search, and a second avoider in shadow."""
    recordings = tmp_path_factory.mktemp("recordings")
    with (
        up(*CONFIG) as robot,
        patch.dict(os.environ, robot.environment),
        served(recordings, ROBOT) as site,
    ):
        robot.wait_for("every node is there")
        yield Driven(robot, site)


@pytest.fixture(params=SIZES)
def size(request: pytest.FixtureRequest) -> str:
    """A phone's page, and that of a desk."""
    return str(request.param)


@pytest.fixture
def page(browser: Browser, driven: Driven, size: str) -> Iterator[Page]:
    """The page, logged in as an operator. The robot has no goal afterwards, and may drive."""
    with logged_in(browser, driven.url(), size) as made:
        try:
            yield made
        finally:
            driven.robot.run("cancel")
            driven.robot.run("resume")
