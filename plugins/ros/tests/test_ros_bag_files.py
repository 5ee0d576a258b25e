"""Bags that were never closed, renamed or cut, or whose definitions cannot be read: nothing is lost silently."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
import ros_bags as bags
import zstandard
from mcap.writer import Writer as McapWriter
from navloom_recording.recording_header import RecordingError
from navloom_ros.bag_import import import_bag
from navloom_ros.bag_outcome import Imported
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

ALL = {"/odom": 40, "/scan": 40}


def room(folder: Path, storage: StoragePlugin = StoragePlugin.SQLITE3, is_compressed: bool = False) -> Path:
    """The drive through the room, 40 scans and 40 odometry messages, and a topic of another package."""
    with bags.Bag(folder / "room", 2) as bag:
        pass
    shutil.rmtree(folder / "room")
    bag = bags.Bag(folder / "room", 2)
    bag.writer = Writer2(folder / "room", version=9, storage_plugin=storage)
    if is_compressed:
        bag.writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    bag.store.register(bags.get_types_from_msg("int32 a", "my_msgs/msg/Odd"))
    with bag:
        bag.put("/tf_static", bag.transform("base_link", "laser", bags.MOUNT_X, bags.MOUNT_YAW, bags.START_NS),
                bags.START_NS)  # fmt: skip
        bag.put("/odd", bag.type("my_msgs/msg/Odd")(3), bags.START_NS)
        for x, stamp_ns in bags.times():
            bag.put("/odom", bag.odometry(x, stamp_ns), stamp_ns)
            bag.put("/scan", bag.scan(bags.ranges_at(x), stamp_ns), stamp_ns)
    return folder / "room"


def imported(bag: Path) -> Imported:
    return import_bag(bag, bag.with_name("a.mcap"))


def taken(found: Imported) -> dict[str, int]:
    return {topic.name: topic.messages for topic in found.topics if topic.sensor not in ("", "mounts")}


def data(bag: Path) -> Path:
    (path,) = (path for path in bag.iterdir() if path.suffix in (".db3", ".mcap"))
    return path


def into_wal(bag: Path) -> None:
    """Move the second half of a bag's messages to the write-ahead log, as if its recorder had been killed."""
    database = data(bag)
    with closing(sqlite3.connect(database)) as writer:
        writer.execute("PRAGMA journal_mode = WAL")
        writer.execute("PRAGMA wal_autocheckpoint = 0")
        rows = writer.execute("SELECT * FROM messages WHERE id > 40").fetchall()
        writer.execute("DELETE FROM messages WHERE id > 40")
        writer.commit()
        writer.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        writer.executemany(f"INSERT INTO messages VALUES ({', '.join('?' * len(rows[0]))})", rows)
        writer.commit()
        # Closing it would empty the log.
        kept = {end: database.with_name(database.name + end).read_bytes() for end in ("", "-wal")}
    for end, content in kept.items():
        database.with_name(database.name + end).write_bytes(content)


def test_messages_in_the_write_ahead_log_are_imported_and_the_bag_stays_as_it_is(tmp_path: Path) -> None:
    bag = room(tmp_path)
    into_wal(bag)
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    assert taken(imported(bag)) == ALL
    assert {path.name: path.read_bytes() for path in bag.iterdir()} == before


def test_messages_that_the_description_counts_and_the_bag_lacks_are_noted(tmp_path: Path) -> None:
    bag = room(tmp_path)
    with closing(sqlite3.connect(data(bag))) as database, database:
        database.execute("DELETE FROM messages WHERE id > 42")  # of 82, of which 2 are neither scan nor odometry
    assert imported(bag).notes == [f"{name}: the bag counts 40 messages, and has 20" for name in ALL]


@pytest.mark.parametrize(
    ("encoding", "text"),
    [("unknown", ""), ("", ""), ("ros2msg", "wstring w"), ("ros2msg", "other_msgs/Thing t"), ("ros2msg", ""),
     ("ros2idl", "IDL: nonsense {")],
)  # fmt: skip
def test_a_definition_that_cannot_be_read_costs_only_its_own_topic(tmp_path: Path, encoding: str, text: str) -> None:
    bag = room(tmp_path)
    with closing(sqlite3.connect(data(bag))) as database, database:
        database.execute(
            "UPDATE message_definitions SET encoding = ?, encoded_message_definition = ? WHERE topic_type LIKE '%Odd'",
            (encoding, text),
        )
    found = imported(bag)
    assert taken(found) == ALL
    assert [dict(topic.skipped) for topic in found.topics if topic.name == "/odd"] == [{"not a type that is read": 1}]


