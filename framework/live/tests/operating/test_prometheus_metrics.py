"""A robot's metrics for Prometheus: their text, stops by reason, and the server."""

from __future__ import annotations

import os
import platform
import re
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from described import counts, described, everyone, heard
from navloom.messages import GateStatus, StopReason
from navloom_live.operating import metrics_server
from navloom_live.operating.metrics_server import MetricsServer
from navloom_live.operating.prometheus_metrics import MOST_REASONS, Stops, families
from navloom_live.operating.robot_nodes import Node
from navloom_live.operating.stream_subscription import Told
from navloom_live.operating.web_server import BindError
from prometheus_client import CollectorRegistry, Metric, generate_latest
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector


def said(reason: str) -> Told:
    status = GateStatus("none" if reason else "avoider", "vfh", bool(reason), False, StopReason.parse(reason), ())
    return Told("gate", "main", "status", status, 0)


def exposition(nodes: Sequence[Node], missing: int, stops: Stops) -> str:
    """What a scrape of these nodes reads."""
    registry = CollectorRegistry()
    registry.register(Scrape(nodes, missing, stops))
    return generate_latest(registry).decode()


class Scrape(Collector):
    def __init__(self, *given: Any) -> None:
        self.given = given

    def collect(self) -> Iterator[Metric]:
        return families("lab/r1", *self.given)


def values(text: str) -> dict[Any, float]:
    """Values as Prometheus reads them: of a metric without labels by its name, of others by `labelled`."""
    found = {}
    for sample in (sample for metric in text_string_to_metric_families(text) for sample in metric.samples):
        labels = dict(sample.labels)
        assert (labels.pop("realm"), labels.pop("robot")) == ("lab", "r1")
        found[labelled(sample.name, **labels) if labels else sample.name] = sample.value
    return found


def labelled(name: str, **labels: str) -> tuple[str, frozenset[tuple[str, str]]]:
    return name, frozenset(labels.items())


def test_stops_are_counted_once_each_by_reason() -> None:
    stops = Stops()
    for reason in ("no_trajectory", "", "stale: avoider", "stale: avoider", "stale: gate", "operator", "", "stale: x"):
        stops.take(said(reason))
    # A stop from before the first message does not count.
    assert stops.counts == {"stale": 2, "operator": 1} and stops.is_stopped is True
    for number in range(2 * MOST_REASONS):
        stops.take(said(f"new{number}"))
    assert len(stops.counts) == MOST_REASONS + 1 and stops.counts["other"] == MOST_REASONS + 2


def test_every_line_is_what_prometheus_reads() -> None:
    stream = counts(received=40, dropped=2, age_p50_s=0.01, age_p99_s=0.03)
    nodes = everyone(
        platform={"ticks": 100, "late_ticks": 3, "driven_ticks": 50, "own_ticks": 49, "stops": 1},
        gate={"chain_p50_s": 0.004, "chain_p99_s": 0.02, "streams": {"avoider/vfh/command": stream}},
    )
    nodes.append(described("avoider", 'a"b\\c\n', busy_s=0.5, faulted=2))
    here = heard([replace(node, pid=os.getpid(), host=platform.node()) for node in nodes])
    here.append(Node("mapper", "silent", "think", None))
    stops = Stops()
    for reason in ("", "operator"):
        stops.take(said(reason))
    found = values(exposition(here, 1, stops))
    assert found["navloom_up"] == 1.0 and found["navloom_nodes_missing"] == 1.0
    assert (
        found[labelled("navloom_gate_stops_total", reason="operator")] == 1.0 and found["navloom_gate_stopped"] == 1.0
    )
    assert found[labelled("navloom_messages_published_total", role="gate", instance="main", port="command")] == 7.0
    to = {"role": "gate", "instance": "main", "stream": "avoider/vfh/command"}
    assert found[labelled("navloom_messages_dropped_total", **to)] == 2.0
    assert found[labelled("navloom_message_age_seconds", **to, quantile="0.99")] == 0.03
    assert found[labelled("navloom_platform_late_ticks_total", instance="sim")] == 3.0
    assert found[labelled("navloom_gate_chain_seconds", quantile="0.5")] == 0.004
    assert found[labelled("navloom_node_busy_seconds", role="avoider", instance='a"b\\c\n')] == 0.5
    assert found[labelled("navloom_node_answers", role="mapper", instance="silent")] == 0.0
    cpu = [value for name, value in found.items() if name[0] == "navloom_process_cpu_seconds_total"]
    spent = sum(os.times()[:2])
    assert cpu and cpu[0] == pytest.approx(spent, abs=1.0)


