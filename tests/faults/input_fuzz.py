"""Mutated and random files for every decoder of files: `python tests/faults/input_fuzz.py --count 1000000`.

All cases of a decoder run in this process, on files in memory. A decoder gives a value or its typed error; anything
else is a defect, and so is a case that takes long. Files of defects are saved in the folder `--keep`. The script prints
the table of docs/inputs.md.
"""

from __future__ import annotations

import argparse
import functools
import gzip
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest.mock import patch

from fuzz_seeds import (
    CARMEN,
    CONFIG,
    IDENTITIES,
    JOURNAL,
    MAP,
    OVERRIDES,
    RAW_CARMEN,
    REQUEST,
    SMALL_CONFIG,
    STUDY,
    TABLE,
    WORLD,
    YAML,
    bag_seeds,
    barn,
    npz_with_checksums,
    png,
    png_with_checksums,
    recordings,
    sweep,
)
from navloom.config import ConfigError, load_config, loader
from navloom.messages import MessageError
from navloom.plugins import Discovery, PluginError
from navloom.roles import InputError
from navloom.worlds import SCHEMES, WorldError
from navloom_carmen.carmen_import import import_carmen
from navloom_live.transport.access import AccessError, read_identities
from navloom_maps import SCHEMES as MAPS
from navloom_maps import rosmap
from navloom_recording.reader import Recording
from navloom_recording.recording_header import RecordingError
from navloom_recording.writer import WriteError
from navloom_ros.bag_import import import_bag
from navloom_ros.bags import opened
from navloom_study.openloop import METHOD
from navloom_study.recorded_sweeps import find_floor, map_sweep, read_recording, sweep_of
from navloom_study.report import study_files as report_data
from navloom_study.study_folder import StudyFolder, open_loop_table, table_of
from rosbags.typesys import get_types_from_msg

SLOWEST, LONGEST = 20.0, 200.0
"""Processor time and wall time after which a case is a defect, s: it computes, or waits, for ever."""
SHARED = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Folder in memory for the files, if the system has one."""
INSTALLED = functools.cache(Discovery)
"""The installed plugins, found once: finding them takes longer than most cases."""
NUMBERS = [0, 1, 2, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1]
TEXTS = b"""[[ ]] { } , . = : " ' \"\"\" ''' # \n \r\n \0 - + e E inf nan 1e309 -1 0x 0b 1_0 !! & * << ? | > % @ true
false null [] {} [[[[[[ }}}}}} 9999999999999999999999 0.0000001 1979-05-27
\xff\xfe \xef\xbb\xbf \xe2\x80\xa8 ../../etc/passwd
.toml #1 ?unknown=free ?height=2 a.b.c [[box]] [raster] [robot] [[sensor]] name plugin rate_hz""".split()


class TooSlow(BaseException):
    """A case took longer than it may; no decoder may catch it."""


@dataclass
class Decoder:
    """A decoder under test: valid seeds of its file, how the file is read, and its typed errors."""

    name: str
    seeds: list[bytes]
    read: Callable[[Path], object]
    errors: tuple[type[Exception], ...]
    pack: Callable[[bytes], bytes] = bytes
    """Turns the mutated bytes into those of the file, for example by compressing them."""


@dataclass
class Result:
    """Results of one decoder; times in s, of a processor except for `seconds`."""

    count: int = 0
    read: int = 0
    seconds: float = 0.0
    spent: float = 0.0
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
    with (
        tempfile.TemporaryDirectory(dir=SHARED) as name,
        patch.object(loader, "Discovery", INSTALLED),
        patch.object(report_data, "Discovery", INSTALLED),
    ):
        folder = Path(name)
        (folder / "f").write_bytes(decoder.pack(decoder.seeds[0]))
        with suppress(*decoder.errors):  # import and compile before the first case is timed
            decoder.read(folder / "f")
        forget_peak()
        resident, start, spent = peak_mb(), time.monotonic(), time.process_time()
        while result.count < count and result.seconds < seconds:
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
            result.seconds = time.monotonic() - start
            result.spent = time.process_time() - spent
            if defect:
                result.defects[defect] += 1
                if keep is not None and result.defects[defect] == 1:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{decoder.name.replace(' ', '_')}-{result.count}").write_bytes(content)
        result.memory_mb = peak_mb() - resident
    return result


def forget_peak() -> None:
    """Reset the peak memory of this process, which an earlier decoder may have raised."""
    Path("/proc/self/clear_refs").write_text("5", "ascii")


def peak_mb() -> float:
    """Peak memory of this process, MB."""
    (line,) = (text for text in Path("/proc/self/status").read_text("ascii").splitlines() if text.startswith("VmHWM"))
    return int(line.split()[1]) / 1e3


def _too_slow(*_: object) -> None:
    raise TooSlow


def _place(error: BaseException) -> str:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return "" if trace is None else f"({Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno})"


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


def read_carmen(path: Path) -> None:
    path.with_name("out.mcap").unlink(missing_ok=True)
    import_carmen(path, path.with_name("out.mcap"))


def remember_definitions() -> None:
    """Let `rosbags` parse and compile each message definition once, not once for each bag: that is half of its time."""
    compiled = functools.lru_cache(4096)(functools.partial(compile, filename="<rosbags>", mode="exec"))
    for module in ("rosbags.serde.utils", "rosbags.typesys.store"):
        patch(f"{module}.exec", lambda code, names: exec(compiled(code), names), create=True).start()
    parsed = functools.lru_cache(1024)(get_types_from_msg)
    patch("rosbags.highlevel.anyreader.get_types_from_msg", lambda text, name: dict(parsed(text, name))).start()