@pytest.mark.parametrize("encoding", ["jsonschema", "protobuf", "unknown", "ros1msg"])
def test_a_schema_of_another_kind_in_an_mcap_file_costs_only_its_own_topic(tmp_path: Path, encoding: str) -> None:
    from mcap.reader import make_reader

    source, target = data(room(tmp_path, StoragePlugin.MCAP)), tmp_path / "odd.mcap"
    with source.open("rb") as file, target.open("wb") as out:
        writer = McapWriter(out)
        writer.start("ros2", "test")
        for schema, channel, message in make_reader(file).iter_messages():
            is_odd = channel.topic == "/odd"
            number = writer.register_schema(
                schema.name, encoding if is_odd else schema.encoding, b"\xff" if is_odd else schema.data
            )
            way = writer.register_channel(channel.topic, channel.message_encoding, number, channel.metadata)
            writer.add_message(way, message.log_time, message.data, message.publish_time)
        writer.finish()
    found = imported(target)
    assert taken(found) == ALL and [topic.type for topic in found.topics if topic.name == "/odd"] == ["my_msgs/msg/Odd"]


def unnamed(bag: Path) -> Path:
    (bag / "metadata.yaml").unlink()
    return bag


def renamed(bag: Path) -> Path:
    data(bag).rename(bag / "my drive.db3")
    return bag


def described(change: Callable[[str], str]) -> Callable[[Path], Path]:
    def changed(bag: Path) -> Path:
        path = bag / "metadata.yaml"
        path.write_text(change(path.read_text("utf-8")), "utf-8")
        return bag

    return changed


COMPRESSED: dict[str, Callable[[Path], Path]] = {
    "as rosbag2 writes it": described(
        lambda text: text.replace("compression_mode: message", "compression_mode: MESSAGE")
    ),
    "not described": described(lambda text: text.replace("compression_mode: message", 'compression_mode: ""')),
    "described as a file": described(lambda text: text.replace("compression_mode: message", "compression_mode: file")),
    "without metadata.yaml": lambda bag: unnamed(bag),
    "the data file alone": lambda bag: data(unnamed(bag)),
}


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("change", COMPRESSED)
def test_messages_that_are_compressed_one_by_one_are_read_with_and_without_a_description(
    tmp_path: Path, storage: StoragePlugin, change: str
) -> None:
    bag = COMPRESSED[change](room(tmp_path, storage, is_compressed=True))
    assert taken(imported(bag)) == ALL


def test_a_compressed_message_that_is_cut_is_damage_and_the_bag_is_named(tmp_path: Path) -> None:
    bag = room(tmp_path, is_compressed=True)
    with closing(sqlite3.connect(data(bag))) as database, database:
        database.execute("UPDATE messages SET data = substr(data, 1, 20) WHERE id = 50")
    with pytest.raises(RecordingError, match=r"/room: damaged: a compressed message is cut; copy the bag again"):
        imported(bag)


def without_storage(bag: Path) -> Path:
    described = bag / "metadata.yaml"
    described.write_text(described.read_text("utf-8").replace("storage_identifier: sqlite3", 'storage_identifier: ""'))
    return bag


def packed_alone(bag: Path) -> Path:
    path = bag.with_name("drive.db3.zstd")
    path.write_bytes(zstandard.ZstdCompressor().compress(data(bag).read_bytes()))
    return path


@pytest.mark.parametrize("change", [unnamed, renamed, without_storage, packed_alone])
def test_a_bag_without_its_description_or_with_a_wrong_one_is_read_whole(
    tmp_path: Path, change: Callable[[Path], Path]
) -> None:
    assert taken(imported(change(room(tmp_path)))) == ALL


def test_a_part_that_is_missing_is_noted(tmp_path: Path) -> None:
    bag = room(tmp_path)
    described = bag / "metadata.yaml"
    described.write_text(described.read_text("utf-8").replace("- room.db3", "- room.db3\n  - room_1.db3", 1))
    assert imported(bag).notes[0] == "room_1.db3 is missing: what it holds is lost; copy the bag again"


