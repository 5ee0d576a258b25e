"""Ports of a device: a serial line, UDP, TCP. None waits longer than it is told to, to read or to write."""

from __future__ import annotations

import fcntl
import os
import select
import socket
import termios
import time
from typing import Protocol

__all__ = ["Port", "SerialPort", "TcpPort", "UdpPort"]

PIECE = 65536
"""Most bytes of one read; the largest datagram."""


class Port(Protocol):
    """What a link reads and writes. Every method but `close` raises OSError where the device is gone."""

    def read(self, wait: float) -> bytes:
        """What is there, after at most `wait` s for the first byte; empty where nothing came."""

    def write(self, data: bytes, wait: float) -> None:
        """All of the data, within at most `wait` s. Raises TimeoutError where the device does not take it."""

    def close(self) -> None:
        """Give it up; more than once does no harm."""


class _Descriptor:
    """A port with a file descriptor that does not block."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def read(self, wait: float) -> bytes:
        """See `Port`."""
        if not self._is_ready(select.POLLIN, wait):
            return b""
        try:
            data = os.read(self._descriptor, PIECE)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionResetError("the other end has closed")
        return data

    def write(self, data: bytes, wait: float) -> None:
        """See `Port`."""
        left, end = memoryview(data), time.monotonic() + wait
        while left:
            if not self._is_ready(select.POLLOUT, max(0.0, end - time.monotonic())):
                raise TimeoutError(f"{len(left)} of {len(data)} bytes were not taken within {wait:g} s")
            try:
                left = left[os.write(self._descriptor, left) :]
            except BlockingIOError:
                continue

    def _is_ready(self, event: int, wait: float) -> bool:
        poll = select.poll()
        poll.register(self._descriptor, event)
        # A device that is gone is reported as an event too, and the read or write then says so.
        return bool(poll.poll(wait * 1000.0))


class SerialPort(_Descriptor):
    """A serial line, raw, 8N1, for this process alone.

    Args:
        path: As /dev/ttyUSB0, or better its lasting name below /dev/serial/by-id.
        baud: Bits per second, one that the system names.

    Raises:
        OSError: It is not there, or another process has it.
        ValueError: No such baud rate.
    """

    def __init__(self, path: str, baud: int) -> None:
        speed = getattr(termios, f"B{baud}", None)
        if speed is None:
            raise ValueError(f"baud {baud}: expected one that the system has, as 115200")
        super().__init__(os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC))
        try:
            _make_raw(self._descriptor, speed)
        except termios.error as error:
            self.close()
            raise OSError(*error.args) from None
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """See `Port`."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)


class _Socket(_Descriptor):
    """A port with a socket."""

    def __init__(self, given: socket.socket) -> None:
        given.setblocking(False)
        self._socket = given
        super().__init__(given.fileno())

    def close(self) -> None:
        """See `Port`."""
        self._socket.close()
        self._descriptor = -1


class TcpPort(_Socket):
    """A TCP connection to a device.

    Args:
        address: Host and port.
        wait: Longest wait for the connection, s.

    Raises:
        OSError: Nobody answers there.
    """

    def __init__(self, address: tuple[str, int], wait: float = 1.0) -> None:
        made = socket.create_connection(address, wait)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        super().__init__(made)


class UdpPort(_Socket):
    """Datagrams from one device; those of others are passed over, and one `read` gives one datagram.

    Args:
        local: Address and port to listen at: 127.0.0.1, or that of the interface that the device is on.
        device: Address of the device; None to take datagrams of anybody.

    Raises:
        OSError: The address is not of this host, or taken.
    """

    def __init__(self, local: tuple[str, int], device: str | None) -> None:
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            made.bind(local)
        except OSError:
            made.close()
            raise
        super().__init__(made)
        self._device = device
        self._from: tuple[str, int] | None = None

    def read(self, wait: float) -> bytes:
        """See `Port`."""
        if not self._is_ready(select.POLLIN, wait):
            return b""
        try:
            data, sender = self._socket.recvfrom(PIECE)
        except (BlockingIOError, ConnectionRefusedError):  # the latter is of a datagram that was sent before
            return b""
        if self._device is not None and sender[0] != self._device:
            return b""
        self._from = sender
        return data

    def write(self, data: bytes, wait: float) -> None:
        """See `Port`: to where the last datagram came from."""
        if self._from is None:
            raise TimeoutError("the device has not sent anything yet, so its port is not known")
        self._socket.sendto(data, self._from)


def _make_raw(descriptor: int, speed: int) -> None:
    termios.tcgetattr(descriptor)  # raises where it is no terminal
    marks: list[bytes | int] = [b"\0"] * 32
    marks[termios.VMIN], marks[termios.VTIME] = 1, 0
    flags = termios.CS8 | termios.CREAD | termios.CLOCAL
    settings: list[int | list[bytes | int]] = [0, 0, flags, 0, speed, speed, marks]
    termios.tcsetattr(descriptor, termios.TCSANOW, settings)
    termios.tcflush(descriptor, termios.TCIOFLUSH)
    fcntl.ioctl(descriptor, termios.TIOCEXCL)
