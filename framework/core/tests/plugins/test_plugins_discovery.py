"""Plugins by entry point: listed without importing, loaded by name, and blamed by name."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib import invalidate_caches
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from navloom.plugins import Discovery, PluginError, PluginInfo

PLANNER = """
from navloom import PlanFailure, Planner, Point2D, hookimpl

class Nowhere(Planner):
    name = "{name}"
    api = {api}

    def plan(self, given):
        return PlanFailure(given.request.request_id, "no_path", Point2D(0.0, 0.0), "never")

@hookimpl
def navloom_register(registry):
    registry.add(Nowhere)
"""

WORLDS = """
from navloom import World, hookimpl

@hookimpl
def navloom_register(registry):
    registry.world("hall", lambda: World("hall"))
    registry.world_scheme("file", lambda argument, base: World(f"{base.name}/{argument}"))
    registry.world_scheme("toml", lambda argument, base: World(f"toml {argument}"))
    registry.world_scheme("rosmap", lambda argument, base: World(f"rosmap {argument}"))
"""

Write = Callable[[str, str], str]


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Write]:
    """Writes a module with a unique name, importable in this test only."""
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)

    def write(name: str, text: str) -> str:
        (tmp_path / f"{name}.py").write_text(text, "utf-8")
        invalidate_caches()
        return name

    yield write
    for name in set(sys.modules) - before:
        if name.startswith("fake_"):
            del sys.modules[name]


def point(name: str, target: str) -> EntryPoint:
    return EntryPoint(name, target, "navloom")


def refusal(discovery: Discovery, role: str, name: str) -> str:
    with pytest.raises(PluginError) as caught:
        discovery.role(role, name)
    return str(caught.value)


def test_listing_is_sorted_and_imports_nothing(module: Write) -> None:
    module("fake_bomb", "raise RuntimeError('imported')")
    found = Discovery(
        found=[point("planner.b", "fake_bomb"), point("mapper.z", "missing"), point("planner.a", "fake_bomb")]
    )
    assert found.infos() == [
        PluginInfo("mapper", "z", "", "", "missing"),
        PluginInfo("planner", "a", "", "", "fake_bomb"),
        PluginInfo("planner", "b", "", "", "fake_bomb"),
    ]
    assert found.names("planner") == ["a", "b"] and found.names("avoider") == []
    assert "fake_bomb" not in sys.modules


def test_entry_points_with_invalid_or_duplicate_names_are_reported() -> None:
    found = Discovery(
        found=[point(name, "fake_any") for name in ("planner.a", "planner.b", "planner.b", "planer.c", "d")]
    )
    assert found.problems() == [
        "entry point 'd' of fake_any: expected ROLE.NAME; known are avoider, command, controller, localizer, "
        "mapper, message, metric, node, observer, panel, planner, platform, recovery, scheme, suite, world",
        "entry point 'planer.c' of fake_any: expected ROLE.NAME; did you mean 'planner'?",
        "two plugins are named 'planner.b', from fake_any and fake_any: uninstall or rename one of them",
    ]


def test_a_plugin_is_imported_once_and_only_when_its_name_is_requested(module: Write) -> None:
    found = Discovery(found=[point("planner.nowhere", module("fake_nowhere", PLANNER.format(name="nowhere", api=1)))])
    assert "fake_nowhere" not in sys.modules
    made = found.role("planner", "nowhere")
    assert (made.__name__, made.role, made.name) == ("Nowhere", "planner", "nowhere")
    assert made is sys.modules["fake_nowhere"].Nowhere is found.role("planner", "nowhere")


def test_an_unknown_role_is_refused_with_the_nearest() -> None:
    assert refusal(Discovery(found=[]), "planer", "astar") == "role 'planer' does not exist; did you mean 'planner'?"


def test_an_unknown_name_is_refused_with_the_nearest_of_its_role() -> None:
    found = Discovery(found=[point("planner.astar", "x"), point("avoider.atsar", "x")])
    assert refusal(found, "planner", "atsar") == "no plugin 'planner.atsar' is installed; did you mean 'astar'?"
    assert refusal(found, "planner", "q") == "no plugin 'planner.q' is installed; known are astar"


def test_a_plugin_of_the_project_that_is_missing_is_refused_with_what_to_install() -> None:
    every = "pip install 'navloom[all]'"
    found = Discovery(found=[point("planner.mine", "x")])
    install = f"pip install navloom-sensors-sim, or {every} for every plugin of the project"
    assert refusal(found, "platform", "sensors_sim") == f"no plugin 'platform.sensors_sim' is installed: {install}"
    assert refusal(found, "planner", "asta") == "no plugin 'planner.asta' is installed; did you mean 'astar'?"
    assert refusal(found, "planner", "q") == "no plugin 'planner.q' is installed; known are mine"
    brings = f"{every} adds ipabd, known_map, layered, ros_map, scan_grid, union"
    assert refusal(found, "mapper", "q") == f"no plugin 'mapper.q' is installed; no mapper is installed: {brings}"


def test_two_plugins_of_one_name_are_refused_and_the_others_work(module: Write) -> None:
    fine = module("fake_fine", PLANNER.format(name="fine", api=1))
    found = Discovery(found=[point("planner.twin", "one"), point("planner.twin", "two"), point("planner.fine", fine)])
    assert "two plugins are named 'planner.twin', from one and two" in refusal(found, "planner", "twin")
    assert found.role("planner", "fine").name == "fine"


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("raise RuntimeError('no licence')", "RuntimeError: no licence"),
        ("import a_library_that_is_not_there", "ModuleNotFoundError: No module named 'a_library_that_is_not_there'"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("def broken(:", "SyntaxError: invalid syntax"),
        ("from navloom import hookimpl\n@hookimpl\ndef navloom_register(registry):\n    1 / 0", "ZeroDivisionError"),
        ("from navloom import hookimpl\n@hookimpl\ndef navloom_register(registry, more):\n    pass", "'more'"),
        ("from navloom import hookimpl\n@hookimpl\ndef navloom_registre(registry):\n    pass", "navloom_registre"),
    ],
    ids=["raises", "library", "exits", "syntax", "hook", "arguments", "misspelt"],
)
def test_a_broken_plugin_is_blamed_by_name_with_its_cause_each_time_and_only_if_used(
    module: Write, text: str, cause: str
) -> None:
    fine = module("fake_fine", PLANNER.format(name="fine", api=1))
    found = Discovery(found=[point("planner.broken", module("fake_broken", text)), point("planner.fine", fine)])
    assert found.names("planner") == ["broken", "fine"]
    assert found.role("planner", "fine").name == "fine"
    for _ in range(2):
        told = refusal(found, "planner", "broken")
        assert told.startswith("plugin 'planner.broken' from fake_broken fails on import: ") and cause in told
        assert told.endswith("repair it, or block it if it is not needed")
    assert found.role("planner", "fine").name == "fine"


def test_a_missing_module_is_blamed_by_name() -> None:
    told = refusal(Discovery(found=[point("planner.gone", "fake_gone")]), "planner", "gone")
    assert "plugin 'planner.gone' from fake_gone fails on import: ModuleNotFoundError" in told


def test_another_version_of_the_role_is_refused_by_name(module: Write) -> None:
    found = Discovery(found=[point("planner.newer", module("fake_newer", PLANNER.format(name="newer", api=2)))])
    assert refusal(found, "planner", "newer") == (
        "plugin 'planner.newer' from fake_newer: planner.newer is built for version 2 of the role planner, "
        "this framework speaks version 1; install a matching release of it"
    )


def test_an_entry_point_must_register_what_it_is_named_after(module: Write) -> None:
    found = Discovery(
        found=[
            point("planner.right", module("fake_wrong", PLANNER.format(name="wrong", api=1))),
            point("mapper.right", "fake_wrong"),
            point("planner.none", module("fake_none", "x = 1")),
        ]
    )
    assert refusal(found, "planner", "right") == (
        "the entry point planner.right registers planner.wrong, expected planner.right"
    )
    hint = "its module's `navloom_register(registry)`, marked @hookimpl, must add it"
    assert refusal(found, "mapper", "right") == (
        f"the entry point mapper.right registers no mapper, expected mapper.right: {hint}"
    )
    assert refusal(found, "planner", "none") == (
        f"the entry point planner.none registers no planner, expected planner.none: {hint}"
    )


def test_one_module_may_serve_several_entry_points(module: Write) -> None:
    text = PLANNER.format(name="one", api=1) + "    registry.add(type('Two', (Nowhere,), {'name': 'two'}))\n"
    found = Discovery(found=[point(f"planner.{n}", module("fake_pair", text)) for n in ("one", "two")])
    assert [found.role("planner", n).name for n in ("two", "one", "two")] == ["two", "one", "two"]


def test_a_blocked_plugin_is_neither_listed_nor_imported_and_reported_as_blocked(module: Write) -> None:
    module("fake_bomb", "raise RuntimeError('imported')")
    points = [point("planner.bomb", "fake_bomb"), point("world.bomb", "fake_bomb"), point("scheme.bomb", "fake_bomb")]
    found = Discovery(blocked=["planner.bomb", "world.bomb", "scheme.bomb"], found=points)
    assert found.infos() == []
    assert refusal(found, "planner", "bomb") == "no plugin 'planner.bomb' is installed; planner.bomb is blocked"
    for reference in ("bomb", "bomb:x"):
        with pytest.raises(PluginError, match=r"(world|scheme)\.bomb is blocked"):
            found.world(reference, Path())
    assert "fake_bomb" not in sys.modules


def test_blocking_one_of_two_twins_of_other_roles_leaves_the_other() -> None:
    found = Discovery(blocked=["planner.same"], found=[point("planner.same", "x"), point("mapper.same", "x")])
    assert [(info.role, info.name) for info in found.infos()] == [("mapper", "same")]


def test_worlds_come_by_name_by_scheme_and_by_file(module: Write) -> None:
    target = module("fake_worlds", WORLDS)
    found = Discovery(found=[point(n, target) for n in ("world.hall", "scheme.file", "scheme.toml", "scheme.rosmap")])
    assert found.world("hall", Path()).name == "hall"
    assert found.world("file:a.yaml#3", Path("/maps")).name == "maps/a.yaml#3"
    assert found.world("rooms/one.toml", Path()).name == "toml rooms/one.toml"
    assert found.world("rooms/m.yaml?unknown=free", Path()).name == "rosmap rooms/m.yaml?unknown=free"
    assert found.world("m.yml", Path()).name == "rosmap m.yml"


def test_a_node_comes_by_name(module: Write) -> None:
    text = (
        "from navloom import NodePlugin, hookimpl\nclass Tracker(NodePlugin):\n    name = 'tracker'\n    ticks = True\n"
    )
    text += "    def step(self, tick): ...\n"
    text += "@hookimpl\ndef navloom_register(registry):\n    registry.node(Tracker)\n"
    found = Discovery(found=[point("node.tracker", module("fake_node", text)), point("node.other", "fake_node")])
    assert found.names("node") == ["other", "tracker"]
    assert found.node("tracker") is sys.modules["fake_node"].Tracker
    with pytest.raises(PluginError, match=r"the entry point node\.other registers node\.tracker, expected node\.other"):
        found.node("other")
    with pytest.raises(PluginError, match=r"no plugin 'node\.trakcer' is installed; did you mean 'tracker'\?"):
        found.node("trakcer")


def test_unknown_worlds_and_schemes_are_refused_with_the_nearest(module: Write) -> None:
    target = module("fake_worlds", WORLDS)
    found = Discovery(found=[point(n, target) for n in ("world.hall", "scheme.file", "world.attic", "scheme.net")])
    for reference, text in (
        ("hal", r"world 'hal' does not exist; did you mean 'hall'\?"),
        ("flie:x", r"world 'flie:x': unknown scheme 'flie'; did you mean 'file'\?"),
        ("x.toml", "unknown scheme 'toml'; known are file, net"),
        ("barn:3", "world 'barn:3': scheme 'barn' is not installed: pip install navloom-maps"),
        ("attic", r"the entry point world\.attic registers world\.hall, expected world\.attic"),
        (
            "net:x",
            r"the entry point scheme\.net registers scheme\.file, scheme\.rosmap, scheme\.toml, expected scheme\.net",
        ),
    ):
        with pytest.raises(PluginError, match=text):
            found.world(reference, Path())


def test_an_installed_distribution_is_found_with_its_name_and_version(module: Write, tmp_path: Path) -> None:
    module("fake_installed", PLANNER.format(name="fake_installed", api=1))
    info = tmp_path / "fake_installed-2.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fake-installed\nVersion: 2.5\n", "utf-8")
    (info / "entry_points.txt").write_text("[navloom]\nplanner.fake_installed = fake_installed\n", "utf-8")
    (info / "RECORD").write_text("", "utf-8")
    invalidate_caches()
    found = Discovery()
    assert PluginInfo("planner", "fake_installed", "fake-installed", "2.5", "fake_installed") in found.infos()
    assert "fake_installed" not in sys.modules
    assert found.role("planner", "fake_installed").name == "fake_installed"
    assert "fake_installed" not in Discovery(blocked=["planner.fake_installed"]).names("planner")


def test_two_distributions_of_one_plugin_name_are_both_named(module: Write, tmp_path: Path) -> None:
    for name in ("fake_first", "fake_second"):
        module(name, PLANNER.format(name="fake_twin", api=1))
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", "utf-8")
        (info / "entry_points.txt").write_text(f"[navloom]\nplanner.fake_twin = {name}\n", "utf-8")
    invalidate_caches()
    told = refusal(Discovery(), "planner", "fake_twin")
    assert "two plugins are named 'planner.fake_twin', from fake_first and fake_second" in told
    assert not {"fake_first", "fake_second"} & set(sys.modules)


def test_the_framework_and_the_shipped_plugins_register_by_the_same_entry_points() -> None:
    found = {(info.role, info.name): info.distribution for info in Discovery().infos()}
    assert found[("localizer", "odometry")] == "navloom"
    assert found[("planner", "astar")] == "navloom-astar"
