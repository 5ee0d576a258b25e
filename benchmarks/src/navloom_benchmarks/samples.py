"""The messages that `codec`, `bus` and the scripts beside this package measure."""

from __future__ import annotations

from typing import Any

import numpy as np
from navloom.messages import Command, Envelope, Message, Sweep, Twist2D
from navloom.messages.codec import encode
from numpy.typing import NDArray

__all__ = ["ENVELOPE", "samples", "wire_bytes", "wire_size"]

ENVELOPE = Envelope("bench/r1/platform/there/data", 1, 1, 0, 0, 0)


def samples(random: np.random.Generator | None = None) -> dict[str, Message]:
    """Messages by their size on the wire: a velocity command, and a sweep of 77 frames of 181 beams.

    Args:
        random: Source of the sweep's ranges; by default always the same ones.
    """
    random = np.random.default_rng(7) if random is None else random
    ranges, pitches = random.uniform(0.5, 30.0, (77, 181)), np.linspace(-0.7, 0.3, 77)
    times, bearings = np.linspace(0.0, 2.0, 77), np.linspace(-1.57, 1.57, 181)
    return {
        "64 B": Command(Twist2D(0.31, 0.0, -0.12)),
        "110 KB": Sweep(
            0, 1, _kept(ranges), _kept(pitches), _kept(times), _kept(bearings), "paper", 0.2, 0.0, 0.6, 0.02, 30.0
        ),
    }


def wire_bytes(message: Message) -> bytes:
    """An encoded message with its header. Raw peers send these: zeros would all be read from one page of memory."""
    return encode(message, ENVELOPE)


def wire_size(message: Message) -> int:
    """Size of an encoded message with its header, bytes."""
    return len(wire_bytes(message))


def _kept(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
