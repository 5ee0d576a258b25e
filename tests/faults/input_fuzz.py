"""Mutated and random files for every decoder of files: `python tests/faults/input_fuzz.py --count 1000000`.

A decoder gives a value or an error of its own type; anything else is a defect, and so is a case that takes long. What
is found is kept under `--keep`. The table that the script prints is that of docs/inputs.md.
"""

from __future__ import annotations

import argparse
import gzip
import io
import random
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from navloom.config import ConfigError, load_config
from navloom.messages import Envelope, MessageError, Odometry, Pose2D, Twist2D
from navloom.messages.codec import encode, schema_label
from navloom.plugins import PluginError
from navloom.recording.header import RecordingError, header_of
from navloom.recording.reader import Recording
from navloom.recording.ros_import import import_bag
from navloom.recording.writer import RecordingWriter, WriteError
from navloom.roles import InputError
from navloom.runtime.access import AccessError, read_identities
from navloom.study.report_data import read_study
from navloom.study.sweeps import find_floor, map_sweep, read_recording, sweep_of
from navloom.worlds import SCHEMES, WorldError
from PIL import Image

SLOWEST, LONGEST = 20.0, 200.0
"""Processor time and wall time after which a case counts as a defect, s: it computes, or it waits, for ever."""
NUMBERS = [0, 1, 2, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1]
TEXTS = b"""[[ ]] { } , . = : " ' \"\"\" ''' # \n \r\n \0 - + e E inf nan 1e309 -1 0x 0b 1_0 !! & * << ? | > % @ true
false null [] {} [[[[[[ }}}}}} 9999999999999999999999 0.0000001 1979-05-27
\xff\xfe \xef\xbb\xbf \xe2\x80\xa8 ../../etc/passwd
.toml #1 ?unknown=free ?height=2 a.b.c [[box]] [raster] [robot] [[sensor]] name plugin rate_hz""".split()


class TooSlow(BaseException):
    """A case took longer than it may; no decoder may catch it."""


@dataclass
class Decoder:
    """What is fuzzed: files of a folder, one of which is mutated, and how they are read."""

    name: str
    seeds: list[bytes]
    read: Callable[[Path], object]
    errors: tuple[type[Exception], ...]
    pack: Callable[[bytes], bytes] = bytes
    """From what is mutated to what is written, as compressing it."""


@dataclass
class Result:
    """What a decoder did."""

    count: int = 0
    read: int = 0
    slowest: float = 0.0
    memory_mb: float = 0.0
    defects: Counter[str] = field(default_factory=Counter)


