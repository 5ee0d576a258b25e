"""Hostile recordings, ROS bags and studies are refused in one line, with exit code 2 and little memory and time."""

from __future__ import annotations

import functools
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
import ros_bags as bags
import zstandard
from hostile_rig import ZEROS, merges, navloom, refused
from navloom.config import load_config
from navloom_recording.recording_header import header_of


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


def chunk(content: bytes, size: int, how: bytes = b"zstd") -> bytes:
    return record(6, struct.pack("<QQQI", 0, 1, size, 0) + text(how) + struct.pack("<Q", len(content)) + content)


@functools.cache
def head() -> bytes:
    """The header of a recording of the paper's run, as JSON."""
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
    refused(tmp_path, said, "replay", str(path), peak_mb=250.0, seconds=6.0)  # loading kernels takes 100 MB of that


def packed_bag(path: Path, ros: int) -> Path:
    """A valid bag with odometry, a scan, its mount, and a text that makes its chunk unpack to 100 MB."""
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
    refused(tmp_path, "at most 60 MB", "ros", "import", str(bag), "--out", str(out), bound_mb=60, peak_mb=90.0)
    assert not out.exists()
    assert navloom(tmp_path, "ros", "import", str(bag), "--out", str(out), bound_mb=2000).code == 0


BAG = """rosbag2_bagfile_information: {version: 5, storage_identifier: sqlite3, relative_file_paths: [a.db3%s],
  duration: {nanoseconds: 1}, starting_time: {nanoseconds_since_epoch: 1}, message_count: 1, %s
  topics_with_message_count: []}
"""


def test_a_bag_whose_file_unpacks_to_more_than_the_bound_is_refused(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text(BAG % (".zstd", "compression_mode: file, compression_format: zstd,"))
    (tmp_path / "a.db3.zstd").write_bytes(zstandard.compress(bytes(ZEROS)))
    refused(tmp_path, "unpacks to more than 4 MB", "ros", "import", str(tmp_path), "--out", str(tmp_path / "o.mcap"))


ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x AS id, 1 AS topic_id,"
COMPUTED = {
    "view": f"CREATE VIEW messages AS {ENDLESS} x AS timestamp, x AS data FROM n",
    "column": "CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data AS (zeroblob(1000000000)))",
}


def computed_bag(path: Path, kind: str) -> Path:
    """A valid bag but for its table of messages, which is computed."""
    bag = bags.room_bag(path, 2)
    database = sqlite3.connect(next(bag.glob("*.db3")))
    database.executescript(f"DROP TABLE messages; {COMPUTED[kind]};")
    if kind == "column":
        database.execute("INSERT INTO messages SELECT 1, id, 1 FROM topics")
    database.commit()
    database.close()
    return bag


@pytest.mark.parametrize("kind", COMPUTED)
def test_a_bag_whose_tables_are_computed_is_refused(tmp_path: Path, kind: str) -> None:
    bag = computed_bag(tmp_path / "bag", kind)
    refused(tmp_path, "'messages' is computed, expected", "ros", "import", str(bag), "--out", str(tmp_path / "o.mcap"))


def test_a_bag_described_with_aliases_is_refused(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text(merges(8))
    refused(tmp_path, "alias 'a0'", "ros", "import", str(tmp_path), "--out", str(tmp_path / "o.mcap"))


def test_a_hostile_study_is_refused(tmp_path: Path) -> None:
    (tmp_path / "study.json").write_text("[" * 100_000)
    (tmp_path / "episodes.csv").write_text("method\n")
    refused(tmp_path, "study.json: damaged", "report", str(tmp_path))
    (tmp_path / "study.json").write_text(" " * 5_000_000)
    refused(tmp_path, "study.json: 5 MB, expected at most 4 MB", "report", str(tmp_path))


def test_a_hostile_list_of_identities_is_refused(tmp_path: Path) -> None:
    from navloom_live.transport.access import AccessError, read_identities

    (tmp_path / "identities.json").write_text("[" * 100_000)
    with pytest.raises(AccessError, match=r"identities\.json: more than 64 brackets deep"):
        read_identities(tmp_path, "lab", "r1")