def test_an_mcap_file_of_a_recorder_that_was_killed_is_read_up_to_its_end(tmp_path: Path) -> None:
    path = data(room(tmp_path, StoragePlugin.MCAP))
    cut = tmp_path / "cut.mcap"
    with path.open("rb") as file, cut.open("wb") as out:
        from mcap.reader import make_reader
        from mcap.writer import CompressionType

        writer = McapWriter(out, chunk_size=4000, compression=CompressionType.NONE)
        writer.start("ros2", "test")
        for schema, channel, message in make_reader(file).iter_messages():
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            way = writer.register_channel(channel.topic, channel.message_encoding, number, channel.metadata)
            writer.add_message(way, message.log_time, message.data, message.publish_time)
        writer.finish()
    raw = cut.read_bytes()
    cut.write_bytes(raw[: len(raw) // 2])
    found = imported(cut)
    assert 15 < taken(found)["/scan"] < 40 and "cut.mcap cannot be opened" in found.notes[0]


def test_a_ros_1_bag_of_a_recorder_that_was_killed_is_read_up_to_its_end(tmp_path: Path) -> None:
    whole = bags.room_bag(tmp_path / "room.bag", 1)
    raw = whole.read_bytes()
    index = raw.index(b"index_pos=") + 10
    cut = tmp_path / "drive.bag.active"
    cut.write_bytes(raw[:index] + bytes(8) + raw[index + 8 : len(raw) * 98 // 100])
    found = imported(cut)
    assert taken(found) == ALL and "drive.bag.active cannot be opened" in found.notes[0]


def test_the_header_of_early_ros_1_is_that_of_today(tmp_path: Path) -> None:
    raw = bags.room_bag(tmp_path / "room.bag", 1).read_bytes()
    old = raw.replace(b"MSG: std_msgs/Header", b"MSG: roslib/Header  ")
    assert old != raw
    (tmp_path / "old.bag").write_bytes(old)
    assert taken(imported(tmp_path / "old.bag")) == ALL


def _fields(header: bytes) -> dict[bytes, bytes]:
    found, at = {}, 0
    while at < len(header):
        (size,) = struct.unpack_from("<I", header, at)
        name, _, value = header[at + 4 : at + 4 + size].partition(b"=")
        found[name], at = value, at + 4 + size
    return found


def with_index(raw: bytes, version: int, gap: int) -> bytes:
    """A ROS 1 bag whose index records have a version, and entries with `gap` more bytes after their 8 bytes of time."""
    start, moved = raw.index(b"\n") + 1, {}
    out, at = bytearray(raw[:start]), start
    while at < len(raw):
        (size,) = struct.unpack_from("<I", raw, at)
        (length,) = struct.unpack_from("<I", raw, at + 4 + size)
        fields, data = _fields(raw[at + 4 : at + 4 + size]), raw[at + 8 + size : at + 8 + size + length]
        moved[at], at = len(out), at + 8 + size + length
        if fields[b"op"] == b"\x04":
            fields[b"ver"] = struct.pack("<I", version)
            data = b"".join(data[n : n + 8] + bytes(gap) + data[n + 8 : n + 12] for n in range(0, len(data), 12))
        elif fields[b"op"] == b"\x06":
            fields[b"chunk_pos"] = struct.pack("<Q", moved[struct.unpack("<Q", fields[b"chunk_pos"])[0]])
        parts = (name + b"=" + value for name, value in fields.items())
        header = b"".join(struct.pack("<I", len(part)) + part for part in parts)
        out += struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data
    index = raw.index(b"index_pos=") + 10
    out[index : index + 8] = struct.pack("<Q", moved[struct.unpack_from("<Q", raw, index)[0]])
    return bytes(out)


@pytest.mark.parametrize("version, gap", [(1, 8), (0, 8), (0, 4), (2, 8), (0, 0)])
def test_the_index_of_an_early_ros_1_bag_is_not_needed(tmp_path: Path, version: int, gap: int) -> None:
    raw = bags.room_bag(tmp_path / "room.bag", 1).read_bytes()
    old = raw.replace(b"MSG: std_msgs/Header", b"MSG: roslib/Header  ")
    (tmp_path / "old.bag").write_bytes(with_index(old, version, gap))
    found = imported(tmp_path / "old.bag")
    why = f"IDXDATA version {version} is not supported" if version != 1 else "its index cannot be read"
    assert taken(found) == ALL and found.notes[0].startswith(f"old.bag cannot be opened ({why})")


def test_a_bag_before_the_format_2_is_refused_with_a_way_out(tmp_path: Path) -> None:
    path = tmp_path / "old.bag"
    path.write_bytes(b"#ROSRECORD V1.2\n" + bytes(40))
    with pytest.raises(RecordingError, match=r"format before V2\.0; rewrite it with ROS 1.s `rosbag fix`"):
        imported(path)


@pytest.mark.parametrize("is_stamped", [False, True])
def test_a_recorded_command_is_listed_with_the_reason_why_it_is_not_taken(tmp_path: Path, is_stamped: bool) -> None:
    with bags.Bag(tmp_path / "drive", 2) as bag:
        vector = bag.type("geometry_msgs/msg/Vector3")
        twist = bag.type("geometry_msgs/msg/Twist")(vector(0.5, 0.0, 0.0), vector(0.0, 0.0, 0.0))
        bag.put("/tf_static", bag.transform("base_link", "laser", 0.2, 0.0, bags.START_NS), bags.START_NS)
        for x, stamp_ns in bags.times():
            bag.put("/odom", bag.odometry(x, stamp_ns), stamp_ns)
            bag.put("/scan", bag.scan(bags.ranges_at(x), stamp_ns), stamp_ns)
            stamped = bag.type("geometry_msgs/msg/TwistStamped")(bag.header("base_link", stamp_ns), twist)
            bag.put("/cmd_vel", stamped if is_stamped else twist, stamp_ns)
    (command,) = (topic for topic in imported(tmp_path / "drive").topics if topic.name == "/cmd_vel")
    why = "a command: replays compare with the velocities that were driven, those of the odometry"
    assert (command.sensor, dict(command.skipped)) == ("", {why: 40})
