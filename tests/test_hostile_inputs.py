"""Files made to do harm: one line, exit code 2, and little memory and time, whatever a file claims or unpacks to.

Each command runs in a forked child with a bound of 4 MB on its inputs, mostly, 3 GB of memory and 20 s at most.
"""

from __future__ import annotations

import functools
import gzip
import io
import os
import re
import resource
import signal
import sqlite3
import struct
import sys
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import bags
import numpy as np
import pytest
import zstandard
from navloom.cli import main
from navloom.config import load_config
from navloom.recording.header import header_of

BOUND_MB = 4
MEMORY_MB = 3000
SECONDS = 20
ZEROS = 100_000_000
"""Bytes that a bomb unpacks to."""
NOTICES = ("dropped", "later ones load them")
"""Ends of lines that are no errors."""


class Outcome(NamedTuple):
    """Exit code, standard error, peak of the memory beyond what was there before, MB, and processor time, s."""

    code: int
    error: str
    peak_mb: float
    seconds: float


def status_mb(name: str) -> float:
    """A line of this process's status, as VmHWM, MB."""
    found = re.search(rf"{name}:\s+(\d+) kB", Path("/proc/self/status").read_text("ascii"))
    assert found is not None
    return int(found[1]) / 1e3


def navloom(folder: Path, *words: str, bound_mb: float = BOUND_MB) -> Outcome:
    """The command line in a child of its own."""
    said, told = folder / "stderr.txt", folder / "told.txt"
    child = os.fork()
    if not child:
        _run(words, said, told, bound_mb)
    _, status = os.waitpid(child, 0)
    assert told.exists(), f"ended by {status}: {said.read_text('utf-8', 'replace')[-500:]}"
    code, peak, seconds = told.read_text("ascii").split()
    return Outcome(int(code), said.read_text("utf-8", "replace"), float(peak), float(seconds))


def _run(words: tuple[str, ...], said: Path, told: Path, bound_mb: float) -> None:
    """Never returns."""
    code = -1
    try:
        signal.alarm(SECONDS)
        os.environ["NAVLOOM_MAX_INPUT_MB"] = str(bound_mb)
        sys.argv = ["navloom", *words]
        sys.stdout = io.StringIO()
        before = status_mb("VmRSS")
        Path("/proc/self/clear_refs").write_text("5", "ascii")  # the peak counts from here
        limit = round((status_mb("VmSize") + MEMORY_MB) * 1e6)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        began = time.process_time()
        with said.open("w", encoding="utf-8") as sys.stderr:
            try:
                main()
                code = 0
            except SystemExit as end:
                code = int(end.code or 0)
        spent = time.process_time() - began
        told.write_text(f"{code} {status_mb('VmHWM') - before} {spent}", "ascii")
    finally:
        os._exit(0)


