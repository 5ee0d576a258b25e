"""Messages of distributions in tools and recordings: loaded when one arrives, shown generically if unknown."""

from __future__ import annotations

import json
import pickle
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgpack
import pytest
from described import described
from navloom.logs import Level, set_up_logging
from navloom.messages import SCHEMAS, Envelope, Message, Odometry
from navloom.messages.codec import CodecError, UnknownSchema, decode, encode, schema_label
from navloom.messages.generic import GenericMessage, decode_generic
from navloom.plugins import Discovery, PluginError
from navloom.plugins.message_opening import OPENER, Opener
from navloom_live.cli.echo import _messages, _text
from navloom_live.live.description import Description
from navloom_live.live.mailbox import Packet
from navloom_live.operating.introspection import envelope_fields, message_fields
from navloom_live.operating.republishing import republish
from navloom_live.operating.robot_lookup import join
from navloom_live.operating.stream_measurement import StreamMeter
from navloom_live.transport.keyspace import KeySpace
from navloom_recording.reader import Recording
from navloom_recording.recording_header import RecordingHeader
from navloom_recording.writer import RecordingWriter

Install = Callable[..., None]
InProcess = Callable[..., tuple[int, str, str]]

TRACKS = '''
from typing import Annotated

import numpy as np
from navloom import Array, Message, Point2D, hookimpl, message

@message(version=VERSION)
class Tracks(Message):
    """People around the robot.

    Attributes:
        stamp_ns: Run clock of the scan.
        places: (n, 2) where they are, m, map frame.
        first: The nearest,
            m.
        names: Of those that are known.
    """

    stamp_ns: int
    places: Annotated[np.ndarray, Array("float64", ("n", 2))]
    first: Point2D | None
    names: tuple[str, ...] = ()

def made():
    return Tracks(7, np.array([[1.0, 2.0], [3.0, 4.0]]), Point2D(1.0, 2.0), ("Ann",))

@hookimpl
def navloom_register(registry):
    registry.message(Tracks)
'''
KEY = "lab/r1/people/main/tracks"
AT = Envelope(KEY, 1, 2, 30, 30, 0)
MISSING = (
    "messages of fake_people are not installed here (fake_people.Tracks/1 came): pip install fake-people, "
    "or --plugin fake_people.py"
)


def tracks(version: int = 1) -> str:
    return TRACKS.replace("VERSION", str(version))


def sent_by(module: str) -> tuple[bytes, str]:
    """Bytes from another process that has the distribution; this process has not loaded it."""
    message: Message = __import__(module).made()
    sent = encode(message, AT), schema_label(type(message))
    del sys.modules[module], SCHEMAS[type(message).schema_name]
    return sent


