"""Access rules of a router over TLS, with real sessions: what each identity may do, and who is not admitted.

That a message does not arrive is shown by order, not by waiting: an allowed message that the same session sends after
it, at the same priority, does arrive.
"""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import zenoh
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom_live.hosting.network import streams_of
from navloom_live.live.live_node_builder import all_sources
from navloom_live.operating.client import REQUEST_SPACING
from navloom_live.transport.access import (
    ACTING,
    COMMAND,
    PLAIN_ANSWER,
    QUESTION,
    READABLE,
    SMALL_QUESTION,
    AccessError,
    Identity,
    limits,
    rules,
)
from navloom_live.transport.certificate_folder import add_identity, new_authority
from navloom_live.transport.certificates import HOSTS, CertificateRequest
from navloom_live.transport.links import Link, settings
from navloom_live.transport.quality_of_service import retained_ports
from navloom_live.transport.query_limits import RANKS

SOON = 10.0
WHO = ("nodes", "operator", "viewer", "shadow.avoider.forces")
SERVED = (
    *(key.replace("*", "vfh") for key in ACTING),
    "avoider/vfh/describe",
    "avoider/vfh/params/get",
    "gate/main/status",
    "process/think/memory",
)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _who_may(key: str) -> str:
    """Kinds of identity that may query a key."""
    return "shadow.avoider.forces" if key.endswith("/memory") else "operator"


def opened(given: dict[str, Any]) -> zenoh.Session:
    return zenoh.open(zenoh.Config.from_json5(json.dumps(given)))


class Ear:
    """Messages that a session receives, in order."""

    def __init__(self, session: zenoh.Session, *key_exprs: str) -> None:
        self._heard: list[tuple[str, str]] = []
        self._news = threading.Condition()
        handler = zenoh.handlers.Callback(self._take, indirect=False)
        self._held = [session.declare_subscriber(key_expr, handler) for key_expr in key_exprs]

    def _take(self, sample: zenoh.Sample) -> None:
        with self._news:
            self._heard.append((str(sample.key_expr), sample.payload.to_string()))
            self._news.notify_all()

    def heard(self, key: str, text: str, patience: float = SOON) -> bool:
        """Whether a message arrives in time."""
        with self._news:
            return self._news.wait_for(lambda: (key, text) in self._heard, patience)

    def keys(self, text: str) -> list[str]:
        """Keys on which a text has arrived."""
        with self._news:
            return [key for key, said in self._heard if said == text]