def mutated(seeds: list[bytes], rng: random.Random) -> bytes:
    """A seed with one to six changes, or random bytes."""
    if rng.random() < 0.05:
        return rng.randbytes(rng.choice((0, 1, 8, 60, 400)))
    content = bytearray(rng.choice(seeds))
    for _ in range(rng.choice((1, 1, 2, 3, 6))):
        at = rng.randrange(len(content) + 1)
        kind = rng.randrange(8)
        if kind == 0 and at < len(content):
            content[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            content[at : at + rng.randrange(1, 9)] = rng.randbytes(rng.randrange(9))
        elif kind == 2:
            size = rng.choice((1, 2, 4, 8))
            content[at : at + size] = (rng.choice(NUMBERS) % 256**size).to_bytes(size, "little")
        elif kind == 3:
            del content[at : at + rng.choice((1, 4, 40, 4000))]
        elif kind == 4:
            content[at:at] = content[max(0, at - rng.randrange(1, 200)) : at] * rng.choice((1, 1, 2, 50))
        elif kind == 5:
            content[at : at + rng.choice((0, 1, 5))] = rng.choice(TEXTS)
        elif kind == 6:
            other = rng.choice(seeds)
            start = rng.randrange(len(other) + 1)
            content[at:at] = other[start : start + rng.randrange(1, 300)]
        else:
            content[at:at] = rng.choice((b"\0", b"9", b"[", b" ", b"a.", b"\n")) * rng.choice((3, 70, 1000))
    return bytes(content)


def fuzz(decoder: Decoder, count: int, seconds: float, seed: int, keep: Path | None = None) -> Result:
    """Read `count` files, or as many as `seconds` allow."""
    rng, result = random.Random(f"{decoder.name} {seed}"), Result()
    signal.signal(signal.SIGALRM, _too_slow)
    signal.signal(signal.SIGPROF, _too_slow)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    end = time.monotonic() + seconds
    shared = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None) as name:
        folder = Path(name)
        while result.count < count and time.monotonic() < end:
            content = decoder.pack(mutated(decoder.seeds, rng))
            (folder / "f").write_bytes(content)
            began, defect = time.process_time(), ""
            signal.setitimer(signal.ITIMER_PROF, SLOWEST)
            signal.setitimer(signal.ITIMER_REAL, LONGEST)
            try:
                decoder.read(folder / "f")
                result.read += 1
            except decoder.errors as error:
                if len(str(error)) > 20_000:
                    defect = f"an error of {len(str(error))} characters"
            except TooSlow:
                defect = f"more than {SLOWEST:g} s"
            except BaseException as error:
                defect = f"{type(error).__name__}: {str(error)[:80]} {_place(error)}"
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            result.count += 1
            result.slowest = max(result.slowest, time.process_time() - began)
            if defect:
                result.defects[defect] += 1
                if keep is not None and result.defects[defect] == 1:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{decoder.name.replace(' ', '_')}-{result.count}").write_bytes(content)
        result.memory_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak) / 1e3
    return result


def _too_slow(*_: object) -> None:
    raise TooSlow


def _place(error: BaseException) -> str:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return "" if trace is None else f"({Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno})"


YAML = (
    b"{image: m.pgm, resolution: 0.1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.2, mode: raw}"
)
MAP = b"type octile\nheight 2\nwidth 4\nmap\n.GS.\n@OTW\n"
WORLD = b"""bounds = [-5.0, -1.0, 5.0, 9.0]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 7.6 }
goal_tolerance = 0.2
[[box]]
name = "cupboard"
x = [1.0, 1.6]
y = [2.0, 2.4]
yaw_deg = 30.0
[[cylinder]]
x = 0.5
y = 3.0
radius = 0.25
appears = "after_sweep"
[[cylinder]]
x = 1.5
y = 3.0
radius = 0.25
waypoints = [[5.0, 0.5, 3.0], [9.0, 2.5, 3.0]]
loops = true
"""
CONFIG = b"""[robot]
name = "r1"
footprint = { length = 0.8, width = 0.6 }
[run]
seed = 3
period = 0.05
[world]
ref = "paper_gates"
[navigation]
goal = { x = 0.0, y = 7.6 }
[planner]
plugin = "astar"
[controller]
plugin = "lyapunov_tracker"
k1 = 1.0
k3 = 0.6
[[sensor]]
name = "laser"
kind = "range_scan"
beams = 181
"""


def png(mode: str) -> bytes:
    file = io.BytesIO()
    Image.new(mode, (40, 30), 1).save(file, "PNG")
    return file.getvalue()


def png_with_checksums(content: bytes) -> bytes:
    """A PNG whose chunks have the checksums of what they hold, so that what they hold is read."""
    out, at = content[:8], 8
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        body = content[at + 4 : at + 8 + length]
        out += content[at : at + 4] + body + struct.pack(">I", zlib.crc32(body))
        at += 12 + length
    return out + content[at:]


def npz(**arrays: Any) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, np.asarray(array))
            archive.writestr(f"{name}.npy", member.getvalue())
    return file.getvalue()


