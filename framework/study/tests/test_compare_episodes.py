"""Episodes on processes and clusters: the table is the same after any interruption, and a failure costs one row."""

from __future__ import annotations

import csv
import importlib
import json
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest
from navloom.config import ConfigError, load_config
from navloom.runs.episode import run_episode
from navloom_study import worker_pool
from navloom_study.compare import Progress, Study, StudyResult, plan_study, run_study
from navloom_study.episode_key import EpisodeKey
from navloom_study.episode_rows import EpisodeTask, Row, episode_row
from navloom_study.study_folder import StudyFolder, table_of
from navloom_study.worker_pool import Agenda, EpisodeWorker, PoolError

ROGUE = """
import os, signal, sys, threading
from pathlib import Path
from typing import Literal
from navloom import Controller, Metric, Params, TrackingCommand, Twist2D, hookimpl

class RogueParams(Params):
    does: Literal["drive", "raise", "break", "quit", "leave", "die", "hang"] = "drive"
    marker: str = ""

class Rogue(Controller):
    name = "rogue"
    accepts = ()
    Params = RogueParams

    def __init__(self, params, context):
        super().__init__(params, context)
        if params.does == "raise":
            raise RuntimeError(f"nothing is\\nas it was at {object()}")

    def control(self, given):
        does = self.params.does
        if does == "break":
            raise KeyError("gone")
        if does == "quit":
            sys.exit(4)
        if does == "leave":
            os._exit(3)
        if does == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if does == "hang":
            Path(self.params.marker + ".part").write_text(str(os.getpid()))
            os.replace(self.params.marker + ".part", self.params.marker)
            threading.Event().wait()
        print("a plugin talks")
        return TrackingCommand(Twist2D(given.reference.speed, 0.0, 0.0), 0.0, 0.0, 0.0)

def share(trail):
    if trail.succeeded:
        raise ZeroDivisionError("of what")
    return 0.25

@hookimpl
def navloom_register(registry):
    registry.add(Rogue)
    registry.metric(Metric("rogue_share", "1", None, share, "Breaks where the goal was reached."))
"""
CONFIG = """
[run]
stop_after = 20.0

[world]
ref = "empty"

[mapper]
plugin = "known_map"

[controller]
plugin = "rogue"

[navigation]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 1.0 }

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"
"""
DOES = ("raise", "break", "quit", "leave", "die", "hang")


@dataclass(frozen=True)
class Bench:
    """A config with controllers that misbehave in chosen ways."""

    config: str
    marker: Path

    def study(self, vary: str, worlds: tuple[str, ...] = (), seeds: tuple[int, ...] = (0,)) -> Study:
        return plan_study(self.config, [vary], worlds, seeds)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp("rogue")
    (folder / "navloom_rogue_study.py").write_text(ROGUE, "utf-8")
    info = folder / "navloom_rogue_study-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: navloom-rogue-study\nVersion: 0.1\n", "utf-8")
    points = '[navloom]\n"controller.rogue" = navloom_rogue_study\n"metric.rogue_share" = navloom_rogue_study\n'
    (info / "entry_points.txt").write_text(points.replace('"', ""), "utf-8")
    marker = folder / "marker"
    spare = [
        f'[[alternative]]\nname = "{does}s"\nrole = "controller"\nplugin = "rogue"\ndoes = "{does}"\n'
        f'marker = "{marker}"\n'
        for does in DOES
    ]
    config = folder / "robot.toml"
    config.write_text(CONFIG + "\n" + "\n".join(spare), "utf-8")
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
    yield Bench(str(config), marker)
    sys.path.remove(str(folder))
    sys.modules.pop("navloom_rogue_study", None)


@pytest.fixture(scope="module")
def study(bench: Bench) -> Study:
    return bench.study("controller=rogue,lyapunov_tracker", ("empty", "corridor"), (0, 1))


@pytest.fixture(scope="module")
def alone(study: Study, tmp_path_factory: pytest.TempPathFactory) -> tuple[StudyResult, Path]:
    """Run the study in one thread of this process."""
    folder = tmp_path_factory.mktemp("alone")
    with ThreadPoolExecutor(1) as executor:
        return run_study(study, folder, executor=executor), folder