class Net:
    """A router and a client of every identity, on one host, over TLS."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.folder, self.port = folder, free_port()
        self.end = f"tls/127.0.0.1:{self.port}"
        self._stack = stack
        now = datetime.now(UTC)
        new_authority(folder, CertificateRequest("lab", "r1", HOSTS, 30, now))
        add_identity(folder, Identity("shadow.avoider.forces", "shadow", "avoider.forces"), (), 30, now)
        self.keep(opened(settings(Link("router", (self.end,), (), folder, "router"))))
        self.sessions = {name: self.join(name) for name in WHO}
        self.asked: list[str] = []
        self._queryables = [self._serve(self.sessions["nodes"], f"lab/r1/{key}") for key in SERVED]
        self.robot = Ear(self.sessions["nodes"], "lab/r1/**")
        self._settle()

    def hold(self, declared: Any) -> None:
        """Keep a declaration for as long as the network lasts."""
        self._queryables.append(declared)

    def keep(self, session: zenoh.Session) -> zenoh.Session:
        self._stack.callback(session.close)
        return session

    def join(self, identity: str) -> zenoh.Session:
        return self.keep(opened(settings(Link("client", (), (self.end,), self.folder, identity))))

    def _serve(self, session: zenoh.Session, key: str) -> Any:
        def answer(query: zenoh.Query) -> None:
            self.asked.append(f"{query.payload.to_string() if query.payload else ''} {key}")
            query.reply(key, b"done")
            query.drop()

        return session.declare_queryable(key, zenoh.handlers.Callback(answer, indirect=False), complete=True)

    def _settle(self) -> None:
        """Wait until the router knows the declarations of the robot's own process."""
        for attempt in range(1000):
            self.sessions["operator"].put("lab/r1/operator/main/command", f"hello {attempt}")
            answered = all(self.ask(_who_may(key), key, "hello") for key in SERVED)
            if answered and self.robot.heard("lab/r1/operator/main/command", f"hello {attempt}", 0.02):
                return
        raise AssertionError("the robot's own process is not heard")

    def ask(self, who: str, key: str, text: str = "") -> list[str]:
        """Keys of the answers to a query, sent up to three times, as the router drops queries that come too soon."""
        for _ in range(3):
            replies = self.sessions[who].get(
                f"lab/r1/{key}",
                payload=text.encode(),
                timeout=SOON,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
            answered = sorted(
                str(reply.ok.key_expr).removeprefix("lab/r1/") for reply in replies if reply.ok is not None
            )
            if answered:
                return answered
            time.sleep(REQUEST_SPACING)
        return []


@pytest.fixture(scope="module")
def net(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Net]:
    with ExitStack() as stack:
        yield Net(tmp_path_factory.mktemp("access") / "keys", stack)


def repeat_until(heard: Callable[[float], bool], send: Callable[[], None]) -> bool:
    """Send until a message arrives: a declaration may still be on its way to the router."""
    for _ in range(500):
        send()
        if heard(0.02):
            return True
    return False


# --- the rules themselves -------------------------------------------------------------------------------------------


def test_every_stream_for_late_joiners_can_be_queried() -> None:
    readable = [zenoh.KeyExpr(key) for key in READABLE]
    for role, port in retained_ports():
        assert any(key.includes(zenoh.KeyExpr(f"{role}/main/{port}")) for key in readable), f"{role} {port}"


def test_the_access_rules_list_every_service_that_acts() -> None:
    assert {key.split("/", 2)[-1] for key in ACTING} == RANKS.keys() - {
        "memory",
        "extend",
    }  # between the robot's own processes


def test_the_streams_of_a_config_are_all_that_its_nodes_publish() -> None:
    for name in ("paper", "explore", "building"):
        system = assemble(load_config(name))
        known = set(streams_of(system.config))
        instances = {
            role: [one for owner, one in all_sources(system) if owner == role] for role, _ in all_sources(system)
        }
        published = {
            f"{spec.role}/{one}/{port}"
            for spec in system.specs
            for port in (*spec.outputs, "step")
            for one in instances[spec.role]
        }
        assert published <= known, published - known


@pytest.mark.parametrize("acting", ACTING)
def test_no_reading_rule_touches_a_service_that_acts(acting: str) -> None:
    for key in READABLE:
        assert not zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(acting)), key


@pytest.mark.parametrize(
    ("realm", "robot"), [("*", "r1"), ("lab", "**"), ("lab", "r1/gate"), ("", "r1"), ("lab", "$*")]
)
def test_a_name_that_would_widen_the_rules_is_refused(realm: str, robot: str) -> None:
    with pytest.raises(AccessError, match="letters, digits"):
        rules(realm, robot, ())


# --- who reads ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("who", ["viewer", "operator", "shadow.avoider.forces"])
def test_a_reader_receives_every_message(net: Net, who: str) -> None:
    ear = Ear(net.sessions[who], "lab/r1/*/*/*")
    key = "lab/r1/gate/main/command"

    def send() -> None:
        net.sessions["nodes"].put(key, f"for {who}")

    assert repeat_until(lambda patience: ear.heard(key, f"for {who}", patience), send)


@pytest.mark.parametrize("who", ["viewer", "operator", "shadow.avoider.forces"])
def test_readers_may_query_liveliness_and_all_but_viewers_are_notified(net: Net, who: str) -> None:
    seen, key = threading.Event(), f"lab/r1/gate/{who}/alive/1"
    token = net.sessions["nodes"].liveliness().declare_token(key)
    watching = (
        net.sessions[who]
        .liveliness()
        .declare_subscriber(
            f"lab/r1/*/{who}/alive/*",
            zenoh.handlers.Callback(lambda sample: seen.set(), indirect=False),
            history=True,
        )
    )
    found: list[str] = []

    def ask() -> None:
        replies = net.sessions[who].liveliness().get("lab/r1/*/*/alive/*", timeout=SOON)
        found[:] = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    assert repeat_until(lambda patience: key in found, ask)
    assert not seen.is_set() if who == "viewer" else seen.wait(SOON)
    watching.undeclare()
    token.undeclare()


