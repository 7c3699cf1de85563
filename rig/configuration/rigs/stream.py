"""Profiles of the live stream say where it listens, who may read it, and who may command."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field

from rig.configuration.reading import (
    Located,
    Physical,
    Schema,
    Sources,
    elements_of,
    load,
    read_mapping,
    shown,
)
from rig.stream import (
    COMMANDS,
    LONGEST_NAME,
    Access,
    CommandName,
    Endpoint,
    Login,
    Mode,
    Operator,
    StreamSettings,
    Tls,
)

OFF: Final = "off"
"""The text that users write in place of a profile if they want no stream."""
DEFAULT: Final = "loopback"


class StreamFile(Schema):
    """Keys of a stream's profile; the mappings under them have their own schemas."""

    name: str
    description: str = ""
    mode: Mode = "peer"
    listen: list[str] | None = None
    connect: list[str] = Field(default_factory=list)
    tls: Any = None
    login: Any = None
    access: Any = None
    commands: Any = None
    batch: Annotated[int, Field(ge=1, le=200)] = 20
    history: Annotated[float, Physical("s", 0.0, 120.0, 30.0)] = 30.0
    heartbeat: Annotated[float, Physical("s", 0.1, 10.0, 0.5)] = 0.5
    channels: list[str] = Field(default_factory=list)


class TlsFile(Schema):
    """Keys of `tls`, which name PEM files by paths that are relative to the profile's folder."""

    authority: str
    certificate: str
    private_key: str


class LoginFile(Schema):
    """Keys of `login`; its paths are relative to the profile's folder."""

    user: str
    password_file: str
    users: str | None = None


class AccessFile(Schema):
    """Keys of `access`, which list common names of certificates, or names of users."""

    readers: list[str] = Field(default_factory=list)
    commanders: list[str] = Field(default_factory=list)
    rigs: list[str] = Field(default_factory=list)


class OperatorFile(Schema):
    """Keys of one entry of `commands`."""

    operator: str
    allow: list[CommandName]
    key: str | None = None


def load_stream(reference: str | Path, base: Path | None = None) -> StreamSettings:
    """Return the settings of the stream that a profile describes, given by path or by name.

    `base` is the folder from which relative paths are resolved; the working directory if None.

    Raises:
        ConfigError: lists every problem of the file.
    """
    return load("stream", reference, base, read_stream)


def read_stream(path: Path, sources: Sources) -> StreamSettings | None:
    """Return the stream's settings in a file; record problems and return None if it has any."""
    root = sources.read_yaml(path)
    if root is None:
        return None
    before = sources.problems.reported
    file = read_mapping(StreamFile, root, sources.problems)
    listen = _endpoints(root.get("listen"), sources)
    connect = _endpoints(root.get("connect"), sources)
    tls, login = _tls(root.get("tls"), sources), _login(root.get("login"), sources)
    access = _access(root.get("access"), sources)
    operators = _operators(root.get("commands"), sources)
    if file is None or sources.problems.reported > before:
        return None
    settings = StreamSettings(
        mode=file.mode,
        listen=StreamSettings.listen if file.listen is None else listen,
        connect=connect,
        tls=tls,
        login=login,
        access=access,
        operators=operators,
        batch=file.batch,
        history_s=file.history,
        heartbeat_s=file.heartbeat,
        channels=tuple(file.channels),
    )
    _check_open(root, settings, sources)
    return settings if sources.problems.reported == before else None


def _endpoints(item: Located | None, sources: Sources) -> tuple[Endpoint, ...]:
    found = []
    for element in item.elements() if item is not None else ():
        try:
            found.append(Endpoint.parse(str(element.value)))
        except ValueError as error:
            remedy = "write like tcp/127.0.0.1:7447 or tls/rig.example:7447"
            sources.problems.add(element.place, element.name, shown(element), str(error), remedy)
    return tuple(found)


def _tls(item: Located | None, sources: Sources) -> Tls | None:
    file = read_mapping(TlsFile, item, sources.problems) if item is not None else None
    if file is None or item is None:
        return None
    folder = item.place.path.parent
    return Tls(folder / file.authority, folder / file.certificate, folder / file.private_key)


