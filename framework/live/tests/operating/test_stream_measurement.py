"""Rates of streams and offsets of clocks, on sequences whose figures can be checked by hand."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import pytest
from described import KEYS, BusInWords, client, described, everyone, wire
from navloom.messages import Command, Contact, Odometry, Pose2D, Twist2D
from navloom_live.live import mailbox
from navloom_live.live.mailbox import Mailbox, Packet
from navloom_live.operating import stream_measurement
from navloom_live.operating.stream_measurement import StreamMeter, clock_offsets, measure
from navloom_live.transport.zenoh_bus import Answer

MS = 1_000_000
STREAM = "platform/sim/contact"
ODOMETRY = "platform/sim/odometry"
COMMAND = "gate/main/command"


def packet(arrived_ms: float, sequence: int = 1, cause_ms: float = 0.0) -> Packet:
    found = Packet(*wire(Contact(False), STREAM, sequence, 0, round(cause_ms * MS)))
    found.arrived_ns = round(arrived_ms * MS)
    return found


def meter(arrivals_ms: list[float], sequences: list[int] | None = None) -> StreamMeter:
    found = StreamMeter()
    for number, arrived in enumerate(arrivals_ms):
        found.note(packet(arrived, sequences[number] if sequences else number + 1))
    return found


# --- one stream -----------------------------------------------------------------------------------------------------


def test_a_stream_of_10_hz_without_jitter() -> None:
    found = meter([100.0 * number for number in range(21)]).summary(2.05, None)
    assert found["messages"] == 21
    assert found["rate_hz"] == pytest.approx(10.0)
    assert found["jitter_std_s"] == pytest.approx(0.0, abs=1e-12)
    assert found["interval_max_s"] == pytest.approx(0.1)


def test_intervals_of_50_and_150_ms_in_turn_are_10_hz_with_50_ms_of_jitter() -> None:
    found = meter([0.0, 50.0, 200.0, 250.0, 400.0]).summary(0.4, None)
    assert found["rate_hz"] == pytest.approx(10.0)
    assert found["jitter_std_s"] == pytest.approx(0.05)
    assert found["interval_max_s"] == pytest.approx(0.15)


def test_one_message_has_a_rate_over_the_time_of_listening_and_no_intervals() -> None:
    found = meter([70.0]).summary(4.0, None)
    assert (found["messages"], found["rate_hz"]) == (1, 0.25)
    assert found["jitter_std_s"] is None and found["interval_max_s"] is None


def test_a_silent_stream_has_no_rate() -> None:
    found = StreamMeter().summary(3.0, 0)
    assert (found["messages"], found["rate_hz"], found["bytes_per_s"]) == (0, 0.0, 0.0)
    assert found["age_p50_s"] is None


@pytest.mark.parametrize(
    ("sequences", "lost"),
    [
        ([1, 2, 3, 4], 0),
        ([7, 8, 9], 0),
        ([1, 2, 5, 6, 10], 5),
        ([8, 9, 1, 2, 4], 1),
        ([3, 3, 4], 0),
    ],
    ids=["none", "joined late", "two gaps", "started anew", "twice"],
)
def test_gaps_in_the_sequence_are_losses(sequences: list[int], lost: int) -> None:
    arrivals = [10.0 * number for number in range(len(sequences))]
    assert meter(arrivals, sequences).summary(1.0, None)["lost"] == lost


def test_bytes_that_are_no_message_are_malformed_and_count_only_as_bytes() -> None:
    found = meter([0.0, 100.0])
    size = found.size
    found.note(Packet(b"\x00" * 40, "navloom.Contact/1"))
    summary = found.summary(2.0, None)
    assert (summary["messages"], summary["malformed"]) == (2, 1)
    assert "navloom.Contact/1" in summary["complaint"]
    assert summary["bytes_per_s"] == (size + 40) / 2.0


def test_an_age_counts_from_the_platforms_stamp_on_the_run_clock() -> None:
    # the run clock is 1000 ms ahead of this host's; message n arrives n ms after the stamp it derives from
    found = StreamMeter()
    for late in range(1, 101):
        arrived = 20.0 * late
        found.note(packet(arrived, late, cause_ms=arrived + 1000.0 - late))
    ages = found.summary(2.0, 1000 * MS)
    assert ages["age_p50_s"] == pytest.approx(0.0505)
    assert ages["age_p99_s"] == pytest.approx(0.09901)


# --- listening ------------------------------------------------------------------------------------------------------


class Speaking(BusInWords):
    """Delivers prepared messages at once to a subscriber."""

    def __init__(self, told: dict[str, list[tuple[bytes | None, str]]]) -> None:
        super().__init__(everyone())
        self._told = told

    def subscribe(self, key_expr, receive, most=0) -> None:  # type: ignore[no-untyped-def]
        super().subscribe(key_expr, receive, most)
        for data, label in self._told.get(key_expr.removeprefix(f"{KEYS.prefix}/"), ()):
            receive(key_expr, data, label)


def odometry(stamp_ms: float, sequence: int) -> tuple[bytes, str]:
    stamp, still = round(stamp_ms * MS), Twist2D(0.0, 0.0, 0.0)
    return wire(Odometry(stamp, Pose2D(0.0, 0.0, 0.0), still), ODOMETRY, sequence, stamp, stamp)


def command(cause_ms: float) -> tuple[bytes, str]:
    cause = round(cause_ms * MS)
    return wire(Command(Twist2D(0.0, 0.0, 0.0)), COMMAND, 1, cause, cause)


def test_ages_are_relative_to_the_odometry_that_arrived_fastest(monkeypatch: pytest.MonkeyPatch) -> None:
    # a command caused at 400 ms arrives together with the odometry of 500 ms, which is the fastest
    clock = SimpleNamespace(monotonic=time.monotonic, monotonic_ns=lambda: 7 * MS)
    monkeypatch.setattr(mailbox, "time", clock)
    bus = Speaking({ODOMETRY: [odometry(200.0, 1), odometry(500.0, 2)], COMMAND: [command(400.0)]})
    found = measure(client(bus), [COMMAND], [ODOMETRY], 0.05, has_clock=True)
    assert set(found) == {COMMAND}
    assert found[COMMAND]["age_p50_s"] == pytest.approx(0.1)


def test_without_a_run_clock_there_are_no_ages() -> None:
    bus = Speaking({ODOMETRY: [odometry(500.0, 1)], COMMAND: [command(400.0)]})
    found = measure(client(bus), [COMMAND, ODOMETRY], [ODOMETRY], 0.05, has_clock=False)
    assert found[COMMAND]["messages"] == found[ODOMETRY]["messages"] == 1
    assert found[COMMAND]["age_p50_s"] is None


def test_a_message_too_large_to_copy_is_malformed() -> None:
    bus = Speaking({COMMAND: [command(400.0), (None, "navloom.Command/1")]})
    found = measure(client(bus), [COMMAND], [], 0.05, has_clock=True)[COMMAND]
    assert (found["messages"], found["malformed"], found["complaint"]) == (1, 1, "it is too large to be copied")


def test_ctrl_c_ends_the_listening_and_not_the_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    waits = iter([0])

    def interrupted(self: Mailbox, seen: int, timeout: float | None) -> int:
        for number in waits:
            return number
        raise KeyboardInterrupt

    monkeypatch.setattr(Mailbox, "wait", interrupted)
    found = measure(client(Speaking({COMMAND: [command(400.0)]})), [COMMAND], [], 3600.0, has_clock=True)
    assert found[COMMAND]["messages"] == 1
    assert found[COMMAND]["bytes_per_s"] > len(command(400.0)[0])  # over the time until Ctrl-C, not over an hour


# --- clocks ---------------------------------------------------------------------------------------------------------


class Clocks(BusInWords):
    """Hosts with clocks ahead by s, and answers that take ms there and ms back; only they let time pass."""

    def __init__(self, ahead: dict[str, float], trips_ms: list[tuple[float, float]]) -> None:
        super().__init__([node for node in everyone(gate={"host": "far"}) if node.role in ("gate", "platform")])
        self._ahead, self._trips = ahead, iter(trips_ms)
        self.now_ns = 1_700_000_000_000_000_000

    def ask(self, key_expr: str, data: bytes = b"", timeout: float = 2.0) -> Iterator[Answer]:
        there, back = next(self._trips)
        self.now_ns += round(there * MS)
        host = "far" if "gate" in key_expr else "base"
        wall = self.now_ns + round(self._ahead[host] * 1e9)
        self.now_ns += round(back * MS)
        told = replace(described(*KEYS.split(key_expr)[:2]), wall_ns=wall)
        yield Answer(key_expr, json.dumps(told.to_json()).encode(), "json", "")


def offsets(monkeypatch: pytest.MonkeyPatch, bus: Clocks) -> dict[str, stream_measurement.Offset]:
    def now() -> int:
        return bus.now_ns

    monkeypatch.setattr(
        stream_measurement, "time", SimpleNamespace(time_ns=now, perf_counter_ns=now, sleep=lambda s: None)
    )
    return clock_offsets(client(bus), bus.nodes)


def test_the_fastest_answer_gives_the_offset_with_half_its_duration_as_uncertainty(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # there and back take different times: the estimate is off by half the difference, within its uncertainty
    trips = [(30.0, 10.0), (1.0, 5.0), (40.0, 40.0), (9.0, 1.0), (20.0, 0.0)]
    found = offsets(monkeypatch, Clocks({"base": 0.0, "far": 3.0}, trips + trips))
    assert set(found) == {"base", "far"}
    assert found["far"].uncertain == pytest.approx(0.003)
    assert found["far"].seconds == pytest.approx(3.0 - 0.002)
    assert found["base"].seconds == pytest.approx(-0.002)


def test_a_host_that_does_not_answer_has_no_offset() -> None:
    refusing = BusInWords([])  # answers Timeout, as the network does
    assert clock_offsets(client(refusing), everyone()) == {}
    assert refusing.asked == ["lab/r1/gate/main/describe"] * 5  # one node of a host, the last
