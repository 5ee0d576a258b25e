"""Access control of a robot's network: rules that a TLS listener enforces by the name in the certificate."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navloom.errors import NavloomError
from navloom.inputs.bounds import TEXT_MB, read_file
from navloom.inputs.texts import INSTANCE, json_of

from navloom_live.transport.keyspace import ALIVE

__all__ = ["ACTING", "HERE", "IDENTITIES", "KINDS", "MOVED", "READABLE", "AccessError", "Identity", "common_name",
           "kind_of", "limits", "read_identities", "rules"]  # fmt: skip

IDENTITIES = "identities.json"
"""File, beside the certificates, with the identities that a listener admits; all others are refused."""
KINDS = ("router", "nodes", "operator", "viewer", "shadow")
ACTING = (
    "goal/main/submit",
    "goal/main/cancel",
    "goal/main/replan",
    "gate/main/swap",
    "gate/main/limit",
    "gate/main/stop",
    "gate/main/resume",
    "gate/main/release",
    "gate/main/enter_unseen",
    "localizer/*/place",
    "localizer/*/relocalise",
    "mapper/*/clear",
    "planner/*/plan",
    "*/*/params/set",
    "process/supervisor/add",
)
"""Services that change what the robot does, below `<realm>/<robot>/`."""
READABLE = (
    "*/*/describe",
    "*/*/params/get",
    "*/*/parameters",
    "process/*/config",
    "process/supervisor/shadows",
    "localizer/*/hypotheses",
    "mapper/*/known",
    "mapper/*/map",
    "planner/*/path",
    "planner/*/failure",
    "reference/*/trajectory",
    "goal/*/drive",
    "goal/*/recovery",
    "goal/*/feedback",
    "goal/*/result",
    "gate/*/selection",
    "gate/*/status",
)
"""Keys that readers may query. Listed one by one: a rule for `gate/main/*` would also cover `gate/main/stop`."""
MOVED, HERE = "@router/moved", "@router/here"
"""Key on which a router announces its successor, and the router's token, which all identities that it knows can see.
No wildcard matches these keys, and only a router may publish there."""
DRIVING = "operator/main/command"
"""Stream of the commands of an operator who drives."""
RECALLED = "process/*/memory"
"""The robot's memory, which a starting process queries; allowed for `nodes` and shadows."""
QUESTION, SMALL_QUESTION, COMMAND, PLAIN_ANSWER = 65_536, 1024, 4096, 1_048_576
"""Largest size over TLS, from any sender, bytes: of a query, of a query that only reads, of a command, and of a
shadow's messages except maps and paths. The robot's own messages stay below a tenth of each."""
PACE, PACES = 50.0, {"*/*/describe": 20.0, "process/*/config": 5.0, RECALLED: 100.0}
"""Largest rate of one session's queries that pass the router, for each key, Hz: the second of two queries that are
closer together gets no answer."""
SAID = 250.0
"""Largest rate of messages that pass the router, for each stream of a shadow and for an operator's commands, Hz."""

# No `*` or `$`: in a name they would make a rule for the keys of others.
_NAME = re.compile(r"[A-Za-z0-9_-]+")
_INSTANCE = re.compile(INSTANCE)
_ALL = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "declare_queryable",
    "reply",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


class AccessError(NavloomError, ValueError):
    """A list of identities that cannot be used."""


@dataclass(frozen=True)
class Identity:
    """The owner of a certificate.

    Attributes:
        name: Name of the certificate's file.
        kind: One of KINDS.
        instance: ROLE.NAME for a shadow; otherwise empty.
        generation: Increases when a certificate of that name is revoked and made again.
    """

    name: str
    kind: str
    instance: str = ""
    generation: int = 1


def common_name(identity: Identity, realm: str, robot: str) -> str:
    """Common name in a certificate: kind, name and robot, so that another robot's certificate is not valid here.

    It includes the generation, so that a revoked certificate stays invalid after another of that name was made.
    """
    later = f"#{identity.generation}" if identity.generation > 1 else ""
    return f"{identity.kind}:{identity.name}{later}@{realm}/{robot}"


