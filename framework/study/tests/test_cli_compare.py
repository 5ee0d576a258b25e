"""`navloom compare` as people and scripts use it; workers are tested without the command line."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from navloom.plugins import one_file
from navloom_study import compare
from navloom_study.cli.compare import _truths
from navloom_study.report import study_report

CONFIG = """
[run]
stop_after = 20.0

[world]
ref = "empty"

[mapper]
plugin = "known_map"

[controller]
plugin = "kanayama"
k_y = 20.0

[navigation]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 1.0 }

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"
"""
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "robot.toml"
    path.write_text(CONFIG, "utf-8")
    return str(path)


@pytest.fixture
def navloom(in_process: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs the command with its episodes in this process; gives exit code, output and errors."""
    real = compare.run_study

    def in_thread(study: compare.Study, out: Path | None, **options: Any) -> compare.StudyResult:
        with ThreadPoolExecutor(1) as executor:
            return real(study, out, executor=executor, progress=options["progress"])

    monkeypatch.setattr(compare, "run_study", in_thread)
    # The tests of reports cover figures; here their texts would cost seconds.
    monkeypatch.setattr(study_report, "svg_of", lambda figure: "<svg></svg>")
    return lambda *words: in_process("compare", *words)


def test_json_has_every_row_and_the_request(navloom: Run, config: str, tmp_path: Path) -> None:
    out = tmp_path / "study"
    words = ("--vary", "controller=kanayama,lyapunov_tracker", "--worlds", "empty", "corridor", "--seeds", "0:2")
    code, said, _ = navloom(config, *words, "--out", str(out), "--json")
    found = json.loads(said)
    assert code == 0
    assert [(row["method"], row["world"], row["seed"]) for row in found["episodes"][:3]] == [
        ("kanayama", "empty", 0),
        ("kanayama", "empty", 1),
        ("kanayama", "corridor", 0),
    ]
    assert len(found["episodes"]) == 8
    assert found["summary"]["kanayama"]["episodes"] == 4
    assert found["summary"]["kanayama"]["outcomes"] == {"succeeded": 4}
    assert found["held_equal"]["robot.max_linear"] == 0.5
    assert json.loads((out / "study.json").read_text("utf-8")).items() <= found.items()


METHODS = """
[[method]]
name = "slow"
set = { navigation.speed = [0.1, 0.1] }

[[method]]
name = "fast"
set = { navigation.speed = [0.4, 0.4], controller.plugin = "lyapunov_tracker", controller.k1 = 0.8 }
"""


def test_methods_of_the_config_are_rows_that_differ_as_they_set(navloom: Run, config: str, tmp_path: Path) -> None:
    path, out = Path(config), tmp_path / "study"
    path.write_text(CONFIG + METHODS, "utf-8")
    words = (config, "--vary", "method=slow,fast", "--seeds", "0:1", "--set", "robot.height=1.0", "--out", str(out))
    code, said, _ = navloom(*words, "--json")
    found = json.loads(said)
    slow, fast = found["episodes"]
    assert code == 0 and (slow["outcome"], fast["outcome"]) == ("succeeded", "succeeded")
    # 1 m less the goal's tolerance of 0.2 m, at 0.1 m/s; at four times the speed, 2 s.
    assert slow["time"] > 8.0 > 2.0 * fast["time"]
    assert found["methods"]["slow"]["set"] == {"navigation.speed": [0.1, 0.1]}
    assert found["differs"]["controller.plugin"] == {"slow": "kanayama", "fast": "lyapunov_tracker"}
    assert found["differs"]["controller.k1"]["fast"] == 0.8
    report = (out / "report.md").read_text("utf-8")
    assert "| fast | controller.k1 | 0.8 |" in report and f"navloom run {config} --method fast --set" in report

    path.write_text(CONFIG + METHODS + '[[method]]\nname = "later"\n', "utf-8")
    assert json.loads(navloom(*words, "--json")[1])["went_on_from"] == 2
    path.write_text(CONFIG + METHODS.replace("0.1, 0.1", "0.1, 0.2"), "utf-8")
    code, _, error = navloom(*words)
    assert code == 2 and "holds another study: methods.slow" in error


WRONG = """
import random
import sys
import time

from navloom import Avoidance, Avoider, Twist2D


class Wrong(Avoider):
    name = "wrong"

    def avoid(self, given):
        print("x" * 5000, file=sys.stderr)
        return Avoidance(Twist2D(0.0, 0.0, 20.0 + 1e-6 * random.random() + 1e-9 * time.monotonic()), "steering")
"""


