"""One distribution adds a sensor, two nodes and an avoider that reads them; the framework does not know it."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dist_rig import put_on_path
from live_rig import runtime_folder
from navloom import Avoidance, AvoiderInput, Extra
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.catalogue import FRAMEWORK
from navloom.geometry.frames import transform
from navloom.messages import GateStatus, Message
from navloom.messages.envelope import Envelope, StepRecord
from navloom.plugins import Discovery, PluginError
from navloom.runs.episode import run_episode
from navloom_live.operating.republishing import republish
from navloom_recording.reader import Recording
from navloom_study.openloop import open_loop_of
from navloom_study.study_methods import methods_of
from navloom_viewer.drawing import Drawing
from navloom_viewer.lockstep_viewing import Gathering
from navloom_viewer.panels import panels_of
from navloom_viewer.picture_setup import facts_of
from toys import blamed

Typed = Callable[..., tuple[int, str, str]]
SHORT = ("run.stop_after=8.0",)
NODES = ("platform", "localizer", "mapper", "planner", "controller", "avoider", "recovery", "goal", "reference", "gate")


class Heard:
    """Observer that keeps the reason of the gate's status, by tick."""

    wants = frozenset({("gate", "status")})
    wants_steps = False

    def __init__(self) -> None:
        self.reasons: dict[int, str] = {}

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        assert isinstance(message, GateStatus)
        self.reasons[at.tick] = message.reason

    def on_step(self, record: StepRecord) -> None:
        """Never called: `wants_steps` is False."""


class Drawn:
    """A sink that keeps the positions at which beacons were drawn, m, base frame."""

    def __init__(self) -> None:
        self.beacons: list[list[list[float]]] = []

    def log(self, path: str, archetypes: Sequence[Any], tick: int | None, stamp_ns: int) -> None:
        if path.endswith("/beacons") and tick is not None:
            (batch,) = (
                one for one in archetypes[0].as_component_batches() if "positions" in str(one.component_descriptor())
            )
            self.beacons.append(batch.as_arrow_array().to_pylist())

    def layout(self, blueprint: Any) -> None:
        """Ignored."""

    series = layout
    close = layout


def refused(config: Path, *changes: str) -> str:
    with pytest.raises((ConfigError, PluginError)) as caught:
        assemble(load_config(str(config), changes))
    return str(caught.value)


def test_the_nodes_step_and_the_avoider_reads_them_in_lockstep(people: Path) -> None:
    trace = io.BytesIO()
    episode = run_episode(load_config(str(people)), trace=trace)
    assert episode.summary()["truly_reached"]
    assert b"people beacon_tracker tracks" in trace.getvalue() and b"platform beacon_robot beacons" in trace.getvalue()
    (shadow,) = episode.summary()["shadows"]
    assert shadow["instance"] == "improved_vfh" and shadow["differences"]["vx"]["max"] > 0.05
    assert shadow["differences"]["wz"]["max"] == 0.0


def test_its_nodes_are_not_in_another_system_of_the_same_process(people: Path) -> None:
    system = assemble(load_config(str(people)))
    assert system.catalogue.answer_ports("people") == ("tracks",)
    other = assemble(load_config("paper"))
    assert "people" not in other.catalogue.nodes and "people" not in FRAMEWORK.nodes
    roles = [port.role for port in FRAMEWORK.ports() if port.role != "world"]
    assert [port.role for port in other.catalogue.ports()] == roles


def test_an_alternative_reads_only_the_inputs_that_it_declares(people: Path) -> None:
    system = assemble(load_config(str(people)))
    read = {
        name: {given.name for given in system.wiring["avoider", name].inputs} for name in ("polite", "improved_vfh")
    }
    assert read["polite"] - read["improved_vfh"] == {"extra.tracks"}


