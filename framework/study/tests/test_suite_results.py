"""Results of suites: equal bytes, forged rows found at the stated rate, and rows of another processor."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from navloom.config import ConfigError
from navloom.plugins import one_file
from navloom_study.suites import results_store
from navloom_study.suites.method_files import read_methods
from navloom_study.suites.result_file import (
    Key,
    ResultRow,
    SuiteResult,
    metrics_of,
    read_result,
    result_of,
    summary_of,
)
from navloom_study.suites.results_page import command_of, results_page, verdict
from navloom_study.suites.results_store import known_results, store, stored_cost, stored_results
from navloom_study.suites.suite import read_suite
from navloom_study.suites.suite_run import plan_suite
from navloom_study.suites.verification import check_request, check_rows, check_sample, detection, drawn
from test_suites import TINY

Run = Callable[..., tuple[int, str, str]]
METRICS = ("barn_2_8", "success", "spl", "time", "clearance_min", "collisions", "false_success", "person_distance_min",
           "pose_error_rms")  # fmt: skip


STILL = """
from navloom import Avoidance, Avoider, Twist2D, hookimpl


class Still(Avoider):
    name = "still"

    def avoid(self, given):
        return Avoidance(Twist2D(0.0, 0.0, 0.0), "trapped")
"""


def made(worlds: int = 400, seed: int = 0) -> SuiteResult:
    """A result of one method with an episode in each world; two of three succeed."""
    rng = np.random.default_rng(seed)
    rows = []
    for number in range(worlds):
        won = float(rng.random() < 2 / 3)
        values = (0.5 * won, won, won, 20.0, 0.3, 0.0, 0.0, None, 0.01)
        rows.append(ResultRow("m", "all", f"w{number}", 0, "succeeded" if won else "stuck", f"{number:064x}", values))
    return SuiteResult(
        "made-1", "aa", "barn_2_8", METRICS, {}, {"m": {"set": None, "config_sha256": {}}}, {"navloom": "1"}, {},
        "a cpu", tuple(rows), summary_of(rows, METRICS),
    )  # fmt: skip


def honest(result: SuiteResult) -> Callable[[Sequence[Key]], list[ResultRow]]:
    """Stands for running episodes again: the honest rows."""
    rows = {row.key: row for row in result.rows}
    return lambda keys: [rows[key] for key in keys]


def forged(result: SuiteResult, share: float, rng: random.Random) -> SuiteResult:
    """The result with a share of its rows made better, and the summary of these rows."""
    rows = list(result.rows)
    for at in rng.sample(range(len(rows)), round(share * len(rows))):
        values = rows[at].values
        rows[at] = replace(rows[at], values=(0.499, *values[1:]))
    return replace(result, rows=tuple(rows), summary=summary_of(rows, METRICS))


def test_forged_rows_are_found_at_the_stated_rate() -> None:
    result, trials, found = made(), 200, 0
    false = forged(result, 0.1, random.Random(1))
    for trial in range(trials):
        keys = drawn(false.rows, 20, random.Random(100 + trial))
        try:
            check_sample(false, keys, honest(result), is_same=True)
        except ConfigError as error:
            assert "the row is not what the episode gives" in str(error)
            found += 1
    # 1 - 0.9^20 = 0.878; three standard deviations of 200 trials are 0.069.
    assert detection(0.1, 20) == pytest.approx(0.8784, abs=1e-4)
    assert abs(found / trials - detection(0.1, 20)) < 0.07


def test_honest_rows_pass_bit_for_bit() -> None:
    result = made()
    check_rows(result)
    assert check_sample(result, drawn(result.rows, 20, random.Random(0)), honest(result), is_same=True).is_bit_equal


def test_a_row_of_another_processor_passes_within_the_interval() -> None:
    result, rng = made(), np.random.default_rng(3)
    other = {row.key: row for row in result.rows}
    # Chaotic drives: of ten episodes one ends otherwise, to either side.
    for key, row in other.items():
        if rng.random() < 0.1:
            value = 0.5 - (row.values[0] or 0.0)
            other[key] = replace(row, values=(value, *row.values[1:]), trace_sha256="0" * 64)
    keys = drawn(result.rows, 60, random.Random(2))
    verified = check_sample(result, keys, lambda keys: [other[key] for key in keys], is_same=False)
    assert not verified.is_bit_equal


def test_rows_that_are_too_good_for_another_processor_are_refused() -> None:
    result = made()
    false = forged(result, 1.0, random.Random(1))
    keys = drawn(false.rows, 60, random.Random(2))
    with pytest.raises(ConfigError, match="more than another processor explains"):
        check_sample(false, keys, honest(result), is_same=False)


def test_a_forged_summary_is_refused() -> None:
    result = made(40)
    summary = json.loads(json.dumps(result.summary))
    summary["m"]["metrics"]["barn_2_8"][0] += 0.01
    with pytest.raises(ConfigError, match="summary of m: is not what the rows give"):
        check_rows(replace(result, summary=summary))


@pytest.fixture
def planned_result(tmp_path: Path) -> tuple[SuiteResult, Path]:
    """A result for the tiny suite, with rows that nobody drove."""
    path = tmp_path / "tiny-1.toml"
    path.write_text(TINY, "utf-8")
    suite = read_suite(path)
    plan = plan_suite(suite, ["vff"], {})
    metrics = metrics_of(suite)
    rows = [ResultRow(*key, "succeeded", "ab" * 32, (1.0, 0.9, 9.0, 0.5, 0.0, 0.0, None, 0.1)) for key in plan.tasks()]
    blank = result_of(suite, plan.studies, {"empty": []}, {})
    return replace(blank, rows=tuple(rows), summary=summary_of(rows, metrics)), path


def test_a_result_that_fits_its_suite_is_accepted(planned_result: tuple[SuiteResult, Path]) -> None:
    result, path = planned_result
    check_request(result, plan_suite(read_suite(path), ["vff"], {}))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"versions": {"navloom": "0.0.0"}}, "was made with navloom 0.0.0"),
        ({"suite_sha256": "00"}, "is of the suite 00"),
        ({"plugin_files": {"mine.py": "00"}}, "its plugins are in mine.py (00…), given here by --plugin are no files"),
        ({"methods": {"vff": {"set": None, "config_sha256": {"empty": "00"}}}}, "its config is not what the suite"),
        ({"worlds": {"empty": {"empty": "00"}}}, "world empty: is another one here"),
        ({"metrics": ("spl",), "primary": "spl"}, "its metrics are spl"),
    ],
)
def test_a_result_of_something_else_is_refused(
    planned_result: tuple[SuiteResult, Path], change: dict[str, object], named: str
) -> None:
    result, path = planned_result
    if "versions" in change:
        change = {"versions": {**result.versions, "navloom": "0.0.0"}}
    with pytest.raises(ConfigError) as refused:
        check_request(replace(result, **change), plan_suite(read_suite(path), ["vff"], {}))  # type: ignore[arg-type]
    assert named in str(refused.value)


def test_a_missing_row_is_refused(planned_result: tuple[SuiteResult, Path]) -> None:
    result, path = planned_result
    with pytest.raises(ConfigError, match="1 episodes are missing and 0 are not of the suite"):
        check_request(replace(result, rows=result.rows[1:]), plan_suite(read_suite(path), ["vff"], {}))


def test_a_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text(made(5).text(), "utf-8")
    assert read_result(path).text() == made(5).text()


@pytest.mark.parametrize("text", ["{}", "[]", "not json", '{"format": 2}'])
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "result.json"
    path.write_text(text, "utf-8")
    with pytest.raises(ConfigError, match=r"result\.json"):
        read_result(path)


def test_a_stored_row_is_not_replaced_by_another_method_of_its_name(tmp_path: Path) -> None:
    store(tmp_path, made(5), {}, {})
    other = replace(made(5), methods={"m": {"set": {"avoider": {"plugin": "vff"}}, "config_sha256": {}}})
    with pytest.raises(ConfigError, match="holds another method of that name"):
        store(tmp_path, other, {}, {})
    assert len(stored_results(tmp_path)) == 1


def test_shipped_rows_are_beside_those_of_a_folder_whose_own_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def named(method: str) -> SuiteResult:
        one = made(5)
        return replace(
            one, methods={method: one.methods["m"]}, summary={method: one.summary["m"]},
            rows=tuple(replace(row, method=method) for row in one.rows),
        )  # fmt: skip

    monkeypatch.setattr(results_store, "SHIPPED", tmp_path / "shipped")
    cost = {"step_us": 1000.0}
    store(tmp_path / "shipped", named("ours"), {"ours": cost}, {})
    store(tmp_path / "shipped", replace(named("both"), processor="theirs"), {"both": cost}, {})
    store(tmp_path / "own", named("both"), {}, {})
    store(tmp_path / "own", named("mine"), {}, {})
    found = {method: one.processor for one in known_results(tmp_path / "own") for method in one.methods}
    assert [*found] == ["both", "mine", "ours"]
    assert found["both"] != "theirs"
    assert stored_cost(tmp_path / "own", "made-1", "ours")["step_us"] == 1000.0
    assert stored_cost(tmp_path / "own", "made-1", "both") == {}


def test_a_method_is_told_beside_the_shipped_rows_and_without_the_baseline(
    in_process: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder without any results, as that of who has installed navloom."""
    monkeypatch.chdir(tmp_path)
    Path("tiny-1.toml").write_text(TINY, "utf-8")
    Path("mine.toml").write_text('[[method]]\nname = "mine"\nset = { avoider.plugin = "vff" }\n', "utf-8")
    code, said, wrong = in_process(
        "compare", "--suite", "tiny-1.toml", "--methods", "dwa", "--out", "ours", "--jobs", "1"
    )
    assert code == 0, said + wrong
    monkeypatch.setattr(results_store, "SHIPPED", tmp_path / "shipped")
    store(tmp_path / "shipped", read_result(Path("ours/result.json")), {}, {})
    code, said, wrong = in_process("compare", "--suite", "tiny-1.toml", "--method", "mine.toml", "--jobs", "1")
    assert code == 0, said + wrong
    rows = {line.split()[0]: line.split()[-1] for line in said.splitlines() if line.split()[0] in ("mine", "dwa")}
    assert [*rows] == ["mine", "dwa"] and rows["dwa"] == "stored"