def trails(folder: Path) -> dict[str, bytes]:
    """Files of the tracks, by name."""
    return {path.name: path.read_bytes() for path in (folder / "trails").iterdir()}


def one_row(bench: Bench, method: str) -> Row:
    (task,) = bench.study(f"controller={method}").tasks()
    return episode_row(task)


def test_a_study_writes_one_row_for_each_episode_in_the_requested_order(
    alone: tuple[StudyResult, Path], study: Study
) -> None:
    result, folder = alone
    with (folder / "episodes.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["method", "world", "seed", "outcome", "reason", *study.metrics, "trace_sha256"]
    assert [(r["method"], r["world"], int(r["seed"])) for r in rows] == [
        (key.method, key.world, key.seed) for key in study.keys
    ]
    assert {row["outcome"] for row in rows} == {"succeeded"}  # by ground truth in a study
    assert result.files == ("episodes.csv", "study.json", "timing.json", "journal.jsonl", "trails")


def test_wall_times_are_in_a_separate_file(alone: tuple[StudyResult, Path]) -> None:
    _, folder = alone
    timing = json.loads((folder / "timing.json").read_text("utf-8"))
    assert len(timing["episodes"]) == 8
    assert all(entry["tick_us_p50"] > 0.0 and entry["wall_s"] > 0.0 for entry in timing["episodes"])
    for name in ("episodes.csv", "study.json"):
        assert "wall" not in (folder / name).read_text("utf-8")


def test_a_row_equals_the_result_of_run(alone: tuple[StudyResult, Path], study: Study) -> None:
    result, _ = alone
    asked = study.request()
    row = result.rows[-1]
    changes = [
        *asked["methods"][row.key.method]["changes"],
        *asked["worlds"][row.key.world]["changes"],
    ]
    episode = run_episode(load_config(study.config, changes, row.key.seed))
    assert episode.log.trace_sha256 == row.trace_sha256
    assert episode.summary()["path_length_m"] == row.metrics["path_length"]


def test_an_interrupted_study_that_continues_gives_the_same_table(
    alone: tuple[StudyResult, Path], study: Study, tmp_path: Path
) -> None:
    def stop(done: int, total: int, left: float | None) -> None:
        if done >= 3:
            raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as executor, pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path, executor=executor, progress=stop)
    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path, jobs=2, progress=_unless_first(stop))
    assert not multiprocessing.active_children()
    assert not (tmp_path / "episodes.csv").exists()
    with (tmp_path / "journal.jsonl").open("ab") as journal:
        journal.write(b'{"method": "rogue", "wor')
    with ThreadPoolExecutor(1) as executor:
        result = run_study(study, tmp_path, executor=executor)
    assert result.before == 3
    assert (tmp_path / "episodes.csv").read_bytes() == (alone[1] / "episodes.csv").read_bytes()
    assert (tmp_path / "study.json").read_bytes() == (alone[1] / "study.json").read_bytes()
    assert trails(tmp_path) == trails(alone[1]) and len(trails(tmp_path)) == 8


def _unless_first(progress: Progress) -> Progress:
    """Progress that skips the first call, before which no process runs."""
    calls = iter(range(1_000_000))

    def told(done: int, total: int, left: float | None) -> None:
        if next(calls):
            assert multiprocessing.active_children()
            progress(done, total, left)

    return told


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_with_processes_the_table_is_the_same(
    alone: tuple[StudyResult, Path], study: Study, tmp_path: Path, jobs: int
) -> None:
    run_study(study, tmp_path, jobs=jobs)
    assert (tmp_path / "episodes.csv").read_bytes() == (alone[1] / "episodes.csv").read_bytes()
    assert trails(tmp_path) == trails(alone[1])