def _login(item: Located | None, sources: Sources) -> Login | None:
    file = read_mapping(LoginFile, item, sources.problems) if item is not None else None
    if file is None or item is None:
        return None
    folder = item.place.path.parent
    users = None if file.users is None else folder / file.users
    return Login(file.user, folder / file.password_file, users)


def _access(item: Located | None, sources: Sources) -> Access | None:
    file = read_mapping(AccessFile, item, sources.problems) if item is not None else None
    if file is None:
        return None
    return Access(tuple(file.readers), tuple(file.commanders), tuple(file.rigs))


def _operators(item: Located | None, sources: Sources) -> tuple[Operator, ...]:
    found: dict[str, Operator] = {}
    remedy = "write a list: - {operator: NAME, allow: [abort]}"
    for element in elements_of(item, sources.problems, remedy):
        file = read_mapping(OperatorFile, element, sources.problems)
        if file is None:
            continue
        place = element.find(("operator",)).place
        if not 0 < len(file.operator.strip()) <= LONGEST_NAME:
            limit, remedy = f"must have 1 to {LONGEST_NAME} characters", "name the operator"
            sources.problems.add(place, "operator", file.operator, limit, remedy)
        if file.operator in found:
            sources.problems.add(place, "operator", file.operator, "is there twice", "keep one")
        folder = element.place.path.parent
        key = None if file.key is None else folder / Path(file.key).expanduser()
        found[file.operator] = Operator(file.operator, tuple(file.allow), key)
    return tuple(found.values())


def _check_open(root: Located, settings: StreamSettings, sources: Sources) -> None:
    """Record a problem where more people could read or command the stream than the profile says.

    This is so, for example, if it is served beyond this machine without TLS and without a login.
    """

    def refuse(name: str, value: object, limit: str, remedy: str) -> None:
        entry = root.get(name)
        place = entry.place if entry is not None else root.place
        sources.problems.add(place, name, value, limit, remedy)

    encrypted = [end for end in (*settings.listen, *settings.connect) if end.protocol == "tls"]
    if encrypted and settings.tls is None:
        refuse("tls", encrypted[0], "has no certificates", "add `tls: {authority: ..., ...}`")
    if settings.tls is not None and not encrypted:
        refuse("tls", "", "is used by no endpoint", "write tls/HOST:PORT, or remove `tls`")
    if settings.access is not None and settings.tls is None and settings.login is None:
        refuse("access", "", "cannot tell who anybody is", "add `tls` or `login`")
    if settings.login is not None and settings.login.users is None and settings.listen:
        refuse(
            "login", "", "knows nobody that connects", "add `users: FILE` of user:password lines"
        )
    for end in (*_reachable(settings.listen), *_reachable(settings.connect)):
        name = "listen" if end in settings.listen else "connect"
        if end.protocol != "tls" and settings.login is None:
            refuse(
                name, end, "is open to whoever reaches it, as it is not on loopback",
                "use tls/ with `tls`, or add `login`; or listen on 127.0.0.1",
            )  # fmt: skip
        elif name == "listen" and settings.access is None:
            refuse(
                name, end, "lets whoever has a certificate or password do everything",
                "add `access: {readers: [...], commanders: [...]}`",
            )  # fmt: skip


def _reachable(endpoints: Iterable[Endpoint]) -> list[Endpoint]:
    return [endpoint for endpoint in endpoints if not endpoint.is_loopback]


def stream_lines(settings: StreamSettings) -> tuple[str, ...]:
    """Return the lines by which `rig check` describes a stream."""
    known = "certificates" if settings.tls else "user and password" if settings.login else "nobody"
    may = [f"{who.name} may {', '.join(who.allow) or 'nothing'}" for who in settings.operators]
    return (
        f"  {settings.mode}, listens on {_joined(settings.listen)}; "
        f"connects to {_joined(settings.connect)}",
        f"  told apart by {known}; "
        + ("whoever connects may read" if settings.access is None else "access controlled"),
        f"  commands: {'; '.join(may) or 'none'}",
    )


def _joined(endpoints: Iterable[Endpoint]) -> str:
    return ", ".join(map(str, endpoints)) or "nothing"


__all__ = ["COMMANDS", "DEFAULT", "OFF", "load_stream", "read_stream", "stream_lines"]