def test_a_suite_run_twice_gives_the_same_bytes_and_a_checked_row(
    in_process: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tiny-1.toml").write_text(TINY, "utf-8")
    Path("mine.toml").write_text('[[method]]\nname = "mine"\nset = { avoider.plugin = "still" }\n', "utf-8")
    Path("still.py").write_text(STILL, "utf-8")
    given = ("--suite", "tiny-1.toml", "--method", "mine.toml", "--plugin", "still.py", "--methods", "dwa")
    for out in ("one", "two"):
        code, said, wrong = in_process("compare", *given, "--jobs", "1", "--out", out)
        assert code == 0, said + wrong
    assert f"--plugin {tmp_path / 'still.py'} --suite tiny-1.toml` checks and stores it" in said
    assert Path("one/result.json").read_bytes() == Path("two/result.json").read_bytes()
    # As on another computer: the plugin's file is in a different folder.
    monkeypatch.chdir(shutil.copytree(tmp_path, tmp_path / "theirs"))
    monkeypatch.delenv(one_file.FILES)
    words = "results add one/result.json --suite tiny-1.toml --sample 2 --jobs 1 --results r --plugin still.py"
    navloom = [sys.executable, "-m", "navloom"]
    done = subprocess.run([*navloom, *words.split()], capture_output=True, text=True, check=False)
    assert (done.returncode, "bit for bit" in done.stdout) == (0, True), done.stdout + done.stderr
    mine = next(found for found in stored_results(Path("r")) if "mine" in found.methods)
    assert command_of(Path("r"), "tiny-1", "mine", mine).endswith("--method r/tiny-1/mine.toml --plugin still.py")
    assert read_methods(Path("r/tiny-1/mine.toml")) == {"mine": {"avoider": {"plugin": "still"}}}
    stored = [(*found.methods, found.checked["sample"]) for found in stored_results(Path("r"))]
    assert stored == [("dwa", 2), ("mine", 2)]


def test_a_stored_row_of_a_study_of_two_methods_is_checked_alone(
    in_process: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The distribution of the other method was missed."""
    monkeypatch.chdir(tmp_path)
    Path("tiny-1.toml").write_text(TINY, "utf-8")
    suite, sample = ("--suite", "tiny-1.toml", "--jobs", "1"), ("--sample", "1")
    for given in (
        ("compare", *suite, "--methods", "dwa,vff", "--out", "both"),
        ("results", "add", "both/result.json", *suite, *sample, "--results", "first"),
        ("results", "add", "first/tiny-1/vff.json", *suite, *sample, "--results", "second"),
    ):
        code, said, wrong = in_process(*given)
        assert code == 0, said + wrong
    assert "bit for bit" in said


@pytest.mark.parametrize("option", [("--set", "gate.monitor=false"), ("--worlds", "empty"), ("--primary", "time")])
def test_an_option_that_changes_the_suite_is_refused(in_process: Run, option: tuple[str, str]) -> None:
    code, _, wrong = in_process("compare", "--suite", "doors-1", "--methods", "vff", *option)
    assert code == 2
    assert f"{option[0]}: the suite decides that; leave it out" in wrong


def counted(reached: dict[str, int]) -> SuiteResult:
    parts = {part: {"episodes": 20, "reached": count, "contacts": 0} for part, count in reached.items()}
    return replace(made(2), summary={"m": {"parts": parts}})


@pytest.mark.parametrize(
    ("expects", "own", "other", "word"),
    [
        ("fails", {"1.6 m": 0, "2.0 m": 1}, None, "confirmed"),
        ("fails", {"1.6 m": 0, "2.0 m": 4}, None, "refined"),
        ("arrives", {"1.6 m": 3, "2.0 m": 10}, None, "refuted"),
        ("better", {"1.6 m": 5, "2.0 m": 20}, {"1.6 m": 0, "2.0 m": 4}, "confirmed"),
        ("better", {"1.6 m": 5, "2.0 m": 20}, {"1.6 m": 0, "2.0 m": 20}, "confirmed"),
        ("better", {"1.6 m": 0, "2.0 m": 20}, {"1.6 m": 0, "2.0 m": 4}, "refined"),
        ("better", {"1.6 m": 0, "2.0 m": 20}, {"1.6 m": 16, "2.0 m": 4}, "refined"),
        ("better", {"1.6 m": 0, "2.0 m": 20}, {"1.6 m": 16, "2.0 m": 20}, "refuted"),
    ],
)
def test_a_claim_is_judged_by_the_counts(
    expects: str, own: dict[str, int], other: dict[str, int] | None, word: str
) -> None:
    claim = {"says": "", "suite": "made-1", "method": "m", "expects": expects}
    found = {("made-1", "m"): counted(own)}
    if other is not None:
        claim["than"] = "o"
        found["made-1", "o"] = replace(counted(other), summary={"o": counted(other).summary["m"]})
    assert verdict(claim, found)[0] == word


def test_every_cell_of_the_page_has_its_command_and_says_if_it_was_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(results_store, "SHIPPED", tmp_path / "shipped")
    page = results_page(tmp_path, tmp_path)
    assert page.count(">not run</td>") > 100
    assert f'data-command="{command_of(Path("r"), "doors-1", "vff@printed")}"' in page
    assert "navloom compare --suite doors-1 --methods vff@printed" in page
