"""`navloom graph` of a config; test_cli_introspection.py tests that of a live robot."""

from __future__ import annotations

import json

import pytest
from navloom.cli.command import App
from navloom.cli.describing.graph import graph
from navloom.config import ConfigError
from typer.testing import CliRunner

APP = App()
APP.command()(graph)


def run(*words: str) -> str:
    done = CliRunner().invoke(APP, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_the_graph_of_a_config_has_its_nodes_and_their_readers() -> None:
    found = json.loads(run("paper", "--set", "avoider.plugin=vfh", "--json"))
    assert {"role": "avoider", "instances": ["vfh"]}.items() <= next(
        node for node in found["nodes"] if node["role"] == "avoider"
    ).items()
    assert any(edge["from"] == "mapper" and edge["to"] == "planner" for edge in found["edges"])
    assert "digraph navloom {" in run("paper", "--dot")


def test_a_stream_that_a_node_reads_twice_is_printed_once() -> None:
    lines = run("paper").splitlines()
    read = lines[lines.index("gate (main)") + 1].removeprefix("  reads ").split(", ")
    assert "platform.sonars" in read and len(set(read)) == len(read)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--set", "run.seed=1"], "--set run.seed=1: it changes a config; name one"),
        (["paper", "--robot", "lab/r1"], "--robot is for a live robot, and paper is a config"),
        (["paper", "--connect", "tcp/127.0.0.1:7447"], "--connect is for a live robot"),
        (["paper", "--insecure"], "--insecure is for a live robot"),
    ],
    ids=["set-without-config", "robot", "connect", "insecure"],
)
def test_options_of_the_other_kind_of_graph_are_refused(words: list[str], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        run(*words)
