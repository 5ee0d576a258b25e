"""Random streams: one per name, independent of each other and of other instances."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np

__all__ = ["stream_source"]


def stream_source(seed: int, role: str, instance: str) -> Callable[[str], np.random.Generator]:
    """A function that returns one instance's stream of a name; a second call returns the same stream, continued.

    A stream is seeded from (seed, role, instance, name) alone, so adding a shadow or a sensor changes nothing.
    """
    made: dict[str, np.random.Generator] = {}

    def stream(name: str) -> np.random.Generator:
        if name not in made:
            # A separator that no name contains: "a", "bc" and "ab", "c" are different streams.
            label = "\0".join((role, instance, name)).encode()
            # A hash of our own, because Python's differs between processes; the byte order is fixed.
            words = np.frombuffer(hashlib.sha256(label).digest(), dtype="<u4")
            # The generator is named: numpy may change what `default_rng` returns.
            made[name] = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *words.tolist()])))
        return made[name]

    return stream