def npz_with_checksums(content: bytes) -> bytes:
    """The archive with checksums of what its members hold; as it is where that cannot be found."""
    content = bytearray(content)
    try:
        entries = zipfile.ZipFile(io.BytesIO(bytes(content))).infolist()
    except Exception:
        return bytes(content)
    at = bytes(content).find(b"PK\x01\x02")
    for entry in entries:
        if at < 0 or entry.compress_type != zipfile.ZIP_STORED:
            break
        start = entry.header_offset + 30 + len(entry.filename)
        content[at + 16 : at + 20] = struct.pack("<I", zlib.crc32(content[start : start + entry.file_size]))
        at = bytes(content).find(b"PK\x01\x02", at + 4)
    return bytes(content)


def barn() -> bytes:
    return npz(world=[1, 2], cyl=np.ones((3, 3)), cyl_off=[0, 2, 3], start=np.zeros(3), goal=np.zeros(2),
               goal_tol=1.0, time_limit=9.0, path_len_m=[8.0, 9.0])  # fmt: skip


def sweep() -> bytes:
    pitches, bearings = np.radians(np.linspace(-60, 0, 30)), np.radians(np.linspace(-40, 40, 41))
    down = -np.sin(pitches)[:, None] + 0.0 * bearings
    ranges = np.where(down > 0.1, 0.6 / np.maximum(down, 0.1), 6.0)
    return npz(ranges_m=ranges, pitch_deg=np.degrees(pitches), beam_deg=np.degrees(bearings))


