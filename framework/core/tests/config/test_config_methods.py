"""Methods of a config: when they apply, what they may set, and where each message points."""

from __future__ import annotations

from pathlib import Path

import pytest
from navloom.config import Config, ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.effective_config import holding

CONFIG = """
[world]
ref = "empty"

[mapper]
plugin = "known_map"

[avoider]
plugin = "improved_vfh"
sectors = 36

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"
"""
FORCES = """
[[method]]
name = "forces"
set = { avoider.plugin = "vff", avoider.cell = 0.2, controller.k1 = 0.7, navigation.handover = "always" }
"""


@pytest.fixture
def config(tmp_path: Path) -> str:
    return written(tmp_path, FORCES)


def written(folder: Path, methods: str) -> str:
    path = folder / "robot.toml"
    path.write_text(CONFIG + methods, "utf-8")
    return str(path)


def test_a_method_overrides_the_file(config: str) -> None:
    loaded = load_config(config, method="forces")
    assert (loaded.config.avoider.plugin, loaded.config.avoider.params) == ("vff", {"cell": 0.2})
    assert loaded.config.navigation.handover == "always"
    assert loaded.dropped == ("avoider.sectors",)


def test_a_set_overrides_the_method(config: str) -> None:
    loaded = load_config(config, ["navigation.handover=never", "avoider.cell=0.3"], method="forces")
    assert (loaded.config.navigation.handover, loaded.config.avoider.params) == ("never", {"cell": 0.3})


def test_a_set_of_another_plugin_drops_the_methods_parameters(config: str) -> None:
    loaded = load_config(config, ["avoider.plugin=vfh"], method="forces")
    assert (loaded.config.avoider.plugin, loaded.config.avoider.params) == ("vfh", {})
    assert loaded.dropped == ("avoider.sectors", "avoider.cell")


@pytest.mark.parametrize(
    "given",
    [
        'set = { avoider = { plugin = "vfh@printed", threshold_low = 2.5 } }',
        '[method.set.avoider]\nthreshold_low = 2.5\nplugin = "vfh"\npreset = "printed"',
        'set = { "avoider.threshold_low" = 2.5, "avoider.plugin" = "vfh@printed" }',
    ],
)
def test_overrides_may_be_tables_or_dotted_keys(tmp_path: Path, given: str) -> None:
    loaded = load_config(written(tmp_path, f'[[method]]\nname = "a"\n{given}'), method="a")
    assert (loaded.config.avoider.instance, loaded.config.avoider.params) == ("vfh@printed", {"threshold_low": 2.5})


def test_a_method_reaches_a_node_by_its_name(tmp_path: Path) -> None:
    given = '[[node]]\nname = "people"\nplugin = "a"\n[[method]]\nname = "b"\nset = { node.people.plugin = "c" }'
    loaded = load_config(written(tmp_path, given), method="b")
    assert loaded.config.node[0].plugin == "c"
    assert loaded.sources["node.0.plugin"] == "method b"


def test_an_empty_method_is_the_file(tmp_path: Path) -> None:
    config = written(tmp_path, '[[method]]\nname = "as_is"\nset = { navigation = {} }')
    assert load_config(config, method="as_is").sha256() == load_config(config).sha256()


def test_a_method_that_is_not_chosen_changes_no_hash(tmp_path: Path) -> None:
    without = load_config(written(tmp_path, ""))
    with_it = load_config(written(tmp_path, FORCES))
    assert with_it.sha256() == without.sha256()
    assert with_it.to_json() == without.to_json()


def test_a_method_counts_as_the_values_that_it_sets(config: str) -> None:
    settings = ["avoider.plugin=vff", "avoider.cell=0.2", "controller.k1=0.7", "navigation.handover=always"]
    assert load_config(config, method="forces").sha256() == load_config(config, settings).sha256()


def test_the_source_of_a_value_names_the_method(config: str) -> None:
    rows = holding(assemble(load_config(config, ["avoider.cell=0.3"], method="forces")))
    sources = {place: source for place, _, source in rows}
    assert (sources["controller.k1"], sources["avoider.cell"]) == ("method forces", "--set")
    assert (sources["mapper.plugin"], sources["navigation.speed"]) == ("file", "derived from max_linear")