@pytest.mark.parametrize("who", ["viewer", "operator", "shadow.avoider.forces"])
def test_readers_may_query_services_that_do_not_act(net: Net, who: str) -> None:
    assert net.ask(who, "gate/main/status") == ["gate/main/status"]
    assert net.ask(who, "*/*/describe") == ["avoider/vfh/describe"]
    assert net.ask(who, "avoider/vfh/params/get") == ["avoider/vfh/params/get"]


@pytest.mark.parametrize("who", ["viewer", "shadow.avoider.forces"])
def test_readers_reach_no_service_that_acts_by_any_spelling_of_its_key(net: Net, who: str) -> None:
    acting = [key.replace("*", "vfh") for key in ACTING]
    for key in (
        *acting,
        "gate/main/*",
        "gate/*/stop",
        "gate/main/st*",
        "*/*/*",
        "**/stop",
        "**",
        "avoider/vfh/params/*",
    ):
        if "st*" in key:
            key = key.replace("st*", "st$*")
        assert net.ask(who, key, f"{who} {key}") == [], key
    assert net.ask(who, "gate/main/status", f"{who} last")
    assert [line for line in net.asked if line.startswith(who)] == [f"{who} last lab/r1/gate/main/status"]


def test_only_node_processes_may_query_the_memory(net: Net) -> None:
    assert net.ask("shadow.avoider.forces", "process/*/memory") == ["process/think/memory"]
    for who in ("viewer", "operator"):
        assert net.ask(who, "process/*/memory") == []


@pytest.mark.parametrize("who", ["viewer", "operator", "shadow.avoider.forces"])
def test_a_reading_query_passes_the_router_up_to_its_size_limit(net: Net, who: str) -> None:
    fits, large = "f" * SMALL_QUESTION, "l" * (SMALL_QUESTION + 1)
    assert net.ask(who, "*/*/describe", fits) == ["avoider/vfh/describe"]
    assert net.ask(who, "*/*/describe", large) == []
    assert f"{large} lab/r1/avoider/vfh/describe" not in net.asked


def test_of_a_flood_of_reading_queries_few_pass_and_the_others_end_at_once(net: Net) -> None:
    began, ended = time.monotonic(), 0
    while time.monotonic() - began < 0.5:
        for _ in net.sessions["viewer"].get("lab/r1/*/*/describe", payload=b"flood", timeout=SOON):
            pass
        ended += 1
    passed = net.asked.count("flood lab/r1/avoider/vfh/describe")
    assert 1 <= passed <= 15 and ended >= 3 * passed  # 20 a second


def test_of_a_flood_of_an_operators_commands_few_pass(net: Net) -> None:
    operator, key, began, sent = net.sessions["operator"], "lab/r1/operator/main/command", time.monotonic(), 0
    while time.monotonic() - began < 0.4:
        operator.put(key, "flood")
        sent += 1
    assert repeat_until(lambda patience: net.robot.heard(key, "over", patience), lambda: operator.put(key, "over"))
    assert 1 <= len(net.robot.keys("flood")) <= 150 < sent  # 250 a second


def test_an_acting_query_passes_the_router_up_to_its_size_limit(net: Net) -> None:
    assert net.ask("operator", "goal/main/submit", "s" * QUESTION) == ["goal/main/submit"]
    assert net.ask("operator", "goal/main/submit", "s" * (QUESTION + 1)) == []