def read_identities(folder: Path, realm: str, robot: str) -> tuple[Identity, ...]:
    """The identities that a folder of certificates lists.

    Args:
        folder: Folder with identities.json.
        realm, robot: Names of the robot that they must be for.

    Raises:
        AccessError: There is no list, it is broken, or it is another robot's.
    """
    path = folder / IDENTITIES
    try:
        given = json_of(read_file(path, TEXT_MB, AccessError), str(path), AccessError)
        owner = f"{given['realm']}/{given['robot']}"
        found = tuple(
            Identity(str(entry["name"]), str(entry["kind"]), str(entry["instance"]), int(entry.get("generation", 1)))
            for entry in given["identities"]
        )
    except OSError as error:
        raise AccessError(
            f"{path}: {error.strerror}; a TLS listener needs it: copy it from the folder that `navloom keys new` made"
        ) from None
    except AccessError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError):
        raise AccessError(
            f"{path}: not a list of identities as `navloom keys` writes it; copy it from the folder it made"
        ) from None
    if owner != f"{realm}/{robot}":
        raise AccessError(
            f"{path}: its certificates are for robot {owner}, this robot is {realm}/{robot}; "
            f"make its own with `navloom keys new DIR --realm {realm} --robot {robot}`"
        )
    for identity in found:
        _check(path, identity)
    return found


def kind_of(folder: Path, name: str) -> str:
    """Kind of the identity that a folder of certificates lists with a common name; empty if it admits none."""
    realm, _, robot = name.rpartition("@")[2].partition("/")
    with contextlib.suppress(AccessError):
        for one in read_identities(folder, realm, robot):
            if common_name(one, realm, robot) == name:
                return one.kind
    return ""


def _check(path: Path, identity: Identity) -> None:
    if identity.kind not in KINDS:
        raise AccessError(f"{path}: {identity.name} is of kind {identity.kind!r}, expected one of {', '.join(KINDS)}")
    role, _, name = identity.instance.partition(".")
    if identity.kind == "shadow" and not (_NAME.fullmatch(role) and _INSTANCE.fullmatch(name)):
        raise AccessError(f"{path}: shadow {identity.name} is for instance {identity.instance!r}, expected ROLE.NAME")


def rules(realm: str, robot: str, identities: Iterable[Identity], streams: Sequence[str] = ()) -> dict[str, Any]:
    """Zenoh's `access_control` for a TLS listener: everything that is not allowed here is denied.

    A rule applies to key expressions that it includes completely. So a query with `*` passes only if a rule is as wide.

    Args:
        realm, robot: Names of the robot.
        identities: The identities to admit.
        streams: Streams of the robot, as role/instance/port, to which viewers and shadows may subscribe one by one.
            Each key costs the router work for every message, so some thousand of them would stop the robot. Empty if
            unknown: then any key of three parts is allowed.

    Raises:
        AccessError: A name would widen the rules.
    """
    for what, name in (("realm", realm), ("robot", robot)):
        if not _NAME.fullmatch(name):
            raise AccessError(f"{what} {name!r}: expected letters, digits, _ and -")
    prefix = f"{realm}/{robot}"
    made = _Rules(prefix)
    for identity in identities:
        subject = common_name(identity, realm, robot)
        if identity.kind in ("router", "nodes"):
            # Their certificates are on the robot's own hosts, and any of their keys may be needed.
            made.grant(subject, _everything(prefix))
            continue
        own = []
        if identity.kind == "operator":
            own = [*_operating(prefix), *_watching(prefix), *_hearing(prefix, ["**"])]
        elif identity.kind == "shadow":
            own = [*_shadowing(prefix, identity.instance.replace(".", "/", 1)), *_watching(prefix)]
        made.grant(subject, [*_reading(prefix, streams), *own])
    # Keys that begin with @ match no wildcard, so that `_everything` does not cover them.
    between = [f"{prefix}/@router/*"]
    made.grant_sockets([*_everything(prefix), _rule("ingress", _ALL, between), _rule("egress", _ALL, between)])
    return {
        "enabled": True,
        # A key that is forgotten here is refused, and somebody will notice.
        "default_permission": "deny",
        "rules": made.rules,
        "subjects": made.subjects,
        "policies": made.policies,
    }