@pytest.mark.parametrize(
    "place",
    [
        "robot.max_linear", "platform.slip", "world.ref", "gate.monitor", "run.seed", "map.ref", "live.hang_timeout",
        "plugins.blocked", "event", "sensor", "navigation.goal", "navigation.goal_tolerance", "navigation.start.x",
        "navigation.heading_tolerance_deg", "navigation.stuck_after", "avoider.latency", "controller.latency",
        "node.people.latency",
    ],
)  # fmt: skip
def test_what_belongs_to_the_comparison_is_refused(tmp_path: Path, place: str) -> None:
    node = '[[node]]\nname = "people"\nplugin = "a"\n'
    config = written(tmp_path, f'{node}[[method]]\nname = "a"\nset = {{ {place} = 1 }}')
    with pytest.raises(ConfigError, match=r"which the comparison keeps equal for all methods; a method sets localizer"):
        load_config(config)


def test_one_message_names_all_that_is_refused_at_its_line(tmp_path: Path) -> None:
    given = "set = { robot.max_linear = 2.0, robot.height = 1.0, gate.monitor = false, avoider.latency = 0.1 }"
    config = written(tmp_path, f'[[method]]\nname = "a"\n{given}')
    with pytest.raises(ConfigError) as raised:
        load_config(config)
    (problem,) = raised.value.problems
    assert problem.startswith(f"{config}:18: method.0.set: sets robot, gate, avoider.latency, which")


def test_a_list_of_nodes_may_not_set_latency(tmp_path: Path) -> None:
    given = '[[method]]\nname = "a"\nset = { node = [{ name = "x", plugin = "y", latency = 0.1 }] }'
    with pytest.raises(ConfigError, match=r"sets node\.latency, which"):
        load_config(written(tmp_path, given))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("set = { avoidr.plugin = 'vff' }", "unknown table; did you mean 'avoider'"),
        ("set = { navigation.sped = 1 }", "unknown key; did you mean 'speed'"),
        ("sets = {}", "method.0.sets: unknown key; did you mean 'set'"),
        ("set = { alternative = [] }", r"neither shadowed nor swapped; \[\[alternative\]\] is for that"),
        ('role = "avoider"\nplugin = "vff"', r"has role and plugin, .* \[\[alternative\]\] is for that"),
        ("shadow = true", r"has shadow, .* \[\[alternative\]\] is for that"),
        ('[[method]]\nname = "a"', 'two tables .* are named "a"'),
        ('[[alternative]]\nrole = "method"\nplugin = "a"', r"neither shadowed nor swapped"),
        ('[[event]]\nat = 1.0\ndo = "swap"\nrole = "avoider"\nname = "a"', r"a is a \[\[method\]\]: .*nor swapped"),
        ('[[node]]\nname = "method"\nplugin = "a"', "choose another name"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_with_the_nearest_fix(tmp_path: Path, given: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        load_config(written(tmp_path, f'[[method]]\nname = "a"\n{given}'))


@pytest.mark.parametrize("shadow", ["method=forces", "avoider=forces"])
def test_a_method_is_no_shadow(config: str, shadow: str) -> None:
    with pytest.raises(ConfigError, match=r"neither shadowed nor swapped; \[\[alternative\]\] is for that"):
        load_config(config, shadows=[shadow])


def test_an_unknown_method_is_refused_with_the_nearest(config: str) -> None:
    with pytest.raises(ConfigError, match=r"method force: .* did you mean 'forces'"):
        load_config(config, method="force")
    with pytest.raises(ConfigError, match="it has none: write"):
        load_config("paper", method="forces")


def test_a_set_of_a_method_is_refused_since_it_would_come_too_late(config: str) -> None:
    with pytest.raises(ConfigError, match="--set applies after a method; choose one with --method NAME"):
        load_config(config, ["method.forces.set.avoider.cell=0.3"], method="forces")


def test_a_wrong_value_is_located_in_its_method(tmp_path: Path) -> None:
    config = written(tmp_path, FORCES + '[[method]]\nname = "b"\n[method.set]\navoider.plugin = "vff"\navoider.cel = 1')
    with pytest.raises(ConfigError) as raised:
        assemble(load_config(config, method="b"))
    assert str(raised.value) == f"{config}:24: method b: avoider.cel: unknown key; did you mean 'cell'?"


def test_the_schema_describes_methods() -> None:
    assert set(Config.model_json_schema()["$defs"]["MethodTable"]["properties"]) == {"name", "set"}
