"""Fuzzes the decoders of messages with mutated messages and random bytes: `python tests/faults/fuzz_codec.py --help`.

Valid messages of every class are mutated; only the typed error may be raised. It prints how many were refused and
decoded, the longest time of one, and the largest memory that one used at once.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import resource
import struct
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from navloom.messages import SCHEMAS, Array, Envelope, Message
from navloom.messages.codec import CodecError, decode, encode, read_envelope, schema_label
from navloom.messages.generic import decode_generic
from navloom.messages.kinds import Kind

__all__ = ["Findings", "fuzz_codec", "main", "sample"]

TRACED = 20
"""Every so many decodes one is traced for memory; tracing makes it ten times slower, so it is not timed."""
AT = Envelope("lab/r1/localizer/main/pose", 3, 4, 200_000_000, 150_000_000, 0)
BOMBS = (b"\x9f", b"\x91", b"\x81\xa1a", b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xdc\x10\x00", b"\x80",
         b"\xc6\xff\xff\xff\xff", b"\xdb\x00\xff\xff\xff", b"\xc9\x00\x00\x10\x00", b"\xcb\x7f\xf8\0\0\0\0\0\0",
         b"\xd3\x80\0\0\0\0\0\0\0", b"\xcf\xff\xff\xff\xff\xff\xff\xff\xff", b"\xc1", b"\xc0")  # fmt: skip
"""MessagePack that nests, claims a huge length, or is at the end of a range."""
VALUES = (None, -1, 0, 1, True, False, 2**62, 2**63 - 1, 2**63, 2**64 - 1, -(2**63), 1.5, -0.0, 4.0, math.pi, math.nan,
          math.inf, -math.inf, 5e-324, "", "x" * 300, "é" * 100, "é" * 200, [], [1], [1.5], ["a"], [None], {},
          [[]] * 50, {"x": {}}, b"b", msgpack.ExtType(5, b"x"), msgpack.Timestamp(1))  # fmt: skip
"""Values that replace a field."""
SIZES = (1, 8, 64, 500, 4000, 60_000, 250_000, 1_000_000)


@dataclass
class Findings:
    """Results of a run.

    Attributes:
        refused, decoded: Number of inputs that gave the typed error, and a message.
        wrong: Inputs that gave anything else, as text.
        worst_s, worst_bytes: Longest processor time of one input, s, and largest memory that one used at once.
        slowest: The input that took longest.
    """

    refused: int = 0
    decoded: int = 0
    wrong: list[str] = field(default_factory=list)
    worst_s: float = 0.0
    worst_bytes: int = 0
    slowest: str = ""

    def attempt(self, act: Callable[[], Any], what: str, expected: type[Exception], is_traced: bool) -> None:
        """Decode once, timed or traced for memory."""
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
    """One mutant for each way to mutate bytes."""
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
    """Headers of the right length with wrong contents: mutated, with other values, or with a bomb in a field."""
    (length,) = struct.unpack_from("<I", valid)
    packed, rest = valid[4 : 4 + length], valid[4 + length :]
    for spoiled in mutants(packed, source):
        yield struct.pack("<I", len(spoiled)) + spoiled + rest
    header = msgpack.unpackb(packed)
    name = source.choice([*header["fields"], "unknown"])
    fields = header["fields"]
    if isinstance(fields.get(name), dict) and source.random() < 0.7:  # one of a nested message
        fields, name = fields[name], source.choice([*fields[name], "unknown"])
    fields[name] = source.choice(VALUES)
    if source.random() < 0.1:
        del fields[name]
    if source.random() < 0.2:
        header["envelope"][source.randrange(6)] = source.choice(VALUES)
    if source.random() < 0.2 and header["arrays"]:
        source.choice(header["arrays"])[source.randrange(3)] = source.choice((*VALUES, 0, 64, 128, [2], [1, 3], "<f8"))
    elif source.random() < 0.2:
        header["arrays"] = [["<f8", [source.choice((-1, 0, 3, 2**40, 2**64 - 1))] * source.randrange(10), 0]]
    tail = valid[4 + length + -(4 + length) % 64 :]
    yield joined(msgpack.packb(header), tail)
    yield joined(rearranged(msgpack.unpackb(packed), source), tail)
    if source.random() < 0.05:
        yield with_bomb(header, name, source)


def rearranged(header: dict[str, Any], source: random.Random) -> bytes:
    """A header with its parts and fields in another order, and perhaps one of them twice."""
    fields = {key: msgpack.packb(value) for key, value in header["fields"].items()}
    parts = {name: msgpack.packb(header[name]) for name in ("envelope", "arrays")}
    return shuffled(parts | {"fields": shuffled(fields, source)}, source)


def shuffled(entries: dict[str, bytes], source: random.Random) -> bytes:
    """A map of packed values, in any order."""
    pairs = list(entries.items())
    source.shuffle(pairs)
    if source.random() < 0.3:
        key, value = source.choice(pairs)
        again = value if source.random() < 0.5 else msgpack.packb(source.choice(VALUES))
        pairs.insert(source.randrange(len(pairs) + 1), (key, again))
    return bytes([0x80 + len(pairs)]) + b"".join(msgpack.packb(key) + value for key, value in pairs)


def joined(packed: bytes, tail: bytes) -> bytes:
    """A header and the arrays behind it, at a multiple of 64."""
    head = struct.pack("<I", len(packed)) + packed
    return head + (bytes(-len(head) % 64) + tail if tail else b"")


def with_bomb(header: dict[str, Any], name: str, source: random.Random) -> bytes:
    """A header with a bomb of up to a megabyte in a field."""
    bomb, size = source.choice(BOMBS), source.choice(SIZES)
    fields = {key: value for key, value in header["fields"].items() if key != name}
    parts = [b"\x83", msgpack.packb("envelope"), msgpack.packb(header["envelope"]), msgpack.packb("fields")]
    parts += [bytes([0x81 + len(fields)]), *(msgpack.packb(entry) for pair in fields.items() for entry in pair)]
    parts += [msgpack.packb(name), bomb * (size // len(bomb) + 1), msgpack.packb("arrays"), b"\x90"]
    packed = b"".join(parts)
    return struct.pack("<I", len(packed)) + packed


def spoiled(count: int, seed: int) -> Iterator[tuple[str, bytes, random.Random]]:
    """Label and bytes of at least `count` mutated messages of all classes, and the random source."""
    source = random.Random(seed)
    classes = sorted(SCHEMAS.values(), key=lambda cls: cls.schema_name)
    done = 0
    while done < count:
        cls = classes[done % len(classes)] if done < 10_000 else source.choice(classes)
        valid = encode(sample(cls, source), AT)
        for data in (valid, *mutants(valid, source), *headers(valid, source)):
            yield schema_label(cls), data, source
            done += 1


def fuzz_codec(count: int, seed: int) -> Findings:
    """Decode at least `count` messages of all classes: whole, the envelope alone, or without a class."""
    found = Findings()
    for done, (label, data, source) in enumerate(spoiled(count, seed)):
        whole: Callable[[], Any] = lambda: decode(data, label)  # noqa: B023, E731
        partly: list[Callable[[], Any]] = [lambda: read_envelope(data), lambda: decode_generic(data, label)]  # noqa: B023
        act = source.choice(partly) if source.random() < 0.2 else whole
        found.attempt(act, f"{label}, {len(data)} bytes, {data[:60].hex()}", CodecError, done % TRACED == 0)
    return found


def report(name: str, findings: Findings) -> dict[str, Any]:
    """The findings as plain values."""
    return {
        "what": name,
        "refused": findings.refused,
        "decoded": findings.decoded,
        "wrong": len(findings.wrong),
        "first_wrong": findings.wrong[:5],
        "worst_ms": round(findings.worst_s * 1e3, 3),
        "slowest": findings.slowest[:200],
        "worst_kb": findings.worst_bytes // 1024,
        "rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }


def resident_mb() -> float:
    """Resident memory of this process, MB."""
    return round(int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20, 1)


def main(words: Sequence[str] | None = None) -> int:
    """The command line; returns 1 if anything but the typed error was raised."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(words)
    fuzz_codec(10_000, given.seed)
    before = resident_mb()
    found = fuzz_codec(given.count, given.seed)
    said = report("codec", found) | {"rss_mb_before": before, "rss_mb_after": resident_mb()}
    print(json.dumps(said), flush=True)
    return 1 if found.wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