@pytest.fixture(autouse=True)
def _fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Resets what this process has discovered, as in a new process."""
    set_up_logging(Level.INFO, as_json=False)
    monkeypatch.setattr(OPENER, "_why", {})
    monkeypatch.setattr(OPENER, "_discovery", None)
    monkeypatch.setattr(OPENER, "_blocked", frozenset())


@pytest.fixture
def missing(install: Install, tmp_path: Path) -> tuple[bytes, str]:
    """A message of a distribution that is not installed here."""
    install("fake_people", tracks(), ["message.Tracks"])
    sent = sent_by("fake_people")
    for path in (tmp_path / "site").iterdir():
        if path.is_dir():
            (path / "entry_points.txt").unlink(missing_ok=True)
    return sent


def test_two_distributions_have_a_message_of_one_name(install: Install) -> None:
    for module in ("fake_people", "fake_cars"):
        install(module, tracks(), ["message.Tracks"])
    install("fake_bomb", "raise RuntimeError('imported')", ["message.Tracks", "message.Other", "avoider.bomb"])
    sent = [sent_by(module) for module in ("fake_people", "fake_cars")]
    assert [label for _, label in sent] == ["fake_people.Tracks/1", "fake_cars.Tracks/1"]
    assert Discovery().names("message") == [f"fake_{name}" for name in ("bomb.Other", "bomb.Tracks", "cars.Tracks",
                                                                        "people.Tracks")]  # fmt: skip
    assert not Discovery().problems()
    people, cars = (Opener().open(*one)[0] for one in sent)
    assert type(people) is sys.modules["fake_people"].Tracks and type(cars) is sys.modules["fake_cars"].Tracks
    assert people.places.tolist() == [[1.0, 2.0], [3.0, 4.0]] and "fake_bomb" not in sys.modules


def test_a_command_asks_which_of_two_messages_of_one_name_is_meant(install: Install, in_process: InProcess) -> None:
    for module in ("fake_people", "fake_cars"):
        install(module, tracks(), ["message.Tracks"])
    code, _, err = in_process("check", "message.Tracks")
    there = "there are message.fake_cars.Tracks and message.fake_people.Tracks; name one of them in full"
    assert (code, err) == (2, f"navloom: message.Tracks: {there}\n")
    code, _, err = in_process("plugins", "message.Tracks")
    hint = "a message has no parameters; `navloom messages Tracks` lists its fields"
    assert (code, err) == (2, f"navloom: message.Tracks: {hint}\n")


def test_nodes_load_no_distribution_for_a_received_label(install: Install) -> None:
    install("fake_people", tracks(), ["message.Tracks"])
    data, label = sent_by("fake_people")
    with pytest.raises(UnknownSchema, match=r"schema 'fake_people\.Tracks/1' is unknown here"):
        decode(data, label)
    assert Packet(data, label).try_open() is None and "fake_people" not in sys.modules


def test_a_message_that_is_not_installed_here_is_shown_from_its_header(missing: tuple[bytes, str]) -> None:
    message, envelope = Opener().open(*missing)
    assert isinstance(message, GenericMessage) and envelope == AT and message.why == MISSING
    assert dict(message.fields) == {
        "stamp_ns": 7, "places": 0, "first": {"x": 1.0, "y": 2.0}, "names": ("Ann",)
    }  # fmt: skip
    assert [array.tolist() for array in message.arrays] == [[[1.0, 2.0], [3.0, 4.0]]]
    with pytest.raises(AttributeError, match="cannot be changed"):
        message.label = "other"
    with pytest.raises(TypeError):
        message.fields["stamp_ns"] = 8  # type: ignore[index]
    with pytest.raises(ValueError, match="read-only"):
        message.arrays[0][0, 0] = 9.0
    again = pickle.loads(pickle.dumps(message))
    assert (again.label, again.fields, again.why) == (message.label, message.fields, message.why)
    with pytest.raises(UnknownSchema, match="pip install fake-people"):
        Opener().decode(*missing)


def header_of(fields: Any, arrays: Any = ()) -> bytes:
    header = msgpack.packb({"envelope": list(AT), "fields": fields, "arrays": list(arrays)})
    return len(header).to_bytes(4, "little") + header


def nested(depth: int) -> list[Any]:
    value: list[Any] = []
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "got 0 bytes"),
        (b"\xff\xff\xff\xff", "got 4 bytes, expected a header that fits"),
        (header_of(3), "fields is int, expected a map"),
        (header_of({}, [["<f8", [1 << 40], 0]]), "expected it at a multiple of 64"),
        (header_of({}, [["|O", [1], 0]]), "expected dtype, shape and offset"),
        (header_of({"a": nested(40)}), "nested deeper than 16"),
        (header_of({str(n): [0] * 4000 for n in range(10)}), "fields holds more than 32768 values"),
        (header_of({"a": [0] * 5000}), "not MessagePack of a message"),
        (header_of({str(n): 0 for n in range(300)}), "not MessagePack of a message"),
        (header_of({"a": b"raw"}), "not MessagePack of a message"),
        (header_of({1: 2}), "not MessagePack of a message"),
        (header_of({"a": ["x" * 200] * 1500}), "the header takes .* bytes, expected at most 262144"),
    ],
)
def test_bytes_that_are_no_message_of_any_class_are_refused(data: bytes, text: str) -> None:
    with pytest.raises(CodecError, match=text):
        decode_generic(data, "fake_people.Tracks/1")


def test_another_version_is_shown_generically_with_a_note_of_both_versions(install: Install) -> None:
    install("fake_people", tracks(2), ["message.Tracks"], "0.9")
    data, label = sent_by("fake_people")
    assert label == "fake_people.Tracks/2"
    __import__("fake_people")
    told = "message fake_people.Tracks: version 1 was sent, fake-people 0.9 here has version 2; update the older side"
    message, _ = Opener().open(data, "fake_people.Tracks/1")
    assert isinstance(message, GenericMessage) and message.why == told
    with pytest.raises(UnknownSchema) as refused:
        Opener().decode(data, "fake_people.Tracks/1")
    assert str(refused.value) == told
    assert type(Opener().open(data, label)[0]) is sys.modules["fake_people"].Tracks


def test_a_broken_distribution_gives_one_line_and_its_messages_are_shown(install: Install) -> None:
    install("fake_people", tracks(), ["message.Tracks"])
    data, label = sent_by("fake_people")
    module = Path(sys.path[0]) / "fake_people.py"
    module.write_text("raise SystemExit('no licence')\n", "utf-8")
    sys.path_importer_cache.clear()
    opener = Opener()
    for _ in range(2):
        message, _ = opener.open(data, label)
        assert isinstance(message, GenericMessage)
        assert message.why.startswith("message fake_people.Tracks: plugin 'message.Tracks' from fake_people fails on")
        assert "SystemExit: no licence (fake_people.py:1)" in message.why and "\n" not in message.why


@pytest.mark.parametrize("name", ["message.Tracks", "message.fake_people.Tracks"])
def test_a_blocked_message_is_not_loaded(install: Install, name: str) -> None:
    install("fake_people", tracks(), ["message.Tracks", "metric.people"])
    data, label = sent_by("fake_people")
    opener = Opener()
    opener.block([name])
    message, _ = opener.open(data, label)
    assert isinstance(message, GenericMessage) and "fake_people" not in sys.modules
    told = "is not declared by fake-people 1.0, which is installed here: update it, or unblock it"
    assert message.why == f"message fake_people.Tracks {told}"
    assert Discovery([name]).names("message") == []


@pytest.mark.parametrize(
    "label", ["navloom.Nothing/1", "navloom.Odometry/2", "nothing", "a.b.c/1", "a.B/0", "a.B/x", ""]
)
def test_a_label_of_no_distribution_is_refused(label: str, missing: tuple[bytes, str]) -> None:
    with pytest.raises(UnknownSchema, match=r"is unknown here|this side speaks version 1"):
        Opener().open(missing[0], label)
    assert schema_label(Odometry) == "navloom.Odometry/1"


def test_an_entry_point_registers_the_message_it_is_named_after(install: Install) -> None:
    install("fake_people", tracks(), ["message.Persons"])
    with pytest.raises(
        PluginError, match=r"registers message\.fake_people\.Tracks, expected message\.fake_people\.Pers"
    ):
        Discovery().message("fake_people.Persons")


# --- tools ----------------------------------------------------------------------------------------------------------


class Looker:
    """A client of a robot with one stream, which is also its network."""

    keys = KeySpace("lab", "r1")

    def __init__(self, sent: Sequence[tuple[bytes, str]]) -> None:
        self.bus, self.sent = self, sent
        self.unreadable: dict[tuple[str, str], str] = {}

    def describe(self) -> list[Description]:
        return [described("people", "main", published={"tracks": 1})]

    def alive(self, key: str) -> list[str]:
        return []

    def ask(self, key: str, timeout: float = 1.0) -> list[Any]:
        return []

    def neighbours(self) -> list[str]:
        return ["somebody"]

    def subscribe(self, key: str, receive: Callable[..., None], most: int) -> None:
        for data, label in self.sent:
            receive(key, data, label)


def echoed(sent: tuple[bytes, str]) -> str:
    _, message, envelope = next(iter(_messages(Looker([sent, sent]), "people/tracks")))
    return _text("people/main/tracks", envelope_fields(envelope), message_fields(message))


def metered(sent: tuple[bytes, str]) -> tuple[int, int]:
    meter = StreamMeter()
    for _ in range(3):
        meter.note(Packet(*sent, opens=OPENER.open))
    return len(meter.arrived_ns), meter.malformed


def test_echo_and_hz_know_the_messages_of_an_installed_distribution(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install("fake_people", tracks(), ["message.Tracks"])
    sent = sent_by("fake_people")
    assert metered(sent) == (3, 0)
    assert echoed(sent).splitlines()[1:] == [
        "  stamp_ns  7",
        "  places    float64[2, 2]  min 1  mean 2.5  max 4  [1, 2, 3, 4]",
        "  first     (x 1, y 2)",
        "  names     [Ann]",
    ]
    assert capsys.readouterr().err == ""


def test_echo_and_hz_show_messages_of_a_distribution_that_is_not_installed(
    missing: tuple[bytes, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert metered(missing) == (3, 0)
    assert echoed(missing).splitlines()[1:] == [
        "  stamp_ns  7",
        "  places    0",
        "  first     (x 1, y 2)",
        "  names     [Ann]",
        "  array 0   float64[2, 2]  min 1  mean 2.5  max 4  [1, 2, 3, 4]",
    ]
    assert capsys.readouterr().err == f"navloom: {MISSING}; shown from its header alone\n"


def recorded(path: Path, sent: tuple[bytes, str], count: int = 2, every_ns: int = 1) -> Recording:
    with RecordingWriter(path, RecordingHeader("lab", "r1", "live", 0.05, 7, "wall")) as writer:
        for number in range(count):
            writer.add(KEY, sent[1], sent[0], number * every_ns, 30, number + 1)
    return Recording(path)


def test_a_recording_holds_the_messages_of_distributions_and_explains_them(install: Install, tmp_path: Path) -> None:
    install("fake_people", tracks(), ["message.Tracks"])
    with recorded(tmp_path / "a.mcap", sent_by("fake_people")) as recording:
        assert "array of float64, shape (n, 2)" in recording.schema_text("fake_people.Tracks/1")
        assert [type(message.message).__name__ for message in recording.messages()] == ["Tracks"] * 2
        assert recording.unknown() == []


def test_a_recording_reports_once_which_messages_are_unknown(missing: tuple[bytes, str], tmp_path: Path) -> None:
    with recorded(tmp_path / "a.mcap", missing) as recording:
        assert recording.unknown() == [MISSING]
        assert list(recording.messages()) == [] and (recording.malformed, recording.complaint) == (
            2,
            f"{KEY}: {MISSING}",
        )
        assert [bytes(raw.data) for raw in recording.raw()] == [missing[0]] * 2


def test_unknown_messages_of_one_distribution_are_reported_together(missing: tuple[bytes, str]) -> None:
    labels = ["fake_people.Tracks/1", "navloom.Odometry/1", "fake_people.Seats/3", "fake_people.Tracks/1"]
    assert Opener().reasons(labels) == [MISSING.replace("Tracks/1", "Tracks/1 and fake_people.Seats/3")]


@pytest.fixture
def runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A new runtime folder with a short path, as that of a socket is limited."""
    with TemporaryDirectory(prefix="nl", dir="/tmp") as folder:
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", folder)
        yield


