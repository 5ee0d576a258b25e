"""Warnings of a run in which nothing fails: each once, with its plugin, and none without a problem."""

from __future__ import annotations

import datetime
import inspect
import io
import json
import os
import random
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from navloom import (
    Avoidance,
    AvoiderInput,
    Message,
    PlatformInput,
    PlatformOutput,
    Registry,
    hookimpl,
)
from navloom.engine.build import assemble
from navloom.engine.run_warnings import FEW, RunWarnings, Volume, large_messages, slow_steps, who
from navloom.plugins import Discovery
from navloom.plugins.output_limit import LARGEST_OUTPUT
from navloom.runs.episode import Episode, run_episode
from toys import Bystander, Robot, blamed, toy_config
from toys import discovery as toys

HERE = FilePath(__file__).name
Act = Callable[[Any], Any]
ACTS: dict[str, Act] = {}
"""Name -> what the avoider below does in each step."""


class Does(Bystander):
    name = "does"

    class Params(Bystander.Params):
        does: str = ""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        turn = ACTS.get(self.params.does, lambda given: None)(given)
        right = super().avoid(given)
        twist = right.twist if turn is None else replace(right.twist, wz=1e-9 * turn)
        return replace(right, twist=twist)


class Silent(Robot):
    """A robot whose sensor stops after a while."""

    name = "silent_robot"

    class Params(Robot.Params):
        until: float = 0.0

    def advance(self, given: PlatformInput) -> PlatformOutput:
        right = super().advance(given)
        scans: Mapping[str, Message] = right.scans if given.time_ns * 1e-9 < self.params.until else {}
        return PlatformOutput(right.odometry, scans, right.contact, right.truth)


@hookimpl
def navloom_register(registry: Registry) -> None:
    registry.add(Does)
    registry.add(Silent)


def with_these() -> Discovery:
    """The plugins above in addition to the toys."""
    sys.modules.setdefault("navloom_test_warnings", sys.modules[__name__])
    names = ("avoider.does", "platform.silent_robot")
    return Discovery(found=[*toys()._points, *(EntryPoint(name, "navloom_test_warnings", "navloom") for name in names)])


def drive(folder: FilePath, *overrides: str) -> Episode:
    return run_episode(toy_config(folder, "avoider.plugin=does", *overrides), discovery=with_these())


def test_a_run_of_good_plugins_warns_of_nothing(tmp_path: FilePath) -> None:
    episode = drive(tmp_path)
    assert (episode.summary()["truly_reached"], blamed(episode)) == (True, [])


def test_a_sensor_that_stops_is_named_with_the_time(tmp_path: FilePath) -> None:
    episode = drive(
        tmp_path, "platform.plugin=silent_robot", "platform.until=0.52", "run.stop_after=3.0", "gate.monitor=false"
    )
    (warning,) = blamed(episode)
    assert str(warning).startswith("platform silent_robot gave no scan of the sensor 'ear' after 0.50 s")
    assert warning.figures["scans"] == 11


def test_a_sensor_that_never_publishes_is_named(tmp_path: FilePath) -> None:
    episode = drive(tmp_path, "platform.plugin=silent_robot", "run.stop_after=3.0")
    told = [str(warning) for warning in episode.warnings if warning.kind == "silent"]
    assert len(told) == 1 and "gave no scan of the sensor 'ear' in 3.05 s" in told[0]


def test_a_flood_is_cut_and_blamed_on_its_line(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ACTS, "floods", lambda given: print("x" * 5000))
    out = io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    episode = drive(tmp_path, "avoider.does=floods")
    assert sys.stdout is out and len(out.getvalue()) == LARGEST_OUTPUT + 1
    (warning,) = blamed(episode)
    assert (warning.kind, warning.role, warning.plugin) == ("output", "avoider", "does")
    assert f"printed more than 64 kB: the rest is left out ({HERE}:" in str(warning)