def test_a_study_prints_each_warning_once_for_a_method_with_its_episodes(
    navloom: Run, config: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(one_file.FILES, "[]")
    (tmp_path / "wrong_avoider.py").write_text(WRONG, "utf-8")
    words = ("--plugin", str(tmp_path / "wrong_avoider.py"), "--vary", "avoider=improved_vfh,wrong", "--seeds", "0:2")
    code, said, errors = navloom(config, *words, "--json")
    found = {warning["kind"]: warning for warning in json.loads(said)["warnings"]}
    found.pop("late", None)  # of a step that other tests delayed
    assert code == 0 and set(found) == {"clock", "limits", "output", "random"}
    assert all((one["method"], one["plugin"], one["episodes"]) == ("wrong", "wrong", 2) for one in found.values())
    for one in found.values():
        told = f"warning: wrong: {one['text']} (2 episodes, the first: empty, seed 0)"
        assert errors.count(told) == 1 and "wrong_avoider.py:" in told


def test_a_broken_metric_of_another_distribution_does_not_stop_a_study(
    navloom: Run, config: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "site" / "fake_torn-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fake-torn\nVersion: 1.0\n", "utf-8")
    (info / "entry_points.txt").write_text("[navloom]\nmetric.torn = fake_torn\n", "utf-8")
    (info.parent / "fake_torn.py").write_text("import not_there\n", "utf-8")
    monkeypatch.syspath_prepend(str(info.parent))
    code, said, errors = navloom(config, "--seeds", "0:1", "--json")
    assert code == 0 and json.loads(said)["episodes"][0]["outcome"] == "succeeded"  # by ground truth in a study
    (told,) = (line for line in errors.splitlines() if "metric.torn" in line)
    assert "No module named 'not_there' (fake_torn.py:1)" in told and told.endswith(
        "the study goes on without this metric"
    )


def test_the_printed_result_has_the_table_and_the_dropped_parameters(navloom: Run, config: str, tmp_path: Path) -> None:
    out = tmp_path / "study"
    words = (config, "--vary", "controller=kanayama,lyapunov_tracker", "--out", str(out))
    code, said, errors = navloom(*words)
    assert code == 0
    assert "2 methods x 1 worlds x 1 seeds: 2 episodes, 0 of them from an earlier run" in said
    assert "lyapunov_tracker: controller.k_y belongs to the replaced plugin: dropped" in errors
    files = ("episodes.csv", "study.json", "timing.json", "journal.jsonl", "trails", *study_report.FILES)
    assert f"written to {out}: {', '.join(files)}" in said
    assert all((out / name).exists() for name in files)
    _, again, _ = navloom(*words)
    assert "2 of them from an earlier run" in again


def test_without_a_folder_nothing_is_written(
    navloom: Run, config: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    code, said, _ = navloom(config)
    assert code == 0 and "not saved" in said
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("papr",), "did you mean 'paper'"),
        (("paper", "--vary", "avoider=improved_vf"), "did you mean 'improved_vfh'"),
        (("paper", "--worlds", "empty", "dorway", "--seeds", "0:2"), "did you mean 'doorway'"),
        (("paper", "--seeds", "2:1"), "END itself is not included"),
        (("paper", "--vary", "controller.k33=1"), "did you mean 'k3'"),
        (("paper", "--jobs", "0"), "--jobs"),
        (("paper", "--vary", "avoider=vff,vfh", "--baseline", "vhf"), "did you mean 'vfh'"),
        (("paper", "--open-loop"), "nothing can run beside as_configured"),
    ],
    ids=["config", "plugin", "world", "seeds", "setting", "jobs", "baseline", "open_loop"],
)
def test_a_wrong_request_is_one_message_and_exit_2(
    navloom: Run, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], told: str
) -> None:
    monkeypatch.delattr(compare, "run_on_executor")
    code, _, errors = navloom(*words)
    assert code == 2
    assert told in errors
    assert "Traceback" not in errors


def test_another_study_in_the_folder_is_exit_2(navloom: Run, config: str, tmp_path: Path) -> None:
    out = str(tmp_path / "study")
    assert navloom(config, "--out", out)[0] == 0
    code, _, errors = navloom(config, "--seeds", "3", "--out", out)
    assert code == 2
    assert "holds another study: seeds was [0], now [3]" in errors


def test_an_interrupted_study_says_how_to_continue(
    navloom: Run, config: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*given: Any, **options: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(compare, "run_study", stop)
    code, _, errors = navloom(config, "--out", str(tmp_path / "study"))
    assert code == 1
    assert errors == f"navloom: interrupted; the same command goes on from {tmp_path / 'study'}\n"


def test_without_dask_the_extra_is_named(navloom: Run, config: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    code, _, errors = navloom(config, "--scheduler", "tcp://127.0.0.1:1")
    assert code == 2
    assert "navloom[cluster]" in errors


def test_the_table_notes_false_successes_and_successes_without_truth() -> None:
    def rows(method: str, outcome: str, false: float | None) -> list[Any]:
        key, metrics = SimpleNamespace(method=method), {"false_success": false}
        return [SimpleNamespace(key=key, outcome=outcome, metrics=metrics)] * 3

    methods = [SimpleNamespace(name=name) for name in ("right", "wrong", "blind")]
    told = [*rows("right", "succeeded", 0.0), *rows("wrong", "false_success", 1.0), *rows("blind", "succeeded", None)]
    lines = list(_truths(cast(Any, SimpleNamespace(study=SimpleNamespace(methods=methods), rows=told))))
    assert [line.partition(":")[0] for line in lines] == ["wrong", "blind"]
    assert "false success in 3 of 3 episodes" in lines[0] and "3 of 3 successes are the robot's own report" in lines[1]
