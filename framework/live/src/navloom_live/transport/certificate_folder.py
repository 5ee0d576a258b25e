"""A folder of certificates for a robot that spans hosts: create, add, renew and revoke."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path

from navloom.config.tables import ROLE_TABLES, TAKEN
from navloom.inputs.bounds import TEXT_MB, read_file
from navloom.inputs.texts import INSTANCE, json_of
from navloom.roles import FIXED

from navloom_live.transport.access import IDENTITIES, KINDS, AccessError, Identity, read_identities
from navloom_live.transport.certificate_validity import AUTHORITY
from navloom_live.transport.certificates import (
    AUTHORITY_DAYS,
    SERVING,
    CertificateRequest,
    KeysError,
    alternative_name,
    hosts_of,
    make_authority,
    make_certificate,
    read_authority,
    write_new,
)
from navloom_live.transport.key_pairs import files_of, place_pair, sweep_pairs

__all__ = ["add_identity", "new_authority", "renew", "revoke"]

DRAFT = ".keys-"
"""Beginning of the names of folders for unfinished files."""


def new_authority(folder: Path, order: CertificateRequest) -> tuple[Identity, ...]:
    """Make a folder with an authority and certificates of router, nodes, operator and viewer: all of them, or none.

    Args:
        folder: The folder, which must not exist yet.
        order: The robot, hosts and validity.

    Returns:
        The identities made.

    Raises:
        KeysError: The folder exists, it cannot be written, or the request is invalid.
    """
    _check_order(order)
    if folder.exists() or folder.is_symlink():
        has_keys = (folder / "identities.json").exists()
        add = f", or add one certificate with `navloom keys add {folder} NAME --kind viewer`" if has_keys else ""
        raise KeysError(f"{folder}: exists already and is not overwritten; name another folder{add}")
    made = tuple(Identity(kind, kind) for kind in KINDS if kind != "shadow")
    with _writing(folder.parent) as draft:
        authority = make_authority(draft, order)
        for identity in made:
            make_certificate(draft, authority, identity, order)
        _write_list(draft, _Listed(order.realm, order.robot, made, {}))
        try:
            # One step, so that a folder with half of the certificates never has its name.
            draft.rename(folder)
        except OSError as error:
            raise KeysError(f"{folder}: {error.strerror}") from None
    return made


def add_identity(folder: Path, identity: Identity, hosts: Sequence[str], days: int, now: datetime) -> None:
    """Make one more certificate in a folder that `new_authority` made.

    Args:
        folder: The folder, with the authority's private key.
        identity: The new identity. Its name must be free; a revoked one's name is free, and gets the next generation.
        hosts: Where it listens; for kinds that accept connections.
        days: Validity, days.
        now: Time of the request, with its time zone.

        Raises:
            KeysError: The name is taken or invalid, or there is no authority; nothing was changed.
    """
    if hosts and identity.kind not in SERVING:
        raise KeysError(f"--host {hosts[0]}: only for --kind nodes; a {identity.kind} accepts no connections")
    _check_identity(identity)
    with _changing(folder) as (draft, listed):
        order = CertificateRequest(listed.realm, listed.robot, tuple(hosts), days, now)
        _check_order(order)
        files = files_of(identity.name)
        if any((folder / file).exists() for file in files) or identity.name in listed.by_name:
            raise KeysError(f"{folder}: there is a certificate of {identity.name!r} already; choose another name")
        # Or the revoked certificate of that name would be valid again.
        made = replace(identity, generation=listed.revoked.get(identity.name, 0) + 1)
        make_certificate(draft, read_authority(folder), made, order)
        _write_list(draft, replace(listed, identities=(*listed.identities, made)))
        _install(draft, folder, [identity.name], has_list=True)


def renew(folder: Path, names: Sequence[str], hosts: Sequence[str], days: int, now: datetime) -> tuple[Identity, ...]:
    """Replace certificates by new ones with new keys: all that are named, or none.

    The old ones stay valid until they expire, so that processes that still use one are not cut off.

    Args:
        folder: The folder, with the authority's private key.
        names: Names of the identities; empty for all.
        hosts: Where the kinds that accept connections listen; empty for no change.
        days: Validity of the new ones, days; at most as long as the authority's.
        now: Time of the request, with its time zone.

    Returns:
        The identities with new certificates.

    Raises:
        KeysError: A name is unknown, or there is no authority; nothing was changed.
    """
    with _changing(folder) as (draft, listed):
        # All are made before any is installed.
        chosen = [_known(folder, listed, name) for name in names] or list(listed.identities)
        if hosts and all(identity.kind not in SERVING for identity in chosen):
            raise KeysError(f"--host {hosts[0]}: only for router and nodes; others accept no connections")
        authority = read_authority(folder)
        for identity in chosen:
            order = _order_again(folder, listed, identity, hosts, days, now)
            make_certificate(draft, authority, identity, order)
        _install(draft, folder, [identity.name for identity in chosen])
    return tuple(chosen)


def revoke(folder: Path, name: str, now: datetime, replacement_days: int | None = None) -> Identity | None:
    """Remove an identity from the list that listeners use. Its certificate is refused from then on.

    Args:
        folder: The folder; for a replacement, with the authority's private key.
        name: Name of the identity.
        now: Time of the request, with its time zone.
        replacement_days: Make another certificate of that name with this validity, days; None for no replacement.

    Returns:
        The identity of the replacement; None without one.

    Raises:
        KeysError: The name is unknown, or the robot cannot run without it; nothing was changed.
    """
    with _changing(folder) as (draft, listed):
        identity = _known(folder, listed, name)
        if identity.kind == "router":
            raise KeysError(
                f"{folder}: the router's certificate cannot be revoked, since its clients do not "
                "check the list; make a new folder with `navloom keys new`, with which no certificate of this one works"
            )
        if name == "nodes" and replacement_days is None:
            raise KeysError(
                f"{folder}: without the certificate of nodes the robot cannot run; --replace makes another in its place"
            )
        rest = tuple(other for other in listed.identities if other is not identity)
        revoked = {**listed.revoked, name: identity.generation}
        if replacement_days is None:
            _write_list(draft, replace(listed, identities=rest, revoked=revoked))
            _install(draft, folder, (), has_list=True, removed=files_of(name))
            return None
        made = replace(identity, generation=identity.generation + 1)
        order = _order_again(folder, listed, identity, (), replacement_days, now)
        make_certificate(draft, read_authority(folder), made, order)
        _write_list(draft, replace(listed, identities=(*rest, made), revoked=revoked))
        _install(draft, folder, [name], has_list=True)
        return made


@dataclass(frozen=True)
class _Listed:
    """The list of identities of a folder.

    Attributes:
        realm, robot: Names of the robot.
        identities: Admitted identities.
        revoked: Newest revoked generation, by name.
    """

    realm: str
    robot: str
    identities: tuple[Identity, ...]
    revoked: Mapping[str, int]

    @property
    def by_name(self) -> dict[str, Identity]:
        """Admitted identities, by name."""
        return {identity.name: identity for identity in self.identities}


def _known(folder: Path, listed: _Listed, name: str) -> Identity:
    found = listed.by_name.get(name)
    if found is None:
        if name == AUTHORITY:
            raise KeysError(f"{folder}: the authority is not renewed; make a new folder with `navloom keys new`")
        if name in listed.revoked:
            raise KeysError(f"{folder}: {name} is revoked; `navloom keys add {folder} {name}` makes another")
        raise KeysError(f"{folder}: no certificate of {name!r}; there are {', '.join(listed.by_name)}")
    return found


def _order_again(
    folder: Path, listed: _Listed, identity: Identity, hosts: Sequence[str], days: int, now: datetime
) -> CertificateRequest:
    """The request for another certificate of an identity."""
    if identity.kind not in SERVING:
        hosts = ()
    elif not hosts:
        # The new certificate serves the same hosts, which stand nowhere else.
        hosts = hosts_of(folder / f"{identity.name}.pem")
    order = CertificateRequest(listed.realm, listed.robot, tuple(hosts), days, now)
    _check_order(order)
    return order


def _check_order(order: CertificateRequest) -> None:
    for what, name in (("--realm", order.realm), ("--robot", order.robot)):
        if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
            raise KeysError(f"{what} {name!r}: expected letters, digits, _ and -")
    if not 1 <= order.days <= AUTHORITY_DAYS:
        raise KeysError(f"--days {order.days}: expected 1 to {AUTHORITY_DAYS}")
    for host in order.hosts:
        alternative_name(host)


def _check_identity(identity: Identity) -> None:
    name = identity.name
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name) or name == AUTHORITY or name.endswith("-key"):
        raise KeysError(f"name {name!r}: expected letters, digits, . _ and -, not 'ca' and not ending in -key")
    if identity.kind not in KINDS or identity.kind == "router":
        raise KeysError(f"--kind {identity.kind}: expected {', '.join(kind for kind in KINDS if kind != 'router')}")
    if identity.kind != "shadow":
        if identity.instance:
            raise KeysError(f"--instance {identity.instance}: only for --kind shadow")
        return
    role, _, instance = identity.instance.partition(".")
    shadowed = [role for role in ROLE_TABLES if role not in FIXED]
    is_node = re.fullmatch(r"[a-z][A-Za-z0-9_]*", role) and role not in TAKEN
    if not (role in shadowed or is_node) or not re.fullmatch(INSTANCE, instance):
        raise KeysError(
            f"--instance {identity.instance or '(none)'}: a shadow is one instance, expected ROLE.NAME, as "
            f"avoider.forces; roles are {', '.join(shadowed)}, and the names of a config's [[node]] tables"
        )


def _write_list(folder: Path, listed: _Listed) -> None:
    given = {
        "realm": listed.realm,
        "robot": listed.robot,
        "identities": [asdict(identity) for identity in listed.identities],
        "revoked": dict(listed.revoked),
    }
    write_new(folder / IDENTITIES, json.dumps(given, indent=2).encode() + b"\n", 0o644)


def _read_list(folder: Path) -> _Listed:
    try:
        given = json_of(read_file(folder / IDENTITIES, TEXT_MB, KeysError), str(folder / IDENTITIES), KeysError)
        realm, robot = str(given["realm"]), str(given["robot"])
        revoked = {str(name): int(generation) for name, generation in given.get("revoked", {}).items()}
    except OSError as error:
        raise KeysError(f"{folder / IDENTITIES}: {error.strerror}; make the folder with `navloom keys new`") from None
    except KeysError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError):
        raise KeysError(f"{folder / IDENTITIES}: not a list of identities; restore it, or make a new folder") from None
    try:
        return _Listed(realm, robot, read_identities(folder, realm, robot), revoked)
    except AccessError as error:
        raise KeysError(str(error)) from None


@contextlib.contextmanager
def _changing(folder: Path) -> Iterator[tuple[Path, _Listed]]:
    """A draft folder for new files, and the folder's list, which no other process can change meanwhile."""
    _read_list(folder)  # raises for a folder without a list
    with _alone(folder):
        _sweep(folder)
        try:
            with _writing(folder) as draft:
                yield draft, _read_list(folder)
        finally:
            sweep_pairs(folder)


