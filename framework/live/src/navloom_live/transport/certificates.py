"""X.509 certificates: a robot's certificate authority, and the certificates that it signs."""

from __future__ import annotations

import contextlib
import ipaddress
import os
import re
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from navloom.inputs.bounds import TEXT_MB, read_file

from navloom_live.transport.access import Identity, common_name
from navloom_live.transport.links import LinkError

__all__ = ["AUTHORITY_DAYS", "HOSTS", "SERVING", "CertificateRequest", "KeysError", "alternative_name", "hosts_of",
           "make_authority", "make_certificate", "read_authority", "write_new"]  # fmt: skip

HOSTS = ("localhost", "127.0.0.1")
"""Default names and addresses of the router."""
LONGEST_NAME = 64
"""Longest common name, in characters: upper bound of X.520."""
AUTHORITY_DAYS = 3650
SKEW = timedelta(days=1)
"""How long before its making a certificate becomes valid: a robot without a battery-backed clock may be behind."""
SERVING = ("router", "nodes")
"""Kinds that may also accept connections."""


class KeysError(LinkError):
    """Certificates cannot be made. The text says why."""


@dataclass(frozen=True)
class CertificateRequest:
    """A request for certificates.

    Attributes:
        realm, robot: Names of the robot.
        hosts: Names and addresses where its router listens.
        days: Validity, days.
        now: Time of the request, with its time zone.
    """

    realm: str
    robot: str
    hosts: tuple[str, ...]
    days: int
    now: datetime


def alternative_name(host: str) -> x509.GeneralName:
    """A host name or address in a certificate. Raises KeysError if it is neither."""
    address = None
    with contextlib.suppress(ValueError):
        address = ipaddress.ip_address(host)
    if address is not None:
        # A certificate for 0.0.0.0 fits no address that a client connects to.
        if address.is_unspecified:
            raise KeysError(f"--host {host}: names no host, expected the address that others connect to")
        return x509.IPAddress(address)
    if len(host) > 253 or not re.fullmatch(r"(?!-)[A-Za-z0-9-]+(\.[A-Za-z0-9-]+)*", host):
        raise KeysError(f"--host {host!r}: expected the router's name or address alone, as base.local or 10.0.0.1")
    return x509.DNSName(host)


def hosts_of(path: Path) -> tuple[str, ...]:
    """Host names and addresses of a certificate. Raises KeysError if it cannot be read or has none."""
    try:
        names = x509.load_pem_x509_certificate(read_file(path, TEXT_MB, KeysError)).extensions.get_extension_for_class(
            x509.SubjectAlternativeName
        )
    except OSError as error:
        raise KeysError(f"{path}: {error.strerror}; give its address with --host") from None
    except (ValueError, x509.ExtensionNotFound):
        raise KeysError(f"{path}: names no hosts; give its address with --host") from None
    return tuple(str(name.value) for name in names.value)


@dataclass(frozen=True)
class Authority:
    """The certificate authority, which signs every other certificate.

    Attributes:
        certificate, key: Its own certificate and private key.
    """

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def make_authority(folder: Path, order: CertificateRequest) -> Authority:
    """Make ca.pem and ca-key.pem in a folder."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = _x509_name(f"navloom {order.realm}/{order.robot}")
    usage = x509.KeyUsage(False, False, False, False, False, True, True, False, False)
    certificate = (
        _builder(name, name, key, order.now, order.now + timedelta(days=AUTHORITY_DAYS))
        # No further authorities below it: a stolen certificate must not sign others.
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .sign(key, hashes.SHA256())
    )
    _write_pair(folder, "ca", certificate, key)
    return Authority(certificate, key)


def read_authority(folder: Path) -> Authority:
    """The authority of a folder. Raises KeysError if it is missing or broken."""
    try:
        certificate = x509.load_pem_x509_certificate(read_file(folder / "ca.pem", TEXT_MB, KeysError))
        key = serialization.load_pem_private_key(read_file(folder / "ca-key.pem", TEXT_MB, KeysError), None)
    except OSError as error:
        raise KeysError(
            f"{error.filename}: {error.strerror}; make certificates where `navloom keys new` made the folder: "
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
    return Authority(certificate, key)


def make_certificate(folder: Path, authority: Authority, identity: Identity, order: CertificateRequest) -> None:
    """Make a certificate and its private key in a folder. It expires no later than its authority."""
    key = ec.generate_private_key(ec.SECP256R1())
    usage = x509.KeyUsage(True, False, False, False, False, False, False, False, False)
    # An operator's or viewer's certificate must not pass for the router's.
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    subject = _x509_name(common_name(identity, order.realm, order.robot))
    issuer_key = authority.certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
    end = min(order.now + timedelta(days=order.days), authority.certificate.not_valid_after_utc)
    if end <= order.now:
        raise KeysError(
            f"{identity.name}: the authority expired on {end:%Y-%m-%d}; make a new folder with `navloom keys new`"
        )
    builder = (
        _builder(subject, authority.certificate.subject, key, order.now, end)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(issuer_key), critical=False)
    )
    if identity.kind in SERVING:
        uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        names = x509.SubjectAlternativeName([alternative_name(host) for host in order.hosts or HOSTS])
        builder = builder.add_extension(names, critical=False)
    certificate = builder.add_extension(x509.ExtendedKeyUsage(uses), critical=False).sign(
        authority.key, hashes.SHA256()
    )
    _write_pair(folder, identity.name, certificate, key)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, now: datetime, end: datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - SKEW)
        .not_valid_after(end)
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
    # Without a passphrase: a robot starts without anybody who types one.
    secret = key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption())
    write_new(folder / f"{name}-key.pem", secret, 0o600)
    write_new(folder / f"{name}.pem", certificate.public_bytes(serialization.Encoding.PEM), 0o644)


def write_new(path: Path, data: bytes, mode: int) -> None:
    """Write a new file, which has its mode from the beginning."""
    # `chmod` after the fact would leave a private key readable for a moment.
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(data)
        file.flush()
        # Before the file is moved into place: after a power cut, a name must not lead to an empty file.
        os.fsync(file.fileno())
