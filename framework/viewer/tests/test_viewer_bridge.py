"""The bridge and the live sink: no behaviour of a viewer blocks the caller that hands over messages."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from navloom.messages import Contact, Truth, Twist2D
from navloom.messages.motion import Pose2D
from navloom_viewer import viewer_errors
from navloom_viewer.bridge import Bridge, Wanted
from navloom_viewer.builtin_panels import BUILT_IN
from navloom_viewer.drawing import Shown
from navloom_viewer.drawing_task import ViewerOrder
from navloom_viewer.live_sink import LiveSink
from navloom_viewer.program import Program, address_of
from navloom_viewer.viewer_errors import ViewerError
from navloom_viewer.viewer_session import Where, showing
from viewer_rig import facts_for, pose_at, rows_of, shown

rr = pytest.importorskip("rerun", reason="the extra `view` is not installed")
Start = Callable[[], Program]


def until(holds: Callable[[], bool], what: str, seconds: float = 30.0) -> None:
    """Wait for a condition that another process fulfils."""
    limit = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < limit, f"{what} did not come about in {seconds:g} s"
        time.sleep(0.02)


def truth_at(tick: int) -> Shown:
    message = Truth(Pose2D(0.01 * tick, 0.0, 0.0), Twist2D(0.2, 0.0, 0.0), 1.5, "wall", False)
    return shown(message, port="truth", tick=tick)


# --- the queue ------------------------------------------------------------------------------------------------------


def test_while_the_child_is_frozen_messages_beyond_the_queue_are_dropped_and_counted(tmp_path: Path) -> None:
    bridge = Bridge(ViewerOrder(facts_for(), tmp_path / "run.rrd", None, "test"), capacity=50)
    bridge.await_start()
    pid = bridge.process.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    taken = sum(bridge.put(truth_at(tick)) for tick in range(200))  # if it blocked, this would never end
    assert bridge.dropped == 200 - taken
    assert 50 <= taken <= 52  # the queue, and the messages that the child had already taken
    os.kill(pid, signal.SIGCONT)
    counts = bridge.close()
    assert (counts.drawn, counts.dropped, counts.is_complete) == (taken, bridge.dropped, True)
    assert rows_of(tmp_path / "run.rrd")["/metrics/clearance/r1"] == taken


def test_when_the_child_is_killed_put_does_not_block(tmp_path: Path) -> None:
    bridge = Bridge(ViewerOrder(facts_for(), tmp_path / "run.rrd", None, "test"), capacity=10)
    bridge.await_start()
    bridge.process.kill()
    bridge.process.join()
    for tick in range(30):
        bridge.put(truth_at(tick))
    bridge.put_all(truth_at(30))
    assert bridge.dropped >= 20
    counts = bridge.close()
    assert not counts.is_complete
    assert counts.notes == ("the viewer's process ended early: exit code -9",)


def test_messages_that_are_not_drawn_or_too_frequent_are_not_copied() -> None:
    wanted = Wanted(BUILT_IN)
    assert not wanted.take(shown(Contact(False), port="contact"))
    truths = [wanted.take(truth_at(tick // 2)) for tick in range(20)]  # two of each tick, of at most 20 a second
    assert sum(truths) == 10
    assert wanted.take(pose_at(0.0, 0.0))


def test_a_file_that_cannot_be_written_is_reported_before_anything_is_drawn(tmp_path: Path) -> None:
    bridge = Bridge(ViewerOrder(facts_for(), tmp_path, None, "test"))
    with pytest.raises(ViewerError, match=r"--rerun .*: there is such a folder already"):
        bridge.await_start()


def test_a_child_that_does_not_start_leaves_no_file_but_the_one_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("navloom_viewer.bridge.STARTED", 0.0)
    begun, earlier = tmp_path / "begun.rrd", tmp_path / "earlier.rrd"
    earlier.write_bytes(b"of an earlier run")
    for file in (begun, earlier):
        bridge = Bridge(ViewerOrder(facts_for(), file, None, "test"))
        if file is begun:
            file.write_bytes(b"RRF2")  # as the child begins it
        with pytest.raises(ViewerError, match=r"process does not start within 0 s"):
            bridge.await_start()
        assert not bridge.process.is_alive()
    assert [path.name for path in tmp_path.iterdir()] == ["earlier.rrd"]


# --- the viewer -----------------------------------------------------------------------------------------------------


def test_a_frozen_viewer_costs_the_file_nothing_and_the_oldest_shapes_are_dropped(
    tmp_path: Path, server: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer = server()
    sink = LiveSink(viewer.url, "test", "frozen")
    monkeypatch.setattr("navloom_viewer.live_sink.MOST_ITEMS", 100)
    until(lambda: sink.connections == 1, "a connection")
    os.kill(viewer.process.pid, signal.SIGSTOP)
    release = threading.Event()
    # With a frozen viewer, the SDK never returns once its own buffers are full.
    sink._put(lambda to: release.wait(), 0)
    until(lambda: not sink._waiting, "the sender being stuck")
    for tick in range(1000):
        sink.log("/points", (rr.Points3D(np.zeros((10, 3))),), tick, tick)
    assert (sink.dropped, len(sink._waiting)) == (900, 100)
    os.kill(viewer.process.pid, signal.SIGCONT)
    release.set()
    until(lambda: not sink._waiting, "the viewer getting what waited")
    sink.close()
    assert sink.sent == 101


def test_a_restarted_viewer_is_found_and_gets_the_scene(server: Start) -> None:
    viewer = server()
    sink = LiveSink(viewer.url, "test", "again")
    until(lambda: sink.connections == 1, "a connection")
    sink.log("/map", (rr.Points3D([[0, 0, 0]]),), None, 0)
    until(lambda: sink.sent == 1, "the map being sent")
    viewer.process.kill()
    viewer.process.wait()
    until(lambda: not sink._connected, "the loss being noticed")
    for tick in range(20):
        sink.log("/points", (rr.Points3D([[tick, 0, 0]]),), tick, tick)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("navloom_viewer.program.PORT", viewer.port)
        again = server()
    assert again.port == viewer.port
    until(lambda: sink.connections == 2, "the new viewer being found")
    until(lambda: sink.sent == 21, "it being sent what waited")
    sink.close()
    assert sink.dropped == 0


@pytest.mark.slow
def test_absent_frozen_and_killed_viewers_leave_the_file_whole(tmp_path: Path, server: Start) -> None:
    viewer = server()
    where = Where(tmp_path / "run.rrd", viewer.url)
    with showing(facts_for(), where, recording_id="whole", live=True) as found:
        for tick in range(300):
            if tick == 100:
                os.kill(viewer.process.pid, signal.SIGSTOP)
            if tick == 200:
                os.kill(viewer.process.pid, signal.SIGKILL)
            assert found.bridge.put(truth_at(tick))
    assert (found.counts.drawn, found.counts.dropped, found.counts.is_complete) == (300, 0, True)
    assert found.counts.connections == 1
    assert rows_of(tmp_path / "run.rrd")["/metrics/clearance/r1"] == 300


def test_it_listens_on_the_loopback_only(server: Start) -> None:
    listening = Path("/proc/net/tcp")
    if not listening.exists():
        pytest.skip("no /proc/net/tcp here: what listens where cannot be told")
    port = f"{server().port:04X}"
    tables = [Path(f"/proc/net/{name}").read_text("utf-8").splitlines()[1:] for name in ("tcp", "tcp6")]
    lines = [line.split() for table in tables for line in table]
    where = {line[1].split(":")[0] for line in lines if line[3] == "0A" and line[1].endswith(f":{port}")}
    assert where == {"0100007F"}


# --- errors ---------------------------------------------------------------------------------------------------------


def test_without_the_extra_one_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(viewer_errors, "import_module", missing)
    with pytest.raises(ViewerError, match=r"uv sync --group view, or pip install 'navloom\[view\]'"):
        Bridge(ViewerOrder(facts_for(), None, None, "test"))
    monkeypatch.setattr(viewer_errors, "import_module", import_module)


def test_viewers_that_start_at_the_same_time_are_not_confused(server: Start) -> None:
    with ThreadPoolExecutor(3) as pool:
        programs = list(pool.map(lambda _: server(), range(3)))
    assert len({program.port for program in programs}) == 3
    assert [program.process.poll() for program in programs] == [None] * 3


@pytest.mark.parametrize("url", ["nonsense", "rerun+http://127.0.0.1/proxy", "127.0.0.1:9876/x", "127.0.0.1:port"])
def test_an_invalid_address_of_a_viewer_is_refused(url: str) -> None:
    with pytest.raises(ViewerError, match="expected rerun\\+http://HOST:PORT/proxy, or HOST:PORT"):
        address_of(url)


def test_an_address_may_be_short() -> None:
    assert address_of("127.0.0.1:9876") == address_of("rerun+http://127.0.0.1:9876/proxy") == ("127.0.0.1", 9876)


def test_a_viewer_that_was_not_started_is_reported_as_absent() -> None:
    with (
        pytest.raises(ViewerError, match="nothing listens there"),
        showing(facts_for(), Where(url="127.0.0.1:9"), recording_id="x"),
    ):
        pass
