"""From `--vary`, `--worlds` and `--seeds` to methods, worlds and seeds, and their refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from navloom.config import ConfigError, load_config, shipped_configs
from navloom.geometry.world import Place, World
from navloom.plugins import Discovery
from navloom.worlds import WORLDS
from navloom_study.compare import Study, plan_study
from navloom_study.study_methods import methods_of, toml_value, variation_of
from navloom_study.study_worlds import expanded, placed, seeds_of, world_digest, worlds_of

CONFIG = """
[world]
ref = "empty"

[robot]
max_linear = 0.6

[mapper]
plugin = "known_map"

[avoider]
plugin = "improved_vfh"
sectors = 36

[navigation]
start = { x = 1.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 1.0, y = 2.0 }

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"

[[alternative]]
name = "forces"
role = "avoider"
plugin = "vff"
cell = 0.2
"""


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "robot.toml"
    path.write_text(CONFIG, "utf-8")
    return str(path)


def named(config: str, *vary: str, changes: tuple[str, ...] = ()) -> dict[str, tuple[str, ...]]:
    return {method.name: method.changes for method in methods_of(config, vary, changes, Discovery())}


def test_values_are_split_at_commas_outside_brackets_and_quotes() -> None:
    assert variation_of("navigation.speed=[0.1, 0.2],[0.2,0.4]").values == ("[0.1, 0.2]", "[0.2,0.4]")
    assert variation_of('map.ref="a,b",c').values == ('"a,b"', "c")


@pytest.mark.parametrize("text", ["avoider", "avoider=", "=vff", "avoider=vff,", "avoider=vff,vff"])
def test_a_variation_without_path_or_values_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="expected"):
        variation_of(text)


def test_methods_are_the_product_in_the_order_written() -> None:
    found = named("paper", "avoider=improved_vfh,vff", "controller.k3=0.3,0.6")
    assert list(found) == ["improved_vfh+k3=0.3", "improved_vfh+k3=0.6", "vff+k3=0.3", "vff+k3=0.6"]
    assert found["vff+k3=0.3"] == ('avoider.plugin="vff"', "controller.k3=0.3")


def test_without_variations_the_config_is_the_method() -> None:
    assert named("paper") == {"as_configured": ()}


def test_the_replaced_plugins_parameters_are_dropped(config: str) -> None:
    _, vff = methods_of(config, ["avoider=improved_vfh,vff"], (), Discovery())
    assert vff.loaded.dropped == ("avoider.sectors",)
    assert vff.loaded.config.avoider.params == {}


def test_an_alternative_replaces_the_table_of_its_role_with_its_parameters(config: str) -> None:
    first, second = methods_of(config, ["avoider=improved_vfh,forces"], (), Discovery())
    assert (second.loaded.config.avoider.plugin, second.loaded.config.avoider.instance) == ("vff", "forces")
    assert second.loaded.config.avoider.params == {"cell": 0.2}
    assert first.loaded.config.avoider.params == {"sectors": 36}
    assert first.loaded.config.alternative == second.loaded.config.alternative == []


def test_an_alternative_that_an_event_names_stays(config: str) -> None:
    swap = 'event=[{ at = 1.0, do = "swap", role = "avoider", name = "forces" }]'
    (method,) = methods_of(config, ["controller.k1=1.0"], [swap], Discovery())
    assert [table.instance for table in method.loaded.config.alternative] == ["forces"]


def test_a_set_of_an_alternative_reaches_the_method(config: str) -> None:
    (method,) = methods_of(config, ["avoider=forces"], ["alternative.forces.cell=0.3"], Discovery())
    assert method.loaded.config.avoider.params == {"cell": 0.3}


def test_the_changes_of_a_method_reproduce_its_config(config: str) -> None:
    for method in methods_of(config, ["avoider=improved_vfh,forces,vff", "controller.k1=0.5"], (), Discovery()):
        assert load_config(config, method.changes).sha256() == method.loaded.sha256()


@pytest.mark.parametrize(
    ("vary", "told"),
    [
        ("avoider=improved_vf", "did you mean 'improved_vfh'"),
        ("controler.k3=0.3", "did you mean 'controller'"),
        ("controller.k33=0.3", "did you mean 'k3'"),
        ("controller.k3=-1.0", "controller.k3: got -1.0"),
        ("run.seed=1,2", "--seeds 0:10"),
        ("world.ref=empty,doorway", "--worlds"),
        ("alternative.forces.cell=0.1", "vary the role"),
    ],
)
def test_a_variation_that_does_not_fit_is_refused_with_the_nearest_fix(vary: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        plan_study("paper", [vary])


def test_a_path_is_varied_once() -> None:
    with pytest.raises(ConfigError, match="given twice"):
        methods_of("paper", ["avoider=vff", "avoider=improved_vfh"], (), Discovery())


METHODS = """
[[method]]
name = "as_is"

