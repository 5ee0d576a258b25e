"""From messages to paths and shapes: frames, rates, changes, shadows, panels of plugins."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path as FilePath
from typing import Any, get_args

import numpy as np
import pytest
from navloom.geometry.footprints import rectangle
from navloom.messages import (
    AvoiderDiagnostics,
    AvoiderStatus,
    Bodies,
    Command,
    Contact,
    GateStatus,
    GoalState,
    HandOver,
    Hypotheses,
    MapUpdate,
    OccupancyGrid,
    Path,
    Pose2D,
    RangeScan,
    StopReason,
    Sweep,
    Tracks,
    Truth,
    Twist2D,
)
from navloom.plugins import Discovery, Registry
from navloom_viewer.blueprint import states
from navloom_viewer.colours import STATES
from navloom_viewer.draw_sensing import FREE, OCCUPIED, UNKNOWN
from navloom_viewer.drawing import Drawing
from navloom_viewer.panels import Panel, panels_of
from navloom_viewer.picture_setup import actors_of
from navloom_viewer.shapes import cones, prism, ring_bars, slot_arcs, stripes
from navloom_viewer.world_drawing import legend, standing
from viewer_rig import Memory, component, facts_for, pose_at, shown

pytest.importorskip("rerun", reason="the extra `view` is not installed")
SHADOW = (("avoider", "other"),)


def drawing(
    *names: str, shadows: tuple[tuple[str, str], ...] = (), panels: tuple[Panel, ...] = ()
) -> tuple[Drawing, Memory]:
    memory = Memory()
    made = Drawing(facts_for(*names, shadows=shadows), [memory], panels)
    made.begin()
    return made, memory


def diagnostics(histogram: list[float], **changes: object) -> AvoiderDiagnostics:
    values = {
        "window": np.zeros((0, 0), np.uint8), "window_resolution": 0.0, "window_x": 0.0, "window_y": 0.0,
        "histogram": np.array(histogram), "threshold": 2.0, "slots": np.zeros((0, 2)), "chosen": None, "why": "test",
    }  # fmt: skip
    return AvoiderDiagnostics(**{**values, **changes})  # type: ignore[arg-type]


# --- scene ----------------------------------------------------------------------------------------------------------


def contrast(one: tuple[int, ...], other: tuple[int, ...]) -> float:
    """Contrast ratio of two colours as WCAG defines it, 1 to 21."""
    light = [
        sum(w * (c / 3294.6 if c <= 10 else ((c / 255 + 0.055) / 1.055) ** 2.4)
            for w, c in zip((0.2126, 0.7152, 0.0722), colour, strict=True))
        for colour in (one, other)
    ]  # fmt: skip
    return (max(light) + 0.05) / (min(light) + 0.05)


def test_free_unknown_and_occupied_cells_are_told_apart() -> None:
    assert contrast(FREE, UNKNOWN) > 3.0 and contrast(UNKNOWN, OCCUPIED) > 3.0
    # The viewer's background: what is unknown is not what has no map.
    assert contrast(UNKNOWN, (18, 20, 26)) > 2.5


def test_the_names_of_robots_in_one_place_and_of_their_shadows_are_at_different_heights() -> None:
    made, memory = drawing("a", "b", shadows=SHADOW)
    for name in ("a", "b"):
        made.take(pose_at(0.0, 0.0, tick=1, name=name))
    heights = [float(component(memory.at(f"/run/{name}/base/name")[-1], "positions")[0][2]) for name in ("a", "b")]
    robot = made.facts.variants[0].height
    # The arrow of the only shadow is 0.4 m above the robot.
    assert sorted([robot + 0.4, *heights]) == pytest.approx([robot + 0.4, robot + 0.7, robot + 1.0])


def test_the_name_of_a_robot_tells_the_time_of_its_pose() -> None:
    made, memory = drawing()
    for tick in (1, 2, 41):  # 0.05, 0.1 and 2.05 s
        made.take(pose_at(0.0, 0.0, tick=tick))
    assert [component(one, "labels") for one in memory.at("/run/r1/base/name")] == [["r1, 0 s"], ["r1, 2 s"]]


def test_the_places_where_a_robot_may_be_are_arrows_until_one_is_left() -> None:
    made, memory = drawing()
    poses = np.array([(1.0, 2.0, 0.0), (3.0, 4.0, math.pi / 2)])
    for count, tick in ((2, 1), (1, 21)):
        made.take(shown(Hypotheses(0, poses[:count], np.array([0.75, 0.25])[:count]), role="localizer", tick=tick))
    first, last = memory.at("/run/r1/hypotheses")
    assert np.array(component(first, "origins"))[:, :2].tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert np.array(component(first, "vectors")) == pytest.approx(np.array([(0.6, 0, 0), (0, 0.6, 0)]), abs=1e-6)
    assert component(first, "radii") == pytest.approx([0.08, 0.04]) and not len(component(last, "origins"))


def test_tracks_are_drawn_where_they_are_with_the_way_of_their_next_second() -> None:
    made, memory = drawing()
    given = np.array([(1.0, 2.0), (3.0, 4.0)]), np.array([(0.5, 0.0), (0.0, -1.0)])
    tracks = Tracks(0, np.array([1, 7]), *given, np.zeros((2, 4, 4)), np.array([0.3, 0.5]), np.array([0.0, 2.0]))
    made.take(shown(tracks, role="people", tick=1))
    (discs,), (arrows,) = memory.at("/run/r1/tracks"), memory.at("/run/r1/tracks/velocity")
    assert component(discs, "labels") == ["1", "7"]
    assert np.array(component(discs, "half_sizes")) == pytest.approx(np.array([(0.3, 0.3, 0.5), (0.5, 0.5, 0.5)]))
    assert np.array(component(arrows, "origins"))[:, :2].tolist() == given[0].tolist()
    assert np.array(component(arrows, "vectors"))[:, :2].tolist() == given[1].tolist()


def test_every_entity_of_the_3d_view_has_a_frame_that_is_placed() -> None:
    made, memory = drawing()
    made.take(pose_at(1.0, 0.0))
    made.take(shown(RangeScan(0, np.zeros((1, 2)), np.zeros(1), np.full(1, 0.2), np.zeros(1), np.ones(1), 0.1, 4.0)))
    placed = {"map"} | {
        component(s, "child_frame")[0] for p, ss, _, _ in memory.logged if p.startswith("/tf/") for s in ss
    }
    spatial = {p for p, *_ in memory.logged if p.startswith(("/run/", "/world/"))}
    assert {memory.frame_of(path) for path in spatial} <= placed
    assert memory.frame_of("/run/r1/base/x") == "r1/base"


def test_a_robot_that_has_been_up_for_long_begins_at_its_first_message() -> None:
    made, memory = drawing()
    made.take(shown(Contact(False), port="contact", tick=7000))
    stamps = {stamp for path, _, tick, stamp in memory.logged if tick is not None}
    assert stamps == {7000 * 50_000_000}


def test_glass_and_what_is_not_on_the_map_are_drawn_apart() -> None:
    facts = facts_for()
    assert facts.world is not None
    wall, *_ = facts.world.obstacles
    solids = (wall, replace(wall, name="pane", material="glass"), replace(wall, name="new", is_mapped=False))
    shapes = dict(standing(replace(facts, world=replace(facts.world, obstacles=solids))))
    colours = [component(shapes[f"/world/{where}"], "colors") for where in ("in_the_way", "glass", "unmapped")]
    assert len({str(colour) for colour in colours}) == 3


def test_an_obstacle_appears_when_the_sweep_has_ended() -> None:
    made, memory = drawing()
    made.take(pose_at(0.0, 0.0, tick=1))
    assert memory.at("/world/in_the_way_later") == []
    sweep = Sweep(0, 1, np.ones((1, 1)), np.zeros(1), np.zeros(1), np.zeros(1), "paper", 0.0, 0.0, 0.4, 0.0, 9.0)
    made.take(shown(sweep, port="laser", tick=20))
    assert component(memory.at("/world/names_later")[-1], "labels") == ["surprise"]


def test_a_body_is_as_high_as_the_robot() -> None:
    vertices, triangles = prism(rectangle(0.8, 0.6), 1.2)
    assert vertices[:, 2].max() == 1.2
    assert triangles.shape == (16, 3)  # two for each side, one for each corner of each lid
    assert triangles.max() < len(vertices)


def test_the_legend_names_every_robot_and_its_plugins() -> None:
    text = legend(facts_for("vff", "dwa"))
    assert "**vff**, sky blue" in text
    assert "**dwa**, orange" in text
    assert "avoider *main_avoider*" in text


# --- messages -------------------------------------------------------------------------------------------------------


def test_a_scan_is_drawn_at_most_five_times_a_second() -> None:
    made, memory = drawing()
    scan = RangeScan(0, np.zeros((1, 2)), np.zeros(1), np.full(1, 0.2), np.zeros(1), np.ones(1), 0.1, 4.0)
    for tick in range(40):  # 2 s at 20 Hz
        made.take(shown(scan, port="sonars", tick=tick))
    assert len(memory.at("/run/r1/base/sonars")) == 10


def test_cells_with_the_lowest_y_are_the_images_last_row() -> None:
    made, memory = drawing()
    cells = np.array([[100, 0, -1], [0, 0, 0]], dtype=np.int8)
    made.take(
        shown(MapUpdate(0, OccupancyGrid(cells, 0.4, Pose2D(-1.0, -2.0, 0.0)), np.zeros((0, 4)), ()), "mapper", "map")
    )
    (drawn,) = memory.at("/run/r1/map")
    pixels = np.array(component(drawn, "data")[0], dtype=np.uint8).reshape(2, 3, 4)
    assert pixels[1, 0].tolist() == [12, 13, 16, 255]
    assert pixels[1, 2].tolist() == [92, 104, 122, 255]
    assert pixels[0, 0].tolist() == [226, 228, 230, 255]
    assert component(drawn, "translation")[0] == pytest.approx([-1.0, -2.0, 0.0])


def test_bars_are_by_bearing_from_the_robot_in_units_of_the_threshold() -> None:
    made, memory = drawing()
    made.take(pose_at(0.0, 0.0, heading=math.pi / 2))
    made.take(shown(AvoiderStatus("steering", diagnostics([0.0, 3.0, 0.0, 0.0])), "avoider", "status"))
    (chart,) = memory.at("/histogram/r1")
    bearings = component(chart, "abscissa")[0]["buffer"]
    values = component(chart, "values")[0]["buffer"]
    # The sector along the map's y axis is straight ahead of a robot that looks along it; 3 is 1.5 thresholds.
    assert dict(zip(np.round(bearings).tolist(), values, strict=True)) == {-180.0: 0.0, -90.0: 0.0, 0.0: 1.5, 90.0: 0.0}


def test_an_obstacle_at_the_left_of_the_robot_is_at_the_left_of_the_chart() -> None:
    made, memory = drawing()
    made.take(pose_at(0.0, 0.0))
    made.take(shown(AvoiderStatus("steering", diagnostics([0.0, 3.0, 0.0, 0.0])), "avoider", "status"))
    (chart,) = memory.at("/histogram/r1")
    bearings = np.array(component(chart, "abscissa")[0]["buffer"])
    # The sector along the map's y axis is at the left of a robot that looks along x; the axis grows to the right.
    assert bearings[np.argmax(component(chart, "values")[0]["buffer"])] == pytest.approx(-90.0)


def test_a_status_without_diagnostics_leaves_the_last_bars_in_the_picture() -> None:
    made, memory = drawing()
    made.take(pose_at(0.0, 0.0))
    made.take(shown(AvoiderStatus("steering", diagnostics([0.0, 3.0, 0.0, 0.0])), "avoider", "status"))
    made.take(shown(AvoiderStatus("clear"), "avoider", "status"))
    assert len(memory.at("/histogram/r1")) == 1
    assert len(memory.at("/avoider")) >= 2  # the state still changes


def test_lanes_of_states_have_plain_names() -> None:
    made, memory = drawing(shadows=SHADOW)
    status = AvoiderStatus("clear", diagnostics([]))
    made.take(shown(status, "avoider", "status"))
    made.take(shown(status, "avoider", "status", instance="other", active=False))
    several, both = drawing("vff", "dwa")
    several.take(shown(GateStatus("controller", "", False, False, None, ()), "gate", "status", name="dwa"))
    lanes = [path for kept in (memory, both) for path, shapes, *_ in kept.logged
             if type(shapes[0]).__name__ == "StateChange"]  # fmt: skip
    assert lanes == ["/avoider", "/other/avoider", "/dwa/driver"]
    styled = {path for path, shapes, *_ in memory.logged if type(shapes[0]).__name__ == "StateConfiguration"}
    assert styled == {"/goal", "/driver", "/avoider", "/other/avoider"}


def test_the_layout_shows_the_lanes_that_are_drawn() -> None:
    def lanes(*names: str, shadows: tuple[tuple[str, str], ...] = ()) -> list[str]:
        view = states(facts_for(*names, shadows=shadows))
        assert isinstance(view.contents, list)
        return [str(line) for line in view.contents]

    assert lanes(shadows=SHADOW) == ["+ /goal", "+ /driver", "+ /avoider", "+ /other/avoider"]
    assert lanes("vff", "dwa") == ["+ /vff/driver", "+ /dwa/driver"]


def test_names_are_white_on_the_viewers_dark_ground() -> None:
    made, memory = drawing()
    made.take(pose_at(0.0, 0.0))
    marks = {
        component(shape, "labels")[0]: component(shape, "colors")[0]
        for path, shapes, *_ in memory.logged
        for shape in shapes
        if path.startswith(("/world/", "/run/")) and component(shape, "labels")
    }
    assert marks == dict.fromkeys(("start", "goal", "r1, 0 s"), 0xFFFFFFFF)


# --- several on one line --------------------------------------------------------------------------------------------


def test_stripes_of_all_robots_are_the_whole_line_once() -> None:
    line = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.85]])
    pieces = [piece for number in range(3) for piece in stripes(line, number, 3)]
    assert sum(np.hypot(*np.diff(piece, axis=0).T).sum() for piece in pieces) == pytest.approx(1.85)
    assert stripes(line, 1, 3)[0].tolist() == [pytest.approx([0.3, 0.0]), pytest.approx([0.6, 0.0])]
    # A piece round the corner keeps it.
    assert stripes(line, 0, 3)[1].tolist() == [
        pytest.approx([0.9, 0.0]), pytest.approx([1.0, 0.0]), pytest.approx([1.0, 0.2])
    ]  # fmt: skip
    assert [len(stripes(line[:2] * 0.1, number, 3)) for number in range(3)] == [1, 1, 1]  # 0.1 m: each has a third


def test_plans_and_maps_of_robots_side_by_side_do_not_hide_each_other() -> None:
    made, memory = drawing("vff", "dwa")
    points = np.array([[0.0, 0.0], [4.0, 0.0]])
    grid = OccupancyGrid(np.zeros((1, 1), np.int8), 0.4, Pose2D(0.0, 0.0, 0.0))
    for name in ("vff", "dwa"):
        made.take(shown(Path(1, points, 4.0, None), "planner", "path", name=name))
        made.take(shown(MapUpdate(0, grid, np.array([[0.0, 1.0, 4.0, 1.0]]), ()), "mapper", "map", name=name))
    for what in ("plan", "segments"):
        drawn = {name: component(memory.at(f"/run/{name}/{what}")[0], "strips") for name in ("vff", "dwa")}
        covered = sorted((strip[0][0], strip[-1][0]) for strips in drawn.values() for strip in strips)
        assert all(strips for strips in drawn.values())
        ends = np.array(covered).ravel()
        assert ends[1:-1:2] == pytest.approx(ends[2::2]), what  # each begins where another's ends
        assert (ends[0], ends[-1]) == pytest.approx((0.0, 4.0))


def test_ring_slots_and_cones_have_the_specified_sizes() -> None:
    bars = ring_bars(Pose2D(1.0, 2.0, 0.5), np.array([0.0, 5.0]), 0.7, 0.3, 2.0, 0.1)
    assert bars[0].tolist() == [pytest.approx([1.7, 2.0, 0.1]), pytest.approx([1.73, 2.0, 0.1])]
    assert bars[1, 1, 0] == pytest.approx(1.0 - 0.73 - 0.6)  # ends at two thresholds
    (arc,) = slot_arcs(Pose2D(0.0, 0.0, 0.0), np.array([[math.radians(350.0), math.radians(370.0)]]), 2.0, 0.0)
    assert np.degrees(np.arctan2(arc[[0, -1], 1], arc[[0, -1], 0])) == pytest.approx([-10.0, 10.0])
    (cone,) = cones(np.zeros((1, 2)), np.array([math.pi / 2]), np.array([0.2]), np.array([3.0]), 0.25)
    assert cone[3].tolist() == pytest.approx([0.0, 3.0, 0.25], abs=1e-12)


def test_every_state_of_a_goal_has_a_colour() -> None:
    assert set(get_args(GoalState)) <= set(STATES)


def test_a_gate_stop_is_logged_once_with_its_reason_and_the_remedy() -> None:
    made, memory = drawing()
    for tick, reason in enumerate(["", "contact", "contact", ""]):
        source, why = "none" if reason else "controller", StopReason.parse(reason)
        status = GateStatus(source, "", bool(reason), bool(reason), why, ())
        made.take(shown(status, "gate", "status", tick=tick))
    texts = [component(line, "text")[0] for line in memory.at("/log/r1/gate")]
    assert texts == ["r1: gate stops the robot: it touched something; `navloom resume` when the way is clear"]
    states = [component(state, "state")[0] for state in memory.at("/driver")]
    assert states == ["controller", "stopped", "controller"]


def test_taking_over_and_handing_back_are_logged_and_not_driving_free() -> None:
    made, memory = drawing()
    for tick, engaged in enumerate([False, True, True, False, False]):
        made.take(shown(HandOver(engaged, 0.61 + tick), "avoider", "handover", tick=tick))
    texts = [component(line, "text")[0] for line in memory.at("/log/r1/handover")]
    assert texts == ["r1: avoider takes over: something 1.61 m ahead", "r1: avoider hands back"]


def test_the_drawn_track_is_that_of_the_truth() -> None:
    made, memory = drawing()
    for tick in range(21):  # 1 s at 0.5 m/s
        twist = Twist2D(0.5, 0.0, 0.0)
        made.take(shown(Truth(Pose2D(0.025 * tick, 0.0, 0.0), twist, math.inf, "", False), port="truth", tick=tick))
    pieces = [component(piece, "strips")[0] for piece in memory.at("/run/r1/driven")]
    ends = [(strip[0][0], strip[-1][0]) for strip in pieces]
    assert np.array(ends) == pytest.approx(np.array([(0.1 * i, 0.1 * (i + 1)) for i in range(5)]), abs=1e-6)


def test_what_moves_is_drawn_where_it_is_and_no_robot_with_it() -> None:
    made, memory = drawing()
    part = [(0, 1.0, 2.0, 0.25, 0.0, 0.0, 0.0, 1.8, 0.0), (1, 3.0, 0.0, 0.5, 0.2, 0.0, 0.0, 1.0, 0.0),
            (2, 0.0, 0.0, 0.4, 0.4, 0.0, 0.0, 1.2, 0.0)]  # fmt: skip
    poses = np.array([(1.0, 2.0, 0.0), (3.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
    bodies = Bodies(0, ("person", "cart", "r1"), poses, np.zeros((3, 3)), np.array(part), 1)
    made.take(shown(bodies, "world", "bodies"))
    (rounds,), (boxes,) = memory.at("/run/r1/bodies_round"), memory.at("/run/r1/bodies")
    assert np.array(component(rounds, "centers")).tolist() == [[1.0, 2.0, pytest.approx(0.9)]]
    assert np.array(component(boxes, "half_sizes")).tolist() == [[0.5, pytest.approx(0.2), 0.5]]
    (names,) = memory.at("/run/r1/body_names")
    assert component(names, "labels") == ["person", "cart"]


def test_numbers_reach_the_sinks_together_with_their_ticks() -> None:
    made, memory = drawing()
    for tick in range(3):
        made.take(pose_at(0.0, 0.0, tick=tick))
    assert memory.numbers == {}
    made.flush()
    assert memory.numbers["/metrics/speed/r1"] == [(0, 0.3), (1, 0.3), (2, 0.3)]
    assert memory.numbers["/metrics/turn_rate/r1"][0][1] == pytest.approx(math.degrees(0.1))


# --- several robots and shadows -------------------------------------------------------------------------------------


def test_a_shadow_has_its_own_path_colour_and_half_the_opacity() -> None:
    made, memory = drawing(shadows=SHADOW)
    made.take(shown(Command(Twist2D(0.2, 0.0, 0.0)), "avoider", "command", instance="other", active=False))
    (way,) = memory.at("/run/other/base/command")
    colour = component(way, "colors")[0]
    actor = actors_of(facts_for(shadows=SHADOW))[("r1", "avoider", "other")]
    assert colour == (actor.colour[0] << 24) | (actor.colour[1] << 16) | (actor.colour[2] << 8) | 128
    assert memory.frame_of("/run/other/base/command") == "r1/base"


def test_nothing_is_drawn_of_a_waiting_instance() -> None:
    made, memory = drawing()
    made.take(pose_at(0.0, 0.0))
    before = len(memory.logged)
    made.take(shown(Command(Twist2D(0.2, 0.0, 0.0)), "avoider", "command", instance="spare", active=False))
    assert len(memory.logged) == before


def test_robots_side_by_side_have_different_colours() -> None:
    actors = actors_of(facts_for("improved_vfh", "vff", "dwa"))
    assert len({actor.colour for actor in actors.values()}) == 3


# --- panels of plugins ----------------------------------------------------------------------------------------------

PLUGIN = '''
import rerun as rr
from navloom import Contact, Panel, hookimpl

def draw(message, seen):
    if seen.time > 0.5:
        raise RuntimeError("too late")
    yield seen.in_base("bumper"), rr.Points3D([[0.4, 0.0, 0.1]], colors=[255, 0, 0])

@hookimpl
def navloom_register(registry):
    registry.panel(Panel("bumper", Contact, draw, max_hz=20.0))
'''  # fmt: skip


@pytest.fixture
def bumper(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> Discovery:
    (tmp_path / "my_bumper.py").write_text(PLUGIN, "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    points = [EntryPoint("panel.bumper", "my_bumper", "navloom"), EntryPoint("panel.gone", "no_such_module", "navloom")]
    return Discovery(found=points)


def test_a_plugins_panel_is_drawn_and_a_broken_one_is_named(bumper: Discovery) -> None:
    panels, wrong = panels_of(bumper)
    assert [panel.name for panel in panels] == ["bumper"]
    assert len(wrong) == 1
    assert "panel.gone" in wrong[0]
    made, memory = drawing(panels=tuple(panels))
    made.take(shown(Contact(True), port="contact"))
    assert len(memory.at("/run/r1/base/bumper")) == 1


def test_a_panel_that_fails_is_dropped_and_the_rest_goes_on(bumper: Discovery) -> None:
    made, memory = drawing(panels=tuple(panels_of(bumper)[0]))
    for tick in (0, 20, 40):
        made.take(shown(Contact(True), port="contact", tick=tick))
    assert made.broken == {"bumper": "panel bumper failed: RuntimeError: too late"}
    assert [component(line, "text")[0] for line in memory.at("/log/viewer")] == list(made.broken.values())
    made.take(pose_at(1.0, 0.0, tick=41))
    assert component(memory.at("/tf/r1")[-1], "translation")[0] == pytest.approx([1.0, 0.0, 0.0])


def test_the_panel_of_the_docs_registers_and_draws() -> None:
    page = FilePath(__file__).resolve().parents[3] / "docs" / "viewing.md"
    source = page.read_text("utf-8").split("```python\n")[1].split("```")[0]
    scope: dict[str, Any] = {"__name__": "my_panels"}
    exec(compile(source, "viewing.md", "exec"), scope)
    registry = Registry()
    scope["navloom_register"](registry)
    panel = registry.panels["bumper"]
    assert isinstance(panel, Panel)
    made, memory = drawing(panels=(panel,))
    made.take(shown(Contact(True), port="contact"))
    assert len(memory.at("/run/r1/base/bumper")) == 1


def test_arrows_on_the_robot_show_where_the_active_avoider_and_its_shadow_would_lead() -> None:
    made, memory = drawing(shadows=SHADOW)
    for instance, active, twist in (("main", True, (0.3, 0.0)), ("other", False, (0.2, math.pi / 2))):
        command = Command(Twist2D(twist[0], 0.0, twist[1]))
        made.take(shown(command, "avoider", "command", instance=instance, active=active))
    reach = 0.4 * math.sqrt(2.0) + 0.6  # the outline, and the length at rest
    (ours,), (theirs,) = memory.at("/run/r1/base/direction_avoider"), memory.at("/run/other/base/direction_avoider")
    assert component(ours, "vectors") == [pytest.approx([reach + 2 * 0.3, 0.0, 0.0])]
    to_the_left = [0.0, reach + 2 * 0.2, 0.0]  # the chord of a turn of 180 deg in 2 s
    assert component(theirs, "vectors") == [pytest.approx(to_the_left, abs=1e-6)]
    assert (component(ours, "labels"), component(theirs, "labels")) == ([], ["other"])
    assert component(ours, "colors") != component(theirs, "colors")
    assert memory.frame_of("/run/other/base/direction_avoider") == "r1/base"


def test_a_shadow_that_would_stop_has_a_name_without_an_arrow() -> None:
    made, memory = drawing(shadows=SHADOW)
    stop = Command(Twist2D(0.0, 0.0, 0.0))
    made.take(shown(stop, "avoider", "command", instance="other", active=False))
    (arrow,) = memory.at("/run/other/base/direction_avoider")
    assert component(arrow, "vectors") == [[0.0, 0.0, 0.0]] and component(arrow, "labels") == ["other: stop"]


def test_without_shadows_no_arrow_of_the_active_avoider_is_drawn() -> None:
    made, memory = drawing()
    made.take(shown(Command(Twist2D(0.3, 0.0, 0.0)), "avoider", "command", instance="main_avoider"))
    assert memory.at("/run/r1/base/direction_avoider") == []


def test_after_a_swap_the_arrows_change_their_owners() -> None:
    made, memory = drawing(shadows=SHADOW)
    ahead = Command(Twist2D(0.3, 0.0, 0.0))
    made.take(shown(ahead, "avoider", "command", instance="other", active=False, tick=0))
    made.take(shown(ahead, "avoider", "command", instance="other", active=True, tick=20))
    made.take(shown(ahead, "avoider", "command", instance="main_avoider", active=False, tick=20))
    arrow, cleared = memory.at("/run/other/base/direction_avoider")
    assert component(arrow, "labels") == ["other"] and type(cleared).__name__ == "Clear"
    assert len(memory.at("/run/r1/base/direction_avoider")) == 1
    assert component(memory.at("/run/main_avoider/base/direction_avoider")[0], "labels") == ["main_avoider"]
