"""The report of a study: numbers that can be checked by hand, reproducible bytes, and unusual studies."""

from __future__ import annotations

import csv
import json
import shlex
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from navloom.cli import main
from navloom.config import ConfigError
from navloom.messages import OUTCOMES
from navloom.runs.episode_trail import FALSE_SUCCESS, lost_trail
from navloom_study import Trail
from navloom_study.report import study_report
from navloom_study.report.study_files import read_study
from navloom_study.report.study_report import write_report
from navloom_study.report.track_figures import worlds_shown
from study_rig import NAMES, straight, study_folder

Outcomes = Callable[[str, str, int], str]


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two methods, 5 worlds, 2 seeds: `good` always arrives, `bad` ends in every other way there is, and twice so."""
    failures = [outcome for outcome in OUTCOMES if outcome != "succeeded"]
    ends = iter([*failures, "succeeded", "stuck"])

    def trail_of(method: str, world: str, seed: int) -> Trail:
        return straight("succeeded") if method == "good" else straight(next(ends), 10, 0.2, 0.3)

    folder = tmp_path_factory.mktemp("two") / "study"
    worlds = ("empty", "corridor", "doorway", "u_trap", "paper_gates")
    study_folder(folder, ("good", "bad"), worlds, (0, 1), trail_of)
    write_report(folder)
    return folder


def test_the_summary_agrees_with_one_computed_by_hand(two: Path) -> None:
    rows = {(row["method"], row["metric"]): row for row in table(two / "summary.csv")}
    # good: 20 s at 0.4 m/s are 8 m, of 7.5 m: SPL 0.9375. OT = 3.75 s, and 19.75 s are after the first 0.1 m.
    score = 3.75 / 19.75
    expected = {"success": 1.0, "spl": 7.5 / 8.0, "barn_2_8": score, "barn_4_8": score, "time": 20.0,
                "path_length": 8.0, "cross_track_rms": 0.0, "collisions": 0.0}  # fmt: skip
    for name, value in expected.items():
        assert float(rows["good", name]["mean"]) == pytest.approx(value), name
    # bad: 10 s at 0.2 m/s are 2 m. One of ten succeeds: SPL 1 there (2 m are less than the shortest way), BARN
    # 3.75 s / 9.5 s and at most 0.25, 10 s; nine count with 120 s: 109 s. One collides.
    expected = {"success": 0.1, "spl": 0.1, "barn_2_8": 0.375 / 9.5, "barn_4_8": 0.025, "time": 109.0,
                "path_length": 2.0, "cross_track_rms": 0.3, "collisions": 0.1}  # fmt: skip
    for name, value in expected.items():
        assert float(rows["bad", name]["mean"]) == pytest.approx(value), name
    assert rows["bad", "success"]["episodes"] == "10" and rows["bad", "success"]["worlds"] == "5"


def test_differences_are_method_minus_baseline_with_their_pairs(two: Path) -> None:
    rows = {row["metric"]: row for row in table(two / "differences.csv")}
    assert {row["method"] for row in rows.values()} == {"bad"} and {row["baseline"] for row in rows.values()} == {
        "good"
    }
    assert float(rows["success"]["difference"]) == pytest.approx(-0.9)
    assert float(rows["time"]["difference"]) == pytest.approx(89.0)
    assert (rows["time"]["pairs"], rows["time"]["unpaired"], rows["time"]["worlds"]) == ("10", "0", "5")
    # Nine of ten episodes differ in success, all the same way: 2 of 2^9 sign patterns are as far from 0.
    assert float(rows["success"]["p"]) == pytest.approx(2 / 2**9)
    assert float(rows["success"]["p_holm"]) >= float(rows["success"]["p"])
    assert rows["path_length"]["p"] == "" and rows["path_length"]["better"] == ""


def test_the_page_names_what_counts_and_needs_no_other_file(two: Path) -> None:
    page = (two / "report.html").read_text("utf-8")
    for told in ("For these worlds only", "good: 10 of 10 succeeded (95 % interval 0.692 to 1.000)",
                 "bad: 1 of 10 succeeded (95 % interval 0.003 to 0.445)",
                 "good is better than bad in success, for these worlds only: bad has −90.0 points (95 % interval −",
                 "because collision", "Held constant", "navigation.speed", "c" * 16, "— too slow"):  # fmt: skip
        assert told in page, told
    assert "<script" not in page and "http://" not in page.replace("http://www.w3.org/", "")
    assert 'href="#s1"' in page and 'src="' not in page.replace('src="data:', "")
    assert page.count("<svg") >= 6


def test_the_tables_show_one_metric_of_each_quantity_and_the_files_all(two: Path) -> None:
    page, told = (two / "report.md").read_text("utf-8"), {row["metric"] for row in table(two / "summary.csv")}
    assert "pose_error_rms" in page and "pose_error_p95" not in page and "pose_error_max" not in page
    assert {"pose_error_rms", "pose_error_p95", "pose_error_max"} <= told


def test_the_tables_show_the_details_of_a_role_in_which_the_methods_differ(two: Path) -> None:
    study = read_study(two)
    of_localizers = replace(study, request={**study.request, "differs": {"localizer.plugin": {}}})
    added = {metric.name for metric in of_localizers.table_metrics} - {metric.name for metric in study.table_metrics}
    assert {"found_time", "jump_max", "pose_error_max"} <= added and "pose_error_p95" not in added


def test_every_outcome_is_in_the_report(two: Path) -> None:
    text = (two / "report.md").read_text("utf-8")
    assert all(f"because {outcome}" in text for outcome in OUTCOMES if outcome != "succeeded")
    assert set(read_study(two).comparison.outcomes["bad"]) == set(OUTCOMES)


def test_the_worst_worlds_come_with_a_command_that_a_shell_reads_back(two: Path) -> None:
    study = read_study(two)
    worst = study.comparison.worst["bad"][0]
    told = study.command("bad", worst.world, worst.seed)
    changes = ["--set", 'avoider.plugin="bad"', "--set", f'world.ref="{worst.world}"']
    assert shlex.split(told) == ["navloom", "run", "paper", *changes, "--seed", str(worst.seed)]
    assert f"`{told}`" in (two / "report.md").read_text("utf-8")
    of_file = replace(study, request={**study.request, "plugin_files": ["/my plugins/bad.py"]})
    assert shlex.split(of_file.command("bad", worst.world, worst.seed))[3:5] == ["--plugin", "/my plugins/bad.py"]


def test_a_second_report_is_the_same_except_for_wall_times(two: Path) -> None:
    study = read_study(two)
    again = study_report.build_report(replace(study, timing={**study.timing, "wall_s": 99.0}))
    assert again.summary_csv == (two / "summary.csv").read_text("utf-8")
    assert again.differences_csv == (two / "differences.csv").read_text("utf-8")
    for now, name in ((again.html, "report.html"), (again.markdown, "report.md")):
        before, mark = (two / name).read_text("utf-8"), "Compute time"
        assert now.rpartition(mark)[0] == before.rpartition(mark)[0] and now != before


def test_another_baseline_changes_the_sign_of_the_differences(two: Path) -> None:
    found = read_study(two, "bad").comparison.difference("good", "success")
    assert found.estimate.mean == pytest.approx(0.9)


def test_the_worst_and_the_middle_world_are_those_by_success(two: Path) -> None:
    study = read_study(two)
    shown = dict(worlds_shown(study))
    # bad's one success is in the last world, but both drives of a world count together; the first world has none.
    assert shown["the worst world"].world == "empty" and shown["the median world"].world == "doorway"
    assert all(len(told) == 2 for told in shown["the worst world"].tracks.values())


def one_of_each(outcome: str) -> Callable[..., Trail]:
    return lambda method, world, seed: straight(outcome)


@pytest.mark.parametrize(
    ("methods", "worlds", "seeds", "outcome", "draws"),
    [
        pytest.param(1, 1, 1, "succeeded", True, id="one_of_all"),
        pytest.param(10, 1, 2, "stuck", False, id="ten_methods_all_failed"),
        pytest.param(10, 1, 2, "stuck", True, id="ten_methods_drawn", marks=pytest.mark.slow),
        pytest.param(2, 50, 1, "succeeded", True, id="fifty_worlds", marks=pytest.mark.slow),
        pytest.param(2, 1, 2, "error", True, id="same", marks=pytest.mark.slow),
    ],
)
def test_studies_of_any_size_have_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, methods: int, worlds: int, seeds: int, outcome: str, draws: bool
) -> None:
    if not draws:
        monkeypatch.setattr(study_report, "svg_of", lambda figure: "<svg></svg>")
    names = [f"method_{k}" for k in range(methods)]
    places = ["empty"] if worlds == 1 else [f"clutter:{k}" for k in range(worlds)]
    folder = study_folder(tmp_path / "s", names, places, range(seeds), one_of_each(outcome))
    made = write_report(folder)
    few = "For these worlds only" in made.html
    assert few == (worlds < 10) and ("Differences from" in made.html) == (methods > 1)
    assert len(table(folder / "summary.csv")) == methods * len(NAMES)


def test_undefined_metrics_and_missing_tracks_are_stated(tmp_path: Path) -> None:
    def nothing(method: str, world: str, seed: int) -> Trail:
        return straight("rejected", 0)

    folder = study_folder(tmp_path / "s", ("a", "b"), ("empty",), (0, 1), nothing)
    made = write_report(folder)
    assert "Nothing to draw: in no stored track" in made.html
    assert next(row for row in table(folder / "summary.csv") if row["metric"] == "jerk")["mean"] == ""


def test_false_successes_and_successes_without_truth_are_stated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study_report, "svg_of", lambda figure: "<svg></svg>")
    limits = {"period": 1.0, "limit": 120.0, "max_linear": 0.5, "max_deceleration": 1.0, "reaction": 0.1}

    def trail_of(method: str, world: str, seed: int) -> Trail:
        if method == "blind":
            return lost_trail("succeeded", "the goal was reached", **limits)
        reason = f"succeeded by its own estimate, {seed + 1}.5 m from the goal by ground truth"
        return replace(straight(FALSE_SUCCESS), reason=reason)

    folder = study_folder(tmp_path / "s", ("wrong", "blind"), ["empty"], range(4), trail_of)
    text = write_report(folder).markdown
    assert "wrong: 0 of 4 succeeded (95 % interval 0.000 to 0.602)" in text
    assert "False successes: 4 of 4 with wrong." in text
    assert "by the robot's own report only, without ground truth: 4 of 4 with blind." in text
    assert "| wrong | false_success | succeeded by its own estimate, … m from the goal by ground truth | 4 |" in text
    rows = {(row["method"], row["metric"]): row["mean"] for row in table(folder / "summary.csv")}
    assert (rows["wrong", "success"], rows["wrong", "spl"], rows["wrong", "false_success"]) == ("0", "0", "1")
    assert (rows["blind", "false_success"], rows["blind", "time"]) == ("", "")


def test_without_the_world_only_its_walls_are_missing(two: Path) -> None:
    # The hash of these worlds is not that of the real ones, so they count as changed.
    assert "has changed" in (two / "report.html").read_text("utf-8")


def _seedless(folder: Path) -> None:
    path = folder / "episodes.csv"
    path.write_text(path.read_text("utf-8").replace(",0,succeeded", ",zero,succeeded"), "utf-8")


def _number(folder: Path, part: str) -> None:
    """A number among the names."""
    request = json.loads((folder / "study.json").read_text("utf-8"))
    (folder / "study.json").write_text(json.dumps({**request, part: [*request[part], 7]}))


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda folder: (folder / "study.json").unlink(), "holds no study"),
        (lambda folder: (folder / "episodes.csv").unlink(), "is not finished"),
        (lambda folder: (folder / "study.json").write_text("{"), "study.json: damaged"),
        (lambda folder: (folder / "study.json").write_text("[]"), "study.json: damaged"),
        (lambda folder: _number(folder, "methods"), "study.json: damaged"),
        (lambda folder: _number(folder, "metrics"), "study.json: damaged"),
        (lambda folder: (folder / "timing.json").write_text("{"), "timing.json: damaged"),
        (lambda folder: _seedless(folder), "episodes.csv: damaged"),
        (lambda folder: (folder / "episodes.csv").write_text("method,world\n"), "is not the table of study.json"),
    ],
    ids=["no_study", "unfinished", "cut", "other", "method", "metric", "timing", "seed", "table"],
)
def test_a_folder_that_is_no_study_is_refused(tmp_path: Path, spoil: Callable[[Path], Any], told: str) -> None:
    folder = study_folder(tmp_path / "s", ("a",), ("empty",), (0,), one_of_each("succeeded"))
    spoil(folder)
    with pytest.raises(ConfigError, match=told):
        write_report(folder)


def command(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["navloom", "report", *words])
    with pytest.raises(SystemExit) as caught:
        main()
    return int(caught.value.code or 0)


def test_the_command_names_its_files_and_refuses_in_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = study_folder(tmp_path / "s", ("a", "b"), ("empty",), (0,), one_of_each("succeeded"))
    monkeypatch.setattr(study_report, "svg_of", lambda figure: "<svg></svg>")
    assert command(monkeypatch, str(folder), "--json") == 0
    assert json.loads(capsys.readouterr().out)["files"] == list(study_report.FILES)
    assert all((folder / name).stat().st_size for name in study_report.FILES)
    assert command(monkeypatch, str(folder), "--baseline", "c") == 2
    assert "--baseline c: no such method" in capsys.readouterr().err
    assert command(monkeypatch, str(tmp_path)) == 2
    assert "holds no study: study.json is missing; name a folder in it that has one: s" in capsys.readouterr().err
