"""Validity of certificates: warnings ahead and refusals; the time is an argument."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom_live.hosting import live_robot as robot_module
from navloom_live.hosting.live_robot import LiveRobot
from navloom_live.hosting.network import Network
from navloom_live.transport.access import Identity
from navloom_live.transport.certificate_folder import add_identity, new_authority
from navloom_live.transport.certificate_validity import expiry_warnings
from navloom_live.transport.certificates import AUTHORITY_DAYS, HOSTS, CertificateRequest
from navloom_live.transport.links import Link, LinkError, settings

NOW = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
END = "tls/10.0.0.1:7447"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Certificates that are valid for 100 days, alice's for 60."""
    made = tmp_path / "keys"
    new_authority(made, CertificateRequest("lab", "r1", HOSTS, 100, NOW))
    add_identity(made, Identity("alice", "viewer"), (), 60, NOW)
    return made


def after(days: float) -> datetime:
    return NOW + timedelta(days=days)


def test_there_is_no_warning_more_than_thirty_days_ahead(folder: Path) -> None:
    assert expiry_warnings(folder, after(29.9)) == ()


def test_the_first_to_expire_is_named_with_its_day_and_the_command_that_renews_it(folder: Path) -> None:
    assert expiry_warnings(folder, after(49)) == (
        f"in {folder} the certificate of alice expires on 2026-04-30, in 11 days; "
        f"`navloom keys renew {folder} alice` renews, on the host with ca-key.pem",
    )


def test_one_line_names_all_certificates_that_expire_on_a_day(folder: Path) -> None:
    told = expiry_warnings(folder, after(98.5))
    assert len(told) == 2
    assert "the certificate of alice expired on 2026-04-30 12:00 UTC; `navloom keys renew" in told[0]
    assert "certificates of nodes, operator, router, viewer expire on 2026-06-09, in 1 day; " in told[1]
    assert f"renew {folder} nodes operator router viewer`" in told[1]


def test_when_the_authority_expires_all_certificates_do(folder: Path) -> None:
    word = expiry_warnings(folder, after(AUTHORITY_DAYS - 7))[-1]
    assert f"the authority of {folder}, and with it every certificate it made, expires on 2036-02-27, in 7 days" in word
    assert "`navloom keys new`" in word


def test_a_folder_without_certificates_gives_no_warning(tmp_path: Path) -> None:
    (tmp_path / "broken.pem").write_text("-----BEGIN NOTHING", "utf-8")
    assert expiry_warnings(tmp_path, NOW) == ()


@pytest.mark.parametrize(
    ("mode", "identity", "day", "words"),
    [
        ("client", "alice", 60, r"/alice\.pem expired on 2026-04-30 12:00 UTC; `navloom keys renew .* alice`"),
        ("router", "router", 101, r"certificate .*/router\.pem expired on 2026-06-09 12:00 UTC; `navloom keys renew"),
        ("client", "alice", 3651, r"certificate .*/ca\.pem expired on 2036-02-27 12:00 UTC; make a new folder"),
        ("client", "alice", -2, r"ca\.pem is valid from 2026-02-28 12:00 UTC on, .* says 2026-02-27 .*set the clock"),
    ],
    ids=["own", "router's", "authority's", "clock"],
)  # fmt: skip
def test_a_certificate_that_is_not_valid_is_refused_by_name(
    folder: Path, mode: str, identity: str, day: float, words: str
) -> None:
    ends = {"client": ((), (END,)), "router": ((END,), ())}
    link = Link(mode, *ends[mode], folder, identity)
    assert settings(link, after(59))["mode"] == mode
    with pytest.raises(LinkError, match=words):
        settings(link, after(day))


def test_a_key_of_another_certificate_and_a_broken_one_are_refused_by_name(folder: Path) -> None:
    link = Link("client", (), (END,), folder, "alice")
    (folder / "alice-key.pem").write_bytes((folder / "viewer-key.pem").read_bytes())
    with pytest.raises(LinkError, match=r"alice-key\.pem does not belong to .*alice\.pem"):
        settings(link, NOW)
    (folder / "alice.pem").write_text("-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n", "utf-8")
    with pytest.raises(LinkError, match=r"alice\.pem: broken"):
        settings(link, NOW)


def test_up_repeats_a_warning_the_next_day_and_not_before(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    now = 10**6  # s
    clock = SimpleNamespace(monotonic=lambda: now, monotonic_ns=lambda: now * 10**9)
    monkeypatch.setattr(robot_module, "time", clock)
    network = Network("lab", "r1", END, True, folder)
    robot = LiveRobot(assemble(load_config("paper")), network, None, False, said.append)
    seen = []
    for hours in (0, 1, 22, 2, 1):
        now += hours * 3600
        robot.warn_of_expiry()
        seen.append(sum("alice" in text for text in said))
    assert seen == [1, 1, 1, 2, 2]
