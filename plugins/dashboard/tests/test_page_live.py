"""Each act of the page, end to end on a live simulated robot, on a phone and on a desk.

What the robot then does is read from the robot itself, not from the page.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from navloom.messages import Command, Twist2D
from navloom.messages import Path as PlannedPath
from navloom.messages.codec import decode
from navloom_live import Listening, Navigator
from numpy.typing import NDArray
from page_rig import ROBOT, WAIT, Driven, click, close_panels, drag_on_map, logged_in, open_panel, opened, points_of
from playwright.sync_api import Browser, Page, expect

DEAD_MAN = 0.3
"""Longest time that a robot is driven on by a page that is lost, s."""


def status_of(driven: Driven, holds: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    """The robot's status as soon as it is so."""
    limit = time.monotonic() + WAIT
    while True:
        status: dict[str, Any] = driven.robot.json("status")
        if holds(status):
            return status
        assert time.monotonic() < limit, status


def place_goal(page: Page, *drag: float) -> tuple[float, ...]:
    """Place a goal by pixels from the robot, with a drag for its heading; the point that the page says."""
    close_panels(page)
    if page.locator("#follow").get_attribute("aria-pressed") == "false":
        click(page, "Follow the robot")
    click(page, "Goal")
    drag_on_map(page, *drag)
    return points_of(page)


def apart(place: dict[str, Any], x: float, y: float) -> float:
    return float(((place["x"] - x) ** 2 + (place["y"] - y) ** 2) ** 0.5)


def test_a_token_in_the_address_logs_in_and_is_removed_from_it(page: Page) -> None:
    assert "token" not in page.url and page.evaluate("location.hash") == ""
    expect(page.locator("#robot")).to_have_value(ROBOT)


def test_a_goal_is_driven_to_after_a_click_and_a_drag_for_its_heading(page: Page, driven: Driven) -> None:
    x, y, heading = place_goal(page, 40, 40, -50, 0)
    assert heading == 180.0
    click(page, "Drive there")
    feedback = status_of(driven, lambda status: (status["goal_feedback"] or {}).get("goal_id"))["goal_feedback"]
    result = status_of(driven, lambda status: (status["goal_result"] or {}).get("goal_id") == feedback["goal_id"])
    assert result["goal_result"]["outcome"] == "succeeded"
    assert apart(result["goal_result"]["place"], x, y) < 0.35
    expect(page.locator("#state")).to_have_text("no goal")


def test_a_goal_goes_by_the_points_that_were_placed_before_it(page: Page, driven: Driven) -> None:
    with Navigator(ROBOT) as robot:
        plans = robot.listen(["planner/path"])
        via = place_goal(page, -70, 0)
        drag_on_map(page, -70, -50)
        expect(page.locator("#draft-text")).to_contain_text("by 1 point")
        goal = points_of(page)
        plans.take(0.0)  # the path of an earlier goal
        click(page, "Drive there")
        paths = new_paths(plans)
        assert any(np.hypot(*(path - via[:2]).T).min() < 0.05 for path in paths)
        assert any(np.hypot(*(path[-1] - goal[:2])) < 0.05 for path in paths)


def new_paths(plans: Listening) -> Iterator[NDArray[np.float64]]:
    """Points of each path that is planned, m, map frame."""
    limit = time.monotonic() + WAIT
    while time.monotonic() < limit:
        yield from (told.message.points for told in plans.take(0.2) if isinstance(told.message, PlannedPath))


def test_cancel_ends_the_goal(page: Page, driven: Driven) -> None:
    place_goal(page, 0, -60)
    click(page, "Drive there")
    expect(page.locator("#state")).to_have_text("driving")
    click(page, "Cancel goal")
    assert status_of(driven, lambda status: status["goal_result"])["goal_result"]["outcome"] == "cancelled"


def test_a_robot_that_searches_for_itself_is_told_where_it_is(page: Page, driven: Driven) -> None:
    before = driven.robot.json("status")["pose"]
    click(page, "Follow the robot")
    click(page, "Follow the robot")  # the place stays in the middle while the estimate jumps
    click(page, "Relocalise")
    expect(page.locator("#lost")).to_contain_text("The localizer is searching")
    click(page, "I am here")
    heading = math.radians(before["heading_deg"])
    drag_on_map(page, 0, 0, 60 * math.cos(heading), -60 * math.sin(heading))
    page.locator("#draft-go").click()
    found = status_of(driven, lambda status: status["pose"]["state"] == "tracking")["pose"]
    assert apart(found, before["x"], before["y"]) < 0.1 and abs(found["heading_deg"] - before["heading_deg"]) < 5.0
    expect(page.locator("#lost")).to_be_empty()


def test_the_robot_forgets_what_it_has_mapped(page: Page, driven: Driven) -> None:
    open_panel(page, "Layers")
    with Navigator(ROBOT) as robot:
        maps = robot.listen(["mapper/map"])
        maps.take(WAIT)  # the map of before
        click(page, "Clear the map")
        expect(page.locator("#said")).to_have_text("The robot has forgotten what it has mapped.")
        assert maps.take(WAIT)