def test_a_live_replay_publishes_unknown_messages(
    missing: tuple[bytes, str], tmp_path: Path, runtime: None, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, told = recorded(tmp_path / "a.mcap", missing, 400, 25_000_000), []
    is_published, ending = threading.Event(), threading.Event()

    def say(text: str) -> None:
        told.append(text)
        is_published.set()

    with ThreadPoolExecutor(1) as pool:
        try:
            counted = pool.submit(republish, recording, 1.0, ending, say)
            assert is_published.wait(30.0)
            with join("replay/r1") as client:
                stream, message, envelope = next(_messages(client, "people/tracks"))
        finally:
            ending.set()
    assert stream == "people/main/tracks" and envelope == AT._replace(key="replay/r1/people/main/tracks")
    assert isinstance(message, GenericMessage) and message.arrays[0].tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert counted.result() > 0 and len(told) == 1
    assert capsys.readouterr().err == f"navloom: {MISSING}; shown from its header alone\n"


def test_a_live_replay_reports_once_what_it_leaves_out(
    missing: tuple[bytes, str], tmp_path: Path, runtime: None, in_process: InProcess
) -> None:
    recorded(tmp_path / "a.mcap", (b"\xff" * 8, missing[1])).path.rename(tmp_path / "b.mcap")
    code, out, err = in_process("replay", str(tmp_path / "b.mcap"), "--live")
    assert code == 0 and out == "published 0 messages\n"
    assert err.splitlines()[0] == f"navloom: {MISSING}"
    assert err.splitlines()[2:] == [
        f"navloom: 2 messages are damaged and were left out; the first: {KEY}: got 8 bytes, "
        "expected a header that fits into them"
    ]


def test_messages_are_listed_with_their_distributions(install: Install, in_process: InProcess) -> None:
    install("fake_people", tracks(3), ["message.Tracks"], "2.5")
    install("fake_broken", "import a_library_that_is_not_there", ["message.Tracks"])
    code, out, err = in_process("messages", "--json")
    listed = {row["schema"]: row for row in json.loads(out)}
    assert code == 0 and listed["navloom.Odometry"]["version"] == 1
    assert listed["fake_people.Tracks"] == {
        "schema": "fake_people.Tracks", "version": 3, "distribution": "fake-people 2.5",
        "what": "People around the robot.",
    }  # fmt: skip
    assert len(err.splitlines()) == 1 and "a_library_that_is_not_there" in err
    code, out, _ = in_process("messages")
    assert code == 0 and "fake_people.Tracks" in out


def test_the_fields_of_a_message_are_shown_with_units(install: Install, in_process: InProcess) -> None:
    install("fake_people", tracks(), ["message.Tracks"])
    for name in ("Tracks", "fake_people.Tracks"):
        code, out, err = in_process("messages", name, "--json")
        one = next(one for one in json.loads(out) if one["schema"] == "fake_people.Tracks")  # navloom has a Tracks too
        rows = [(row["name"], row["type"], row["unit"]) for row in one["fields"]]
        assert (code, err) == (0, "")
        assert rows == [
            ("stamp_ns", "int", "ns"),
            ("places", "array of float64, shape (n, 2)", "m"),
            ("first", "navloom.Point2D or null", "m"),
            ("names", "list of str", ""),
        ]
    code, out, _ = in_process("messages", "fake_people.Tracks")
    assert code == 0 and out.startswith("fake_people.Tracks/1 of fake-people 1.0: People around the robot.\n")
    code, _, err = in_process("messages", "Trakcs")
    assert code == 2 and err == "navloom: message 'Trakcs' is not known here; did you mean 'Tracks'?\n"
