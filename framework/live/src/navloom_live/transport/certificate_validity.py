"""Validity of certificates: warnings before they expire, and clear errors once they have."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID
from navloom.inputs.bounds import TEXT_MB, read_file

__all__ = ["AUTHORITY", "WARN_AHEAD", "expiry_warnings", "kind_of_certificate", "why_unusable"]

WARN_AHEAD = timedelta(days=30)
"""How long before a certificate expires users are warned."""
AUTHORITY = "ca"
"""Name of the authority's certificate file, without .pem."""


def expiry_warnings(folder: Path, now: datetime) -> tuple[str, ...]:
    """Warnings about certificates in a folder that expire soon or have expired: one sentence for each day.

    Args:
        folder: Folder with ca.pem. Unreadable files are ignored here, and reported by the process that uses them.
        now: Current time, with its time zone.
    """
    ends: dict[str, datetime] = {}
    for path in folder.glob("*.pem"):
        certificate = None if path.stem.endswith("-key") else _read(path)
        if certificate is not None and certificate.not_valid_after_utc - now < WARN_AHEAD:
            ends[path.stem] = certificate.not_valid_after_utc
    told = []
    for day in sorted({end.date() for end in ends.values()}):
        names = sorted(name for name, end in ends.items() if end.date() == day)
        end = min(ends[name] for name in names)
        # With the authority all others end; naming each would hide that.
        if AUTHORITY in names:
            names = [AUTHORITY]
            what = f"the authority of {folder}, and with it every certificate it made, {_when('expires', end, now)}"
        elif len(names) == 1:
            what = f"in {folder} the certificate of {names[0]} {_when('expires', end, now)}"
        else:
            what = f"in {folder} the certificates of {', '.join(names)} {_when('expire', end, now)}"
        told.append(f"{what}; {_remedy(folder, names)}")
    return tuple(told)


def why_unusable(certificate: Path, key: Path, authority: Path, now: datetime) -> str:
    """What is wrong with a certificate and its key, and what to do; empty for nothing.

    Zenoh's own errors name no file.

    Args:
        certificate, key, authority: Files in PEM form.
        now: Current time, with its time zone.
    """
    found = None
    for path in (authority, certificate):
        found = _read(path)
        if found is None:
            return f"certificate {path}: broken; copy it again from where `navloom keys` made it"
        end = found.not_valid_after_utc
        if end <= now:
            return f"certificate {path} {_when('expires', end, now)}; {_remedy(path.parent, [path.stem])}"
        if found.not_valid_before_utc > now:
            return (
                f"certificate {path} is valid from {found.not_valid_before_utc:%Y-%m-%d %H:%M} UTC on, and this host's "
                f"clock says {now:%Y-%m-%d %H:%M} UTC: set the clock"
            )
    try:
        assert found is not None
        fits = load_pem_private_key(read_file(key, TEXT_MB, ValueError), None).public_key() == found.public_key()
    except (ValueError, TypeError):
        fits = False
    return "" if fits else f"private key {key} does not belong to {certificate}; copy both from where they were made"


def kind_of_certificate(path: Path) -> str:
    """Kind of the owner of a certificate, as `operator`; empty if it cannot be read. See `access.common_name`."""
    found = _read(path)
    names = [] if found is None else found.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value).partition(":")[0] if names else ""


def _read(path: Path) -> x509.Certificate | None:
    try:
        return x509.load_pem_x509_certificate(read_file(path, TEXT_MB, ValueError))
    except (OSError, ValueError):
        return None


def _when(verb: str, end: datetime, now: datetime) -> str:
    if end <= now:
        return f"expired on {end:%Y-%m-%d %H:%M} UTC"
    days = (end - now).days
    return f"{verb} on {end:%Y-%m-%d}, in {days} day{'' if days == 1 else 's'}"


def _remedy(folder: Path, names: list[str]) -> str:
    if names == [AUTHORITY]:
        return f"make a new folder with `navloom keys new` and copy it to every host in place of {folder}"
    return f"`navloom keys renew {folder} {' '.join(names)}` renews, on the host with ca-key.pem"