class Commands:
    """Commands of the gate as they arrive: time, s, and the twist."""

    def __init__(self) -> None:
        self.heard: list[tuple[float, Twist2D]] = []

    def hear(self, key: str, data: bytes | None, label: str) -> None:
        message = None if data is None else decode(data, label)[0]
        if isinstance(message, Command):
            self.heard.append((time.monotonic(), message.twist))

    def last_moving(self) -> float:
        """When the last command that moves the robot has arrived; 0 before the first."""
        return max((at for at, twist in self.heard if abs(twist.vx) + abs(twist.wz) > 0.001), default=0.0)

    def wait_for_motion(self, after: float) -> None:
        limit = time.monotonic() + WAIT
        while self.last_moving() <= after:
            assert time.monotonic() < limit, "the robot was not commanded to move"
            time.sleep(0.01)


@contextmanager
def gate_commands() -> Iterator[Commands]:
    """Listen to what the gate sends to the wheels."""
    with Navigator(ROBOT) as robot:
        found = Commands()
        robot.client.bus.subscribe(f"{ROBOT}/gate/main/command", found.hear)
        yield found


def test_stop_is_acknowledged_and_stops_the_robot_until_resume(page: Page, driven: Driven) -> None:
    place_goal(page, 0, -60)
    click(page, "Drive there")
    expect(page.locator("#state")).to_have_text("driving")
    page.locator("#stop").click()
    expect(page.locator("#stop-state")).to_have_text(re.compile(r"sent, \d+ ms|robot is stopped"))
    assert status_of(driven, lambda status: status["gate_status"]["latched"])["gate_status"]["reason"] == "operator"
    expect(page.locator("#state")).to_have_text("STOPPED")
    click(page, "Resume")
    status_of(driven, lambda status: not status["gate_status"]["latched"])
    expect(page.locator("#state")).not_to_have_text("STOPPED")


def test_the_stick_drives_while_it_is_held_and_hands_the_robot_back(page: Page, driven: Driven) -> None:
    open_panel(page, "Drive")
    box = page.locator("#stick").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    with gate_commands() as gate:
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 40, y, steps=3)
        gate.wait_for_motion(0.0)
        expect(page.locator("#drives")).to_have_text("an operator drives")
        expect(page.locator("#teleop-limits")).to_contain_text("the gate gives")
        page.mouse.up()
        released = time.monotonic()
        click(page, "Hand back")
        assert status_of(driven, lambda status: status["gate_status"]["source"] == "none")
        assert gate.last_moving() < released + DEAD_MAN


def test_a_page_that_is_lost_while_it_drives_stops_the_robot(browser: Browser, driven: Driven, size: str) -> None:
    with gate_commands() as gate:
        with logged_in(browser, driven.url(), size) as page:
            open_panel(page, "Drive")
            page.locator("#stick").focus()
            page.keyboard.down("ArrowRight")
            gate.wait_for_motion(0.0)
            lost = time.monotonic()
        time.sleep(2 * DEAD_MAN)  # what must not happen has this long to happen
        assert gate.last_moving() < lost + DEAD_MAN
    driven.robot.run("resume")


def test_a_page_that_freezes_while_it_drives_stops_the_robot(page: Page, driven: Driven) -> None:
    with gate_commands() as gate:
        open_panel(page, "Drive")
        page.locator("#stick").focus()
        page.keyboard.down("ArrowLeft")
        gate.wait_for_motion(0.0)
        frozen = time.monotonic()
        page.evaluate("() => { const until = performance.now() + 1500; while (performance.now() < until); }")
        moving = [at for at, twist in gate.heard if frozen < at < frozen + 1.4 and abs(twist.wz) > 0.001]
        assert max(moving, default=0.0) - frozen < DEAD_MAN
        page.keyboard.up("ArrowLeft")
        click(page, "Hand back")


def test_another_instance_is_made_active_and_its_commands_are_compared(page: Page, driven: Driven) -> None:
    place_goal(page, 0, -70)
    click(page, "Drive there")
    panel = open_panel(page, "Compare")
    row = panel.get_by_role("row", name="improved_vfh")
    expect(row.get_by_role("cell").nth(0)).to_have_text(re.compile(r"-?\d\.\d\d"))
    panel.get_by_role("button", name="Make improved_vfh active as avoider").click()
    expect(panel.get_by_role("row", name="improved_vfh (active)")).to_be_visible()
    assert "avoider improved_vfh" in driven.robot.json("status")["gate_selection"]["instances"]
    panel.get_by_role("button", name="Make dwa active as avoider").click()
    expect(panel.get_by_role("row", name="dwa (active)")).to_be_visible()


