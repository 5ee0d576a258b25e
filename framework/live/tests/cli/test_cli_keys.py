"""`navloom keys` as people and scripts use it."""

from __future__ import annotations

import json
import re
import shutil
import stat
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from navloom.config import load_config
from navloom_live.cli.keys import app
from navloom_live.hosting.network import network_of
from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.transport.access import Identity, read_identities
from navloom_live.transport.certificate_folder import new_authority
from navloom_live.transport.certificates import HOSTS, CertificateRequest, KeysError
from navloom_live.transport.links import Link, settings
from typer.testing import CliRunner

RUNNER = CliRunner()


def run(*words: str) -> str:
    done = RUNNER.invoke(app, list(words), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_new_prints_which_files_to_copy_where_and_which_stay(tmp_path: Path) -> None:
    said = run("new", str(tmp_path / "keys"))
    assert "the router: ca.pem router.pem router-key.pem identities.json\n" in said
    assert "people and programs that only watch: ca.pem viewer.pem viewer-key.pem\n" in said
    assert "ca-key.pem stays" in said


def test_new_as_json(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    words = (
        "--realm",
        "plant",
        "--robot",
        "r7",
        "--host",
        "base.local",
        "--host",
        "10.0.0.1",
        "--days",
        "90",
        "--json",
    )
    found = json.loads(run("new", str(folder), *words))
    assert found["folder"] == str(folder) and found["hosts"] == ["base.local", "10.0.0.1"] and found["days"] == 90
    assert [identity["name"] for identity in found["identities"]] == ["router", "nodes", "operator", "viewer"]
    assert found["identities"][1]["common_name"] == "nodes:nodes@plant/r7"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_link_accepts_the_certificates_of_new(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    run("new", str(folder), "--robot", "r7")
    found = settings(Link("router", ("tls/0.0.0.0:7447",), (), folder, "router", robot="r7"))
    assert {subject["id"] for subject in found["access_control"]["subjects"]} - {"sockets"} == {
        f"{name}:{name}@lab/r7" for name in ("router", "nodes", "operator", "viewer")
    }


def test_add_a_shadow(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    run("new", str(folder))
    said = run("add", str(folder), "shadow.avoider.forces", "--kind", "shadow", "--instance", "avoider.forces")
    assert "identities.json" in said and "a running router loads it" in said
    assert read_identities(folder, "lab", "r1")[-1] == Identity("shadow.avoider.forces", "shadow", "avoider.forces")
    found = json.loads(run("add", str(folder), "bob", "--kind", "operator", "--json"))
    assert (found["name"], found["kind"], found["days"]) == ("bob", "operator", 825)


def test_a_second_new_is_refused_in_one_message(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    run("new", str(folder))
    with pytest.raises(KeysError, match="navloom keys add"):
        run("new", str(folder))


def test_the_router_admits_the_two_hosts_of_the_docs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).resolve().parents[4] / "docs" / "security.md").read_text("utf-8")
    (config,) = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (session,) = re.findall(r"^```console\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    lines = [line.partition("$")[2].split() for line in session.splitlines()]
    assert len(lines) == 5
    monkeypatch.chdir(tmp_path)
    Path("robot.toml").write_text('[world]\nref = "paper_gates"\n' + config, "utf-8")
    assert lines[0][:2] == ["navloom", "keys"]
    run(*lines[0][2:])
    loaded = load_config("robot.toml")
    at_base, at_brain = (network_of(loaded.config, host, insecure=False) for host in ("base", "brain"))
    router = at_base.router_link()
    assert router is not None and at_brain.router_link() is None
    assert settings(router)["listen"]["endpoints"] == ["tls/10.0.0.1:7447"]
    copied = tmp_path / "robot" / "keys"
    copied.mkdir(parents=True)
    for pattern in lines[1][3:6]:
        for path in tmp_path.glob(pattern):
            shutil.copy(path, copied)
    monkeypatch.chdir(copied.parent)
    links = at_brain.links(RobotFolder("lab", "r1"), {"think": [("planner", "astar")], "drive": [("gate", "main")]})
    for link in (*links.values(), at_brain.outsider(RobotFolder("lab", "r1"), {})):
        assert settings(link)["transport"]["link"]["tls"]["enable_mtls"] is True


def test_renew_prints_whose_certificates_and_where_to_copy_them(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    run("new", str(folder))
    said = run("renew", str(folder))
    assert "renewed: router, nodes, operator, viewer\n" in said and "copy NAME.pem and NAME-key.pem" in said
    found = json.loads(run("renew", str(folder), "viewer", "--days", "30", "--json"))
    assert found == {"folder": str(folder), "renewed": ["viewer"], "days": 30}


def test_revoke_prints_what_to_copy(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    run("new", str(folder))
    run("add", str(folder), "bob", "--kind", "operator")
    said = run("revoke", str(folder), "bob")
    assert "bob: revoked\n" in said and "copy identities.json to the router's host" in said
    found = json.loads(run("revoke", str(folder), "viewer", "--replace", "--json"))
    assert found == {"folder": str(folder), "revoked": "viewer", "replaced": True}
    assert read_identities(folder, "lab", "r1")[-1] == Identity("viewer", "viewer", "", 2)


def test_a_command_refuses_an_expired_certificate_by_name_and_says_what_renews_it(tmp_path: Path) -> None:
    folder, then = tmp_path / "keys", datetime.now(UTC) - timedelta(days=9, hours=12)
    new_authority(folder, CertificateRequest("lab", "r1", HOSTS, 9, then))
    words = ["status", "--connect", "tls/127.0.0.1:9", "--keys", str(folder)]
    done = subprocess.run(
        [sys.executable, "-c", "from navloom.cli import main; main()", *words],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    said = done.stderr.splitlines()[-1]
    assert f"certificate {folder}/viewer.pem expired on" in said and f"`navloom keys renew {folder} viewer`" in said