[[method]]
name = "integrated"
set = { avoider.plugin = "vff", avoider.cell = 0.2, navigation.handover = "always" }
"""


@pytest.fixture
def rows(config: str) -> str:
    with Path(config).open("a", encoding="utf-8") as file:
        file.write(METHODS)
    return config


def test_a_method_of_the_config_is_a_row(rows: str) -> None:
    as_is, integrated = methods_of(rows, ["method=as_is,integrated"], ["controller.k1=0.9"], Discovery())
    assert as_is.loaded.sha256() == load_config(rows, [*as_is.changes]).sha256()
    assert (integrated.name, integrated.table) == ("integrated", "integrated")
    assert (integrated.loaded.config.avoider.plugin, integrated.loaded.config.avoider.params) == ("vff", {"cell": 0.2})
    assert integrated.loaded.config.navigation.handover == "always"
    assert {method.loaded.config.controller.params["k1"] for method in (as_is, integrated)} == {0.9}


def test_the_changes_and_the_method_of_a_row_reproduce_its_config(rows: str) -> None:
    vary = ["method=as_is,integrated", "avoider=vff,improved_vfh,forces", "controller.k1=0.5,0.6"]
    methods = methods_of(rows, vary, (), Discovery())
    assert len(methods) == 12
    for method in methods:
        assert load_config(rows, method.changes, method=method.table).sha256() == method.loaded.sha256()


def test_a_varied_role_replaces_that_of_the_method(rows: str) -> None:
    found = methods_of(rows, ["avoider=vff,improved_vfh", "method=as_is,integrated"], (), Discovery())
    plugins = {method.name: method.loaded.config.avoider.plugin for method in found}
    assert plugins == {
        "vff+as_is": "vff", "vff+integrated": "vff",
        "improved_vfh+as_is": "improved_vfh", "improved_vfh+integrated": "improved_vfh",
    }  # fmt: skip
    # The method's own plugin keeps the method's parameters; another one has its defaults.
    assert found[1].loaded.config.avoider.params == {"cell": 0.2}
    assert found[3].loaded.config.avoider.params == {}


def test_a_method_may_use_the_plugin_of_an_alternative(rows: str) -> None:
    with Path(rows).open("a", encoding="utf-8") as file:
        file.write('[[alternative]]\nrole = "avoider"\nplugin = "vff"\n')
        file.write('[[event]]\nat = 1.0\ndo = "set"\nrole = "avoider"\nname = "vff"\nvalues = { cell = 0.1 }\n')
    as_is, integrated = methods_of(rows, ["method=as_is,integrated"], (), Discovery())
    assert [table.instance for table in as_is.loaded.config.alternative] == ["vff"]
    assert integrated.loaded.config.alternative == []


def test_the_request_tells_what_a_method_sets(rows: str) -> None:
    request = plan_study(rows, ["method=as_is,integrated"], seeds=(0,)).request()
    told = request["methods"]["integrated"]
    assert told["method"] == "integrated"
    assert told["set"] == {"avoider.cell": 0.2, "avoider.plugin": "vff", "navigation.handover": "always"}
    assert request["differs"]["navigation.handover"] == {"as_is": "when_blocked", "integrated": "always"}
    assert "controller.plugin" in request["held_equal"]


def test_a_request_without_methods_is_as_before(rows: str) -> None:
    told = plan_study(rows, ["avoider=vff"], seeds=(0,)).request()["methods"]["vff"]
    assert told.keys() == {"config_sha256", "changes"}


@pytest.mark.parametrize(
    ("vary", "told"),
    [
        ("method=integratd", "did you mean 'integrated'"),
        ("method=forces", r"is an \[\[alternative\]\]: --vary avoider=forces"),
        ("avoider=integrated", r"is a \[\[method\]\]: --vary method=integrated"),
        ("method.integrated.set=1", "choose one with --method"),
    ],
)
def test_a_method_is_no_alternative(rows: str, vary: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        methods_of(rows, [vary], (), Discovery())


def test_toml_value_is_read_back(tmp_path: Path) -> None:
    import tomllib

    value = {"a b": [1, 2.5, True, 'quote " and \\'], "inner": {"x": -1e-9}, "none": []}
    assert tomllib.loads(f"v = {toml_value(value)}")["v"] == value


def test_seeds() -> None:
    assert seeds_of("0:3") == [0, 1, 2]
    assert seeds_of("7") == [7]
    assert seeds_of("3,5,8:10") == [3, 5, 8, 9]


@pytest.mark.parametrize("text", ["a", "3:3", "5:2", "-1", "1,1", "0:2,1", "0:", "0:1000000"])
def test_texts_that_are_no_seeds_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"--seeds .*(expected|END|each seed once)"):
        seeds_of(text)


def test_ranges_of_worlds_include_both_ends() -> None:
    assert expanded("clutter:8-10") == ["clutter:8", "clutter:9", "clutter:10"]
    assert expanded("movingai:room-3.map") == ["movingai:room-3.map"]
    assert expanded("floor:0-1?glass=0.2") == ["floor:0?glass=0.2", "floor:1?glass=0.2"]
    assert expanded("doorway") == ["doorway"]


@pytest.mark.parametrize("ref", ["clutter:5-3", "clutter:0-999999"])
def test_a_range_that_falls_or_is_endless_is_refused(ref: str) -> None:
    with pytest.raises(ConfigError, match="FIRST-LAST"):
        expanded(ref)


def test_a_range_of_a_barn_file_takes_the_worlds_it_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import numpy as np

    np.savez(
        tmp_path / "few.npz",
        world=np.array([1, 7, 13]),
        cyl=np.zeros((0, 3)),
        cyl_off=np.zeros(4, dtype=np.int64),
        start=np.array([0.0, 0.0, 1.5]),
        goal=np.array([0.0, 9.0]),
        goal_tol=1.0,
        time_limit=100.0,
    )
    monkeypatch.chdir(tmp_path)
    assert expanded("barn:few.npz#2-13") == ["barn:few.npz#7", "barn:few.npz#13"]
    with pytest.raises(ConfigError, match="no world of these numbers"):
        expanded("barn:few.npz#2-6")
    (case,) = plan_study("paper", worlds=["barn:few.npz#7-8"]).worlds
    assert case.values["navigation.goal_tolerance"] == 1.0
    assert case.values["navigation.goal"] == {"x": 0.0, "y": 9.0}


def goals(study: Study) -> list[tuple[float, float]]:
    found = []
    for method in study.methods:
        for case in study.worlds:
            task = placed(method.loaded.to_json(), case.values, 0, study.here).config.navigation
            assert task.goal is not None
            found.append((task.goal.x, task.goal.y))
    return found


def test_a_world_brings_its_own_task_and_the_configs_belongs_to_the_configs_world(config: str) -> None:
    study = plan_study(config, ["avoider=improved_vfh,vff"], ["empty", "doorway"])
    assert goals(study) == [(1.0, 2.0), (0.0, 6.0)] * 2


@pytest.mark.parametrize(
    ("start", "told"),
    [
        ('"unknown"', None),
        ("{ x = 9.0, y = 9.0, spread = 2.0 }", {"x": 0.0, "y": 0.0, "heading_deg": 90.0, "spread": 2.0}),
    ],
)
def test_in_another_world_a_guess_stays_one_and_an_unknown_start_unknown(
    start: str, told: dict[str, float] | None, tmp_path: Path
) -> None:
    path = tmp_path / "lost.toml"
    path.write_text(f"{shipped_configs()['building']}\n[navigation]\nstart = {start}\n", "utf-8")
    path.write_text(path.read_text("utf-8").replace('ref = "doorway"', 'ref = "doorway"\nstart = { x = 1.0, y = 1.0 }'))
    (case,) = worlds_of(load_config(str(path)), ["corridor"], Discovery())
    assert case.values.get("navigation.start") == told
    # That of the config belongs to the config's own world.
    assert case.values["world.start"] == {"x": 0.0, "y": 0.0, "heading_deg": 90.0}


def test_a_goal_of_set_has_precedence_over_both(config: str) -> None:
    study = plan_study(config, (), ["empty", "doorway"], changes=["navigation.goal={ x = 1.0, y = 1.0 }"])
    assert goals(study) == [(1.0, 1.0)] * 2


def test_the_changes_of_method_and_world_are_what_run_needs(config: str) -> None:
    study = plan_study(config, ["avoider=improved_vfh,forces"], ["empty", "doorway"])
    asked = study.request()
    for method in study.methods:
        for case in study.worlds:
            changes = [*asked["methods"][method.name]["changes"], *asked["worlds"][case.ref]["changes"]]
            here = placed(method.loaded.to_json(), case.values, 5, study.here)
            assert load_config(config, changes, seed=5).sha256() == here.sha256()


@pytest.mark.parametrize(
    ("worlds", "told"),
    [(["dorway"], "did you mean 'doorway'"), (["empty", "empty"], "twice"), (["barn:none.npz#1"], "no such file")],
)
def test_a_wrong_world_is_refused(worlds: list[str], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        plan_study("paper", worlds=worlds)


def test_a_start_inside_an_obstacle_is_refused_before_anything_runs(config: str) -> None:
    with pytest.raises(
        ConfigError, match=r"method as_configured in world u_trap: navigation.start: .*occupied by trap right"
    ):
        plan_study(config, (), ["empty", "u_trap"], changes=["navigation.start={ x = 1.6, y = 3.0 }"])


def test_equal_and_differing_settings_are_computed_from_the_full_configs(config: str) -> None:
    study = plan_study(config, ["avoider=improved_vfh,vff", "controller.k3=0.3,0.6"])
    assert study.held_equal["robot.max_linear"] == 0.6
    assert study.held_equal["controller.k1"] == load_config("paper").config.controller.params["k1"]
    assert study.held_equal["planner.plugin"] == "astar"
    assert study.differs["controller.k3"] == {
        "improved_vfh+k3=0.3": 0.3, "improved_vfh+k3=0.6": 0.6, "vff+k3=0.3": 0.3, "vff+k3=0.6": 0.6,
    }  # fmt: skip
    assert set(study.differs["avoider.plugin"].values()) == {"improved_vfh", "vff"}
    assert not set(study.held_equal) & set(study.differs)
    assert not [place for place in study.held_equal if place.startswith(("world.", "run.seed", "navigation.goal."))]


def test_episodes_are_ordered_by_method_world_and_seed() -> None:
    study = plan_study("paper", ["avoider=vff,improved_vfh"], ["empty", "corridor"], [3, 1])
    keys = [(key.method, key.world, key.seed) for key in study.keys]
    assert keys[:4] == [("vff", "empty", 3), ("vff", "empty", 1), ("vff", "corridor", 3), ("vff", "corridor", 1)]
    assert sorted(task.key for task in study.tasks()) == sorted(study.keys)


def test_a_reference_length_is_in_a_world_s_hash_and_its_absence_is_not() -> None:
    plain = World("w", start=Place(0.0, 0.0))
    # The hash that studies made before worlds had reference lengths hold.
    assert world_digest(plain) == "dbdb83bb425fa735299b017f30acd70a7fd2ccab2076d5c88f51d47dbb4c8af1"
    assert world_digest(replace(plain, reference_length=2.0)) != world_digest(replace(plain, reference_length=3.0))


def test_what_is_glass_or_not_mapped_is_in_a_world_s_hash_and_its_absence_is_not() -> None:
    plain = WORLDS["corridor"]()
    # The hash that studies made before obstacles had a material hold.
    assert world_digest(plain) == "0216d1bfdf49fec11b5f1b8b1d02cd96fde5b59706850c006e67ee7306312449"
    wall, *others = plain.obstacles
    changed = (replace(wall, material="glass"), replace(wall, is_mapped=False), wall)
    assert len({world_digest(replace(plain, obstacles=(one, *others))) for one in changed}) == 3


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("sucess", "--primary sucess: no such metric; did you mean 'success'?"),
        ("path_length", "--primary path_length: neither more nor less of it is better; name another metric"),
    ],
)
def test_a_primary_metric_that_decides_nothing_is_refused(name: str, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        plan_study("paper", primary=[name])
    assert str(caught.value) == told


def test_a_named_primary_metric_is_in_the_request_and_the_default_is_not() -> None:
    assert plan_study("paper", primary=["time"]).request()["primary"] == ["time"]
    assert "primary" not in plan_study("paper").request()
