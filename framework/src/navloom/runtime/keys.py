"""Certificates for a robot that spans hosts: its own authority, and one certificate for everybody it lets in."""

from __future__ import annotations

import contextlib
import fcntl
import ipaddress
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from navloom.config.schema import ROLE_TABLES
from navloom.inputs.bounds import TEXT_MB, read_file
from navloom.inputs.texts import json_of
from navloom.runtime.access import IDENTITIES, KINDS, AccessError, Identity, common_name, read_identities
from navloom.runtime.links import LinkError

__all__ = ["DAYS", "HOSTS", "KeysError", "Order", "add_identity", "new_authority"]

DAYS = 825
"""Days a certificate is good for, where nothing else is asked."""
HOSTS = ("localhost", "127.0.0.1")
"""Where the router is, where nothing else is said."""
LONGEST_NAME = 64
"""Characters of a common name: X.520, upper bound."""
AUTHORITY_DAYS = 3650
SKEW = timedelta(days=1)
"""A robot without a battery-backed clock may be behind."""
SERVING = ("router", "nodes")
"""Kinds that may also be connected to."""


class KeysError(LinkError):
    """Certificates that are not made; the text says why."""


@dataclass(frozen=True)
class Order:
    """What certificates are made for.

    Attributes:
        realm, robot: Whose network.
        hosts: Names and addresses where its router listens.
        days: They are good for.
        now: Time of the order, with its time zone.
    """

    realm: str
    robot: str
    hosts: tuple[str, ...]
    days: int
    now: datetime


def new_authority(folder: Path, order: Order) -> tuple[Identity, ...]:
    """Make a folder with an authority and certificates of router, nodes, operator and viewer: all of it, or nothing.

    Args:
        folder: Must not exist yet.
        order: What they are for.

    Returns:
        The identities made.

    Raises:
        KeysError: The folder exists, cannot be written, or the order does not fit.
    """
    _check_order(order)
    if folder.exists() or folder.is_symlink():
        has_keys = (folder / "identities.json").exists()
        add = f", or add one certificate with `navloom keys add {folder} NAME --kind viewer`" if has_keys else ""
        raise KeysError(f"{folder}: exists already and is not overwritten; name another folder{add}")
    made = tuple(Identity(kind, kind) for kind in KINDS if kind != "shadow")
    with _writing(folder.parent) as draft:
        authority = _make_authority(draft, order)
        for identity in made:
            _make_certificate(draft, authority, identity, order)
        _write_identities(draft, order, made)
        try:
            draft.rename(folder)
        except OSError as error:
            raise KeysError(f"{folder}: {error.strerror}") from None
    return made


def add_identity(folder: Path, identity: Identity, hosts: Sequence[str], days: int, now: datetime) -> None:
    """Make one more certificate in a folder that `new_authority` made.

    Args:
        folder: With the authority's private key.
        identity: Whose; its name must be new.
        hosts: Where it listens; for kinds that are connected to.
        days: It is good for.
        now: Time of the order, with its time zone.

    Raises:
        KeysError: The name is taken or unfit, or there is no authority; nothing was changed.
    """
    if hosts and identity.kind not in SERVING:
        raise KeysError(f"--host {hosts[0]}: only for --kind nodes; nobody connects to a {identity.kind}")
    realm, robot = _owner(folder)
    order = Order(realm, robot, tuple(hosts), days, now)
    _check_order(order)
    _check_identity(identity)
    with _alone(folder), _writing(folder) as draft:
        try:
            known = read_identities(folder, realm, robot)
        except AccessError as error:
            raise KeysError(str(error)) from None
        ends = (f"{identity.name}-key.pem", f"{identity.name}.pem")
        taken = [end for end in ends if (folder / end).exists()]
        if taken or identity.name in [other.name for other in known]:
            raise KeysError(f"{folder}: there is a certificate of {identity.name!r} already; choose another name")
        _make_certificate(draft, _read_authority(folder), identity, order)
        _write_identities(draft, order, (*known, identity))
        _move_in(draft, folder, ends)


def _check_order(order: Order) -> None:
    for what, name in (("--realm", order.realm), ("--robot", order.robot)):
        if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
            raise KeysError(f"{what} {name!r}: expected letters, digits, _ and -")
    if not 1 <= order.days <= AUTHORITY_DAYS:
        raise KeysError(f"--days {order.days}: expected 1 to {AUTHORITY_DAYS}")
    for host in order.hosts:
        _alternative_name(host)


def _check_identity(identity: Identity) -> None:
    name = identity.name
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name) or name == "ca" or name.endswith("-key"):
        raise KeysError(f"name {name!r}: expected letters, digits, . _ and -, not 'ca' and not ending in -key")
    if identity.kind not in KINDS or identity.kind == "router":
        raise KeysError(f"--kind {identity.kind}: expected {', '.join(kind for kind in KINDS if kind != 'router')}")
    if identity.kind != "shadow":
        if identity.instance:
            raise KeysError(f"--instance {identity.instance}: only for --kind shadow")
        return
    role, _, instance = identity.instance.partition(".")
    if role not in ROLE_TABLES or role == "platform" or not re.fullmatch(r"[A-Za-z0-9_-]+", instance):
        raise KeysError(
            f"--instance {identity.instance or '(none)'}: a shadow is one instance, expected ROLE.NAME, as "
            f"avoider.forces; roles are {', '.join(role for role in ROLE_TABLES if role != 'platform')}"
        )


