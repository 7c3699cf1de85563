"""`rig accounts` keeps the accounts by which people log in to the operator's console."""

import json
import os
import stat
import sys
from pathlib import Path

import click

from rig.accounts import FILE_NAME, AccountFile, AccountsError, Passwords, Role, checked_password
from rig.cli.application import EXIT_BAD_INPUT, ending
from rig.cli.option_types import text
from rig.stream import state_folder

_MOST_BYTES = 4096
_FILE = click.Path(path_type=Path, dir_okay=False)
_name = click.argument("name", type=text)
_role = click.Choice([str(role) for role in Role])
_file = click.option(
    "--file", "path", type=_FILE, metavar="FILE",
    help="The file of accounts; console-accounts.json beside the console's token if not given.",
)  # fmt: skip
_password_file = click.option(
    "--password-file", type=click.Path(path_type=Path, dir_okay=False, allow_dash=True),
    metavar="FILE", help="Read the password's one line from a file that only you may read, or `-`.",
)  # fmt: skip


@click.group()
def command() -> None:
    """Keep the accounts by which people log in to `rig console`, with name and password.

    A viewer sees everything and may stop. An operator also starts, holds, goes on, skips and
    acknowledges. An engineer also changes the control of a test that runs. Once there is an
    account, consoles of this user that are started ask for name and password in place of the token;
    without any they go on as before. A change holds at once, also for who is logged in.
    Exit code: 0 if it was done, 2 if not, with the reason.
    """


@command.command()
@_name
@click.option("--role", type=_role, required=True, help="What the account may do.")
@_password_file
@_file
def add(name: str, role: str, password_file: Path | None, path: Path | None) -> int:
    """Make an account for NAME; its password is asked for, twice."""
    with ending(EXIT_BAD_INPUT, AccountsError, ValueError, before="accounts: "):
        file = _accounts(path)
        hashed = _hashed(name, password_file)
        account = file.add(name, Role[role.upper()], hashed)
        click.echo(f"{account.name}: {account.role}, in {file.path}")
    return 0


@command.command("list")
@click.option("--json", "as_json", is_flag=True, help="As one JSON list.")
@_file
def list_accounts(as_json: bool, path: Path | None) -> int:
    """Show names and roles, in the order in which the accounts were made."""
    with ending(EXIT_BAD_INPUT, AccountsError, OSError, before="accounts: "):
        file = _accounts(path)
        accounts = [*file.read().values()] if file.exists() else []
    if as_json:
        told = [{"name": each.name, "role": str(each.role)} for each in accounts]
        click.echo(json.dumps(told, ensure_ascii=False))
        return 0
    for each in accounts:
        click.echo(f"{each.role!s:9} {each.name}")
    if not accounts:
        then = "is refused" if file.exists() else "asks for its token"
        click.echo(f"{file.path}: no accounts; a console that is started {then}")
    return 0


@command.command()
@_name
@_file
def remove(name: str, path: Path | None) -> int:
    """Remove NAME's account; who is logged in by it is logged out."""
    with ending(EXIT_BAD_INPUT, AccountsError, before="accounts: "):
        file = _accounts(path)
        account = file.remove(name)
        click.echo(f"{account.name}: removed from {file.path}")
    return 0


@command.command("role")
@_name
@click.argument("role", type=_role)
@_file
def set_role(name: str, role: str, path: Path | None) -> int:
    """Give NAME's account another ROLE, which holds at once."""
    with ending(EXIT_BAD_INPUT, AccountsError, before="accounts: "):
        account = _accounts(path).change(name, role=Role[role.upper()])
        click.echo(f"{account.name}: {account.role} from now on")
    return 0


@command.command("password")
@_name
@_password_file
@_file
def set_password(name: str, password_file: Path | None, path: Path | None) -> int:
    """Give NAME's account another password; who is logged in by it is logged out."""
    with ending(EXIT_BAD_INPUT, AccountsError, ValueError, before="accounts: "):
        file = _accounts(path)
        file.check(name)
        account = file.change(name, password=_hashed(name, password_file))
        click.echo(f"{account.name}: has another password from now on")
    return 0


def _accounts(path: Path | None) -> AccountFile:
    return AccountFile(path or state_folder() / FILE_NAME)


def _hashed(name: str, password_file: Path | None) -> str:
    """Ask for a password or read it from a file, and return its hash.

    Raises:
        ValueError: it cannot be read, or may be no password.
    """
    if password_file is not None:
        password = _read(password_file)
    elif sys.stdin.isatty():
        password = click.prompt("Password", hide_input=True, confirmation_prompt=True)
    else:
        raise ValueError("password: there is no terminal to ask at; give --password-file")
    return Passwords().hash(checked_password(password, name))


def _read(path: Path) -> str:
    """Return the one line of a password file, without the end of the line.

    Raises:
        ValueError: it cannot be read, others may read it, or it is not one line of UTF-8.
    """
    try:
        if str(path) == "-":
            content = sys.stdin.buffer.read(_MOST_BYTES + 1)
        else:
            with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
                mode = os.fstat(file.fileno()).st_mode
                if stat.S_ISREG(mode) and mode & 0o077:
                    raise ValueError(f"{path}: may be read by others; chmod 600 {path}")
                content = file.read(_MOST_BYTES + 1)
        line = content.decode().removesuffix("\n").removesuffix("\r")
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: is no UTF-8; write the password in UTF-8") from None
    if "\n" in line or len(content) > _MOST_BYTES:
        raise ValueError(f"{path}: holds more than one line; it is for the password alone")
    return line
