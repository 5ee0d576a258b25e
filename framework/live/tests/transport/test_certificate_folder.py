"""Certificates: their contents; no file is overwritten or written in part."""

from __future__ import annotations

import json
import os
import signal
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Address
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from navloom_live.transport import certificate_folder
from navloom_live.transport.access import IDENTITIES, Identity, common_name, read_identities
from navloom_live.transport.certificate_folder import add_identity, new_authority, renew, revoke
from navloom_live.transport.certificates import HOSTS, CertificateRequest, KeysError

NOW = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
ORDER = CertificateRequest("lab", "r1", ("base.local", "10.0.0.1"), 30, NOW)
ALICE = Identity("alice", "viewer")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "keys"
    new_authority(made, ORDER)
    return made


def certificate(folder: Path, name: str) -> x509.Certificate:
    return x509.load_pem_x509_certificate((folder / f"{name}.pem").read_bytes())


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


def test_the_folder_holds_an_authority_and_four_identities_for_its_user_alone(folder: Path) -> None:
    names = ("ca", "nodes", "operator", "router", "viewer")
    expected = sorted([IDENTITIES, *(f"{name}.pem" for name in names), *(f"{name}-key.pem" for name in names)])
    assert sorted(path.name for path in folder.iterdir()) == expected
    assert folder.stat().st_mode & 0o777 == 0o700
    assert {path.stat().st_mode & 0o777 for path in folder.glob("*-key.pem")} == {0o600}
    assert [path.name for path in folder.parent.iterdir()] == ["keys"]


@pytest.mark.parametrize("name", ["router", "nodes", "operator", "viewer"])
def test_a_certificate_is_signed_by_the_authority_and_fits_its_key(folder: Path, name: str) -> None:
    found, authority = certificate(folder, name), certificate(folder, "ca")
    found.verify_directly_issued_by(authority)
    key = load_pem_private_key((folder / f"{name}-key.pem").read_bytes(), None)
    assert isinstance(key, ec.EllipticCurvePrivateKey) and key.curve.name == "secp256r1"
    assert key.public_key() == found.public_key()
    assert found.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value == f"{name}:{name}@lab/r1"
    assert not found.extensions.get_extension_for_class(x509.BasicConstraints).value.ca


def test_a_certificate_is_valid_from_a_day_before_for_the_requested_days(folder: Path) -> None:
    found = certificate(folder, "viewer")
    assert found.not_valid_before_utc == NOW - timedelta(days=1)
    assert found.not_valid_after_utc == NOW + timedelta(days=30)
    assert certificate(folder, "ca").not_valid_after_utc == NOW + timedelta(days=3650)


@pytest.mark.parametrize(
    ("name", "serves"), [("router", True), ("nodes", True), ("operator", False), ("viewer", False)]
)
def test_only_identities_that_listen_have_server_certificates(folder: Path, name: str, serves: bool) -> None:
    extensions = certificate(folder, name).extensions
    uses = set(extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    server = {ExtendedKeyUsageOID.SERVER_AUTH} if serves else set()
    assert uses == {ExtendedKeyUsageOID.CLIENT_AUTH} | server
    named = [extension.value for extension in extensions if isinstance(extension.value, x509.SubjectAlternativeName)]
    assert len(named) == int(serves)
    for names in named:
        assert names.get_values_for_type(x509.DNSName) == ["base.local"]
        assert names.get_values_for_type(x509.IPAddress) == [IPv4Address("10.0.0.1")]


def test_a_folder_that_exists_is_left_as_it_is(folder: Path, tmp_path: Path) -> None:
    before = contents(folder)
    with pytest.raises(KeysError, match="exists already and is not overwritten"):
        new_authority(folder, ORDER)
    assert contents(folder) == before
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "nowhere")
    with pytest.raises(KeysError, match=r"exists already and is not overwritten; name another folder$"):
        new_authority(link, ORDER)