def test_an_optional_input_that_nothing_publishes_is_none(people: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import navloom_people

    read = []

    class Alone(navloom_people.ImprovedVfh):
        name = "polite"
        tracks = Extra(navloom_people.Tracks, optional=True)

        def avoid(self, given: AvoiderInput) -> Avoidance:
            read.append(given.extra[self.tracks])
            return super().avoid(given)

    monkeypatch.setattr(navloom_people, "Polite", Alone)
    episode = run_episode(load_config(str(people), ("node=[]", *SHORT)))
    assert not episode.log.faults
    assert set(read) == {None}


def test_with_two_publishers_the_config_must_name_the_one_to_read(people: Path) -> None:
    both = 'node=[{ name = "left", plugin = "beacon_tracker" }, { name = "right", plugin = "nearest_tracker" }]'
    said = refused(people, both)
    assert "avoider.inputs.tracks: polite reads Tracks, and there are left.tracks, right.tracks: name one" in said
    assert 'inputs = { tracks = "left.tracks" }' in said
    system = assemble(load_config(str(people), (both, 'avoider.inputs.tracks="right.tracks"')))
    given = next(one for one in system.wiring["avoider", "polite"].inputs if one.name == "extra.tracks")
    assert str(given) == "right.tracks"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("node=[]", "avoider.inputs.tracks: polite reads Tracks, and no [[node]] or [[sensor]] publishes it"),
        ('avoider.inputs.trakcs="people.tracks"', "polite has no such input; did you mean 'tracks'?"),
        ('avoider.inputs.tracks="people.tarcks"', "expected a stream of Tracks; there are people.tracks"),
        ("node.peple.rate_hz=10", "there is no node.peple; did you mean 'people'?"),
        ("event.0.at=1.0", "there is no event.0; the config has no [[event]]"),
        ("node.people.name=gate", '"gate" is a name of the framework; choose another'),
        ("node.people.plugin=tracker", "no plugin 'node.tracker' is installed"),
        ("node.people.sensors=['laser']", "'laser' gives Sweep, beacon_tracker takes Beacons and RangeScan"),
        ("node.people.speed=1", "node.0.speed: unknown key"),
        ("node.people.rate_hz=7", "node.0.rate_hz: 7 does not divide the tick rate of 20 Hz"),
        ('live.hosts={ a = ["robot", "think", "drive", "safe"] }', "no host starts the process nodes of people"),
        (
            f"live.processes={{ all = {[*NODES, 'peple']} }}",
            'process all names "peple", expected a role',
        ),
        ("alternative.improved_vfh.role=peple", "expected a role or the name of a [[node]]; did you mean 'people'?"),
        (
            'event=[{ at = 1.0, do = "swap", role = "people", name = "x" }]',
            'names people "x"; there are beacon_tracker',
        ),
    ],
)
def test_a_config_that_does_not_fit_is_refused_with_the_place(people: Path, change: str, said: str) -> None:
    assert said in refused(people, change)


def test_an_avoider_that_waits_for_tracks_is_not_blamed(people: Path) -> None:
    heard = Heard()
    run_episode(load_config(str(people), (*SHORT, "node.people.latency=6.5")), observers=[heard])
    late = next(tick for tick, reason in heard.reasons.items() if not reason)
    assert 130 <= late < 135 and heard.reasons[0] == "waits: avoider polite for people.tracks"


def test_an_avoider_that_never_gets_tracks_gives_a_warning(people: Path) -> None:
    (warning,) = blamed(run_episode(load_config(str(people), ("run.stop_after=1.0", "node.people.latency=2.0"))))
    assert warning.kind == "waiting" and str(warning).startswith("avoider polite never stepped: ")
    assert str(warning).endswith(" people.tracks")


def test_a_swap_between_trackers_is_an_event(people: Path) -> None:
    more = 'alternative=[{ role = "people", plugin = "nearest_tracker" }]'
    event = 'event=[{ at = 2.0, do = "swap", role = "people", name = "nearest_tracker" }]'
    episode = run_episode(load_config(str(people), (*SHORT, more, event)))
    assert episode.log.swaps == 1 and episode.shadows[0].role == "people"
    assert set(episode.shadows[0].values) == {"unequal"}