def recordings(folder: Path) -> list[bytes]:
    """A small recording, closed, not closed, and with its chunks unpacked, so that what is in them is mutated too."""
    path = folder / "r.mcap"
    writer = RecordingWriter(path, header_of(load_config("paper"), "lockstep", {}), {})
    with writer:
        for number in range(1, 6):
            at = Envelope("lab/r1/platform/main/odometry", number, number, number * 10**7, number * 10**7, 0)
            message = Odometry(at.stamp_ns, Pose2D(0.1 * number, 0.0, 0.0), Twist2D(0.5, 0.0, 0.0))
            writer.add(at.key, schema_label(Odometry), encode(message, at), at.stamp_ns, at.stamp_ns, number)
        writer.close({"messages": 5})
    whole = path.read_bytes()
    plain, at = whole[:8], 8
    while at + 9 <= len(whole):
        opcode, length = struct.unpack_from("<BQ", whole, at)
        content, at = whole[at + 9 : at + 9 + length], at + 9 + length
        if opcode == 6:
            (size,) = struct.unpack_from("<Q", content, 16)
            (how,) = struct.unpack_from("<I", content, 28)
            data = zstandard.ZstdDecompressor().decompress(content[40 + how :], max_output_size=size)
            content = content[:24] + bytes(4) + bytes(4) + struct.pack("<Q", len(data)) + data
        plain += struct.pack("<BQ", opcode, len(content)) + content
        if opcode == 2:
            break
    plain += whole[:8]
    return [plain, plain, whole, plain[: len(plain) // 2]]


def read_mcap(path: Path) -> None:
    with Recording(path) as recording:
        recording.keys(), recording.counts(), recording.span_ns(), recording.note
        for name in recording.attachments():
            recording.attachment(name)
        for _ in recording.messages():
            pass
        recording.header.loaded()


def read_map(path: Path) -> None:
    recording = read_recording(path)
    offset, height = find_floor(recording)
    map_sweep(sweep_of(recording, offset, height))


def read_bag(name: str) -> Callable[[Path], object]:
    def read(path: Path) -> object:
        bag, out = path.with_name(name), path.with_name("out.mcap")
        out.unlink(missing_ok=True)
        shutil.copy(path, bag)
        return import_bag(bag, out)

    return read


def read_image(path: Path) -> object:
    path.with_name("m.yaml").write_bytes(YAML.replace(b"m.pgm", b"f"))
    return SCHEMES["rosmap"]("m.yaml", path.parent)


def read_yaml(path: Path) -> object:
    path.with_name("m.pgm").write_bytes(b"P5\n3 2\n255\n123456")
    return SCHEMES["rosmap"]("f", path.parent)


def read_json(path: Path) -> None:
    read_identities(_named(path, "identities.json"), "lab", "r1")


def read_study_of(path: Path) -> None:
    path.with_name("episodes.csv").write_text("method,world,seed,outcome\n")
    read_study(_named(path, "study.json"))


def _named(path: Path, name: str) -> Path:
    shutil.copy(path, path.with_name(name))
    return path.parent


def bag_seeds(folder: Path) -> dict[str, bytes]:
    """Small bags of each kind, by the end of their names."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "framework" / "tests" / "recording"))
    import bags
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    bags.SECONDS, bags.BEAMS = 0.3, 9
    found = {"x.bag": bags.room_bag(folder / "a.bag", 1).read_bytes()}
    (database,) = bags.room_bag(folder / "b", 2).glob("*.db3")
    found["x.db3"] = database.read_bytes()
    bags.Writer2 = lambda path, version: Writer2(path, version=version, storage_plugin=StoragePlugin.MCAP)
    (recorded,) = bags.room_bag(folder / "c", 2).glob("*.mcap")
    found["x.mcap"] = recorded.read_bytes()
    bags.Writer2 = Writer2
    return found


def decoders(folder: Path) -> list[Decoder]:
    """Every decoder of files, with valid files to begin from."""
    world, config, sweeps = (WorldError,), (ConfigError, PluginError), (ConfigError, InputError, MessageError)
    bags = [
        Decoder(f"bag {name[2:]}", [content], read_bag(name), (RecordingError, WriteError))
        for name, content in bag_seeds(folder).items()
    ]
    identities = b'{"realm": "lab", "robot": "r1", "identities": [{"name": "a", "kind": "viewer", "instance": ""}]}'
    study = b'{"methods": {"a": {}}, "metrics": [], "worlds": {}, "seeds": [1], "open_loop": {"baseline": "a"}}'
    return [
        Decoder("config", [CONFIG], lambda path: load_config(str(path)), config),
        Decoder("recording", recordings(folder), read_mcap, (RecordingError,)),
        Decoder("map yaml", [YAML, YAML.replace(b", ", b"\n")[1:-1]], read_yaml, world),
        Decoder("map pgm", [b"P5\n3 2\n255\n123456", b"P2\n3 2\n#x\n255\n1 2 3 4 5 6\n", b"P5 1 1 65535 ab"],
                read_image, world),
        Decoder("map png", [png(mode) for mode in ("L", "P", "RGBA", "I;16", "1")], read_image, world,
                png_with_checksums),
        Decoder("barn npz", [barn()], lambda path: SCHEMES["barn"]("f#1", path.parent), world, npz_with_checksums),
        Decoder("movingai", [MAP], lambda path: SCHEMES["movingai"]("f", path.parent), world),
        Decoder("movingai gz", [MAP], lambda path: SCHEMES["movingai"]("f", path.parent), world,
                lambda content: gzip.compress(content, 1)),
        Decoder("world toml", [WORLD], lambda path: SCHEMES["toml"]("f", path.parent), world),
        Decoder("sweep npz", [sweep()], read_map, sweeps, npz_with_checksums),
        Decoder("identities", [identities], read_json, (AccessError,)),
        Decoder("study", [study], read_study_of, (ConfigError,)),
        *bags,
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1_000_000, help="files for each decoder")
    parser.add_argument("--seconds", type=float, default=1e9, help="most time for each decoder")
    parser.add_argument("--only", default="", help="decoders whose name begins so")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files of defects")
    given = parser.parse_args()
    print("| decoder | files | read | slowest, s | memory, MB | defects |\n|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for decoder in decoders(Path(folder)):
            if not decoder.name.startswith(given.only):
                continue
            found = fuzz(decoder, given.count, given.seconds, given.seed, given.keep)
            print(f"| {decoder.name} | {found.count} | {found.read} | {found.slowest:.2f} | {found.memory_mb:.0f} | "
                  f"{sum(found.defects.values())} |", flush=True)  # fmt: skip
            for text, number in found.defects.most_common():
                print(f"  {number} times: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
