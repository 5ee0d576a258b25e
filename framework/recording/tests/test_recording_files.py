"""Recording files: their contents, those left by a killed recorder or a full disk, and refusals."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest
from mcap.reader import make_reader
from navloom.config import load_config
from navloom.messages import Envelope, Odometry, Pose2D, Twist2D
from navloom.messages.codec import CodecError, encode, read_envelope, schema_label
from navloom_recording.reader import Recording
from navloom_recording.recorder_counts import RecorderCounts
from navloom_recording.recording_header import RecordingError, RecordingHeader, header_of
from navloom_recording.writer import RecordingWriter, WriteError

KEY = "lab/r1/platform/main/odometry"
HEADER = RecordingHeader("lab", "r1", "live", 0.05, 7, "wall")
LABEL = schema_label(Odometry)


def message(number: int) -> tuple[Odometry, Envelope]:
    stamp_ns = number * 50_000_000
    odometry = Odometry(stamp_ns, Pose2D(0.01 * number, 0.0, 0.0), Twist2D(0.2, 0.0, 0.0))
    return odometry, Envelope(KEY, number + 1, number, stamp_ns, stamp_ns, 0)


def add(writer: RecordingWriter, number: int) -> None:
    odometry, at = message(number)
    writer.add(KEY, LABEL, encode(odometry, at), 1000 + number, at.stamp_ns, at.sequence)


def written(path: Path, count: int = 100, every: int = 10) -> Path:
    """A closed recording of `count` messages in chunks of `every`."""
    with RecordingWriter(path, HEADER, {"world/w.toml": b"bounds = 1"}) as writer:
        for number in range(count):
            add(writer, number)
            if number % every == every - 1:
                writer.flush()
        writer.close({"messages": count, "dropped": {KEY: 3}})
    return path


def test_a_recording_is_read_as_it_was_written(tmp_path: Path) -> None:
    recording = Recording(written(tmp_path / "a.mcap"))
    found = list(recording.messages())
    assert recording.is_complete and recording.note == "" and recording.header == HEADER
    assert [one.message for one in found] == [message(number)[0] for number in range(100)]
    assert [one.envelope for one in found] == [message(number)[1] for number in range(100)]
    assert [one.received_ns for one in found] == list(range(1000, 1100))
    assert recording.attachments() == ["world/w.toml"] and recording.attachment("world/w.toml") == b"bounds = 1"
    assert recording.attachment("other") is None
    assert recording.counts() == {"messages": 100, "dropped": {KEY: 3}} and recording.span_ns() == (1000, 1099)


@pytest.mark.parametrize(
    ("keys", "since", "until", "count"),
    [
        (None, 1010, 1020, 10),
        (["platform/*/odo*"], None, 1005, 5),
        (["lab/r1/*"], 1095, None, 5),
        (["gate/*"], 0, 2000, 0),
    ],
)
def test_messages_are_selected_by_key_and_time(
    tmp_path: Path, keys: list[str] | None, since: int, until: int, count: int
) -> None:
    assert len(list(Recording(written(tmp_path / "a.mcap")).messages(keys, since, until))) == count


def test_other_tools_read_the_file_and_the_file_explains_itself(tmp_path: Path) -> None:
    with written(tmp_path / "a.mcap").open("rb") as file:
        found = list(make_reader(file, validate_crcs=True).iter_messages(topics=[KEY]))
    schema, channel, first = found[0]
    assert len(found) == 100 and channel.message_encoding == "navloom" and schema is not None
    assert (first.log_time, first.publish_time, first.sequence) == (1000, 0, 1)
    assert schema.name == "navloom.Odometry/1" and schema.encoding == "jsonschema"
    described = json.loads(schema.data)
    assert described["$defs"]["navloom.Odometry"]["properties"]["pose"]["$ref"] == "#/$defs/navloom.Pose2D"
    assert "Run clock of the measurement" in described["$defs"]["navloom.Odometry"]["description"]
    assert "MessagePack" in described["description"]


@pytest.mark.parametrize("left", [0.999, 0.9, 0.61, 0.37, 0.2])
def test_a_file_cut_anywhere_opens_and_holds_every_whole_chunk(tmp_path: Path, left: float) -> None:
    whole = written(tmp_path / "a.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(len(whole) * left)])
    recording = Recording(cut)
    found = list(recording.messages())
    assert not recording.is_complete and "the recorder did not close it" in recording.note
    assert len(found) % 10 == 0 and [one.message for one in found] == [message(n)[0] for n in range(len(found))]
    assert recording.keys() == ([KEY] if found else [])


def test_a_file_cut_in_its_last_chunk_loses_that_chunk_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path, HEADER)
    sizes = []
    for number in range(30):
        add(writer, number)
        if number % 10 == 9:
            writer.flush()
            sizes.append(writer.size)
    with path.open("r+b") as file:
        file.truncate(sizes[1] + (sizes[2] - sizes[1]) // 4)
    recording = Recording(path)
    assert len(list(recording.messages())) == 20 and "bytes are torn" in recording.note


def test_counters_are_read_from_a_file_that_was_not_closed(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", HEADER)
    add(writer, 0)
    writer.add_counts({"messages": 1, "dropped": {}}, 5)
    writer.add_counts({"messages": 2, "dropped": {KEY: 1}}, 6)
    writer.flush()
    recording = Recording(tmp_path / "a.mcap")
    assert recording.counts() == {"messages": 2, "dropped": {KEY: 1}} and recording.keys() == [KEY]


def test_a_full_disk_leaves_whole_chunks_and_one_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path, HEADER)
    for number in range(10):
        add(writer, number)
    writer.flush()
    whole = writer.size
    write = os.write

    def full(descriptor: int, data: memoryview) -> int:
        if len(data) > 20:
            return write(descriptor, data[:20])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "write", full)
    add(writer, 10)
    with pytest.raises(WriteError, match=r"a\.mcap: No space left on device; .* \d+ bytes that can be read"):
        writer.flush()
    with pytest.raises(WriteError, match="it was closed"):
        add(writer, 11)
    monkeypatch.undo()
    assert writer.messages == 10 and path.stat().st_size == whole and len(list(Recording(path).messages())) == 10


def test_an_existing_file_is_not_written_over(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match="there is such a file already"):
        RecordingWriter(path, HEADER)
    assert Recording(path).is_complete


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    (tmp_path / "text").write_text("hello world")
    (tmp_path / "other.mcap").write_bytes(b"\x89MCAP0\r\n")
    for name, why in (
        ("empty", "not a recording"), ("text", "not a recording"), ("none", "cannot be read: No such file"),
        ("other.mcap", "without navloom's head"),
    ):  # fmt: skip
        with pytest.raises(RecordingError, match=why):
            Recording(tmp_path / name)


def test_a_message_of_an_unknown_kind_is_counted_and_skipped(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap", HEADER) as writer:
        add(writer, 0)
        writer.add(f"{KEY}2", "strange.Thing/1", b"\x01\x00\x00\x00\x80", 1, 1, 1)
        add(writer, 1)
    recording = Recording(tmp_path / "a.mcap")
    assert len(list(recording.messages())) == 2 and recording.malformed == 1
    assert "strange.Thing/1" in recording.complaint


def test_the_header_has_the_whole_config_and_ignores_unknown_keys() -> None:
    header = header_of(load_config("paper", ["run.seed=11"]), "lockstep", {"navloom-vff": "1.0"})
    again = RecordingHeader.from_text(header.to_text())
    assert again == header and again.loaded().config == load_config("paper", ["run.seed=11"]).config
    assert (again.seed, again.clock, again.versions["navloom-vff"]) == (11, "run", "1.0")
    assert RecordingHeader.from_text(json.dumps({**json.loads(header.to_text()), "later": 1})) == header
    for text in ("[]", "{}", "nothing"):
        with pytest.raises(RecordingError, match="the head of the recording cannot be read"):
            RecordingHeader.from_text(text)
    with pytest.raises(RecordingError, match="holds no config"):
        HEADER.loaded()


def test_gaps_in_a_sequence_are_losses_and_a_fall_is_a_restarted_publisher() -> None:
    counts = RecorderCounts()
    for sequence in (5, 6, 9, 10, 1, 2, 4):
        counts.note(KEY, sequence)
    assert counts.messages == 7 and counts.lost == {KEY: 3} and counts.missed() == 3
    assert counts.has(KEY, 4) and not counts.has(KEY, 5)


def test_an_envelope_is_read_without_its_message() -> None:
    odometry, at = message(3)
    assert read_envelope(encode(odometry, at)) == at
    for data in (b"", b"\x00\x00\x00\x00", b"\xff\xff\xff\xff", b"\x01\x00\x00\x00\xc0"):
        with pytest.raises(CodecError):
            read_envelope(data)