def limits(realm: str, robot: str, identities: Sequence[Identity], streams: Sequence[str] = ()) -> dict[str, Any]:
    """Zenoh's `downsampling`, `low_pass_filter` and `qos` for a TLS listener: limits on the cost of a message.

    The router drops larger messages and more frequent queries before it forwards them, so that they cost the robot's
    processes nothing; the sender of a query gets an empty answer at once. These limits cannot depend on certificates:
    they apply to keys, and so to the robot's own processes too. Rates apply to each session separately.

    Args:
        realm, robot, identities, streams: As for `rules`.
    """
    from navloom.roles import ROLES  # loads arrays, which a stop must not wait for

    prefix = f"{realm}/{robot}"
    small = [f"{prefix}/{key}" for key in (*READABLE, RECALLED)]
    paced = [{"key_expr": f"{prefix}/{key}", "freq": PACES.get(key, PACE)} for key in (*READABLE, RECALLED, *ACTING)]
    shadows = [identity.instance.replace(".", "/", 1) for identity in identities if identity.kind == "shadow"]
    said = [DRIVING, *(stream for stream in streams if stream.rpartition("/")[0] in shadows)]
    rates = [_rate("questions", "query", paced),
             _rate("messages", "put", [{"key_expr": f"{prefix}/{key}", "freq": SAID} for key in said])]  # fmt: skip
    filters = [
        _bound("questions", ("query",), [f"{prefix}/**"], QUESTION),
        _bound("reading questions", ("query",), small, SMALL_QUESTION),
        _bound("commands", ("put", "delete"), [f"{prefix}/*/*/command"], COMMAND),
    ]
    for identity in identities:
        own = identity.instance.replace(".", "/", 1)
        role = ROLES.get(own.partition("/")[0])
        if identity.kind == "shadow" and not (role is not None and role.facts.has_large_messages):
            filters.append(_bound(identity.name, ("put", "delete", "reply"), [f"{prefix}/{own}/**"], PLAIN_ANSWER))
    # An answer inherits both from its question: a reader that does not take it must not block the router.
    patient = {"id": "reading questions", "flows": ["ingress"], "link_protocols": ["tls"], "messages": ["query"],
               "key_exprs": small, "overwrite": {"priority": "data", "congestion_control": "drop"}}  # fmt: skip
    # A stalled reader must not block senders: these messages are few, and a reader that rejoins queries the last ones.
    words = {"id": "words", "flows": ["egress"], "link_protocols": ["tls"], "messages": ["put"],
             "key_exprs": [f"{prefix}/**"], "qos": {"congestion_control": "block", "priority": "interactive_high"},
             "overwrite": {"congestion_control": "drop"}}  # fmt: skip
    return {"downsampling": rates, "low_pass_filter": filters, "qos": {"network": [patient, words]}}