@pytest.mark.parametrize("required", [False, True])
def test_a_tracker_that_breaks_ends_the_goal_only_where_it_is_required(
    people: Path, monkeypatch: pytest.MonkeyPatch, required: bool
) -> None:
    import navloom_people

    def broken(self: object, *given: object) -> None:
        raise ValueError("no people")

    monkeypatch.setattr(navloom_people.BeaconTracker, "seen_from", broken)
    config = load_config(str(people), (*SHORT, "avoider.plugin=improved_vfh", "alternative=[]",
                                       f"node.people.required={str(required).lower()}"))  # fmt: skip
    episode = run_episode(config)
    assert episode.log.faults and episode.log.faults[0].startswith(
        "people beacon_tracker failed: ValueError: no people"
    )
    assert (episode.result.outcome == "error") is required


def test_a_recording_is_replayed_bit_for_bit_and_with_the_other_tracker(
    people: Path, tmp_path: Path, in_process: Typed
) -> None:
    recording = tmp_path / "run.mcap"
    in_process("run", str(people), "--set", SHORT[0], "--record", str(recording), "--json")
    code, out, err = in_process("replay", str(recording), "--check")
    assert code == 0 and "bit for bit" in out, out + err
    steps = next(line.split() for line in out.splitlines() if line.startswith("people beacon_tracker"))
    assert int(steps[2]) > 100
    code, out, err = in_process("replay", str(recording), "--node", "people=nearest_tracker")
    assert code == 0 and "people nearest_tracker on what beacon_tracker was given" in out, out + err
    assert {message.key.rsplit("/", 2)[0] for message in Recording(recording).messages(["people/*/tracks"])} == {
        "lab/r1/people"
    }


def test_hz_echo_and_graph_show_its_streams_like_those_of_the_framework(
    people: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: Typed
) -> None:
    recording = tmp_path / "run.mcap"
    in_process("run", str(people), "--set", SHORT[0], "--record", str(recording), "--json")
    with republished(recording, monkeypatch):
        code, out, err = in_process("hz", "people/tracks", "--for", "1", "--json")
        found = json.loads(out)["people/beacon_tracker/tracks"]
        assert code == 0 and found["messages"] > 5 and found["malformed"] == found["lost"] == 0, out + err
        code, out, err = in_process("echo", "people/tracks", "--count", "1", "--json")
        told = json.loads(out)
        assert (code, told["stream"]) == (0, "people/beacon_tracker/tracks") and "positions" in told["message"], err
        nodes = {node["role"]: node for node in json.loads(in_process("graph", "--json")[1])["nodes"]}
        assert "tracks" in nodes["people"]["published"] and "beacons" in nodes["platform"]["published"]