@pytest.fixture(scope="module", autouse=True)
def warm(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Import what the commands import, so that children measure the file and not the imports."""
    import navloom.recording.ros_import
    import navloom.study.report_data
    import navloom.study.sweeps
    import rosbags.highlevel
    import yaml
    from PIL import PngImagePlugin

    assert navloom.recording.ros_import and navloom.study.report_data and navloom.study.sweeps
    assert rosbags.highlevel and yaml and PngImagePlugin


def refused(
    folder: Path, text: str, *words: str, bound_mb: float = BOUND_MB, peak_mb: float = 60.0, seconds: float = 3.0
) -> None:
    """A command that is refused in one line, at a cost."""
    found = navloom(folder, *words, bound_mb=bound_mb)
    lines = found.error.splitlines()
    assert lines and all(line.endswith(NOTICES) for line in lines[:-1]), found.error[-800:]
    assert re.search(text, lines[-1]), lines[-1][:800]
    assert found.code == 2 and len(lines[-1]) < 1000, lines[-1][:300]
    assert found.peak_mb < peak_mb and found.seconds < seconds, found


def npy(shape: str, kind: str = "<f8", version: int = 1, padding: int = 0) -> bytes:
    """The header of an array."""
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode() + b" " * padding + b"\n"
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H" if version == 1 else "<I", len(text)) + text


def npz(path: Path, members: dict[str, bytes], packing: int = zipfile.ZIP_DEFLATED) -> str:
    with zipfile.ZipFile(path, "w", packing, compresslevel=1) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return str(path)


def sweep(ranges: bytes) -> dict[str, bytes]:
    return {"ranges_m": ranges, "pitch_deg": npy("(2,)") + bytes(16), "beam_deg": npy("(2,)") + bytes(16)}


SWEEPS: dict[str, tuple[Callable[[], bytes], int, str]] = {
    "bomb": (lambda: npy(f"({ZEROS // 8},)") + bytes(ZEROS), 8, "100 MB, expected at most 4 MB; set NAVLOOM_MAX_"),
    "claimed": (lambda: npy("(1000000, 1000000, 1000)"), 8, "expected at most 4 MB"),
    "negative": (lambda: npy("(-1, 2)"), 8, "expected numbers"),
    "long header": (lambda: npy("(2,)", version=2, padding=ZEROS), 8, "no header of version 1.0"),
    "objects": (lambda: npy("(1,)", "|O") + b"cos\nsystem\n(S'ls'\ntR.", 8, "expected numbers"),
    "bzip2": (lambda: npy(f"({ZEROS // 8},)") + bytes(ZEROS), 12, "packed by method 12"),
}


@pytest.mark.parametrize("kind", SWEEPS)
def test_a_hostile_sweep_is_refused(tmp_path: Path, kind: str) -> None:
    content, packing, text = SWEEPS[kind]
    refused(tmp_path, text, "map", npz(tmp_path / "s.npz", sweep(content()), packing))


def test_an_archive_of_very_many_members_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.npz"
    entry = b"PK\x01\x02" + struct.pack("<HHHHHHIIIHHHHHII", 20, 20, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0) + b"a"
    count = 60_000
    path.write_bytes(entry * count + b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, count, count, 47 * count, 0, 0))
    refused(tmp_path, "more than 10000 arrays", "map", str(path))


CONFIGS = {
    "brackets": ("a = " + "[" * 5000 + "]" * 5000, r"line 1: more than 64 brackets deep"),
    "tables": ("a = " + "{a = " * 5000 + "1" + "}" * 5000, r"line 1: more than 64 brackets deep"),
    "key": (".".join("a" * 20_000) + " = 1", r"line 1: a key of more than 64 parts"),
    "header": ("[" + ".".join("a" * 20_000) + "]", r"line 1: a key of more than 64 parts"),
    "together": ("".join("{" + ".".join("a" * 60) + " = " for _ in range(60)).join(("a = ", "1" + "}" * 60)), "deep"),
    "large": ("#" * 5_000_000, r"5 MB, expected at most 4 MB; set NAVLOOM_MAX_INPUT_MB"),
    "long list": ("[run]\nperiod = [\n" + "1,\n" * 8_000 + "]\n", r"2: run.period: got \[1, 1"),
}


@pytest.mark.parametrize("kind", CONFIGS)
def test_a_hostile_config_is_refused(tmp_path: Path, kind: str) -> None:
    text, said = CONFIGS[kind]
    (tmp_path / "c.toml").write_text(text)
    refused(tmp_path, rf"c\.toml.*{said}", "config", "check", str(tmp_path / "c.toml"))


def test_a_config_of_very_many_faults_lists_the_first(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("".join(f"k{n} = 1\n" for n in range(3_000)))
    found = navloom(tmp_path, "config", "check", str(tmp_path / "c.toml"))
    assert found.code == 2 and "mend the first 50" in found.error and len(found.error.splitlines()) == 51
    assert found.seconds < 5.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("run.seed=" + "[" * 5000, "more than 64 brackets deep"),
        (".".join("a" * 20_000) + "=1", "a key of 20000 parts, expected at most 64"),
        ('"' + ".".join("a" * 20_000) + '"=1', "a key of 20000 parts, expected at most 64"),
    ],
)
def test_a_hostile_override_is_refused(tmp_path: Path, change: str, said: str) -> None:
    refused(tmp_path, f"--set .*{said}", "config", "check", "paper", "--set", change)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "folder.toml").mkdir()
    for name, said in (("pipe.toml", "is a pipe"), ("folder.toml", "Is a directory"), ("/dev/zero", "is a device")):
        path = str(tmp_path / name)
        refused(tmp_path, said, "config", "check", path)
        refused(tmp_path, said, "map", path)
        refused(tmp_path, said, "replay", path)
        refused(tmp_path, said, "run", "paper", "--set", f"world.ref=movingai:{path}")
        refused(tmp_path, said, "run", "paper", "--set", f"world.ref=toml:{path}")


def test_a_file_that_grows_is_read_up_to_the_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from navloom.inputs import bounds

    path = tmp_path / "log"
    path.write_bytes(b"x")
    grown = bounds.open_file

    def opened(path: Path, refusal: bounds.Refusal) -> io.BufferedReader:
        file = grown(path, refusal)
        monkeypatch.setattr(os, "fstat", lambda number: os.stat_result((0,) * 10))  # its size before it grew
        return file  # type: ignore[return-value]

    monkeypatch.setattr(bounds, "open_file", opened)
    path.write_bytes(bytes(3_000_000))
    with pytest.raises(ValueError, match="1 MB; set NAVLOOM_MAX_INPUT_MB"):
        bounds.read_file(path, 1.0, ValueError)


@pytest.mark.parametrize("given", ["much", "0", "-1", "nan", "1e300"])
def test_a_bound_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    from navloom.inputs.bounds import bytes_of

    monkeypatch.setenv("NAVLOOM_MAX_INPUT_MB", given)
    with pytest.raises(ValueError, match=f"NAVLOOM_MAX_INPUT_MB={given}: expected a number of MB > 0"):
        bytes_of(1.0, ValueError)


def test_the_bound_can_be_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from navloom.config import load_config

    path = tmp_path / "c.toml"
    path.write_text("#" * 17_000_000)
    with pytest.raises(ValueError, match="17 MB, expected at most 16 MB; set NAVLOOM_MAX_INPUT_MB"):
        load_config(str(path))
    monkeypatch.setenv("NAVLOOM_MAX_INPUT_MB", "20")
    load_config(str(path))


MAP_YAML = "{image: m.pgm, resolution: 0.1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.2}"


def laughs(levels: int, item: str) -> str:
    """Each level nine times the one before."""
    lines = [f"a0: &a0 {item}"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, levels)]
    return "\n".join([*lines, f"image: *a{levels - 1}", MAP_YAML[1:-1].replace(", ", "\n").partition("\n")[2]])


def merges(levels: int) -> str:
    lines = ["a0: &a0 {x: 1}"]
    lines += [f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 9)}]}}" for n in range(1, levels)]
    return "\n".join(lines)


YAMLS = {
    "laughs": (laughs(8, "[x, x, x, x, x, x, x, x, x]"), "alias 'a0'"),
    "merges": (merges(8), "alias 'a0'"),
    "deep": ("[" * 3000, "more than 64 levels deep"),
    "deep blocks": ("".join(" " * n + "a:\n" for n in range(500)), "more than 64 levels deep"),
    "large": ("#" * 5_000_000, "5 MB, expected at most 4 MB"),
}


@pytest.mark.parametrize("kind", YAMLS)
def test_a_hostile_map_description_is_refused(tmp_path: Path, kind: str) -> None:
    text, said = YAMLS[kind]
    (tmp_path / "m.yaml").write_text(text)
    refused(tmp_path, said, "run", "paper", "--set", f"world.ref=rosmap:{tmp_path / 'm.yaml'}")


def png(width: int, height: int, data: bytes) -> bytes:
    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data, 1)) + chunk(b"IEND", b"")


IMAGES: dict[str, tuple[Callable[[], bytes], str]] = {
    "white space": (lambda: b"P5" + b" " * 40 + b"x", "PGM header"),
    "claimed": (lambda: b"P5\n60000 60000\n255\n", "60000 x 60000 pixels, expected 1 to 64000000"),
    "claimed, plain": (lambda: b"P2\n8000 8000\n255\n1 2 3", "truncated: 3 pixels, expected 64000000"),
    "claimed png": (lambda: png(60000, 60000, b""), "60000 x 60000 pixels, expected 1 to 64000000"),
    "large": (lambda: b"P5\n2000 2500\n255\n" + bytes(5_000_000), "5.00002 MB, expected at most 4 MB"),
}


@pytest.mark.parametrize("kind", IMAGES)
def test_a_hostile_image_is_refused(tmp_path: Path, kind: str) -> None:
    content, said = IMAGES[kind]
    (tmp_path / "m.yaml").write_text(MAP_YAML)
    (tmp_path / "m.pgm").write_bytes(content())
    refused(tmp_path, said, "run", "paper", "--set", f"world.ref=rosmap:{tmp_path / 'm.yaml'}")


def test_an_image_of_many_pixels_takes_few_bytes_each(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(MAP_YAML.replace("0.2}", "-0.2}"))
    (tmp_path / "m.yaml").write_text(MAP_YAML)
    (tmp_path / "m.pgm").write_bytes(png(5000, 4000, bytes(5001 * 4000)))
    words = ("plan", str(tmp_path / "m.yaml"), "--start", "-1,-1", "--goal", "-2,-2")
    found = navloom(tmp_path, *words)
    assert found.code == 2, found.error  # outside the map, which is read by then
    assert found.peak_mb < 20 * 14, found  # 20 million pixels; they took 21 bytes each


MAP = b"type octile\nheight %d\nwidth 1\nmap\n"
GZIPPED: dict[str, tuple[Callable[[], bytes], str]] = {
    "bomb": (lambda: MAP % 2 + bytes(ZEROS), "unpacks to more than 4 MB"),
    "empty lines": (lambda: MAP % 2 + b"\n" * 3_900_000, "line 5: 0 cells, expected 1"),
    "claimed": (lambda: MAP % 64_000_000 + b".\n.\n", "truncated: 2 rows, expected 64000000"),
}


@pytest.mark.parametrize("kind", GZIPPED)
def test_a_hostile_benchmark_map_is_refused(tmp_path: Path, kind: str) -> None:
    content, said = GZIPPED[kind]
    path = tmp_path / "m.map.gz"
    path.write_bytes(gzip.compress(content(), 1))
    refused(tmp_path, said, "run", "paper", "--set", f"world.ref=movingai:{path}", peak_mb=40.0)


def test_a_world_of_very_many_cylinders_is_refused(tmp_path: Path) -> None:
    count = 150_000
    arrays = {"world": [1], "cyl_off": [0, count], "start": [0.0] * 3, "goal": [0.0] * 2, "goal_tol": 1.0}
    path = tmp_path / "w.npz"
    np.savez_compressed(path, cyl=np.ones((count, 3)), time_limit=9.0, **{k: np.array(v) for k, v in arrays.items()})
    said = "150000 cylinders of world 1, expected at most 100000"
    refused(tmp_path, said, "run", "paper", "--set", f"world.ref=barn:{path}#1")


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


def chunk(content: bytes, size: int, how: bytes = b"zstd") -> bytes:
    return record(6, struct.pack("<QQQI", 0, 1, size, 0) + text(how) + struct.pack("<Q", len(content)) + content)


@functools.cache
def head() -> bytes:
    """What a recording of the paper's run says of itself."""
    return header_of(load_config("paper"), "lockstep", {}).to_text().encode()


def mcap(*records: bytes, about: bytes = b"") -> bytes:
    values = text(b"header") + text(about or head())
    magic = b"\x89MCAP0\r\n"
    return b"".join([magic, record(0x0C, text(b"navloom") + text(values)), *records, magic])


RECORDINGS: dict[str, tuple[Callable[[], bytes], str]] = {
    "bomb": (lambda: mcap(chunk(zstandard.compress(bytes(4 * ZEROS)), 100)), "damaged: expected 100 bytes"),
    "large": (
        lambda: mcap(chunk(zstandard.compress(bytes(4 * ZEROS)), 4 * ZEROS)),
        "unpacks to 400 MB, expected at most 4 MB",
    ),
    "claimed": (lambda: mcap(chunk(b"", 2**63)), "expected at most 4 MB; set NAVLOOM_MAX_INPUT_MB"),
    "short message": (lambda: mcap(chunk(record(5, b"x"), 10, b"")), "a record is torn"),
    "torn": (lambda: mcap(chunk(struct.pack("<BQ", 5, 2**60), 9, b"")), "a record is torn"),
    "lz4": (lambda: mcap(chunk(b"x", 1, b"lz4")), "packed as 'lz4'; expected zstd"),
    "short chunk": (lambda: mcap(record(6, b"x")), "damaged"),
    "schema": (lambda: mcap(record(3, b"\1\0" + text(b"\xff"))), "damaged"),
    "metadata": (lambda: mcap(record(0x0C, text(b"m" * 5_000_000) + text(b""))), "metadata, schemas and channels of 5"),
    "deep head": (lambda: mcap(about=b"[" * 5000), "the head of the recording cannot be read.*64 brackets deep"),
}


@pytest.mark.parametrize("kind", RECORDINGS)
def test_a_hostile_recording_is_refused(tmp_path: Path, kind: str) -> None:
    content, said = RECORDINGS[kind]
    path = tmp_path / "r.mcap"
    path.write_bytes(content())
    refused(tmp_path, said, "replay", str(path), peak_mb=250.0, seconds=6.0)  # loading kernels takes 100 MB of it


def packed_bag(path: Path, ros: int) -> Path:
    """A good bag, but for a chunk that unpacks to 100 MB: odometry, a scan, its mount, and a long text beside them."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    bag = bags.Bag(path, ros)
    if ros == 1:
        bag.writer.set_compression(Writer1.CompressionFormat.LZ4)
    else:
        bag.writer = Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP)
        bag.writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with bag:
        bag.put("/tf_static", bag.transform("base_link", "laser", 0.2, 0.0, bags.START_NS), bags.START_NS)
        bag.put("/odom", bag.odometry(0.0, bags.START_NS), bags.START_NS)
        bag.put("/scan", bag.scan([1.0, 1.0], bags.START_NS), bags.START_NS)
        bag.put("/chatter", bag.type("std_msgs/msg/String")("x" * ZEROS), bags.START_NS)
    return path


@pytest.mark.parametrize("ros", [1, 2])
def test_a_bag_that_unpacks_to_more_than_the_bound_is_refused(tmp_path: Path, ros: int) -> None:
    bag, out = packed_bag(tmp_path / ("a.bag" if ros == 1 else "a"), ros), tmp_path / "o.mcap"
    refused(tmp_path, "at most 60 MB", "import", str(bag), "--out", str(out), bound_mb=60, peak_mb=90.0)
    assert not out.exists()
    assert navloom(tmp_path, "import", str(bag), "--out", str(out), bound_mb=2000).code == 0


BAG = """rosbag2_bagfile_information: {version: 5, storage_identifier: sqlite3, relative_file_paths: [a.db3%s],
  duration: {nanoseconds: 1}, starting_time: {nanoseconds_since_epoch: 1}, message_count: 1, %s
  topics_with_message_count: []}
"""


def test_a_bag_whose_file_unpacks_to_more_than_the_bound_is_refused(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text(BAG % (".zstd", "compression_mode: file, compression_format: zstd,"))
    (tmp_path / "a.db3.zstd").write_bytes(zstandard.compress(bytes(ZEROS)))
    refused(tmp_path, "unpacks to more than 4 MB", "import", str(tmp_path), "--out", str(tmp_path / "o.mcap"))


ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x"
TOPICS = "CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT)"


@pytest.mark.parametrize(
    "messages",
    [
        f"CREATE VIEW messages AS {ENDLESS} AS id, 1 AS topic_id, x AS timestamp, x AS data FROM n",
        "CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data AS (zeroblob(1000000000)))",
    ],
    ids=["view", "column"],
)
def test_a_bag_whose_tables_are_computed_is_refused(tmp_path: Path, messages: str) -> None:
    (tmp_path / "metadata.yaml").write_text(BAG % ("", ""))
    with sqlite3.connect(tmp_path / "a.db3") as database:
        database.execute(TOPICS)
        database.execute(messages)
    database.close()
    refused(tmp_path, "'messages' is computed, expected", "import", str(tmp_path), "--out", str(tmp_path / "o.mcap"))


def test_a_bag_described_with_aliases_is_refused(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text(laughs(8, "[x]"))
    refused(tmp_path, "alias 'a0'", "import", str(tmp_path), "--out", str(tmp_path / "o.mcap"))


def test_a_hostile_study_is_refused(tmp_path: Path) -> None:
    (tmp_path / "study.json").write_text("[" * 100_000)
    (tmp_path / "episodes.csv").write_text("method\n")
    refused(tmp_path, "study.json: damaged", "report", str(tmp_path))
    (tmp_path / "study.json").write_text(" " * 5_000_000)
    refused(tmp_path, "study.json: 5 MB, expected at most 4 MB", "report", str(tmp_path))


def test_a_hostile_list_of_identities_is_refused(tmp_path: Path) -> None:
    from navloom.runtime.access import AccessError, read_identities

    (tmp_path / "identities.json").write_text("[" * 100_000)
    with pytest.raises(AccessError, match=r"identities\.json: more than 64 brackets deep"):
        read_identities(tmp_path, "lab", "r1")