def test_without_a_node_the_metric_up_is_0() -> None:
    assert values(exposition([], 0, Stops())) == {"navloom_up": 0.0, "navloom_nodes_missing": 0.0}


class Played:
    """Replaces the client, and its subscription, that the server uses."""

    class keys:
        prefix = "lab/r1"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Any:
    class Listening:
        def __init__(self, client: Any, streams: list[str]) -> None:
            self.left = [[said("")], [said("contact")]]

        def take(self, timeout: float) -> list[Told]:
            return self.left.pop(0) if self.left else []

    monkeypatch.setattr(metrics_server, "Listening", Listening)
    monkeypatch.setattr(metrics_server, "listing", lambda client: heard(everyone()))
    made = MetricsServer(Played(), ("127.0.0.1", 0))  # type: ignore[arg-type]
    thread = threading.Thread(target=made.run)
    thread.start()
    yield made
    made.close()
    thread.join()


def test_the_server_answers_scrapes_on_loopback_and_waits_for_no_half_request(server: MetricsServer) -> None:
    with urllib.request.urlopen(server.url, timeout=5.0) as answer:
        assert answer.headers["Content-Type"].startswith("text/plain; version=0.0.4")
        assert values(answer.read().decode())["navloom_up"] == 1.0
    host, port = server.url.removeprefix("http://").removesuffix("/metrics").split(":")
    with socket.create_connection((host, int(port))) as half_sent:
        half_sent.sendall(b"GET /metrics HTTP/1.1\r\n")  # does not delay the next scrape
        with urllib.request.urlopen(server.url, timeout=5.0) as answer:
            assert values(answer.read().decode())["navloom_up"] == 1.0
    assert server.url.startswith("http://127.0.0.1:")
    with pytest.raises(BindError, match=f"127.0.0.1:{port}: cannot be listened at: Address already in use"):
        MetricsServer(Played(), ("127.0.0.1", int(port)))  # type: ignore[arg-type]


def test_half_a_hundred_half_requests_delay_no_scrape(server: MetricsServer) -> None:
    host, port = server.url.removeprefix("http://").removesuffix("/metrics").split(":")
    with ExitStack() as held:
        for _ in range(50):
            half_sent = held.enter_context(socket.create_connection((host, int(port))))
            half_sent.sendall(b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\n")
        began = time.monotonic()
        with urllib.request.urlopen(server.url, timeout=5.0) as answer:
            assert values(answer.read().decode())["navloom_up"] == 1.0
        assert time.monotonic() - began < 1.0  # it was 2 s


@pytest.mark.parametrize(("host", "status"), [("evil.example", 403), ("localhost:9", 200), ("10.0.0.1", 200)])
def test_a_site_whose_name_points_here_reads_no_metrics(server: MetricsServer, host: str, status: int) -> None:
    asked = urllib.request.Request(server.url, headers={"Host": host})
    try:
        with urllib.request.urlopen(asked, timeout=5.0) as answer:
            assert answer.status == status
    except urllib.error.HTTPError as refused:
        assert refused.code == status


def test_metrics_are_at_one_path_only(server: MetricsServer) -> None:
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(server.url.replace("/metrics", "/"), timeout=5.0)


def test_the_docs_name_every_metric() -> None:
    from navloom_live.operating.prometheus_metrics import _HELP

    page = (Path(__file__).resolve().parents[4] / "docs" / "deploying.md").read_text("utf-8")
    table = page[page.index("| `navloom_up`") :]
    full = set(re.findall(r"`(navloom_\w+)`", table))
    ends = tuple(end for end in re.findall(r"`…(_\w+)`", table))
    assert {name for name in _HELP if name not in full and not name.endswith(ends)} == set()