@pytest.mark.parametrize(
    ("who", "key"), [("operator", "operator/main/command"), ("shadow.avoider.forces", "avoider/forces/command")]
)
def test_a_command_passes_the_router_up_to_its_size_limit(net: Net, who: str, key: str) -> None:
    large, fits = f"{who} ".ljust(COMMAND + 1), f"{who} ".ljust(COMMAND)
    for text in (large, fits):
        time.sleep(REQUEST_SPACING)  # of two at once the router drops the second, whatever happens to the first
        net.sessions[who].put(f"lab/r1/{key}", text)
    assert net.robot.heard(f"lab/r1/{key}", fits) and net.robot.keys(large) == []


def test_messages_of_a_shadow_without_maps_are_limited_and_the_robots_own_maps_are_not(net: Net) -> None:
    shadow, large = net.sessions["shadow.avoider.forces"], "l" * (PLAIN_ANSWER + 1)
    for text in (large, large[1:]):  # a busy sender that does not block drops the second while the first is on its way
        shadow.put("lab/r1/avoider/forces/step", text, congestion_control=zenoh.CongestionControl.BLOCK)
    assert net.robot.heard("lab/r1/avoider/forces/step", large[1:])
    assert net.robot.keys(large) == []
    ear = Ear(net.sessions["operator"], "lab/r1/mapper/vfh/map")
    assert repeat_until(
        lambda patience: ear.heard("lab/r1/mapper/vfh/map", large, max(1.0, patience)),
        lambda: net.sessions["nodes"].put("lab/r1/mapper/vfh/map", large),
    )


@pytest.mark.parametrize(("instance", "is_limited"), [("mapper.vfh", False), ("planner.a", False), ("recovery.b", True),
                                                      ("mappers.c", True), ("people.d", True)])  # fmt: skip
def test_a_shadow_is_limited_unless_its_role_has_large_messages(instance: str, is_limited: bool) -> None:
    found = limits("lab", "r1", [Identity("one", "shadow", instance)])["low_pass_filter"]
    assert ("size of one" in [bound["id"] for bound in found]) is is_limited


def test_a_viewers_messages_do_not_arrive(net: Net) -> None:
    viewer = net.sessions["viewer"]
    for key in ("gate/main/command", "operator/main/command", "avoider/forces/command", "**", "gate/*/command"):
        viewer.put(f"lab/r1/{key}", "from viewer")
    assert net.ask("viewer", "gate/main/status") == ["gate/main/status"]
    assert net.robot.keys("from viewer") == []


def test_a_viewer_cannot_answer_in_place_of_the_robot(net: Net) -> None:
    net.sessions["viewer"].put("lab/r1/gate/main/command", "after")
    served: list[str] = []

    def lie(query: zenoh.Query) -> None:
        served.append("lied")
        query.reply("lab/r1/gate/main/status", b"all is well")
        query.drop()

    handler = zenoh.handlers.Callback(lie, indirect=False)
    lying = net.sessions["viewer"].declare_queryable("lab/r1/gate/**", handler, complete=True)
    assert net.ask("viewer", "avoider/vfh/describe")
    assert net.ask("operator", "gate/main/status") == ["gate/main/status"]
    assert served == []
    lying.undeclare()


def test_with_known_streams_a_viewer_receives_only_those_and_each_by_its_key(net: Net) -> None:
    end, stream = f"tls/127.0.0.1:{free_port()}", "gate/main/command"
    link = Link("router", (end,), (), net.folder, "router", streams=(stream,))
    net.keep(opened(settings(link)))
    nodes, viewer, operator = (
        net.keep(opened(settings(Link("client", (), (end,), net.folder, name))))
        for name in ("nodes", "viewer", "operator")
    )
    hears, heard = threading.Event(), set()

    def listen(key: str) -> None:
        def take(sample: zenoh.Sample) -> None:
            heard.add(str(sample.key_expr))
            hears.set()

        handler = zenoh.handlers.Callback(take, indirect=False)
        net.hold(viewer.declare_subscriber(f"lab/r1/{key}", handler))

    for key in ("**", "*/*/*", "gate/*/command", "x/y/z", stream):
        listen(key)
    every = Ear(operator, "lab/r1/**")
    assert repeat_until(hears.wait, lambda: nodes.put(f"lab/r1/{stream}", "news"))
    for number in range(20):
        nodes.put("lab/r1/x/y/z", f"{number}")
        nodes.put(f"lab/r1/{stream}", f"{number}")
    assert every.heard("lab/r1/x/y/z", "19") and every.heard(f"lab/r1/{stream}", "19")
    assert heard == {f"lab/r1/{stream}"}