def read_bag(name: str) -> Callable[[Path], object]:
    def read(path: Path) -> object:
        bag, out = path.with_name(name), path.with_name("out.mcap")
        out.unlink(missing_ok=True)
        shutil.copy(path, bag)
        return import_bag(bag, out)

    return read


def read_image(folder: Path) -> Callable[[Path], object]:
    described = folder / "image.yaml"
    described.write_bytes(YAML)
    description = rosmap._describe(described)
    return lambda path: rosmap._grid(replace(description, image=path))


def read_yaml(path: Path) -> object:
    path.with_name("m.pgm").write_bytes(b"P5\n3 2\n255\n123456")
    return MAPS["rosmap"]("f", path.parent)


def read_override(path: Path) -> object:
    change = path.read_bytes().replace(b"\0", b"")  # a NUL ends an argument of a command
    path.with_name("c.toml").write_bytes(SMALL_CONFIG)
    return load_config(str(path.with_name("c.toml")), [os.fsdecode(change)])


def read_journal(path: Path) -> None:
    study = path.with_name("kept")
    study.mkdir(exist_ok=True)
    shutil.copy(path, study / "journal.jsonl")
    (study / "study.json").write_text(json.dumps(REQUEST))
    with StudyFolder(study, REQUEST) as folder:
        rows = [row for row in folder.rows.values() if row.key.method != METHOD]
        beside = [row for row in folder.rows.values() if row.key.method == METHOD]
    table_of(rows, REQUEST["metrics"])
    open_loop_table(beside, REQUEST["open_loop"]["shadows"])
    json.dumps([row.timing for row in rows])


def read_metadata(bag: Path) -> Callable[[Path], object]:
    def read(path: Path) -> None:
        shutil.copy(path, bag / "metadata.yaml")
        with opened(bag, frozenset()):
            pass

    return read


def read_json(path: Path) -> None:
    read_identities(_named(path, "identities.json"), "lab", "r1")


def read_study_of(path: Path) -> None:
    path.with_name("episodes.csv").write_text(TABLE, "utf-8")
    report_data.read_study(_named(path, "study.json"))


def _named(path: Path, name: str) -> Path:
    shutil.copy(path, path.with_name(name))
    return path.parent


def decoders(folder: Path) -> list[Decoder]:
    """Every decoder of files, with valid files to mutate."""
    world, config, sweeps = (WorldError,), (ConfigError, PluginError), (ConfigError, InputError, MessageError)
    bags = [
        Decoder(f"bag {name[2:]}", contents, read_bag(name), (RecordingError, WriteError))
        for name, contents in bag_seeds(folder).items()
    ]
    metadata = (folder / "d" / "metadata.yaml").read_bytes()
    return [
        Decoder("config", [CONFIG], lambda path: load_config(str(path)), config),
        Decoder("set", OVERRIDES, read_override, config),
        Decoder("journal", [JOURNAL], read_journal, (ConfigError,)),
        Decoder("bag metadata", [metadata], read_metadata(folder / "d"), (RecordingError,)),
        Decoder("recording", recordings(folder), read_mcap, (RecordingError,)),
        Decoder("map yaml", [YAML, YAML.replace(b", ", b"\n")[1:-1]], read_yaml, world),
        Decoder("map pgm", [b"P5\n3 2\n255\n123456", b"P2\n3 2\n#x\n255\n1 2 3 4 5 6\n", b"P5 1 1 65535 ab"],
                read_image(folder), world),
        Decoder("map png", [png(mode) for mode in ("L", "P", "RGBA", "I;16", "1")], read_image(folder), world,
                png_with_checksums),
        Decoder("barn npz", [barn()], lambda path: MAPS["barn"]("f#1", path.parent), world, npz_with_checksums),
        Decoder("movingai", [MAP], lambda path: MAPS["movingai"]("f", path.parent), world),
        Decoder("movingai gz", [MAP], lambda path: MAPS["movingai"]("f", path.parent), world,
                lambda content: gzip.compress(content, 1)),
        Decoder("world toml", [WORLD], lambda path: SCHEMES["toml"]("f", path.parent), world),
        Decoder("sweep npz", [sweep()], read_map, sweeps, npz_with_checksums),
        Decoder("identities", [IDENTITIES], read_json, (AccessError,)),
        Decoder("study", [STUDY], read_study_of, (ConfigError,)),
        Decoder("carmen", [RAW_CARMEN, CARMEN], read_carmen, (RecordingError,)),
        Decoder("carmen gz", [RAW_CARMEN, CARMEN], read_carmen, (RecordingError,), lambda data: gzip.compress(data, 1)),
        *bags,
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1_000_000, help="files for each decoder")
    parser.add_argument("--seconds", type=float, default=1e9, help="most time for each decoder")
    parser.add_argument("--decoder", action="append", default=[], help="name of one, as in the table; may be repeated")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files of defects")
    given = parser.parse_args()
    remember_definitions()
    heads = ("decoder", "files", "read", "files a processor second", "slowest, s", "memory, MB", "defects")
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}", flush=True)
    with tempfile.TemporaryDirectory(dir=SHARED) as folder:
        for decoder in decoders(Path(folder)):
            if given.decoder and decoder.name not in given.decoder:
                continue
            found = fuzz(decoder, given.count, given.seconds, given.seed, given.keep)
            cells = (decoder.name, found.count, found.read, f"{found.count / found.spent:.0f}",
                     f"{found.slowest:.2f}", f"{found.memory_mb:.0f}", sum(found.defects.values()))  # fmt: skip
            print(f"| {' | '.join(map(str, cells))} |", flush=True)
            for text, number in found.defects.most_common():
                print(f"  {number} times: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