@contextmanager
def republished(recording: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Publish a recording again, at its own pace."""
    is_published, ending = threading.Event(), threading.Event()
    with runtime_folder() as folder, ThreadPoolExecutor(1) as pool:
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(folder))
        published = pool.submit(republish, Recording(recording), 1.0, ending, lambda text: is_published.set())
        try:
            assert is_published.wait(30.0), published.exception(0.0)
            yield
        finally:
            ending.set()


def test_the_graph_of_the_config_has_the_node_and_what_reads_it(people: Path, in_process: Typed) -> None:
    wires = [
        (edge["from"], edge["port"], edge["to"])
        for edge in json.loads(in_process("graph", str(people), "--json")[1])["edges"]
    ]
    assert {
        ("platform", "beacons", "people"),
        ("platform", "sonars", "people"),
        ("people", "tracks", "avoider"),
    } <= set(wires)


def test_its_panel_draws_beacons_at_their_places(people: Path) -> None:
    pytest.importorskip("rerun", reason="the extra `view` is not installed")
    loaded, drawn = load_config(str(people), SHORT), Drawn()
    panels, wrong = panels_of(Discovery())
    drawing = Drawing(facts_of({"r1": assemble(loaded)}, "people"), [drawn], panels)
    drawing.begin()
    gathering = Gathering("r1", drawing.take)
    episode = run_episode(loaded, observers=[gathering])
    gathering.drain()
    assert not wrong and not drawing.broken
    assert len(drawn.beacons) > 50
    places = transform(episode.recorder.truth[-1][1:4], np.array(drawn.beacons[-1])[:, :2])
    assert places == pytest.approx(np.array([(1.5, 4.0), (-1.0, 6.0)]), abs=0.2)


def test_trackers_and_avoiders_are_compared(people: Path, in_process: Typed) -> None:
    vary = ("--vary", "avoider=polite,improved_vfh", "--vary", "people=beacon_tracker,nearest_tracker")
    few = ("--set", "run.stop_after=3", "--seeds", "0:1", "--jobs", "1")
    code, out, err = in_process("compare", str(people), *vary, *few)
    assert code == 0 and "4 methods x 1 worlds x 1 seeds: 4 episodes" in out, out + err
    assert "polite+nearest_tracker" in out and "improved_vfh+beacon_tracker" in out


def test_open_loop_runs_the_other_tracker_as_a_shadow(people: Path) -> None:
    methods = methods_of(str(people), ["node.people.plugin=beacon_tracker,nearest_tracker"], (), Discovery())
    found = open_loop_of(methods, "beacon_tracker")
    (table,) = [table for table in found.loaded.config.alternative if table.role == "people"]
    assert (table.plugin, table.shadow, found.shadows) == (
        "nearest_tracker",
        True,
        {"nearest_tracker": "nearest_tracker"},
    )


def test_a_tracker_is_named_by_its_plugin_or_by_an_alternative(people: Path) -> None:
    shelf = 'alternative=[{ role = "people", plugin = "nearest_tracker", name = "near", latency = 0.1 }]'
    methods = methods_of(str(people), ["people=beacon_tracker,near"], [shelf], Discovery())
    assert [method.name for method in methods] == ["beacon_tracker", "near"]
    table = methods[1].loaded.config.role_table("people")
    assert (table.plugin, table.latency) == ("nearest_tracker", 0.1)
    with pytest.raises(ConfigError, match=r"--vary people=nearest: neither a plugin .* did you mean 'nearest_tracker'"):
        methods_of(str(people), ["people=beacon_tracker,nearest"], (), Discovery())


def test_the_kinds_of_sensors_are_listed_with_messages_and_settings(people: Path, in_process: Typed) -> None:
    code, out, _ = in_process("plugins", "platform.beacon_robot")
    assert code == 0 and "beacons" in out and "Beacons" in out and "reach" in out


WATCHER = """
from navloom import {names}, GateStatus, Latest, Message, NodePlugin, Publishes, Stamp, Tick, hookimpl, message

@message
class Seen(Message):
    stamp_ns: Stamp

class Watcher(NodePlugin):
    name = "watcher"
    {more}
    seen = Publishes(Seen)

    def step(self, tick):
        self.seen.put({put})

@hookimpl
def navloom_register(registry):
    registry.node(Watcher)
"""


def watcher(
    folder: Path, patch: pytest.MonkeyPatch, more: str, names: str = "Command", put: str = "Seen(tick.time_ns)"
) -> None:
    """Install a distribution with one node."""
    project = folder / "watcher"
    project.mkdir()
    module = f"fake_watcher_{abs(hash(more + put))}"
    (project / f"{module}.py").write_text(WATCHER.format(names=names, more=more, put=put), "utf-8")
    text = '[project]\nname = "fake-watcher"\nversion = "1"\n[project.entry-points.navloom]\n"node.watcher" = '
    (project / "pyproject.toml").write_text(f'{text}"{module}"\n', "utf-8")
    put_on_path(project, folder / "site", patch)


WATCHED = ('node=[{ name = "eyes", plugin = "watcher" }]', *SHORT)


@pytest.mark.parametrize(
    ("more", "names", "said"),
    [
        ("truth = Latest(Truth, triggers=True)", "Truth", "watcher reads Truth: no plugin may read the ground truth"),
        (
            "command = Latest(Command, triggers=True)",
            "Command",
            "there are operator.command, avoider.command, recovery.command, gate.command: name one, as in "
            'inputs = { command = "operator.command" }',
        ),
        ("scan = Latest(RangeScan, triggers=True)", "RangeScan", "and no [[node]] or [[sensor]] publishes it"),
        ("", "Command", "Watcher never steps: set ticks = True, or triggers=True on one of its inputs"),
    ],
)
def test_a_node_that_cannot_be_wired_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: str, names: str, said: str
) -> None:
    watcher(tmp_path, monkeypatch, more, names)
    changes = ("sensor=[]",) if "RangeScan" in more else ()
    with pytest.raises((ConfigError, PluginError)) as caught:
        assemble(load_config("paper", (*WATCHED, *changes)))
    assert said in str(caught.value)


def test_a_cycle_of_nodes_is_printed(people: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    watcher(tmp_path, monkeypatch, "gate = Latest(GateStatus, triggers=True)")
    import navloom_people

    class Watching(navloom_people.Polite):
        name = "polite"
        seen = Extra(Message)

    monkeypatch.setattr(navloom_people, "Polite", Watching)
    nodes = 'node=[{ name = "eyes", plugin = "watcher" }, { name = "people", plugin = "beacon_tracker" }]'
    said = refused(people, nodes, 'avoider.inputs={ seen = "eyes.seen" }')
    assert "cycle without a ~ edge" in said and "avoider reads eyes.seen" in said and "eyes reads gate.status" in said


def test_an_alternative_of_a_node_publishes_the_same_streams(
    people: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watcher(tmp_path, monkeypatch, "ticks = True; same = 1")
    said = refused(people, 'alternative=[{ role = "people", plugin = "watcher" }]')
    assert "watcher publishes seen (Seen), expected the streams of beacon_tracker, which is active in people" in said


def test_a_wrong_message_is_blamed_on_the_node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    watcher(tmp_path, monkeypatch, "ticks = True", put="tick")
    episode = run_episode(load_config("paper", WATCHED))
    (fault,) = episode.log.faults
    assert fault.startswith("eyes watcher failed: TypeError: seen carries Seen, got Tick") and "fake_watcher" in fault


def test_a_node_that_is_not_installed_is_not_checked_and_the_rest_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: Typed
) -> None:
    recording = tmp_path / "run.mcap"
    with monkeypatch.context() as patch:
        watcher(tmp_path, patch, "ticks = True")
        in_process(
            "run", "paper", *(word for change in WATCHED for word in ("--set", change)), "--record", str(recording)
        )
    code, out, err = in_process("replay", str(recording), "--check")
    assert code == 0 and "bit for bit" in out, out + err
    assert "eyes watcher: not checked: no plugin 'node.watcher' is installed" in out


TYPED = """
from navloom import Avoider, AvoiderInput, Avoidance, Extra, GateStatus, Path

class Mine(Avoider):
    name = "mine"
    gate = Extra(GateStatus)
    maybe = Extra(GateStatus, optional=True)

    def avoid(self, given: AvoiderInput) -> Avoidance:
        path: Path = given.extra[self.gate]
        reason: str = given.extra[self.maybe].reason
        return Avoidance(given.desired, given.extra[self.gate].reason)
"""


@pytest.mark.once
def test_mypy_knows_the_class_of_an_extra_input(tmp_path: Path) -> None:
    source = tmp_path / "typed.py"
    source.write_text(TYPED, "utf-8")
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", str(source)], capture_output=True, text=True
    )
    assert 'has type "GateStatus", variable has type "Path"' in checked.stdout, checked
    assert 'Item "None" of "GateStatus | None" has no attribute "reason"' in checked.stdout


def test_config_show_has_the_node_and_the_streams_it_reads(people: Path, in_process: Typed) -> None:
    rows = {line.split()[0]: line.split()[1] for line in in_process("config", "show", str(people))[1].splitlines()}
    assert rows["node.0.name"] == '"people"' and rows["node.0.inputs.pose"] == '"localizer.pose"'
    assert rows["avoider.inputs.tracks"] == '"people.tracks"'