@contextlib.contextmanager
def _writing(parent: Path) -> Iterator[Path]:
    """A private folder for unfinished files; removed at the end unless it was renamed."""
    try:
        parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=parent, prefix=DRAFT))
    except OSError as error:
        raise KeysError(f"{parent}: {error.strerror}") from None
    try:
        yield draft
    except OSError as error:
        raise KeysError(f"{error.filename or draft}: {error.strerror}") from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Lock the folder: of two processes that add at once, one would lose the other's identity."""
    # The folder itself is the lock file: another one would have to be copied to hosts.
    number = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(number, fcntl.LOCK_EX)
        yield
    finally:
        os.close(number)


def _sweep(folder: Path) -> None:
    """Remove what a command that was killed left in a locked folder: drafts, which hold private keys, and pairs."""
    for draft in folder.glob(f"{DRAFT}*"):
        shutil.rmtree(draft, ignore_errors=True)
    sweep_pairs(folder)


def _install(
    draft: Path, folder: Path, pairs: Sequence[str], *, has_list: bool = False, removed: Sequence[str] = ()
) -> None:
    """Move finished pairs and the list into place, in this order, and remove files: all of it, or nothing."""
    kept = draft / "kept"
    kept.mkdir()
    undone: list[Callable[[], None]] = []
    try:
        for name in pairs:
            undone.append(place_pair(draft, folder, name))
        # The list after the pairs: it must name no certificate that is not there.
        for file in (*([IDENTITIES] if has_list else ()), *removed):
            if (folder / file).exists():
                shutil.copy2(folder / file, kept / file, follow_symlinks=False)
            undone.append(partial(_put_back, kept / file, folder / file))
            if file in removed:
                (folder / file).unlink(missing_ok=True)
            else:
                (draft / file).replace(folder / file)
    except OSError:
        for undo in reversed(undone):
            undo()
        raise


def _put_back(kept: Path, path: Path) -> None:
    if kept.is_symlink() or kept.exists():
        kept.replace(path)
    else:
        path.unlink(missing_ok=True)
