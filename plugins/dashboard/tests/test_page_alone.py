"""The page against a server that says what a test wants: names with markup, old data, lost connections, many scans."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator

import numpy as np
import pytest
from dashboard_rig import served
from navloom import MapUpdate, OccupancyGrid, Pose2D
from navloom_dashboard.frames import map_frame
from page_rig import SIZES, Fingers, click, colour_at, open_panel, opened, placed, violations
from page_server import COMMANDS, EVENT, MARKUP, POSE, ROBOT, Server, about, state
from playwright.sync_api import Browser, expect


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The files of the page, from the server."""
    with served(tmp_path_factory.mktemp("recordings")) as site:
        yield site.server.url


@pytest.fixture
def server(browser: Browser, url: str) -> Iterator[Server]:
    with opened(browser, "desk") as page:
        made = Server(page)
        page.goto(url)
        expect(page.locator("#stop-state")).to_have_text("ready")
        yield made


def test_markup_in_every_name_and_text_is_shown_as_text(server: Server) -> None:
    page = server.page
    lost = {**POSE, "state": "lost", "reason": MARKUP}
    members = {"kind": "members", "age": 0, "members": [{"name": MARKUP, "x": 1, "y": 0, "heading": 0}]}
    server.send(about(MARKUP), lost, state(driver=MARKUP, why=MARKUP, remedy=MARKUP, stopped=True))
    server.send(EVENT, COMMANDS, members)
    for panel in ("Compare", "Parameters", "Events"):
        expect(open_panel(page, panel)).to_contain_text(MARKUP)
    for place in ("#drives", "#why", "#lost"):
        expect(page.locator(place)).to_contain_text(MARKUP)
    assert page.locator("#robot option").nth(1).inner_text() == f"lab/{MARKUP}"
    assert page.locator("img, body script").count() == 0 and page.evaluate("window.broken") is None


def test_data_that_stops_coming_is_shown_as_old_within_its_limit(server: Server) -> None:
    banner = server.page.locator("#banner")
    server.send({**POSE, "age": 0.1}, state())
    expect(banner).to_be_visible()
    expect(banner).to_contain_text("OLD DATA: the pose shown is not the present one.")
    server.send(POSE, state())
    expect(banner).to_be_hidden()


def test_data_that_is_long_on_the_way_is_shown_as_old(browser: Browser, url: str) -> None:
    with opened(browser, "desk") as page:
        page.clock.install()
        server = Server(page)
        page.goto(url)
        expect(page.locator("#stop-state")).to_have_text("ready")
        for way, is_old in ((3.0, True), (0.0, False)):
            server.asked.clear()
            while not server.asked:
                page.clock.fast_forward(1000)
            asked = server.asked[0]["ping"]
            page.clock.fast_forward(round(1000 * way))
            now = page.evaluate("performance.now() / 1000")
            # Half of the 3 s is the way from the server.
            server.send({"kind": "pong", "ping": asked, "sent": now}, {**POSE, "sent": now}, state(sent=now))
            expect(page.locator("#banner")).to_be_visible(visible=is_old)
            if is_old:
                expect(page.locator("#banner")).to_contain_text("OLD DATA: the pose")


def test_a_robot_that_is_gone_is_shown_until_it_is_back(server: Server) -> None:
    server.send({"kind": "gone", "age": None, "why": "no node answers"})
    expect(server.page.locator("#banner")).to_contain_text("THE ROBOT IS GONE. This picture is old. no node answers")
    expect(server.page.locator("#stop-state")).to_have_text("robot is gone")
    server.send(about(), POSE, state())
    expect(server.page.locator("#banner")).to_be_hidden()


HELD_WORKERS = """
    window.held = [];
    window.Worker = class extends Worker {
        set onmessage(take) {
            super.onmessage = (event) => {
                document.documentElement.dataset.held = held.push(() => take(event));
            };
        }
    };
"""
"""Script of a page whose workers' answers wait until the test lets them through."""
GROUND, WALL = [195, 202, 210, 255], [23, 27, 33, 255]
"""Colours of what is unknown, and of what is occupied, in light colours."""


def occupied_map() -> bytes:
    """The message of a map of 20 m x 20 m without free space."""
    grid = OccupancyGrid(np.full((40, 40), 100, np.int8), 0.5, Pose2D(-10.0, -10.0, 0.0))
    data = map_frame(MapUpdate(0, grid, np.empty((0, 4)), ()), 1).wire(0.0, 0.0)
    assert isinstance(data, bytes)
    return data


@pytest.mark.parametrize(("is_changed", "colour"), [(False, WALL), (True, GROUND)], ids=["same", "another"])
def test_a_map_that_is_unpacked_late_is_not_shown_for_another_robot(
    browser: Browser, url: str, is_changed: bool, colour: list[int]
) -> None:
    with opened(browser, "desk") as page:
        page.add_init_script(HELD_WORKERS)
        server = Server(page)
        page.goto(url)
        expect(page.locator("#stop-state")).to_have_text("ready")
        assert server.live is not None
        server.live.send(occupied_map())
        expect(page.locator("html")).to_have_attribute("data-held", "1")
        if is_changed:
            page.locator("#robot").select_option(index=1)
            expect(page.locator("#stop-state")).to_have_text("ready")
        page.evaluate("held.forEach((take) => take())")
        assert colour_at(page, 100, 100) == colour