def test_a_folder_that_cannot_be_completed_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(number: int) -> None:
        raise OSError(28, "No space left on device", "disk")

    monkeypatch.setattr(certificate_folder.os, "fsync", full)
    with pytest.raises(KeysError, match="No space left on device"):
        new_authority(tmp_path / "deep" / "keys", ORDER)
    assert list((tmp_path / "deep").iterdir()) == []


def test_a_folder_within_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", "utf-8")
    with pytest.raises(KeysError, match=r"Not a directory|File exists"):
        new_authority(tmp_path / "file" / "keys", ORDER)


def test_an_added_identity_is_signed_and_listed(folder: Path) -> None:
    shadow = Identity("shadow.avoider.forces", "shadow", "avoider.forces")
    add_identity(folder, ALICE, (), 7, NOW)
    add_identity(folder, shadow, (), 7, NOW)
    for name in ("alice", "shadow.avoider.forces"):
        certificate(folder, name).verify_directly_issued_by(certificate(folder, "ca"))
        assert (folder / f"{name}-key.pem").stat().st_mode & 0o777 == 0o600
    assert read_identities(folder, "lab", "r1")[-2:] == (ALICE, shadow)
    assert not list(folder.glob(".keys-*"))


def test_a_name_that_is_taken_is_refused_and_nothing_changes(folder: Path) -> None:
    before = contents(folder)
    for name in ("viewer", "router"):
        with pytest.raises(KeysError, match=f"certificate of '{name}' already"):
            add_identity(folder, Identity(name, "operator"), (), 7, NOW)
    assert contents(folder) == before


def test_a_name_with_only_a_file_left_is_taken_too(folder: Path) -> None:
    add_identity(folder, ALICE, (), 7, NOW)
    given = json.loads((folder / IDENTITIES).read_text("utf-8"))
    given["identities"].pop()
    (folder / IDENTITIES).write_text(json.dumps(given), "utf-8")
    (folder / "alice.pem").unlink()
    before = contents(folder)
    with pytest.raises(KeysError, match="'alice' already"):
        add_identity(folder, ALICE, (), 7, NOW)
    assert contents(folder) == before


def break_replacing(monkeypatch: pytest.MonkeyPatch, broken_step: int) -> None:
    """Make the replacement of one file fail."""
    done, replace_file = [], Path.replace

    def fail(source: Path, target: Path) -> Path:
        done.append(target)
        if len(done) == broken_step:
            raise OSError(5, "Input/output error", str(target))
        return replace_file(source, target)

    monkeypatch.setattr(Path, "replace", fail)


@pytest.mark.parametrize("broken_step", [1, 2, 3])
def test_an_added_certificate_that_cannot_be_completed_is_removed(
    folder: Path, monkeypatch: pytest.MonkeyPatch, broken_step: int
) -> None:
    before = contents(folder)
    break_replacing(monkeypatch, broken_step)
    with pytest.raises(KeysError, match="Input/output error"):
        add_identity(folder, ALICE, (), 7, NOW)
    assert contents(folder) == before


def test_two_simultaneous_additions_are_both_listed(folder: Path) -> None:
    names = [f"v{number}" for number in range(6)]
    adding = [
        threading.Thread(target=add_identity, args=(folder, Identity(name, "viewer"), (), 7, NOW)) for name in names
    ]
    for thread in adding:
        thread.start()
    for thread in adding:
        thread.join()
    assert {identity.name for identity in read_identities(folder, "lab", "r1")} >= set(names)


def test_without_the_authoritys_key_nothing_is_added(folder: Path) -> None:
    (folder / "ca-key.pem").unlink()
    before = contents(folder)
    with pytest.raises(KeysError, match=r"ca-key.pem: No such file.*authority's private key stays there"):
        add_identity(folder, ALICE, (), 7, NOW)
    assert contents(folder) == before