def test_a_parameter_shows_its_unit_bounds_and_default_and_is_set(page: Page, driven: Driven) -> None:
    panel = open_panel(page, "Parameters")
    panel.get_by_role("searchbox", name="Find").fill("controller lyapunov_tracker k3")
    row = panel.locator(".param:visible")
    expect(row).to_have_count(1)
    expect(row).to_contain_text("default")
    before = row.get_by_role("spinbutton").input_value()
    row.get_by_role("spinbutton").fill("0.9")
    row.get_by_role("button", name="Set k3", exact=True).click()
    expect(page.locator("#said")).to_contain_text("k3 is 0.9")
    assert "k3" in str(driven.robot.json("status")["changed_parameters"])
    row.get_by_role("spinbutton").fill("-5")
    row.get_by_role("button", name="Set k3", exact=True).click()
    expect(page.locator("#said")).to_contain_text("k3: ")
    row.get_by_role("spinbutton").fill(before)
    row.get_by_role("button", name="Set k3", exact=True).click()
    expect(page.locator("#said")).to_contain_text(f"k3 is {before}")


def test_a_drive_is_recorded_and_downloaded(page: Page, tmp_path: Path) -> None:
    panel = open_panel(page, "Record")
    panel.get_by_role("button", name="Start recording").click()
    panel.get_by_role("button", name="Stop recording").click()
    expect(panel.get_by_text("Not recording.")).to_be_visible()
    with page.expect_download() as download:
        panel.get_by_role("link").first.click()
    file = tmp_path / "drive.mcap"
    download.value.save_as(file)
    assert file.read_bytes().startswith(b"\x89MCAP")


def test_events_and_the_doctor_are_shown_with_remedies(page: Page) -> None:
    page.locator("#stop").click()
    panel = open_panel(page, "Events")
    event = panel.locator(".events li").filter(has_text="stopped: by an operator").first
    expect(event).to_contain_text("→ Resume lets it drive again")
    expect(panel.locator(".findings")).to_contain_text(re.compile("stopped|No problem"))


def test_a_viewer_sees_the_robot_and_is_told_why_it_cannot_act(browser: Browser, driven: Driven, size: str) -> None:
    with logged_in(browser, driven.url("view"), size) as page:
        for name in ("Goal", "Cancel goal", "Relocalise", "Resume"):
            button = page.get_by_role("button", name=name, exact=True)
            expect(button).to_have_attribute("aria-disabled", "true")
            button.click(force=True)
            expect(page.locator("#said")).to_have_text("View only: log in with an operator's token to act.")
        page.keyboard.press("Space")
        expect(page.locator("#stop-state")).to_have_text("view only")
        assert not driven.robot.json("status")["gate_status"]["latched"]


def tab_to(page: Page, name: str) -> None:
    """Press Tab until the focus is on what has this name, and see that it shows."""
    for _ in range(80):
        page.keyboard.press("Tab")
        focused = page.locator(":focus")
        if focused.count() and (focused.get_attribute("aria-label") or focused.inner_text()) == name:
            assert focused.evaluate("(one) => getComputedStyle(one).outlineStyle") != "none"
            return
    raise AssertionError(f"Tab does not reach {name}")


def test_a_whole_drive_by_keyboard(browser: Browser, driven: Driven, size: str) -> None:
    with opened(browser, size) as page:
        page.goto(driven.site.server.url)
        expect(page.locator("#token")).to_be_focused()
        page.keyboard.type(driven.site.dashboard.sessions.tokens["operate"])
        page.keyboard.press("Enter")
        expect(page.locator("#ages")).to_contain_text("pose")
        page.keyboard.press("f")
        tab_to(page, "Goal")
        page.keyboard.press("Enter")
        for key in ("ArrowUp", "ArrowUp", "ArrowLeft", "Shift+ArrowLeft"):
            page.keyboard.press(key)
        page.keyboard.press("Enter")
        expect(page.locator("#draft-text")).to_contain_text("heading 15°")
        goal = points_of(page)
        page.keyboard.press("Enter")
        expect(page.locator("#state")).to_have_text("driving")
        page.keyboard.press("Space")
        expect(page.locator("#state")).to_have_text("STOPPED")
        page.keyboard.press("r")
        expect(page.locator("#state")).to_have_text("no goal")
        assert apart(driven.robot.json("status")["goal_result"]["place"], *goal[:2]) < 0.35
        page.keyboard.press("t")
        page.keyboard.down("a")
        expect(page.locator("#drives")).to_have_text("an operator drives")
        page.keyboard.up("a")
        tab_to(page, "Hand back")
        page.keyboard.press("Enter")
        expect(page.locator("#hand-back")).to_be_hidden()
        page.keyboard.press("o")
        page.keyboard.press("o")
        page.keyboard.press("ArrowRight")
        expect(page.get_by_role("tab", name="Compare")).to_be_focused()
        page.keyboard.press("Escape")
        expect(page.locator("#panel")).to_be_hidden()
        page.keyboard.press("?")
        expect(page.get_by_role("heading", name="Keys")).to_be_visible()
