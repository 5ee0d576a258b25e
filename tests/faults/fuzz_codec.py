"""Mutated messages and random bytes into what decodes them: `python tests/faults/fuzz_codec.py --help`.

Valid messages of every class are spoiled. Nothing but the typed error may come out. It prints how many were refused and
decoded, the worst time of one and the most memory that one had at once.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import struct
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np
from navloom.messages import SCHEMAS, Array, Envelope, Message
from navloom.messages.codec import CodecError, decode, encode, read_envelope, schema_label
from navloom.messages.generic import decode_generic
from navloom.messages.kinds import Kind

__all__ = ["Findings", "fuzz_codec", "main"]

TRACED = 20
"""Every so manieth decode is also watched for memory, which makes it ten times slower, so it is not timed."""
AT = Envelope("lab/r1/localizer/main/pose", 3, 4, 200_000_000, 150_000_000, 0)
BOMBS = (b"\x9f", b"\x91", b"\x81\xa1a", b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xdc\x10\x00", b"\x80",
         b"\xc6\xff\xff\xff\xff", b"\xdb\x00\xff\xff\xff", b"\xc9\x00\x00\x10\x00", b"\xcb\x7f\xf8\0\0\0\0\0\0",
         b"\xd3\x80\0\0\0\0\0\0\0", b"\xcf\xff\xff\xff\xff\xff\xff\xff\xff", b"\xc1", b"\xc0")  # fmt: skip
"""What nests, claims much, or is at the end of a range."""
SIZES = (1, 8, 64, 500, 4000, 60_000, 250_000, 1_000_000)


@dataclass
class Findings:
    """What came of it.

    Attributes:
        refused, decoded: How many ended in the typed error, and in a message.
        wrong: What ended in anything else, as text.
        worst_s, worst_bytes: Longest time of one, of a processor, and most memory that one had at once.
        slowest: What took the longest.
    """

    refused: int = 0
    decoded: int = 0
    wrong: list[str] = field(default_factory=list)
    worst_s: float = 0.0
    worst_bytes: int = 0
    slowest: str = ""

    def attempt(self, act: Callable[[], Any], what: str, expected: type[Exception], is_traced: bool) -> None:
        """Do it once, by the clock or watched for memory."""
        if is_traced:
            tracemalloc.start()
        began = time.thread_time()
        try:
            act()
            self.decoded += 1
        except expected as error:
            self.refused += 1
            if len(str(error)) > 2000:
                self.wrong.append(f"{what}: a text of {len(str(error))} characters")
        except Exception as error:
            self.wrong.append(f"{what}: {type(error).__name__}: {error}"[:300])
        took = time.thread_time() - began
        if is_traced:
            self.worst_bytes = max(self.worst_bytes, tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        elif took > self.worst_s:
            self.worst_s, self.slowest = took, what


def sample(cls: type[Message], source: random.Random) -> Message:
    """A valid message of a class."""
    sizes: dict[str, int] = {}
    return cls(*[_value(kind, source, sizes) for kind in cls.kinds.values()])


def _value(kind: Kind, source: random.Random, sizes: dict[str, int]) -> Any:
    if kind.optional and source.random() < 0.3:
        return None
    if kind.array is not None:
        return _array(kind.array, source, sizes)
    if kind.message is not None:
        return sample(kind.message, source)
    if kind.item is not None:
        return tuple(_value(kind.item, source, {}) for _ in range(source.choice((0, 1, 3, min(60, kind.most)))))
    if kind.choices:
        return source.choice(kind.choices)
    made: dict[str, Any] = {
        "str": "w" * source.choice((0, 5, min(kind.most, 200))),
        "bool": source.random() < 0.5,
        "int": source.randrange(0, 2**62),
        "float": source.uniform(0.1, 3.0),
    }
    return made[kind.form]


def _array(spec: Array, source: random.Random, sizes: dict[str, int]) -> Any:
    shape = [n if isinstance(n, int) else sizes.setdefault(n, source.randrange(1, 5)) for n in spec.shape]
    return np.ones(shape, dtype=spec.dtype)


def mutants(valid: bytes, source: random.Random) -> Iterator[bytes]:
    """One of each way to spoil bytes."""
    place = source.randrange(len(valid))
    flipped = bytearray(valid)
    for _ in range(source.randrange(1, 6)):
        flipped[source.randrange(len(valid))] = source.randrange(256)
    yield bytes(flipped)
    yield valid[:place]
    yield valid[:place] + source.randbytes(source.randrange(1, 40)) + valid[place:]
    yield valid[:place] + source.choice(BOMBS) + valid[place + 1 :]
    yield source.randbytes(source.randrange(0, 400))


def headers(valid: bytes, source: random.Random) -> Iterator[bytes]:
    """Headers whose length fits and whose contents do not: spoiled, replaced, or with a bomb in a field."""
    (length,) = struct.unpack_from("<I", valid)
    packed, rest = valid[4 : 4 + length], valid[4 + length :]
    for spoiled in mutants(packed, source):
        yield struct.pack("<I", len(spoiled)) + spoiled + rest
    header = msgpack.unpackb(packed)
    name = source.choice([*header["fields"], "unknown"])
    header["fields"][name] = source.choice((None, -1, 2**64 - 1, "x" * 300, [], {}, [[]] * 50, {"x": {}}, 1.5, b"b"))
    if source.random() < 0.3:
        header["arrays"] = [["<f8", [source.choice((-1, 0, 3, 2**40, 2**64 - 1))] * source.randrange(10), 0]]
    changed = msgpack.packb(header)
    yield struct.pack("<I", len(changed)) + changed + rest
    if source.random() < 0.05:
        yield with_bomb(header, name, source)


def with_bomb(header: dict[str, Any], name: str, source: random.Random) -> bytes:
    """A header with up to a megabyte of one thing in a field."""
    bomb, size = source.choice(BOMBS), source.choice(SIZES)
    fields = {key: value for key, value in header["fields"].items() if key != name}
    parts = [b"\x83", msgpack.packb("envelope"), msgpack.packb(header["envelope"]), msgpack.packb("fields")]
    parts += [bytes([0x81 + len(fields)]), *(msgpack.packb(entry) for pair in fields.items() for entry in pair)]
    parts += [msgpack.packb(name), bomb * (size // len(bomb) + 1), msgpack.packb("arrays"), b"\x90"]
    packed = b"".join(parts)
    return struct.pack("<I", len(packed)) + packed


def fuzz_codec(count: int, seed: int) -> Findings:
    """So many decodes of messages of every class, of envelopes alone, and of messages of no class."""
    source, found = random.Random(seed), Findings()
    classes = sorted(SCHEMAS.values(), key=lambda cls: cls.schema_name)
    done = 0
    while done < count:
        cls = classes[done % len(classes)] if done < 10_000 else source.choice(classes)
        label = schema_label(cls)
        valid = encode(sample(cls, source), AT)
        for data in (*mutants(valid, source), *headers(valid, source)):
            whole: Callable[[], Any] = lambda: decode(data, label)  # noqa: B023, E731
            partly: list[Callable[[], Any]] = [lambda: read_envelope(data), lambda: decode_generic(data, label)]  # noqa: B023
            act = source.choice(partly) if source.random() < 0.2 else whole
            what = f"{label}, {len(data)} bytes, {data[:60].hex()}"
            found.attempt(act, what, CodecError, done % TRACED == 0)
            done += 1
    return found


def report(name: str, found: Findings) -> dict[str, Any]:
    """The findings as plain values."""
    return {
        "what": name,
        "refused": found.refused,
        "decoded": found.decoded,
        "wrong": len(found.wrong),
        "first_wrong": found.wrong[:5],
        "worst_ms": round(found.worst_s * 1e3, 3),
        "slowest": found.slowest[:200],
        "worst_kb": found.worst_bytes // 1024,
        "rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }


def main(words: Sequence[str] | None = None) -> int:
    """The command line; 1 where anything but the typed error came out."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(words)
    found = fuzz_codec(given.count, given.seed)
    print(json.dumps(report("codec", found)), flush=True)
    return 1 if found.wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