def test_an_authority_that_does_not_fit_is_refused(folder: Path, tmp_path: Path) -> None:
    new_authority(tmp_path / "other", ORDER)
    (folder / "ca-key.pem").write_bytes((tmp_path / "other" / "ca-key.pem").read_bytes())
    with pytest.raises(KeysError, match="does not belong to"):
        add_identity(folder, ALICE, (), 7, NOW)
    (folder / "ca-key.pem").write_text("nothing", "utf-8")
    with pytest.raises(KeysError, match="broken"):
        add_identity(folder, ALICE, (), 7, NOW)


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (CertificateRequest("lab/x", "r1", HOSTS, 30, NOW), "--realm 'lab/x'"),
        (CertificateRequest("lab", "*", HOSTS, 30, NOW), "--robot '\\*'"),
        (CertificateRequest("lab", "r1", HOSTS, 0, NOW), "--days 0: expected 1 to 3650"),
        (CertificateRequest("lab", "r1", HOSTS, 3651, NOW), "--days 3651"),
        (CertificateRequest("lab", "r1", ("tls/10.0.0.1:7447",), 30, NOW), "--host 'tls/10.0.0.1:7447'"),
        (CertificateRequest("lab", "r1", ("0.0.0.0",), 30, NOW), "--host 0.0.0.0: names no host"),
        (CertificateRequest("lab", "r" * 60, HOSTS, 30, NOW), "characters, a certificate takes 64"),
    ],
    ids=["realm", "robot", "no days", "too many days", "endpoint", "wildcard", "long name"],
)
def test_an_invalid_request_creates_nothing(tmp_path: Path, order: CertificateRequest, words: str) -> None:
    with pytest.raises(KeysError, match=words):
        new_authority(tmp_path / "keys", order)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("identity", "hosts", "words"),
    [
        (Identity("ca", "viewer"), (), "name 'ca'"),
        (Identity("a/b", "viewer"), (), "name 'a/b'"),
        (Identity("nodes-key", "viewer"), (), "not ending in -key"),
        (Identity("bob", "router"), (), "--kind router: expected nodes, operator, viewer, shadow"),
        (Identity("bob", "viewer", "avoider.forces"), (), "only for --kind shadow"),
        (Identity("bob", "viewer"), ("10.0.0.2",), "a viewer accepts no connections"),
        (Identity("bob", "shadow"), (), "--instance \\(none\\).*expected ROLE.NAME"),
        (Identity("bob", "shadow", "gate.main"), (), "roles are localizer, mapper"),
        (Identity("bob", "shadow", "platform.sim"), (), "roles are localizer, mapper"),
        (Identity("bob", "shadow", "avoider.*"), (), "expected ROLE.NAME"),
        (Identity("n" * 60, "viewer"), (), "a certificate takes 64"),
    ],
    ids=[
        "the authority's name",
        "path",
        "name of a key",
        "second router",
        "needless instance",
        "needless host",
        "no instance",
        "gate",
        "platform",
        "wildcard",
        "long name",
    ],
)
def test_an_invalid_identity_changes_nothing(
    folder: Path, identity: Identity, hosts: tuple[str, ...], words: str
) -> None:
    before = contents(folder)
    with pytest.raises(KeysError, match=words):
        add_identity(folder, identity, hosts, 7, NOW)
    assert contents(folder) == before


def test_a_folder_without_our_certificates_is_refused(tmp_path: Path) -> None:
    with pytest.raises(KeysError, match="navloom keys new"):
        add_identity(tmp_path, ALICE, (), 7, NOW)
    (tmp_path / IDENTITIES).write_text("[]", "utf-8")
    with pytest.raises(KeysError, match="not a list of identities"):
        add_identity(tmp_path, ALICE, (), 7, NOW)


def public_key(folder: Path, name: str) -> object:
    return certificate(folder, name).public_key()


