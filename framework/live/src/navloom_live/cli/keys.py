"""`navloom keys`: certificates for a robot that spans hosts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from navloom.cli.command import App
from navloom.cli.options import AsJson

__all__ = ["app"]

app = App(help="Make, renew and revoke the certificates of a robot.", no_args_is_help=True)

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of certificates.")]
Hosts = Annotated[
    list[str] | None,
    typer.Option("--host", metavar="ADDR", help="Name or address others connect to; repeats. Default: this host."),
]
Days = Annotated[int, typer.Option(metavar="N", min=1, max=36500, help="Validity of the certificates, days.")]
DAYS = 825
"""Validity of a certificate if nothing else is asked for, days."""


@app.command()
def new(
    folder: Folder,
    realm: Annotated[str, typer.Option(metavar="NAME", help="robot.realm of the config.")] = "lab",
    robot: Annotated[str, typer.Option(metavar="NAME", help="robot.name of the config.")] = "r1",
    host: Hosts = None,
    days: Days = DAYS,
    as_json: AsJson = False,
) -> None:
    """Make an authority and the robot's first certificates.

    They are for the router, the nodes, an operator and a viewer.
    """
    from datetime import UTC, datetime

    from navloom.cli.output import print_json

    from navloom_live.transport.access import common_name
    from navloom_live.transport.certificate_folder import new_authority
    from navloom_live.transport.certificates import HOSTS, CertificateRequest

    order = CertificateRequest(realm, robot, tuple(host or HOSTS), days, datetime.now(UTC))
    made = new_authority(folder, order)
    if as_json:
        entries = [{"name": one.name, "kind": one.kind, "common_name": common_name(one, realm, robot)} for one in made]
        print_json({"folder": str(folder), "hosts": list(order.hosts), "days": days, "identities": entries})
        return
    typer.echo("Copy to each host, into a folder that only its user can enter (mode 700):")
    for one in made:
        files = f"ca.pem {one.name}.pem {one.name}-key.pem" + _LIST.get(one.kind, "")
        typer.echo(f"  {_FOR[one.kind]}: {files}")
    typer.echo(f"ca-key.pem stays in {folder} and nowhere else: anyone who has it can admit anyone")


@app.command()
def add(
    folder: Folder,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of the certificate, as alice.")],
    kind: Annotated[str, typer.Option(metavar="KIND", help="nodes, operator, viewer or shadow.")],
    instance: Annotated[str, typer.Option(metavar="ROLE.NAME", help="Instance of a shadow, as avoider.forces.")] = "",
    host: Hosts = None,
    days: Days = DAYS,
    as_json: AsJson = False,
) -> None:
    """Make one more certificate.

    A router accepts it once it has the new identities.json, without a restart.
    """
    from datetime import UTC, datetime

    from navloom.cli.output import print_json

    from navloom_live.transport.access import Identity
    from navloom_live.transport.certificate_folder import add_identity

    add_identity(folder, Identity(name, kind, instance), host or (), days, datetime.now(UTC))
    if as_json:
        print_json({"folder": str(folder), "name": name, "kind": kind, "instance": instance, "days": days})
        return
    typer.echo(f"{folder / name}.pem: {kind}; {_COPY_LIST}")


@app.command()
def renew(
    folder: Folder,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME…", help="Whose certificates. Default: every one in the folder.")
    ] = None,
    host: Annotated[
        list[str] | None,
        typer.Option("--host", metavar="ADDR", help="Names or addresses of router and nodes; default: as before."),
    ] = None,
    days: Days = DAYS,
    as_json: AsJson = False,
) -> None:
    """Replace certificates by new ones of the same authority.

    The robot may drive meanwhile.
    """
    from datetime import UTC, datetime

    from navloom.cli.output import print_json

    from navloom_live.transport.certificate_folder import renew as renew_certificates

    made = renew_certificates(folder, names or (), host or (), days, datetime.now(UTC))
    if as_json:
        print_json({"folder": str(folder), "renewed": [certificate.name for certificate in made], "days": days})
        return
    typer.echo(f"renewed: {', '.join(certificate.name for certificate in made)}")
    typer.echo("copy NAME.pem and NAME-key.pem to the hosts that have the old ones; running processes load them")


@app.command()
def revoke(
    folder: Folder,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Whose certificate.")],
    replace: Annotated[
        bool, typer.Option("--replace", help="Make another certificate of that name; the old one stays revoked.")
    ] = False,
    days: Days = DAYS,
    as_json: AsJson = False,
) -> None:
    """Revoke a certificate.

    Its owner can do nothing any more once the router has the new identities.json.
    """
    from datetime import UTC, datetime

    from navloom.cli.output import print_json

    from navloom_live.transport.certificate_folder import revoke as revoke_certificate

    made = revoke_certificate(folder, name, datetime.now(UTC), days if replace else None)
    if as_json:
        print_json({"folder": str(folder), "revoked": name, "replaced": made is not None})
        return
    typer.echo(f"{name}: revoked" + (f"; {folder / name}.pem is another certificate" if made else ""))
    typer.echo(_COPY_LIST)


_FOR = {
    "router": "the router",
    "nodes": "processes of the robot",
    "operator": "people and programs that drive, set goals and swap",
    "viewer": "people and programs that only watch",
}
_LIST = {"router": " identities.json"}
_COPY_LIST = "copy identities.json to the router's host; a running router loads it"
