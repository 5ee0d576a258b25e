"""Loading, overriding and refusing configs."""

from __future__ import annotations

from pathlib import Path

import pytest
from navloom.config import ConfigError, load_config, shipped_configs

SWAP = '[[event]]\nat = 1.0\ndo = "swap"\nrole = "avoider"\nname = "vff"\n'


def write(folder: Path, text: str) -> str:
    path = folder / "robot.toml"
    path.write_text(text, "utf-8")
    return str(path)


def test_paper_is_shipped_and_fits() -> None:
    assert "paper" in shipped_configs()
    assert load_config("paper").config.run.period == 0.05


def test_a_value_comes_from_default_file_or_set(tmp_path: Path) -> None:
    loaded = load_config(write(tmp_path, "[run]\nseed = 3\n"), ["run.period=0.1"])
    assert loaded.sources["run.seed"] == "file"
    assert loaded.sources["run.period"] == "--set"
    assert "run.stop_after" not in loaded.sources
    assert (loaded.config.run.seed, loaded.config.run.period, loaded.config.run.stop_after) == (3, 0.1, 120.0)


def test_the_seed_option_overrides_the_file() -> None:
    assert load_config("paper", seed=99).config.run.seed == 99


def test_another_plugin_drops_the_old_ones_parameters_but_not_the_new_ones() -> None:
    loaded = load_config("paper", ["controller.k9=2.0", "controller.plugin=other"])
    assert set(loaded.dropped) == {"controller.preset", "controller.k1", "controller.k3"}
    assert loaded.config.controller.params == {"k9": 2.0}


def test_the_same_plugin_drops_nothing() -> None:
    loaded = load_config("paper", ["controller.plugin=lyapunov_tracker@printed"])
    assert loaded.dropped == () and loaded.config.controller.params == {"k1": 1.0, "k3": 0.6}


def test_a_sensor_is_reached_by_name() -> None:
    loaded = load_config("paper", ["sensor.sonars.layout=pairs"])
    assert loaded.config.sensor[1].params["layout"] == "pairs"
    assert loaded.sources["sensor.1.layout"] == "--set"


def test_the_hash_depends_on_values_and_not_on_where_they_are_written(tmp_path: Path) -> None:
    plain = load_config(write(tmp_path, "[run]\nseed = 3\n")).sha256()
    assert load_config(write(tmp_path, "# words\n[run]\nseed=3\nperiod = 0.05\n")).sha256() == plain
    assert load_config(write(tmp_path, "[run]\nseed = 4\n")).sha256() != plain


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[run]\nsed = 3\n", "run.sed: unknown key; did you mean 'seed'?"),
        ("[rn]\n", "rn: unknown key; did you mean 'run'?"),
        ('[run]\nseed = "x"\n', "run.seed: got 'x', expected a whole number"),
        ("[run]\nperiod = -1.0\n", "run.period: got -1.0, expected at least 0.001"),
        ("[robot]\nfootprint = { length = 1.0 }\n", "expected either length and width, or radius, or polygon"),
        ("[robot]\nfootprint = { radius = 1.0, width = 1.0 }\n", "expected either length and width, or radius"),
        ("[robot]\nfootprint = { lenght = 1.0, width = 1.0 }\n", "robot.footprint.lenght: unknown key; did you mean"),
        ("[navigation]\ngoal = { x = 1.0, y = 0.0, heading_deg = 900 }\n", "got 900, expected at most 360"),
        ("[navigation]\nspeed = [0.4, 0.2]\n", "expected the lower one first"),
        ('[[event]]\nat = 1.0\ndo = "goal"\n', "also needs x and y"),
        ('[[event]]\nat = 1.0\ndo = "stop"\nx = 1.0\n', "has no use for x"),
        (SWAP, 'names avoider "vff"; there are improved_vfh'),
        ('[[alternative]]\nrole = "platform"\nplugin = "x"\n', "never shadowed"),
        ('[[alternative]]\nrole = "planner"\nplugin = "astar"\n', 'two instances of planner are named "astar"'),
        (2 * '[[sensor]]\nname = "a"\nkind = "x"\n', 'two tables [[sensor]] are named "a"'),
        ('[avoider]\nplugin = "x"\nsensors = ["sonars"]\n', 'names "sonars"; sensors are none'),
        ("[run\n", "not TOML"),
    ],
)  # fmt: skip
def test_a_value_that_does_not_fit_is_refused_with_place_value_and_fix(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(write(tmp_path, text))
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("run.seed", "expected PATH=VALUE"),
        ("sensor.sonar.layout=x", "did you mean 'sonars'?"),
        ("run.seed.x=1", "run.seed is the value 7, not a table"),
        ("contoller.k=1", "contoller: unknown key; did you mean 'controller'?"),
    ],
)
def test_a_set_that_leads_nowhere_is_refused(change: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config("paper", [change])
    assert said in str(caught.value)


def test_an_unknown_config_names_the_nearest_shipped_one() -> None:
    with pytest.raises(ConfigError, match="did you mean 'paper'"):
        load_config("papr")


@pytest.mark.parametrize(
    ("live", "text"),
    [
        ('hosts = { a = ["robot"], b = ["think"] }', "hosts reach each other through a router: give router"),
        ('router = "tcp/127.0.0.1:1"\nhosts = { a = ["robot"], b = ["robot"] }', '"robot" is on the hosts a and b'),
        (
            'router = "tcp/127.0.0.1:1"\nrouter_host = "hub"\nhosts = { a = ["robot"] }',
            'router_host is "hub"; hosts are a',
        ),
        ('router_host = "hub"', 'router_host is "hub"; router is missing'),
    ],
    ids=["no-router", "twice", "unknown", "no-router-to-start"],
)
def test_hosts_that_do_not_fit_each_other_are_refused(tmp_path: Path, live: str, text: str) -> None:
    path = tmp_path / "hosts.toml"
    path.write_text(shipped_configs()["paper"] + f"\n[live]\n{live}\n", "utf-8")
    with pytest.raises(ConfigError) as refused:
        load_config(str(path))
    assert text in str(refused.value)


def test_a_process_cannot_have_an_instance_that_does_not_exist(tmp_path: Path) -> None:
    path = tmp_path / "processes.toml"
    processes = 'processes = { one = ["platform", "localizer", "mapper", "planner", "goal", "reference", "controller", '
    processes += '"avoider", "avoider.nosuch", "recovery", "gate"] }'
    path.write_text(shipped_configs()["paper"] + f"\n[live]\n{processes}\n", "utf-8")
    with pytest.raises(
        ConfigError, match=r'live.processes.one: names "avoider.nosuch"; of avoider there are improved_vfh'
    ):
        load_config(str(path))
