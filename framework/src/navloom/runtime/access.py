"""Who may do what on a robot's network: the rules that a TLS listener keeps, by the name in the certificate."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navloom.inputs.bounds import TEXT_MB, read_file
from navloom.inputs.texts import json_of

__all__ = ["ACTING", "IDENTITIES", "KINDS", "READABLE", "HERE", "MOVED", "AccessError", "Identity", "common_name",
           "read_identities", "rules"]  # fmt: skip

IDENTITIES = "identities.json"
"""File, beside the certificates, with the identities a listener lets in. Who is struck from it is kept out."""
KINDS = ("router", "nodes", "operator", "viewer", "shadow")
ACTING = (
    "goal/main/submit",
    "goal/main/cancel",
    "gate/main/swap",
    "gate/main/stop",
    "gate/main/resume",
    "gate/main/release",
    "*/*/params/set",
)
"""Services that change what the robot does, below `<realm>/<robot>/`."""
READABLE = (
    "*/*/describe",
    "*/*/params/get",
    "*/*/parameters",
    "process/*/memory",
    "process/*/config",
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
"""What may be asked by who only reads. Named one by one: a rule for `gate/main/*` would cover `gate/main/stop` too."""
MOVED, HERE = "@router/moved", "@router/here"
"""Where a router says that another takes its place, and its token, which is shown to all whom it knows. No wildcard
leads there, and nobody else may say it."""
DRIVING = "operator/main/command"
"""Where an operator's own commands go."""

_NAME = re.compile(r"[A-Za-z0-9_-]+")
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


class AccessError(ValueError):
    """A list of identities that cannot be used."""


@dataclass(frozen=True)
class Identity:
    """Who a certificate stands for.

    Attributes:
        name: Of the certificate's file.
        kind: One of KINDS.
        instance: Of a shadow, ROLE.NAME; else empty.
        generation: Rises when a certificate of that name was revoked and another one is made.
    """

    name: str
    kind: str
    instance: str = ""
    generation: int = 1


def common_name(identity: Identity, realm: str, robot: str) -> str:
    """Common name in a certificate: kind, name and robot, so that another robot's certificate is nobody here.

    With the generation, so that a revoked certificate is nobody either after another of that name was made.
    """
    later = f"#{identity.generation}" if identity.generation > 1 else ""
    return f"{identity.kind}:{identity.name}{later}@{realm}/{robot}"


def read_identities(folder: Path, realm: str, robot: str) -> tuple[Identity, ...]:
    """The identities that a folder of certificates lists.

    Args:
        folder: With identities.json.
        realm, robot: Whose they must be.

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
            f"{path}: {error.strerror}; who listens over TLS rules by it: "
            f"copy it from the folder that `navloom keys new` made"
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


def _check(path: Path, identity: Identity) -> None:
    if identity.kind not in KINDS:
        raise AccessError(f"{path}: {identity.name} is of kind {identity.kind!r}, expected one of {', '.join(KINDS)}")
    role, _, name = identity.instance.partition(".")
    if identity.kind == "shadow" and not (_NAME.fullmatch(role) and _NAME.fullmatch(name)):
        raise AccessError(f"{path}: shadow {identity.name} is for instance {identity.instance!r}, expected ROLE.NAME")


def rules(realm: str, robot: str, identities: Iterable[Identity]) -> dict[str, Any]:
    """Zenoh's `access_control` for who listens over TLS: what is not allowed here is denied.

    A rule holds for keys that it includes as a whole. So a question with `*` in it passes only where a rule is as wide.

    Args:
        realm, robot: Whose keys.
        identities: Who is let in.

    Raises:
        AccessError: A name that would widen the rules.
    """
    for what, name in (("realm", realm), ("robot", robot)):
        if not _NAME.fullmatch(name):
            raise AccessError(f"{what} {name!r}: expected letters, digits, _ and -")
    prefix = f"{realm}/{robot}"
    made = _Rules(prefix)
    for identity in identities:
        subject = common_name(identity, realm, robot)
        if identity.kind in ("router", "nodes"):
            made.grant(subject, _everything(prefix))
            continue
        own = []
        if identity.kind == "operator":
            own = _operating(prefix)
        elif identity.kind == "shadow":
            own = _shadowing(prefix, identity.instance.replace(".", "/", 1))
        made.grant(subject, [*_reading(prefix), *own])
    between = [f"{prefix}/@router/*"]
    made.grant_sockets([*_everything(prefix), _rule("ingress", _ALL, between), _rule("egress", _ALL, between)])
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": made.rules,
        "subjects": made.subjects,
        "policies": made.policies,
    }


class _Rules:
    """Collects rules with the subjects they are for."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix
        self.rules: list[dict[str, Any]] = []
        self.subjects: list[dict[str, Any]] = []
        self.policies: list[dict[str, Any]] = []

    def grant(self, subject: str, allowed: Sequence[dict[str, Any]]) -> None:
        """Allow the owner of a certificate what follows."""
        self._grant(subject, {"cert_common_names": [subject]}, allowed)

    def grant_sockets(self, allowed: Sequence[dict[str, Any]]) -> None:
        """Allow who comes by a socket what follows: a router's successor, see `Link.door`."""
        self._grant("sockets", {"link_protocols": ["unixsock-stream"]}, allowed)

    def _grant(self, subject: str, who: dict[str, Any], allowed: Sequence[dict[str, Any]]) -> None:
        named = [{**rule, "id": f"{subject} {number}", "permission": "allow"} for number, rule in enumerate(allowed)]
        self.rules += named
        self.subjects.append({"id": subject, **who})
        self.policies.append({"rules": [rule["id"] for rule in named], "subjects": [subject]})


def _rule(flow: str, messages: Iterable[str], keys: Iterable[str]) -> dict[str, Any]:
    """One rule; "ingress" is what comes from the subject, "egress" what goes to it."""
    return {"flows": [flow], "messages": list(messages), "key_exprs": list(keys)}


def _everything(prefix: str) -> list[dict[str, Any]]:
    keys = [f"{prefix}/**"]
    return [_rule("ingress", _ALL, keys), _rule("egress", _ALL, keys), *_moving(prefix)]


def _reading(prefix: str) -> list[dict[str, Any]]:
    everything = [f"{prefix}/**"]
    return [
        _rule("ingress", ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"), everything),
        _rule("ingress", ("query",), (f"{prefix}/{key}" for key in READABLE)),
        _rule("egress", ("put", "delete", "reply", "liveliness_token", "declare_queryable"), everything),
        *_moving(prefix),
    ]


def _moving(prefix: str) -> list[dict[str, Any]]:
    """Everybody hears from the router that another takes its place, and can ask whether it knows him."""
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
    """It says and answers what is its own. Who listens to whom, and asks, it is told, with wildcards too: a question
    reaches only who could declare that he answers it."""
    return [
        _rule("ingress", ("put", "delete", "declare_queryable", "reply", "liveliness_token"), (f"{prefix}/{own}/**",)),
        _rule(
            "egress",
            ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"),
            (f"{prefix}/**",),
        ),
    ]
