"""Ports of devices: serial line, UDP, TCP. Reads and writes have a time limit."""

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
"""Most bytes of one read: the largest datagram."""


class Port(Protocol):
    """Interface of a port. Every method except `close` raises OSError if the device is gone."""

    def read(self, wait: float) -> bytes:
        """Read available bytes, after at most `wait` s for the first one; empty if none came."""

    def write(self, data: bytes, wait: float) -> None:
        """Write all of the data within `wait` s. Raises TimeoutError if the device does not accept it."""

    def close(self) -> None:
        """Close the port; further calls do nothing."""


class _Descriptor:
    """A port with a non-blocking file descriptor."""

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
        # A lost device is reported as an event too; the read or write then raises.
        return bool(poll.poll(wait * 1000.0))


class SerialPort(_Descriptor):
    """A raw serial line, 8N1, opened exclusively.

    Args:
        path: Device, as /dev/ttyUSB0, or better its persistent name below /dev/serial/by-id.
        baud: Baud rate that the system supports, bit/s.

    Raises:
        OSError: The device is missing, or another process uses it.
        ValueError: The baud rate is not supported.
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
        OSError: The connection is refused or times out.
    """

    def __init__(self, address: tuple[str, int], wait: float = 1.0) -> None:
        made = socket.create_connection(address, wait)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        super().__init__(made)


class UdpPort(_Socket):
    """Datagrams from one device; those of other senders are ignored. One `read` returns one datagram.

    Args:
        local: Address and port to listen at: 127.0.0.1, or the address of the device's network interface.
        device: Address of the device; None accepts datagrams from any sender.

    Raises:
        OSError: The address does not belong to this host, or is taken.
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
        except (BlockingIOError, ConnectionRefusedError):  # the latter refers to an earlier sent datagram
            return b""
        if self._device is not None and sender[0] != self._device:
            return b""
        self._from = sender
        return data

    def write(self, data: bytes, wait: float) -> None:
        """See `Port`; the data goes to the sender of the last datagram."""
        if self._from is None:
            raise TimeoutError("the device has not sent anything yet, so its port is not known")
        self._socket.sendto(data, self._from)


def _make_raw(descriptor: int, speed: int) -> None:
    termios.tcgetattr(descriptor)  # raises if it is not a terminal
    marks: list[bytes | int] = [b"\0"] * 32
    marks[termios.VMIN], marks[termios.VTIME] = 1, 0
    flags = termios.CS8 | termios.CREAD | termios.CLOCAL
    settings: list[int | list[bytes | int]] = [0, 0, flags, 0, speed, speed, marks]
    termios.tcsetattr(descriptor, termios.TCSANOW, settings)
    termios.tcflush(descriptor, termios.TCIOFLUSH)
    fcntl.ioctl(descriptor, termios.TIOCEXCL)
