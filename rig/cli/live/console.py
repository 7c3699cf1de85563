"""`rig console` serves the operator's web page."""

import time
from contextlib import suppress
from pathlib import Path

import click

from rig.cli.application import EXIT_BAD_INPUT, ending
from rig.configuration import ConfigError, Problem, load_stream

from .following import endpoints, follows_streams

_FILE = click.Path(path_type=Path, dir_okay=False)
_LISTEN = "127.0.0.1:8480"


@click.command()
@click.option(
    "--listen", default=_LISTEN, show_default=True, metavar="HOST:PORT",
    help="Where the page is served; off this machine only with --certificate and --key.",
)  # fmt: skip
@click.option("--certificate", type=_FILE, help="Of this server, PEM.")
@click.option("--key", type=_FILE, help="Of that certificate, PEM.")
@click.option(
    "--name", "names", multiple=True, metavar="HOST",
    help="What browsers may call this server, besides the host it listens on.",
)  # fmt: skip
@click.option(
    "--campaign", "campaigns", multiple=True, metavar="CAMPAIGN",
    help="A campaign, or a folder of them, that may be started; the shipped ones if not given.",
)  # fmt: skip
@click.option("--rig", "rig_reference", metavar="RIG", help="Start them on this rig.")
@click.option(
    "--runs", type=click.Path(path_type=Path, file_okay=False), default=Path("runs"),
    show_default=True, metavar="DIR", help="Folder for what is started.",
)  # fmt: skip
@click.option(
    "--accounts", "accounts_path", type=_FILE, metavar="FILE",
    help="Accounts to log in by, made by `rig accounts`; those of this user if there are any.",
)  # fmt: skip
@follows_streams
def command(
    listen: str,
    certificate: Path | None,
    key: Path | None,
    names: tuple[str, ...],
    campaigns: tuple[str, ...],
    rig_reference: str | None,
    runs: Path,
    accounts_path: Path | None,
    connect: tuple[str, ...],
    profile: str,
) -> int:
    """Serve the operator's web page: watch rigs live, start, hold, skip, retry, stop.

    The page shows the live stream, and its commands are signed as those of `rig monitor --send`.
    One logs in with a token, which is printed, and kept in a file that only you may read; or, once
    `rig accounts add` has made accounts, with name and password. docs/console.md describes the
    rest. Campaigns can be started only where the profile's endpoints are all on this
    machine and --connect is not given. Ctrl-C ends the page; campaigns go on.
    """
    from rig.accounts import FILE_NAME, AccountFile, AccountsError
    from rig.console import AddressError, Served, address_of, console_token, offers_of, serve
    from rig.stream import KeyFileError, StreamClient, StreamError, state_folder

    settings = load_stream(profile)
    where = endpoints(connect)
    offers = offers_of(campaigns)
    with ending(
        EXIT_BAD_INPUT, AccountsError, KeyFileError, StreamError, OSError, before="console: "
    ):
        try:
            address = address_of(listen, names, certificate, key)
        except AddressError as error:
            problem = Problem("--listen", 0, 0, "console", listen, str(error), "")
            raise ConfigError([problem]) from None
        accounts = AccountFile(accounts_path or state_folder() / FILE_NAME)
        has_accounts = accounts_path is not None or accounts.exists()
        token, token_file = console_token()
        with StreamClient(settings, where) as client:
            may_start = settings.is_local and not where
            served = Served(offers, runs, profile if may_start else "", rig_reference)

            def ready(url: str) -> None:
                click.echo(f"console: {url}")
                if has_accounts:
                    click.echo(f"accounts: {accounts.path}; log in with name and password")
                else:
                    click.echo(f"token:   {token}  (also in {token_file})")

            secrets = token_file.parent
            serve(
                client, token, served, address, log=_log, ready=ready, secrets=secrets,
                accounts=accounts if has_accounts else None,
            )  # fmt: skip
    return 0


def _log(text: str) -> None:
    shown = "".join(c if c.isprintable() else " " for c in text)
    # An order to stop a rig must not fail because the log cannot be written.
    with suppress(OSError):
        click.echo(f"{time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())} {shown}", err=True)