# --- who acts -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", [key.replace("*", "vfh") for key in ACTING])
def test_an_operator_may_act(net: Net, key: str) -> None:
    assert net.ask("operator", key) == [key]


def test_an_operator_drives_only_through_the_gate(net: Net) -> None:
    operator = net.sessions["operator"]
    for key in ("gate/main/command", "avoider/vfh/command", "gate/main/selection", "operator/main/command"):
        operator.put(f"lab/r1/{key}", "from operator")
    assert net.robot.heard("lab/r1/operator/main/command", "from operator")
    assert net.robot.keys("from operator") == ["lab/r1/operator/main/command"]


def test_a_shadow_publishes_only_under_its_own_name(net: Net) -> None:
    shadow, own = net.sessions["shadow.avoider.forces"], "lab/r1/avoider/forces/command"
    for key in (
        "gate/main/command",
        "operator/main/command",
        "avoider/vfh/command",
        "avoider/*/command",
        "avoider/forces2/command",
    ):
        shadow.put(f"lab/r1/{key}", "from shadow")
    shadow.put(own, "from shadow")
    assert net.robot.heard(own, "from shadow")
    assert net.robot.keys("from shadow") == [own]


def test_a_shadow_answers_and_announces_itself_only_under_its_own_name(net: Net) -> None:
    shadow, seen = net.sessions["shadow.avoider.forces"], threading.Event()
    alive: list[str] = []

    def take(sample: zenoh.Sample) -> None:
        alive.append(str(sample.key_expr))
        if alive[-1].endswith("/forces/alive/1"):
            seen.set()

    handler = zenoh.handlers.Callback(take, indirect=False)
    watching = net.sessions["nodes"].liveliness().declare_subscriber("lab/r1/avoider/*/alive/*", handler, history=True)
    tokens = [shadow.liveliness().declare_token(f"lab/r1/avoider/{name}/alive/1") for name in ("vfh", "forces")]
    assert seen.wait(SOON)
    assert alive == ["lab/r1/avoider/forces/alive/1"]
    answering = shadow.declare_queryable(
        "lab/r1/avoider/forces/describe",
        zenoh.handlers.Callback(lambda query: query.reply("lab/r1/avoider/forces/describe", b"me"), indirect=False),
    )
    for key in ("avoider/forces/describe", "*/*/describe"):  # as `list` asks
        answers: list[str] = []

        def ask(key: str = key, answers: list[str] = answers) -> None:
            answers[:] = net.ask("operator", key)

        assert repeat_until(lambda patience, found=answers: "avoider/forces/describe" in found, ask)
    for declared in (answering, watching, *tokens):
        declared.undeclare()


def test_another_robots_keys_are_out_of_reach(net: Net) -> None:
    other = net.join("nodes")
    ear = Ear(other, "lab/r2/**", "lab/r1/x/y/z", "lab/**")
    nodes, operator = net.sessions["nodes"], net.sessions["operator"]

    def send() -> None:
        operator.put("lab/r2/operator/main/command", "to whom")
        nodes.put("lab/r2/gate/main/command", "to whom")
        nodes.put("lab/r1/x/y/z", "to whom")

    assert repeat_until(lambda patience: ear.heard("lab/r1/x/y/z", "to whom", patience), send)
    assert {key.split("/")[1] for key in ear.keys("to whom")} == {"r1"}


def test_an_identity_that_the_router_does_not_list_gets_nothing(net: Net) -> None:
    add_identity(net.folder, Identity("late", "operator"), (), 30, datetime.now(UTC))
    net.sessions["late"] = net.join("late")
    assert net.ask("late", "gate/main/stop", "late") == []
    assert net.ask("late", "*/*/describe", "late") == []
    assert not [line for line in net.asked if line.startswith("late")]