def test_a_little_output_of_a_plugin_passes(
    tmp_path: FilePath, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(ACTS, "says", lambda given: print("here", file=sys.stderr))
    episode = drive(tmp_path, "avoider.does=says", "run.stop_after=1.0")
    assert blamed(episode) == [] and capsys.readouterr().err.count("here") >= 10


def test_a_thread_that_keeps_running_is_blamed_on_the_line_that_started_it(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends, started = threading.Event(), []

    def start(given: AvoiderInput) -> None:
        if not started:
            started.append(threading.Thread(target=ends.wait, name="stays"))
            started[0].start()

    monkeypatch.setitem(ACTS, "starts", start)
    try:
        episode = drive(tmp_path, "avoider.does=starts", "run.stop_after=1.0")
    finally:
        ends.set()
    (warning,) = blamed(episode)
    assert (warning.kind, warning.role, warning.instance) == ("thread", "avoider", "does")
    assert f"started the thread 'stays', which still runs and is not a daemon ({HERE}:" in str(warning)


def test_threads_that_keep_no_process_alive_give_no_warning(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    from concurrent.futures import ThreadPoolExecutor

    ends, pool = threading.Event(), ThreadPoolExecutor(1)

    def start(given: AvoiderInput) -> None:
        threading.Thread(target=ends.wait, daemon=True).start()
        threading.Thread(target=time.sleep, args=(0.01,)).start()
        pool.submit(int).result()

    monkeypatch.setitem(ACTS, "starts", start)
    try:
        assert blamed(drive(tmp_path, "avoider.does=starts", "run.stop_after=0.3")) == []
    finally:
        ends.set()
        pool.shutdown()


def test_a_map_that_no_network_can_carry_is_named(tmp_path: FilePath) -> None:
    episode = drive(tmp_path, "mapper.size=4500", "run.stop_after=0.5")
    (warning,) = blamed(episode)
    assert (warning.kind, warning.role, warning.about) == ("large", "mapper", "map")
    assert "published a message of 20.3 MB on map, of at most 16.8 MB" in str(warning)
    assert 20_250_000 <= warning.figures["largest_bytes"] < 20_251_000  # 4500 x 4500 cells of a byte, and a header


@pytest.mark.parametrize(("delayed", "kinds"), [(1, []), (2, ["late"])])
def test_one_delayed_step_of_a_short_run_warns_of_nothing(tmp_path: FilePath, delayed: int, kinds: list[str]) -> None:
    system, source = assemble(toy_config(tmp_path), toys()), ("avoider", "toy_bystander")
    found = RunWarnings({source: source[1]})
    computed = FEW * [1_000_000]
    slow_steps(found, system, {source: delayed * [900_000_000] + computed[delayed:]}, {source: computed})
    assert [warning.kind for warning in found.listed()] == kinds


@pytest.mark.parametrize(
    ("largest", "total", "told"), [(2**24, 10**9, ""), (2**24, 10**9 + 10, "100 MB a second on points")]
)
def test_a_stream_may_carry_100_mb_a_second(largest: int, total: int, told: str) -> None:
    found = RunWarnings({("lidar", "front"): "velodyne"})
    large_messages(found, [Volume(("lidar", "front"), "points", largest, total)], 10.0)
    texts = [str(one) for one in found.listed()]
    assert [told in text for text in texts] == ([True] if told else [])
    assert all(text.startswith("lidar front (plugin velodyne) ") for text in texts)


def test_each_warning_is_given_once_with_its_plugin() -> None:
    found = RunWarnings({("avoider", "left"): "vff"})
    for number in range(3):
        found.add("limits", ("avoider", "left"), f"number {number}")
    (only,) = found.listed()
    assert (str(only), only.to_json()["plugin"]) == ("avoider left (plugin vff) number 0", "vff")
    assert who("goal", "main", "") == "goal main" and who("avoider", "vff", "vff") == "avoider vff"


def test_warnings_change_nothing_in_the_trace(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ACTS, "floods", lambda given: print("x" * 5000))
    good, flooding = drive(tmp_path), drive(tmp_path, "avoider.does=floods")
    assert good.log.trace_sha256 == flooding.log.trace_sha256 and flooding.warnings
    json.dumps(flooding.summary()["warnings"])


def by_time(given: AvoiderInput) -> float:
    return time.monotonic()


def by_global_random(given: AvoiderInput) -> float:
    return random.uniform(0.0, 1.0)


def by_numpy_random(given: AvoiderInput) -> float:
    return float(np.random.random())  # noqa: NPY002


def line_of(act: Act) -> str:
    return f"{HERE}:{inspect.getsourcelines(act)[1] + 1}"


@pytest.mark.parametrize(
    ("act", "kind", "place"),
    [
        (by_time, "clock", f"{line_of(by_time)}, monotonic"),
        (lambda given: datetime.datetime.now().microsecond, "clock", ", now)"),
        (by_global_random, "random", f"{line_of(by_global_random)}, uniform"),
        (by_numpy_random, "random", f"({HERE}:"),
        (lambda given: os.urandom(1)[0], "random", ", urandom)"),
    ],
    ids=["monotonic", "now", "random", "numpy", "urandom"],
)
def test_a_step_that_cannot_be_repeated_is_detected_in_an_ordinary_run(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch, act: Act, kind: str, place: str
) -> None:
    monkeypatch.setitem(ACTS, "drifts", act)
    (warning,) = blamed(drive(tmp_path, "avoider.does=drifts", "run.stop_after=3.0"))
    assert (warning.kind, warning.role, warning.plugin) == (kind, "avoider", "does")
    assert place in str(warning)
