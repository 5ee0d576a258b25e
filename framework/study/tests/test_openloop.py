"""The open loop of a study: one method drives, the others answer to the same inputs as shadows."""

from __future__ import annotations

import csv
import json
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from navloom.cli import main
from navloom.config import ConfigError
from navloom_study.compare import Study, plan_study, run_study
from navloom_study.openloop import METHOD
from navloom_study.report import study_report
from navloom_study.report.open_loop_figures import open_loop_data, over_time_figure
from navloom_study.report.study_files import read_study

CONFIG = """
[run]
stop_after = 20.0

[world]
ref = "empty"

[mapper]
plugin = "known_map"

[controller]
plugin = "kanayama"

[navigation]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 1.0 }

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"

[[alternative]]
name = "stiff"
role = "controller"
plugin = "kanayama"
k_y = 20.0
"""


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("open") / "robot.toml"
    path.write_text(CONFIG, "utf-8")
    return str(path)


def study_of(config: str, *vary: str, baseline: str = "", seeds: tuple[int, ...] = (0, 1)) -> Study:
    return plan_study(config, vary, ("empty",), seeds, baseline=baseline, open_loop=True)


@pytest.fixture(scope="module")
def run(config: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, Path]:
    """Two controllers as alternatives of the first one, in one world with two seeds."""
    folder = tmp_path_factory.mktemp("run") / "study"
    study = study_of(config, "controller=kanayama,stiff,lyapunov_tracker")
    with ThreadPoolExecutor(1) as executor:
        run_study(study, folder, executor=executor)
    return study, folder


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_baseline_drives_and_the_others_are_its_shadows(config: str) -> None:
    study = study_of(config, "controller=kanayama,stiff,lyapunov_tracker", baseline="stiff")
    assert study.open_loop is not None
    loaded = study.open_loop.loaded.config
    assert (study.open_loop.baseline, loaded.controller.instance) == ("stiff", "stiff")
    assert [(alternative.role, alternative.instance, alternative.shadow) for alternative in loaded.alternative] == [
        ("controller", "kanayama", True),
        ("controller", "lyapunov_tracker", True),
    ]
    assert study.request()["open_loop"]["shadows"] == {"kanayama": "kanayama", "lyapunov_tracker": "lyapunov_tracker"}
    assert [key.method for key in study.open_loop_keys] == [METHOD, METHOD]


def test_methods_that_differ_in_a_setting_get_valid_instance_names(config: str) -> None:
    study = study_of(config, "controller.k_y=10.0,20.0,30.0")
    assert study.open_loop is not None
    assert study.open_loop.shadows == {"method_1": "k_y=20.0", "method_2": "k_y=30.0"}


def test_a_method_that_differs_in_more_than_one_role_is_left_out_by_name(config: str) -> None:
    study = study_of(config, "controller=kanayama,lyapunov_tracker", "navigation.speed=[0.1,0.2],[0.2,0.4]")
    assert study.open_loop is not None
    (told,) = [why for name, why in study.open_loop.left_out.items() if name.startswith("kanayama+")]
    assert "differs in navigation" in told
    assert len(study.open_loop.left_out) == 2 and len(study.open_loop.shadows) == 1


def test_an_open_loop_without_a_possible_shadow_is_refused(config: str) -> None:
    with pytest.raises(
        ConfigError, match="--open-loop: nothing can run beside as_configured: there is one method only"
    ):
        study_of(config)
    with pytest.raises(ConfigError, match=r"nothing can run beside .*differs in navigation: only one role"):
        study_of(config, "navigation.speed=[0.1,0.2],[0.2,0.4]")


def test_a_baseline_that_is_no_method_is_refused(config: str) -> None:
    with pytest.raises(ConfigError, match="--baseline stif: no such method; did you mean 'stiff'"):
        study_of(config, "controller=kanayama,stiff", baseline="stif")


def test_the_shadows_change_nothing(run: tuple[Study, Path]) -> None:
    _, folder = run
    alone = {row["seed"]: row["trace_sha256"] for row in table(folder / "episodes.csv") if row["method"] == "kanayama"}
    beside = {row["seed"]: row["trace_sha256"] for row in table(folder / "open_loop.csv")}
    assert beside == alone and len(set(alone.values())) == 2


def test_open_loop_rows_are_in_a_separate_table(run: tuple[Study, Path]) -> None:
    study, folder = run
    assert len(table(folder / "episodes.csv")) == len(study.keys) == 6
    lines = table(folder / "open_loop.csv")
    # Two shadows, two seeds, three quantities; without side speed none differs there.
    assert len(lines) == 12 and {row["method"] for row in lines} == {"stiff", "lyapunov_tracker"}
    assert {row["max"] for row in lines if row["quantity"] == "vy"} == {"0"}
    assert all(float(row["max"]) >= float(row["rms"]) for row in lines)
    assert all(int(row["ticks"]) > 40 and row["unanswered"] == "0" for row in lines)


def test_continued_from_its_journal_it_gives_the_same_table(run: tuple[Study, Path], tmp_path: Path) -> None:
    study, folder = run
    lines = (folder / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "journal.jsonl").write_bytes(b"".join(lines[:5]))
    (tmp_path / "study.json").write_bytes((folder / "study.json").read_bytes())
    with ThreadPoolExecutor(1) as executor:
        assert run_study(study, tmp_path, executor=executor).before == 5
    assert (tmp_path / "open_loop.csv").read_bytes() == (folder / "open_loop.csv").read_bytes()
    assert (tmp_path / "episodes.csv").read_bytes() == (folder / "episodes.csv").read_bytes()
    for kept in (tmp_path / "trails").iterdir():
        assert kept.read_bytes() == (folder / "trails" / kept.name).read_bytes()


def test_the_report_has_the_disagreement_of_each_tick(run: tuple[Study, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    _, folder = run
    study = read_study(folder)
    data = open_loop_data(study)
    assert data is not None
    assert (data.baseline, data.shadows) == ("kanayama", ("stiff", "lyapunov_tracker"))
    assert (data.changed, data.compared) == (0, 2)
    told = [line for line in study.open_loop if (line.method, line.quantity) == ("lyapunov_tracker", "wz")]
    kept = data.pooled("lyapunov_tracker", "wz")
    assert kept.size == sum(line.ticks for line in told)
    # Stored to the milliradian per second.
    assert abs(kept.max() - max(line.max or 0.0 for line in told)) <= 5.1e-4
    drawn = over_time_figure(study, data)
    assert drawn is not None and drawn[1] == ["empty"] and len(drawn[0].axes) == len(data.quantities)
    monkeypatch.setattr(study_report, "svg_of", lambda figure: "<svg></svg>")
    page = study_report.build_report(study)
    assert "On the same inputs" in page.html
    assert "The traces of all 2 episodes are those of the baseline alone, bit for bit." in page.markdown


def test_run_prints_the_difference_of_a_shadow(
    config: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["navloom", "run", config, "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as caught:
        main()
    said = capsys.readouterr().out
    assert not caught.value.code
    (line,) = [line for line in said.splitlines() if line.startswith("controller stiff")]
    (told,) = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))["shadows"]
    assert line.split()[2] == str(told["ticks"]) and f"wz {told['differences']['wz']['rms']:.3g}/" in line
    assert "shadows.csv" in said and (tmp_path / "out" / "shadows.csv").stat().st_size