def test_a_robot_that_is_back_does_not_have_the_map_and_the_path_of_before(server: Server) -> None:
    assert server.live is not None
    server.live.send(occupied_map())
    server.send({"kind": "path", "age": 0.0, "points": [[0, 0], [1, 0]]})
    expect(server.page.locator("#ages")).to_contain_text("path")
    server.send({"kind": "gone", "age": None, "why": "no node answers"}, about(), POSE, state())
    expect(server.page.locator("#ages")).not_to_contain_text("path")
    assert colour_at(server.page, 100, 100) == GROUND


def test_a_recording_is_shown_on_every_page_and_why_it_has_ended_by_itself(server: Server) -> None:
    server.send({"kind": "recording", "age": None, "file": "a.mcap", "why": ""})
    expect(server.page.locator("#recording")).to_be_visible()
    server.send({"kind": "recording", "age": None, "file": None, "why": MARKUP})
    expect(server.page.locator("#recording")).to_be_hidden()
    expect(server.page.locator("#said")).to_have_text(f"The recording has ended by itself: {MARKUP}")


def test_a_command_that_is_old_is_not_drawn_as_if_it_were_new(server: Server) -> None:
    rows = [{"instance": name, "active": name == "a", "v": 0.5, "w": 0.0} for name in "ab"]
    page, shown = server.page, []
    for age in (0.0, 5.0):
        server.send({"kind": "commands", "age": age, "roles": {"avoider": rows}}, POSE)
        page.evaluate("new Promise(requestAnimationFrame)")
        shown.append(colour_at(page, 60, 0) != GROUND)
    assert shown == [True, False]


def test_without_a_robot_the_page_says_how_to_start_one_until_there_is_one(browser: Browser, url: str) -> None:
    with opened(browser, "phone") as page:
        Server(page)
        robots: list[str] = []
        answer = {"right": "operate", "csrf": "", "robots": robots}
        page.route("**/api/session", lambda route: route.fulfill(json=answer))
        page.goto(url)
        expect(page.locator("#lost")).to_have_text("No robot is up → navloom up starts one.")
        robots.append(ROBOT)
        expect(page.locator("#lost")).to_be_empty()


def test_a_lost_connection_is_shown_and_comes_back_by_itself(server: Server) -> None:
    assert server.live is not None
    first = server.live
    first.close()
    banner = server.page.locator("#banner")
    expect(banner).to_be_visible()
    expect(banner).to_contain_text("NOT CONNECTED")
    expect(banner).to_be_hidden()
    assert server.live is not first


def test_space_stops_wherever_the_focus_is_but_types_in_a_field_for_text(server: Server) -> None:
    page = server.page
    for name in ("Goal", "Help and keys"):
        page.get_by_role("button", name=name, exact=True).focus()
        page.keyboard.press("Space")
    assert [said["n"] for said in server.said] == [1, 2]
    expect(page.get_by_role("button", name="Goal", exact=True)).to_have_attribute("aria-pressed", "false")
    field = open_panel(page, "Compare").get_by_label("Another avoider")
    field.focus()
    page.keyboard.type("a b")
    expect(field).to_have_value("a b")
    assert len(server.said) == 2


def test_a_stop_connection_that_is_down_is_shown_and_the_stop_goes_out_when_it_is_back(server: Server) -> None:
    assert server.stop is not None
    page, button = server.page, server.page.locator("#stop-state")
    server.stop.close()
    expect(button).to_have_text("no connection")
    page.keyboard.press("Space")
    expect(button).to_have_text("NOT SENT: no connection")
    expect(button).to_contain_text("sent, ")
    assert [said["n"] for said in server.said] == [1]


def test_a_stop_connection_without_heartbeats_counts_as_down(server: Server) -> None:
    server.acknowledges = False
    expect(server.page.locator("#stop-state")).to_have_text("no connection")
    expect(server.page.locator("#said")).to_be_empty()


@pytest.mark.parametrize("lost", ["release", "blur", "hidden", "socket"])
def test_driving_by_hand_ends_with_zero_when_the_dead_man_is_let_go(server: Server, lost: str) -> None:
    page = server.page
    open_panel(page, "Drive")
    page.locator("#stick").focus()
    page.keyboard.down("w")
    expect(page.locator("#teleop-state")).to_have_text("asked 0.40 m/s, 0.00 rad/s")
    page.wait_for_timeout(150)  # the dead-man sends at 20 Hz meanwhile
    assert server.said[-1]["v"] == pytest.approx(0.4) and len(server.said) >= 2
    if lost == "release":
        page.keyboard.up("w")
    elif lost == "blur":
        page.locator("#share").focus()
    elif lost == "hidden":
        page.evaluate("Object.defineProperty(document, 'hidden', {value: true, configurable: true});"
                      "document.dispatchEvent(new Event('visibilitychange'))")  # fmt: skip
    elif server.teleop is not None:
        server.teleop.close()
    expect(page.locator("#teleop-state")).to_have_text("not held")
    count = len(server.said)
    page.wait_for_timeout(200)  # four periods in which nothing may be sent
    assert len(server.said) == count
    assert lost == "socket" or (server.said[-1]["v"], server.said[-1]["w"]) == (0, 0)