def test_a_renewed_certificate_has_a_new_key_and_time_and_the_same_name_and_hosts(folder: Path) -> None:
    before = {name: certificate(folder, name) for name in ("router", "nodes", "operator", "viewer")}
    listed = (folder / IDENTITIES).read_bytes()
    made = renew(folder, (), (), 60, NOW + timedelta(days=20))
    assert [one.name for one in made] == list(before)
    for name, old in before.items():
        new = certificate(folder, name)
        new.verify_directly_issued_by(certificate(folder, "ca"))
        assert new.subject == old.subject and new.public_key() != old.public_key()
        assert new.not_valid_after_utc == NOW + timedelta(days=80)
        key = load_pem_private_key((folder / f"{name}-key.pem").read_bytes(), None)
        assert isinstance(key, ec.EllipticCurvePrivateKey) and key.public_key() == new.public_key()
        assert (folder / f"{name}-key.pem").stat().st_mode & 0o777 == 0o600
    hosts = certificate(folder, "router").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert [str(host.value) for host in hosts] == ["base.local", "10.0.0.1"]
    assert (folder / IDENTITIES).read_bytes() == listed and not list(folder.glob(".keys-*"))


def test_only_named_identities_are_renewed_and_their_hosts_can_change(folder: Path) -> None:
    before = contents(folder)
    renew(folder, ("nodes",), ("brain.local",), 60, NOW)
    changed = {name for name, data in contents(folder).items() if before[name] != data}
    assert changed == {"nodes.pem", "nodes-key.pem"}
    hosts = certificate(folder, "nodes").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert hosts.get_values_for_type(x509.DNSName) == ["brain.local"]


@pytest.mark.parametrize(
    ("names", "hosts", "words"),
    [
        (("viewer", "carol"), (), "no certificate of 'carol'; there are router, nodes, operator, viewer"),
        (("ca",), (), "the authority is not renewed; make a new folder"),
        (("viewer",), ("10.0.0.2",), "--host 10.0.0.2: only for router and nodes"),
        (("router",), ("0.0.0.0",), "--host 0.0.0.0: names no host"),
    ],
    ids=["unknown", "authority", "needless host", "wildcard"],
)
def test_an_invalid_renewal_changes_nothing(
    folder: Path, names: tuple[str, ...], hosts: tuple[str, ...], words: str
) -> None:
    before = contents(folder)
    with pytest.raises(KeysError, match=words):
        renew(folder, names, hosts, 60, NOW)
    assert contents(folder) == before


@pytest.mark.parametrize("broken_step", [1, 2, 5, 8])
def test_a_renewal_that_cannot_be_completed_is_undone(
    folder: Path, monkeypatch: pytest.MonkeyPatch, broken_step: int
) -> None:
    before = contents(folder)
    break_replacing(monkeypatch, broken_step)
    with pytest.raises(KeysError, match="Input/output error"):
        renew(folder, (), (), 60, NOW)
    assert contents(folder) == before


def pair_fits(folder: Path, name: str) -> bool:
    """Whether the private key of an identity is that of its certificate."""
    key = load_pem_private_key((folder / f"{name}-key.pem").read_bytes(), None)
    return key.public_key() == certificate(folder, name).public_key()


def killed_at(step: int, work: Callable[[], object]) -> bool:
    """Do something in a process that is killed before a step that renames, links or removes; True if it got so far."""
    child = os.fork()
    if child == 0:
        left = [step]

        def counted(call: Callable[..., object]) -> Callable[..., object]:
            def act(*given: object, **more: object) -> object:
                left[0] -= 1
                if left[0] == 0:
                    os.kill(os.getpid(), signal.SIGKILL)
                return call(*given, **more)

            return act

        for name in ("replace", "symlink", "unlink", "mkdir"):
            setattr(os, name, counted(getattr(os, name)))
        work()
        os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