def _alternative_name(host: str) -> x509.GeneralName:
    address = None
    with contextlib.suppress(ValueError):
        address = ipaddress.ip_address(host)
    if address is not None:
        if address.is_unspecified:
            raise KeysError(f"--host {host}: names no host, expected the address that others connect to")
        return x509.IPAddress(address)
    if len(host) > 253 or not re.fullmatch(r"(?!-)[A-Za-z0-9-]+(\.[A-Za-z0-9-]+)*", host):
        raise KeysError(f"--host {host!r}: expected the router's name or address alone, as base.local or 10.0.0.1")
    return x509.DNSName(host)


@dataclass(frozen=True)
class _Authority:
    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def _make_authority(folder: Path, order: Order) -> _Authority:
    key = ec.generate_private_key(ec.SECP256R1())
    name = _x509_name(f"navloom {order.realm}/{order.robot}")
    usage = x509.KeyUsage(False, False, False, False, False, True, True, False, False)
    certificate = (
        _builder(name, name, key, order.now, AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .sign(key, hashes.SHA256())
    )
    _write_pair(folder, "ca", certificate, key)
    return _Authority(certificate, key)


def _read_authority(folder: Path) -> _Authority:
    try:
        certificate = x509.load_pem_x509_certificate(read_file(folder / "ca.pem", TEXT_MB, KeysError))
        key = serialization.load_pem_private_key(read_file(folder / "ca-key.pem", TEXT_MB, KeysError), None)
    except OSError as error:
        raise KeysError(
            f"{error.filename}: {error.strerror}; add certificates where `navloom keys new` made the folder: "
            "the authority's private key stays there"
        ) from None
    except KeysError:
        raise
    except (ValueError, TypeError):
        raise KeysError(
            f"{folder}: ca.pem or ca-key.pem is broken; make a new folder with `navloom keys new`"
        ) from None
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise KeysError(f"{folder}: ca-key.pem does not belong to ca.pem; restore both from where they were made")
    return _Authority(certificate, key)


def _make_certificate(folder: Path, authority: _Authority, identity: Identity, order: Order) -> None:
    key = ec.generate_private_key(ec.SECP256R1())
    usage = x509.KeyUsage(True, False, False, False, False, False, False, False, False)
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    subject = _x509_name(common_name(identity, order.realm, order.robot))
    issuer_key = authority.certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
    builder = (
        _builder(subject, authority.certificate.subject, key, order.now, order.days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(issuer_key), critical=False)
    )
    if identity.kind in SERVING:
        uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        names = x509.SubjectAlternativeName([_alternative_name(host) for host in order.hosts or HOSTS])
        builder = builder.add_extension(names, critical=False)
    certificate = builder.add_extension(x509.ExtendedKeyUsage(uses), critical=False).sign(
        authority.key, hashes.SHA256()
    )
    _write_pair(folder, identity.name, certificate, key)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, now: datetime, days: int
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - SKEW)
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _x509_name(name: str) -> x509.Name:
    if len(name) > LONGEST_NAME:
        raise KeysError(
            f"name {name!r}: {len(name)} characters, a certificate takes {LONGEST_NAME}; "
            "shorten the realm, the robot's name or the identity's"
        )
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _write_pair(folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
    form = serialization.PrivateFormat.PKCS8
    secret = key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption())
    _write(folder / f"{name}-key.pem", secret, 0o600)
    _write(folder / f"{name}.pem", certificate.public_bytes(serialization.Encoding.PEM), 0o644)


def _write_identities(folder: Path, order: Order, identities: Sequence[Identity]) -> None:
    given = {
        "realm": order.realm,
        "robot": order.robot,
        "identities": [asdict(identity) for identity in identities],
    }
    _write(folder / IDENTITIES, json.dumps(given, indent=2).encode() + b"\n", 0o644)


def _write(path: Path, data: bytes, mode: int) -> None:
    """A new file that never has a wider mode than its own."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _owner(folder: Path) -> tuple[str, str]:
    try:
        given = json_of(read_file(folder / IDENTITIES, TEXT_MB, KeysError), str(folder / IDENTITIES), KeysError)
        return str(given["realm"]), str(given["robot"])
    except OSError as error:
        raise KeysError(f"{folder / IDENTITIES}: {error.strerror}; make the folder with `navloom keys new`") from None
    except (KeyError, TypeError):
        raise KeysError(f"{folder / IDENTITIES}: not a list of identities; restore it, or make a new folder") from None


@contextlib.contextmanager
def _writing(parent: Path) -> Iterator[Path]:
    """A folder for files that are not finished, for this user alone; gone in the end unless it was renamed."""
    try:
        parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=parent, prefix=".keys-"))
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
    """Two that add at once would each lose the other's identity."""
    number = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(number, fcntl.LOCK_EX)
        yield
    finally:
        os.close(number)


def _move_in(draft: Path, folder: Path, names: Sequence[str]) -> None:
    """The list goes last: until then nobody rules by what is half there."""
    placed: list[Path] = []
    try:
        for name in names:
            os.link(draft / name, folder / name)
            placed.append(folder / name)
        (draft / IDENTITIES).replace(folder / IDENTITIES)
    except OSError:
        for path in placed:
            path.unlink()
        raise
