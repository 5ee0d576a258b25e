"""What a node says about itself: on the wire and back, and what is said of an answer that cannot be read."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import pytest
from described import KEYS, counts, described
from navloom.inputs.typed_json import from_json
from navloom_live.live.description import (
    IF_KNOWN,
    Description,
    DescriptionError,
    ProcessConfig,
    clocks,
    read_description,
)
from navloom_live.operating.client import Client, ClientError
from navloom_live.operating.live_recorder import ask_header
from navloom_live.transport.zenoh_bus import Answer

PLATFORM = {"ticks": 100, "late_ticks": 3, "stops": 1, "driven_ticks": 50, "own_ticks": 49}
FULL = described(
    "gate", "main", plugin=None, busy_s=0.25, faulted=2, fault="E", notes=("fast",), waits_for=("platform.odometry",),
    is_patient=False, carries={"command": "navloom.Command/1"}, hosts={"robot": "base"}, wall_ns=17, chain_p50_s=0.5,
    chain_p99_s=0.75, streams={"avoider/vfh/command": counts(misrouted=1, origin="a", complaint="b", age_p50_s=0.5)},
    **PLATFORM,
)  # fmt: skip
OLDEST = {
    "plugin": "vfh", "process": "drive", "pid": 1, "host": "base", "active": True, "enabled": True, "tick": 7,
    "epoch": 0, "versions": {}, "published": {},
}  # fmt: skip


def read(given: Any) -> Description:
    return read_description("gate", "main", json.dumps(given).encode())


@pytest.mark.parametrize(
    "whole", [FULL, described("gate", "main"), described("avoider", "x", clock_ns=None, up_s=None)]
)
def test_a_description_comes_back_from_the_wire_as_it_was(whole: Description) -> None:
    assert read_description(whole.role, whole.instance, json.dumps(whole.to_json()).encode()) == whole


def test_on_the_wire_a_node_has_the_entries_that_tools_of_earlier_versions_read() -> None:
    told = described("gate", "main", plugin=None, is_patient=False, waits_for=()).to_json()
    assert told["plugin"] is None and told["busy_s"] is None  # these are null, and entries of other nodes are left out
    assert told.keys() == {field.name for field in fields(Description)} - {
        *PLATFORM, "chain_p50_s", "chain_p99_s", "wall_ns",
    }  # fmt: skip
    assert counts().to_json().keys() == {"received", "dropped", "malformed", "misrouted", "late", "latest"}
    assert clocks(1, 2).keys() <= IF_KNOWN <= {field.name for field in fields(Description)}


def test_entries_that_this_version_does_not_know_are_ignored() -> None:
    later = FULL.to_json() | {"temperature_c": 41.0}
    later["streams"] = {stream: one | {"jitter_s": 0.1} for stream, one in later["streams"].items()}
    assert read(later) == FULL


def test_a_node_of_a_version_with_fewer_entries_has_their_defaults() -> None:
    found = read(OLDEST)
    assert (found.tick, found.busy_s, found.hosts, found.silence_s, found.faulted) == (7, None, {}, None, 0)
    assert found.ticks is found.is_patient is found.clock_ns is None


def test_role_and_instance_are_those_of_the_key() -> None:
    found = read(OLDEST | {"role": "controller", "instance": ["x"]})
    assert (found.role, found.instance) == ("gate", "main")


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"tick": "late"}, "tick: expected int, got str"),
        ({"active": 1}, "active: expected bool, got int"),
        ({"pid": None}, "pid: expected int, got null"),
        ({"streams": []}, "streams: expected object, got array"),
        ({"streams": {"a": 1}}, "streams[...]: expected object, got int"),
        ({"streams": {"a": {}}}, "streams[...]: object missing required field received"),
        ({"places": {"avoider": "drive"}}, "places: expected ROLE INSTANCE, got 'avoider'"),
        ({"places": {"avoider vfh": 3}}, "places[...]: expected str, got int"),
        ({"hosts": {"drive": None}}, "hosts[...]: expected str, got null"),
        ({"wall_ns": "now"}, "wall_ns: expected int | null, got str"),
        ({"late_ticks": 0.5}, "late_ticks: expected int | null, got float"),
    ],
)
def test_an_entry_of_another_type_gives_one_sentence(changes: dict[str, Any], what: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        read(OLDEST | {"versions": {"navloom": "9.1"}} | changes)
    head, _, tail = str(caught.value).partition(f"({what}): it runs navloom 9.1, this is navloom ")
    assert head == "gate main: its description cannot be read "
    assert tail.endswith("; install the same version on both")


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"[]", "expected object, got list"),
        (b"null", "expected object, got NoneType"),
        (b"{}", "object missing required field plugin"),
        (b"me", "Expecting value: line 1 column 1 (char 0)"),
        (b"[" * 100_000, "maximum recursion depth exceeded"),
    ],
    ids=["list", "null", "empty", "text", "deep"],
)
def test_an_answer_that_is_no_description_gives_one_sentence(data: bytes, what: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        read_description("gate", "main", data)
    assert f"cannot be read ({what}" in str(caught.value) and "it names no version of navloom" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_config_of_a_process_comes_back_from_the_wire_as_it_was() -> None:
    whole = ProcessConfig(loaded={"name": "paper"}, barrier=True, distributions={"navloom": "1.0"})
    assert from_json(ProcessConfig, whole.to_bytes()) == whole


@pytest.mark.parametrize(
    ("config", "why"),
    [
        ({"loaded": None, "barrier": False, "distributions": {}}, "its config is not known"),
        ({"loaded": {}, "distributions": {}}, "object missing required field barrier"),
        ({"loaded": {}, "barrier": "no", "distributions": {}}, "barrier: expected bool, got str"),
        ({"loaded": {}, "barrier": False, "distributions": {}}, "'config'"),
    ],
)
def test_a_recorder_says_why_it_cannot_read_the_config_of_a_process(config: dict[str, Any], why: str) -> None:
    answer = Answer("lab/r1/process/drive/config", json.dumps(config).encode(), "json", "")
    bus = SimpleNamespace(ask=lambda key, timeout: [answer])
    said = re.escape(f"robot lab/r1: the config that it reports cannot be read ({why}); install the same version")
    with pytest.raises(ClientError, match=said):
        ask_header(Client(bus, KEYS))  # type: ignore[arg-type]