def test_a_peer_that_listens_over_tls_keeps_the_same_rules(net: Net) -> None:
    end = f"tls/127.0.0.1:{free_port()}"
    peer = net.keep(opened(settings(Link("peer", (end,), (), net.folder, "nodes"))))
    ear = Ear(peer, "lab/r1/operator/main/command", "lab/r1/gate/main/command")
    sessions = [
        net.keep(opened(settings(Link("peer", (), (end,), net.folder, identity))))
        for identity in ("viewer", "operator")
    ]

    def send() -> None:
        for session in sessions:
            session.put("lab/r1/operator/main/command", "direct")
            session.put("lab/r1/gate/main/command", "direct")

    assert repeat_until(lambda patience: ear.heard("lab/r1/operator/main/command", "direct", patience), send)
    assert set(ear.keys("direct")) == {"lab/r1/operator/main/command"}


# --- who is not admitted --------------------------------------------------------------------------------------------


def without_certificate(net: Net, folder: Path) -> dict[str, Any]:
    given = settings(Link("client", (), (net.end,), net.folder, "viewer"))
    root = given["transport"]["link"]["tls"]["root_ca_certificate"]
    given["transport"]["link"]["tls"] = {"root_ca_certificate": root}
    return given


def of_another_authority(net: Net, folder: Path) -> dict[str, Any]:
    new_authority(folder, CertificateRequest("lab", "r1", HOSTS, 30, datetime.now(UTC)))
    (folder / "ca.pem").write_bytes(
        (net.folder / "ca.pem").read_bytes()
    )  # it trusts the router, but the router does not trust it
    return settings(Link("client", (), (net.end,), folder, "operator"))


def expired(net: Net, folder: Path) -> dict[str, Any]:
    then = datetime.now(UTC) - timedelta(days=9, hours=12)
    add_identity(net.folder, Identity("expired", "operator"), (), 9, then)
    return settings(Link("client", (), (net.end,), net.folder, "expired"), then + timedelta(days=8, hours=18))


def by_plain_tcp(net: Net, folder: Path) -> dict[str, Any]:
    return settings(Link("client", (), (f"tcp/127.0.0.1:{net.port}",)))


def to_a_router_of_another_name(net: Net, folder: Path) -> dict[str, Any]:
    add_identity(net.folder, Identity("elsewhere", "nodes"), ("elsewhere.example",), 30, datetime.now(UTC))
    return _to_listener(net, "elsewhere")


def to_an_operator_that_poses_as_the_router(net: Net, folder: Path) -> dict[str, Any]:
    return _to_listener(net, "operator")


def to_an_expired_router(net: Net, folder: Path) -> dict[str, Any]:
    then = datetime.now(UTC) - timedelta(days=9, hours=12)
    add_identity(net.folder, Identity("old-router", "nodes"), HOSTS, 9, then)
    return _to_listener(net, "old-router", then + timedelta(days=8, hours=18))


def _to_listener(net: Net, identity: str, now: datetime | None = None) -> dict[str, Any]:
    end = f"tls/127.0.0.1:{free_port()}"
    net.keep(opened(settings(Link("router", (end,), (), net.folder, identity), now)))
    return settings(Link("client", (), (end,), net.folder, "nodes"))


def test_foreign_clients_are_not_admitted_and_no_client_accepts_a_false_router(net: Net, tmp_path: Path) -> None:
    cases = (
        without_certificate,
        of_another_authority,
        expired,
        by_plain_tcp,
        to_a_router_of_another_name,
        to_an_operator_that_poses_as_the_router,
        to_an_expired_router,
    )
    outcome: dict[str, str] = {}

    def attempt(name: str, given: dict[str, Any]) -> None:
        try:
            opened(given).close()
        except zenoh.ZError:
            outcome[name] = "refused"
        else:
            outcome[name] = "let in"

    threads = []
    for case in cases:
        given = case(net, tmp_path / case.__name__)
        threads.append(threading.Thread(target=attempt, args=(case.__name__, given), daemon=True))
        threads[-1].start()
    for thread in threads:
        thread.join(2 * SOON)
    assert outcome == {case.__name__: "refused" for case in cases}
    net.join("viewer").close()  # and it still admits known clients