def _rate(name: str, message: str, rates: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {"id": f"rate of {name}", "flows": ["ingress"], "link_protocols": ["tls"], "messages": [message],
            "rules": list(rates)}  # fmt: skip


def _bound(name: str, messages: Iterable[str], keys: Sequence[str], size: int) -> dict[str, Any]:
    return {"id": f"size of {name}", "flows": ["ingress"], "link_protocols": ["tls"], "messages": list(messages),
            "key_exprs": list(keys), "size_limit": size}  # fmt: skip


class _Rules:
    """Collects rules and the subjects that they apply to."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix
        self.rules: list[dict[str, Any]] = []
        self.subjects: list[dict[str, Any]] = []
        self.policies: list[dict[str, Any]] = []

    def grant(self, subject: str, allowed: Sequence[dict[str, Any]]) -> None:
        """Grant rules to the owner of a certificate."""
        self._grant(subject, {"cert_common_names": [subject]}, allowed)

    def grant_sockets(self, allowed: Sequence[dict[str, Any]]) -> None:
        """Grant rules to clients of a local socket: a router's successor, see `Link.door`."""
        self._grant("sockets", {"link_protocols": ["unixsock-stream"]}, allowed)

    def _grant(self, subject: str, who: dict[str, Any], allowed: Sequence[dict[str, Any]]) -> None:
        named = [{**rule, "id": f"{subject} {number}", "permission": "allow"} for number, rule in enumerate(allowed)]
        self.rules += named
        self.subjects.append({"id": subject, **who})
        self.policies.append({"rules": [rule["id"] for rule in named], "subjects": [subject]})


def _rule(flow: str, messages: Iterable[str], keys: Iterable[str]) -> dict[str, Any]:
    """One rule; "ingress" is traffic from the subject, "egress" traffic to it."""
    return {"flows": [flow], "messages": list(messages), "key_exprs": list(keys)}


def _everything(prefix: str) -> list[dict[str, Any]]:
    keys = [f"{prefix}/**"]
    return [_rule("ingress", _ALL, keys), _rule("egress", _ALL, keys), *_moving(prefix)]


def _hearing(prefix: str, streams: Sequence[str]) -> list[dict[str, Any]]:
    return [_rule("ingress", ("declare_subscriber",), (f"{prefix}/{stream}" for stream in streams))]


def _watching(prefix: str) -> list[dict[str, Any]]:
    """Allow subscribing to liveliness tokens; viewers may only query them."""
    return [_rule("ingress", ("declare_liveliness_subscriber",), (f"{prefix}/*/*/{ALIVE}/*", f"{prefix}/process/**"))]


def _reading(prefix: str, streams: Sequence[str]) -> list[dict[str, Any]]:
    everything = [f"{prefix}/**"]
    return [
        *_hearing(prefix, streams or ["*/*/*"]),
        _rule("ingress", ("liveliness_query",), everything),
        _rule("ingress", ("query",), (f"{prefix}/{key}" for key in READABLE)),
        _rule("egress", ("put", "delete", "reply", "liveliness_token", "declare_queryable"), everything),
        *_moving(prefix),
    ]


def _moving(prefix: str) -> list[dict[str, Any]]:
    """Allow receiving the announcement of a router's successor, and querying the router's own token."""
    moved, here = [f"{prefix}/{MOVED}"], [f"{prefix}/{HERE}"]
    return [
        _rule("ingress", ("declare_subscriber",), moved),
        _rule("egress", ("put",), moved),
        _rule("ingress", ("liveliness_query",), here),
        _rule("egress", ("liveliness_token",), here),
    ]


def _operating(prefix: str) -> list[dict[str, Any]]:
    driving = [f"{prefix}/{DRIVING}"]
    return [
        _rule("ingress", ("query",), (f"{prefix}/{key}" for key in ACTING)),
        _rule("ingress", ("put",), driving),
        _rule("egress", ("declare_subscriber",), driving),
    ]


def _shadowing(prefix: str, own: str) -> list[dict[str, Any]]:
    """Allow a shadow to publish and answer only on its own keys. Declarations and queries of others, with wildcards
    too, may reach it: a query reaches only those that could declare that they answer it."""
    return [
        _rule("ingress", ("put", "delete", "declare_queryable", "reply", "liveliness_token"), (f"{prefix}/{own}/**",)),
        _rule("ingress", ("query",), (f"{prefix}/{RECALLED}",)),
        _rule(
            "egress",
            ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"),
            (f"{prefix}/**",),
        ),
    ]