@pytest.mark.parametrize("is_followed", [False, True], ids=["free", "followed"])
def test_two_fingers_zoom_and_turn_the_map(browser: Browser, url: str, is_followed: bool) -> None:
    with opened(browser, "phone") as page:
        Server(page)
        page.goto(url)
        expect(page.locator("#ages")).to_contain_text("pose")
        if is_followed:
            click(page, "Follow the robot")
        x, y, heading = placed(page, -100, 0, 40, 0)
        assert (y, heading) == (pytest.approx(0.0, abs=0.5), 0.0)
        fingers = Fingers(page)
        fingers.at("touchStart", (-40, 0), (40, 0))
        fingers.at("touchMove", (0, -80), (0, 80))  # twice as far apart, and a quarter turn to the right
        fingers.at("touchEnd")
        turned = placed(page, 0, -100, 0, -40)
        # What was 100 pixels to the left is now 200 above; so 100 pixels above the middle it is half as far.
        assert turned[2] == 180.0
        assert turned[0] == pytest.approx(x / 2, abs=0.02)
        pressed = page.locator("#follow").get_attribute("aria-pressed")
        assert pressed == str(is_followed).lower()


def test_a_second_finger_abandons_what_the_first_was_placing(browser: Browser, url: str) -> None:
    with opened(browser, "phone") as page:
        Server(page)
        page.goto(url)
        expect(page.locator("#ages")).to_contain_text("pose")
        click(page, "Goal")
        fingers = Fingers(page)
        fingers.at("touchStart", (-40, 0))
        fingers.at("touchStart", (-40, 0), (40, 0))
        fingers.at("touchMove", (-50, 0), (50, 0))
        fingers.at("touchEnd")
        expect(page.locator("#draft-text")).to_contain_text("Press on the map where to drive to")


def test_a_wrong_token_is_refused_with_what_to_do(browser: Browser, url: str) -> None:
    with opened(browser, "phone") as page:
        page.goto(f"{url}/#token=wrong")
        expect(page.locator("#login-error")).to_contain_text("wrong token: `navloom dashboard` prints the right one")
        assert page.url == f"{url}/"


@pytest.mark.parametrize("size", ["360", "4k", *SIZES])
def test_everything_fits_and_stop_is_in_sight_at_every_size(server: Server, size: str) -> None:
    page = server.page
    sizes = {**SIZES, "360": {"width": 360, "height": 640}, "4k": {"width": 3840, "height": 2160}}
    page.set_viewport_size(sizes[size])  # type: ignore[arg-type]
    for panel in ("Drive", "Compare", "Events"):
        open_panel(page, panel)
        if panel == "Drive":
            expect(page.locator("#stick")).to_be_in_viewport(ratio=1.0)
        expect(page.locator("#stop")).to_be_in_viewport(ratio=1.0)
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        small = page.evaluate("""() => [...document.querySelectorAll("button, select, input")]
            .filter((one) => one.checkVisibility() && one.getBoundingClientRect().height < 43).map(({ id }) => id)""")
        assert small == []


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_axe_finds_no_violation(browser: Browser, url: str, size: str, theme: str) -> None:
    with opened(browser, size, theme) as page:
        page.goto(url)
        expect(page.locator("#login")).to_be_visible()
        assert violations(page) == []
        server = Server(page)
        page.goto(url)
        expect(page.locator("#stop-state")).to_have_text("ready")
        server.send(state(stopped=True, latched=True, why="by an operator", remedy="`navloom resume`"), EVENT, COMMANDS)
        click(page, "Goal")
        assert violations(page) == []
        for panel in ("Drive", "Compare", "Parameters", "Events", "Record", "Layers"):
            open_panel(page, panel)
            assert violations(page, "#panel") == []
        click(page, "Help and keys")
        assert violations(page, "#help") == []


@pytest.mark.benchmark
def test_thirty_frames_a_second_are_drawn_with_1080_beams_at_20_hz(server: Server) -> None:
    page = server.page
    click(page, "Follow the robot")
    page.evaluate("""() => {
        window.seen = [];
        const next = (now) => { window.seen.push(now); requestAnimationFrame(next); };
        requestAnimationFrame(next);
    }""")
    ranges = np.full(1080, 3.0, "<f4").tobytes()
    scan = {"kind": "scan", "name": "laser", "age": 0, "pose": [0, 0, 0], "angle_min": -2.35, "angle_step": 4.7 / 1079}
    header = json.dumps(scan).encode()
    for tick in range(60):
        assert server.live is not None
        server.live.send(struct.pack("<I", len(header)) + header + ranges)
        server.send({**POSE, "x": 0.02 * tick}, state())
        page.wait_for_timeout(45)
    count, span = page.evaluate("[seen.length, (seen.at(-1) - seen[0]) / 1000]")
    assert count / span >= 30.0
