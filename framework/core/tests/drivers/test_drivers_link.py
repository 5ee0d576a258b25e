"""The reader thread of a driver: it reads, writes in bounded time, and reopens its port after any failure."""

from __future__ import annotations

import os
import pty
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from navloom.drivers.link import DriverError, Link
from navloom.drivers.ports import SerialPort, TcpPort, UdpPort


class Played:
    """A simulated port, whose reads and writes a test controls."""

    def __init__(self) -> None:
        self.data: list[bytes | Exception] = []
        self.written: list[bytes] = []
        self.news = threading.Condition()
        self.is_open = True

    def put(self, data: bytes | Exception) -> None:
        with self.news:
            self.data.append(data)
            self.news.notify()

    def read(self, wait: float) -> bytes:
        with self.news:
            self.news.wait_for(lambda: bool(self.data), wait)
            given = self.data.pop(0) if self.data else b""
        if isinstance(given, Exception):
            raise given
        return given

    def write(self, data: bytes, wait: float) -> None:
        self.written.append(data)

    def close(self) -> None:
        self.is_open = False


def until(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + 5.0
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.002)


@pytest.fixture
def ports() -> list[Played]:
    return []


@pytest.fixture
def heard() -> list[bytes]:
    return []


@pytest.fixture
def link(ports: list[Played], heard: list[bytes]) -> Iterator[Link]:
    def opened() -> Played:
        ports.append(Played())
        return ports[-1]

    def received(data: bytes, now_ns: int) -> None:
        assert 0 <= time.monotonic_ns() - now_ns < 10**9
        if data == b"bug":
            raise KeyError("bug")
        heard.append(data)

    made = Link("thing", opened, received, silence=0.3)
    yield made
    made.close()


def test_it_reads_and_writes_until_it_is_closed(link: Link, ports: list[Played], heard: list[bytes]) -> None:
    assert link.fault == "thing: not opened yet"
    with pytest.raises(DriverError, match="thing: not opened yet"):
        link.write(b"x")
    link.start()
    until(lambda: link.fault == "")
    ports[0].put(b"one")
    until(lambda: heard == [b"one"])
    link.write(b"x")
    link.close()
    assert ports[0].written == [b"x"] and not ports[0].is_open and link.fault == "thing: closed"


@pytest.mark.parametrize("given", [OSError(5, "Input/output error"), b"bug"])
def test_it_reopens_after_an_error_and_after_a_bug(
    link: Link, ports: list[Played], heard: list[bytes], given: bytes | Exception
) -> None:
    link.start()
    until(lambda: len(ports) == 1)
    ports[0].put(given)
    until(lambda: len(ports) == 2 and link.fault == "")
    ports[1].put(b"again")
    until(lambda: heard == [b"again"])
    assert not ports[0].is_open and link.openings == 2


def test_it_reopens_after_a_silence(link: Link, ports: list[Played]) -> None:
    link.start()
    until(lambda: len(ports) == 2)
    assert not ports[0].is_open


def test_the_heartbeat_is_called_at_its_period_and_its_failure_reconnects() -> None:
    beats: list[float] = []
    ports: list[Played] = []

    def beat() -> None:
        beats.append(time.monotonic())
        if len(beats) == 20:
            raise DriverError("thing: not taken")

    def opened() -> Played:
        ports.append(Played())
        return ports[-1]

    link = Link("thing", opened, lambda data, now_ns: None, beat=beat, beat_period=0.01)
    link.start()
    until(lambda: len(ports) == 2)
    link.close()
    assert 0.15 < beats[19] - beats[0] < 5.0


def test_a_port_that_cannot_be_opened_is_reported_and_retried() -> None:
    tries: list[float] = []

    def opened() -> Played:
        tries.append(time.monotonic())
        raise FileNotFoundError(2, "No such file or directory")

    link = Link("base at /dev/none", opened, lambda data, now_ns: None)
    link.start()
    until(lambda: len(tries) >= 3)
    assert link.fault == "base at /dev/none: cannot be opened: No such file or directory"
    began = time.monotonic()
    link.close()
    assert time.monotonic() - began < 1.0


def test_a_serial_line_is_raw_and_a_device_that_accepts_nothing_times_out() -> None:
    master, other = pty.openpty()
    port = SerialPort(os.ttyname(other), 115200)
    os.close(other)
    every = bytes(range(256))
    os.write(master, every)
    got = b""
    while len(got) < 256:
        got += port.read(1.0)
    assert got == every and port.read(0.0) == b""
    port.write(every, 0.1)
    assert os.read(master, 1024) == every  # no echo, no line ends
    with pytest.raises(TimeoutError, match=r"were not taken within 0\.05 s"):
        port.write(bytes(1 << 20), 0.05)
    os.close(master)
    with pytest.raises(OSError):
        for _ in range(99):
            port.read(0.1)
    port.close()
    port.close()


def test_a_file_that_is_no_terminal_and_a_wrong_baud_rate_are_refused(tmp_path: object) -> None:
    with pytest.raises(OSError):
        SerialPort("/dev/null", 115200)
    with pytest.raises(ValueError, match="baud 12345"):
        SerialPort("/dev/null", 12345)


def test_tcp_is_read_until_the_other_end_closes() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = TcpPort(server.getsockname())
        peer, _ = server.accept()
        with peer:
            peer.sendall(b"scan")
            assert port.read(1.0) == b"scan" and port.read(0.0) == b""
            port.write(b"go", 0.1)
            assert peer.recv(9) == b"go"
        with pytest.raises(ConnectionResetError):
            port.read(1.0)
        port.close()


def test_udp_gives_one_datagram_at_a_time_and_only_those_of_its_device() -> None:
    port = UdpPort(("127.0.0.1", 0), "127.0.0.1")
    address = port._socket.getsockname()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
        with pytest.raises(TimeoutError, match="has not sent anything yet"):
            port.write(b"x", 0.1)
        device.sendto(b"one", address)
        device.sendto(b"two", address)
        assert port.read(1.0) == b"one" and port.read(1.0) == b"two" and port.read(0.0) == b""
        port.write(b"go", 0.1)
        assert device.recv(9) == b"go"
    port.close()