@pytest.mark.slow
def test_with_a_dask_cluster_the_table_is_the_same(
    alone: tuple[StudyResult, Path], study: Study, tmp_path: Path
) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        run_study(study, tmp_path, executor=client.get_executor())
    assert (tmp_path / "episodes.csv").read_bytes() == (alone[1] / "episodes.csv").read_bytes()
    assert trails(tmp_path) == trails(alone[1])


@pytest.mark.slow
def test_a_task_that_kills_dask_workers_costs_its_episode(bench: Bench) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        result = run_study(bench.study("controller=dies,rogue"), executor=client.get_executor())
    assert [row.outcome for row in result.rows] == ["error", "succeeded"]
    assert result.rows[0].reason == "the cluster lost it: KilledWorker"


def test_a_finished_study_is_read_and_not_run(
    alone: tuple[StudyResult, Path], study: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("navloom_study.compare.run_on_processes")
    again = run_study(study, alone[1])
    assert again.before == 8
    assert again.rows == alone[0].rows


def test_another_request_is_refused_with_the_difference(alone: tuple[StudyResult, Path], bench: Bench) -> None:
    other = bench.study("controller=rogue,lyapunov_tracker", ("empty", "corridor"), (0, 1, 2))
    with pytest.raises(ConfigError, match=r"holds another study: seeds was \[0, 1\], now \[0, 1, 2\]"):
        run_study(other, alone[1])


def test_a_world_file_that_changed_is_another_study(bench: Bench, tmp_path: Path) -> None:
    world = tmp_path / "room.toml"
    text = "bounds = [-3.0, -3.0, 3.0, 3.0]\n[[cylinder]]\nname = 'post'\nx = 2.0\ny = 2.0\nradius = 0.2\n"
    world.write_text(text, "utf-8")
    first = bench.study("controller=rogue", (str(world),)).request()
    world.write_text(text.replace("0.2\n", "0.3\n"), "utf-8")
    second = bench.study("controller=rogue", (str(world),)).request()
    with StudyFolder(tmp_path / "kept", first):
        pass
    with (
        pytest.raises(ConfigError, match=r"holds another study: worlds\..*sha256"),
        StudyFolder(tmp_path / "kept", second),
    ):
        pass


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_text("my diary\n", "utf-8")
    with pytest.raises(ConfigError, match=r"holds journal\.jsonl and no study"), StudyFolder(tmp_path, {}):
        pass
    assert (tmp_path / "journal.jsonl").read_text("utf-8") == "my diary\n"


def test_two_studies_do_not_share_a_folder(tmp_path: Path) -> None:
    with StudyFolder(tmp_path, {}), pytest.raises(ConfigError, match="another navloom compare"):
        StudyFolder(tmp_path, {}).__enter__()


def test_a_plugin_that_cannot_be_created_costs_its_episode(bench: Bench) -> None:
    row = one_row(bench, "raises")
    assert row.outcome == "error"
    blamed = "PluginError: controller.plugin: rogue fails in __init__: "
    assert row.reason.startswith(f"{blamed}RuntimeError: nothing is as it was at <object object at 0x…>")
    assert (row.metrics["success"], row.metrics["spl"], row.metrics["time"]) == (0.0, 0.0, 20.0)


@pytest.mark.parametrize(("method", "cause"), [("breaks", "KeyError: 'gone'"), ("quits", "SystemExit: 4")])
def test_a_plugin_that_breaks_in_a_step_costs_its_episode(bench: Bench, method: str, cause: str) -> None:
    row = one_row(bench, method)
    assert (row.outcome, row.metrics["success"]) == ("error", 0.0)
    assert cause in row.reason


def test_a_metric_that_breaks_costs_its_cell(alone: tuple[StudyResult, Path], bench: Bench) -> None:
    result, _ = alone
    assert {row.metrics["rogue_share"] for row in result.rows} == {None}
    assert result.notes == ["metric rogue_share failed: ZeroDivisionError: of what (8 episodes)"]
    assert one_row(bench, "breaks").metrics["rogue_share"] == 0.25


@pytest.mark.slow
def test_workers_that_die_cost_their_episodes(bench: Bench, tmp_path: Path) -> None:
    result = run_study(bench.study("controller=leaves,dies,rogue"), tmp_path, jobs=2)
    ends = {row.key.method: (row.outcome, row.reason) for row in result.rows}
    assert ends == {
        "leaves": ("error", "the worker process ended with exit code 3"),
        "dies": ("error", "the worker process was killed by SIGKILL"),
        "rogue": ("succeeded", "the goal was reached"),
    }
    assert result.lost == 2


def test_a_worker_killed_from_outside_costs_its_episode_and_no_other(
    alone: tuple[StudyResult, Path], bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    bench.marker.unlink(missing_ok=True)

    def kill(done: int, total: int, left: float | None) -> None:
        if bench.marker.exists():
            os.kill(int(bench.marker.read_text("ascii")), signal.SIGKILL)
            bench.marker.unlink()

    study = bench.study("controller=hangs,rogue,lyapunov_tracker")
    result = run_study(study, jobs=2, progress=kill)
    lost, *others = result.rows
    assert (lost.outcome, lost.reason) == ("error", "the worker process was killed by SIGKILL")
    assert (result.lost, lost.metrics["success"], lost.metrics["time"]) == (1, 0.0, 20.0)
    known = {row.key: row for row in alone[0].rows}
    for row in others:
        assert row.trace_sha256 == known[row.key].trace_sha256
        assert row.metrics == known[row.key].metrics
    assert "a plugin talks" not in capfd.readouterr().out


def test_a_worker_that_hangs_is_killed(bench: Bench) -> None:
    result = run_study(bench.study("controller=hangs"), jobs=1, hang_after=1.0)
    assert [row.outcome for row in result.rows] == ["error"]
    assert result.rows[0].reason == "hung: no sign of life for 1 s, so the worker process was killed"
    assert not multiprocessing.active_children()


def test_workers_that_cannot_begin_end_the_study(study: Study, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(worker_pool, "serve", len)
    with pytest.raises(PoolError, match="ended before they were ready; the last ended with exit code 1"):
        run_study(study, tmp_path, jobs=1)


def test_a_worker_stays_in_its_world_then_goes_where_most_episodes_are_left() -> None:
    def task(world: str, seed: int) -> EpisodeTask:
        return EpisodeTask("", EpisodeKey("m", world, seed), {}, {}, "", ())

    agenda = Agenda([task("a", 0), task("a", 1), task("b", 0), task("b", 1), task("b", 2)])
    order = []
    for world in (None, None, "a", "a", "b"):
        taken = agenda.take(world)
        assert taken is not None
        order.append((taken.key.world, taken.key.seed))
    assert order == [("a", 0), ("b", 0), ("a", 1), ("b", 1), ("b", 2)]
    assert agenda.take("b") is None and len(agenda) == 0


def test_a_worker_is_replaced_for_growth_after_it_has_settled() -> None:
    worker = EpisodeWorker(multiprocessing.get_context("spawn").Process(), multiprocessing.Pipe()[0])
    base = 300 * 2**20
    assert not any(worker.has_grown(base + k) for k in range(worker_pool.SETTLED))
    assert not worker.has_grown(base + worker_pool.GROWTH)
    assert worker.has_grown(base + worker_pool.GROWTH + worker_pool.SETTLED)


def test_the_table_has_numbers_to_12_digits_and_nothing_where_undefined() -> None:
    row = Row(EpisodeKey("m", "w", 3), "stuck", 'said "no", twice', {"a": 1.0, "b": None, "c": 1.0 / 3.0}, "ab")
    text = table_of([row], ["a", "b", "c"])
    assert text.splitlines()[1] == 'm,w,3,stuck,"said ""no"", twice",1,,0.333333333333,ab'


def test_a_row_comes_back_from_the_journal_bit_for_bit() -> None:
    row = Row(EpisodeKey("m", "w", 3), "stuck", "é", {"a": 0.1 + 0.2, "b": None}, "ab", {"too_slow": False}, ("n",))
    assert Row.from_json(json.loads(json.dumps(row.to_json()))) == row