@pytest.mark.parametrize("is_first", [True, False], ids=["plain files", "renewed before"])
def test_a_renewal_that_is_killed_leaves_pairs_that_fit_and_the_next_command_clears_up(
    folder: Path, is_first: bool
) -> None:
    """Every step is tried: two files are never replaced at once, but one link to both is."""
    if not is_first:
        renew(folder, (), (), 60, NOW)
    for step in range(1, 200):
        was_killed = killed_at(step, lambda: renew(folder, ("nodes", "viewer"), (), 60, NOW))
        assert all(pair_fits(folder, name) for name in ("router", "nodes", "operator", "viewer")), step
        if not was_killed:
            break
    assert 10 < step < 199
    add_identity(folder, ALICE, (), 7, NOW)
    assert pair_fits(folder, "alice")
    kept = [path for path in (folder / ".pairs").iterdir() if not path.is_symlink()]
    assert not list(folder.glob(".keys-*")) and len(kept) == (5 if not is_first else 3)


def test_no_certificate_outlives_its_authority(folder: Path) -> None:
    late = NOW + timedelta(days=3600)
    renew(folder, ("viewer",), (), 825, late)
    assert certificate(folder, "viewer").not_valid_after_utc == NOW + timedelta(days=3650)
    before = contents(folder)
    with pytest.raises(KeysError, match="the authority expired on 2036-02-27; make a new folder"):
        renew(folder, ("viewer",), (), 825, NOW + timedelta(days=3651))
    assert contents(folder) == before


def test_a_revoked_identity_is_no_longer_listed_and_its_files_are_gone(folder: Path) -> None:
    add_identity(folder, ALICE, (), 7, NOW)
    assert revoke(folder, "alice", NOW) is None
    assert "alice" not in [identity.name for identity in read_identities(folder, "lab", "r1")]
    assert not list(folder.glob("alice*"))
    with pytest.raises(KeysError, match="alice is revoked; `navloom keys add"):
        revoke(folder, "alice", NOW)


def test_reusing_a_name_does_not_admit_its_revoked_key(folder: Path) -> None:
    names = []
    for _ in range(3):
        add_identity(folder, ALICE, (), 7, NOW)
        names.append(certificate(folder, "alice").subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)
        (listed,) = [identity for identity in read_identities(folder, "lab", "r1") if identity.name == "alice"]
        assert common_name(listed, "lab", "r1") == names[-1]
        revoke(folder, "alice", NOW)
    assert names == ["viewer:alice@lab/r1", "viewer:alice#2@lab/r1", "viewer:alice#3@lab/r1"]


def test_a_revoked_certificate_can_be_replaced_at_once(folder: Path) -> None:
    old = public_key(folder, "nodes")
    made = revoke(folder, "nodes", NOW, 60)
    assert made == Identity("nodes", "nodes", "", 2) and made in read_identities(folder, "lab", "r1")
    assert public_key(folder, "nodes") != old
    name = certificate(folder, "nodes").subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value
    assert name == "nodes:nodes#2@lab/r1"
    assert renew(folder, ("nodes",), (), 60, NOW) == (made,)


@pytest.mark.parametrize(
    ("name", "days", "words"),
    [
        ("router", 60, "router's certificate cannot be revoked.*make a new folder"),
        ("nodes", None, "without the certificate of nodes the robot cannot run; --replace"),
        ("carol", None, "no certificate of 'carol'"),
    ],
)
def test_a_revocation_without_effect_is_refused(folder: Path, name: str, days: int | None, words: str) -> None:
    before = contents(folder)
    with pytest.raises(KeysError, match=words):
        revoke(folder, name, NOW, days)
    assert contents(folder) == before


def test_a_revocation_that_cannot_be_completed_is_undone(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = contents(folder)
    break_replacing(monkeypatch, 3)
    with pytest.raises(KeysError, match="Input/output error"):
        revoke(folder, "viewer", NOW, 60)
    assert contents(folder) == before


def test_a_list_of_an_earlier_version_is_read(folder: Path) -> None:
    given = json.loads((folder / IDENTITIES).read_text("utf-8"))
    del given["revoked"]
    for entry in given["identities"]:
        del entry["generation"]
    (folder / IDENTITIES).write_text(json.dumps(given), "utf-8")
    revoke(folder, "viewer", NOW)
    assert [identity.name for identity in read_identities(folder, "lab", "r1")] == ["router", "nodes", "operator"]
