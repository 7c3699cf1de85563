"""The live stream of commands that drive a rig: what is sent by it, and what is obeyed."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rig.configuration import DEFAULT, OFF, ConfigError, Problem, Rig, load_stream
from rig.control_socket import own_name, remark_of
from rig.runner import Observer, StopFlag
from rig.runner.campaign import LONGEST_TEXT, Desk, RefusedError, Request
from rig.stream import JOGGING, StreamSettings
from rig.supervisor import Inbox, Onlooker

if TYPE_CHECKING:
    from rig.runner.campaign import StreamedRun
    from rig.stream import Command

    Obey = Callable[[Command], str]
    """Takes a command; returns why it is refused, or "" if it is obeyed."""

MANUAL: Final = "manual"
"""What manual mode is called in the message `campaign`, by which the page knows it."""


def stream_of(profile: str | None, *, paced: bool) -> StreamSettings | None:
    """Return the settings of a command's stream; None if it has no stream.

    Args:
        profile: path or name of a profile, or "off". Without one, the default profile is used if
            the rig is paced, and no stream otherwise.
        paced: whether the rig goes at the wall clock.

    Raises:
        ConfigError: the profile, or a certificate, password or key file of it, cannot be used.
    """
    profile = profile or (DEFAULT if paced else OFF)
    if profile == OFF:
        return None
    settings = load_stream(profile)
    from rig.stream import KeyFileError, StreamError, check_files, credentials_of

    try:
        check_files(settings)
        for operator in settings.operators:
            credentials_of(operator)
    except (KeyFileError, StreamError) as error:
        raise ConfigError([Problem(profile, 0, 0, "stream", "", str(error), "")]) from None
    return settings


@contextmanager
def streamed(
    observer: Observer,
    settings: StreamSettings,
    rig: Rig,
    folder: Path,
    obey: "Obey",
    *,
    paced: bool,
    by: str,
    activity: str = "",
    idle: bool = False,
) -> Iterator["StreamedRun"]:
    """Give the block an observer that tells `observer` and the live stream what a command does.

    The stream is opened by the session that the block begins, and ends with the block. If the block
    fails, viewers learn why.

    Args:
        observer: is told first.
        settings: the stream's profile.
        rig: the rig that is driven.
        folder: an existing folder, or that of a run, for what the publisher may log.
        obey: obeys or refuses the stream's commands; it is called from another thread.
        paced: whether the rig goes at the wall clock.
        by: who gave the command; empty if that is not known.
        activity: what the command does with the rig, such as "homing"; empty for a campaign.
        idle: whether it only reads the rig, as a station does that nobody has asked for it.
    """
    from rig.runner.campaign import StreamedRun
    from rig.stream import finite, rig_id
    from rig.supervisor import LOG, Stream, tell_station

    stream = Stream(settings, rig_id(rig.name), folder / LOG, observer.rig_tells, obey)
    simulated = rig.backend == "simulated"
    run = StreamedRun(
        stream, observer, simulated=simulated, live=paced, by=by, activity=activity, idle=idle
    )
    failed = ""

    def tell(ended: Mapping[str, Any]) -> None:
        tell_station(rig, finite({**ended, "folder": str(folder.absolute())}))

    try:
        yield run
    except BaseException as error:
        failed = str(error) or type(error).__name__
        raise
    finally:
        run.ends(failed, None if idle or simulated else tell)


@contextmanager
def motion_streamed(
    observer: Observer,
    settings: StreamSettings | None,
    rig: Rig,
    folder: Path,
    stop: StopFlag,
    activity: str,
    *,
    paced: bool = True,
    jog: "Obey | None" = None,
) -> Iterator[Observer]:
    """Give the block an observer as `streamed` does; anybody who may command can stop the command.

    Without settings the block gets `observer` itself. Of the stream's commands only `abort` is
    obeyed, as there are no tests that could be held or skipped.

    Args:
        observer: is told first.
        settings: the stream's profile; None for no stream.
        rig: the rig that is driven.
        folder: an existing folder, for what the publisher may log.
        stop: a stop is requested on it when somebody asks to abort.
        activity: what the command does with the rig, such as "homing".
        paced: whether the rig goes at the wall clock.
        jog: obeys the commands of manual mode; None if the command has no manual mode.
    """

    def obey(command: "Command") -> str:
        if command.name in JOGGING and jog is not None:
            return jog(command)
        if command.name != "abort":
            also = f", {' and '.join(JOGGING)}" if jog is not None else ""
            return f"{activity} obeys abort{also} only"
        text = remark_of(command.text[:LONGEST_TEXT], command.person)
        who = command.person or command.by
        stop.request(f"{who}: {text}" if text else who)
        return ""

    if settings is None:
        context: Any = nullcontext(observer)
    else:
        context = streamed(
            observer, settings, rig, folder, obey, paced=paced, by=own_name(), activity=activity
        )
    with context as seen:
        yield seen


class _Said(Observer):
    """An observer that shows what is told of the rig, and nothing else.

    Args:
        say: shows a line to the operator.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say

    def rig_tells(self, text: str) -> None:
        """Show the line."""
        self._say(text)


@contextmanager
def session_streamed(
    settings: StreamSettings | None,
    rig: Rig,
    folder: Path,
    stop: StopFlag,
    activity: str,
    say: Callable[[str], None],
    jog: "Obey | None" = None,
) -> Iterator[tuple[Callable[[str], None], Onlooker]]:
    """Give the block two arguments of a `ConnectedRig`, so that its session is seen and stopped.

    They are the function that shows a line, here and to who watches the stream, and the onlooker.
    The arguments are those of `motion_streamed`; `say` shows a line to the operator here.
    """
    with motion_streamed(_Said(say), settings, rig, folder, stop, activity, jog=jog) as seen:
        yield seen.rig_tells, seen if isinstance(seen, Onlooker) else Onlooker()


def manual_streamed(
    settings: StreamSettings | None,
    rig: Rig,
    folder: Path,
    stop: StopFlag,
    inbox: Inbox,
    say: Callable[[str], None],
) -> AbstractContextManager[tuple[Callable[[str], None], Onlooker]]:
    """Return the context of `session_streamed` for manual mode, which takes commands to move, too.

    `inbox` takes them; the other arguments are those of `session_streamed`.
    """

    def jog(command: "Command") -> str:
        text = remark_of(command.text[:LONGEST_TEXT], command.person)
        line = f"beat {text}".strip() if command.name == "beat" else text
        return inbox.ask(line, command.person or command.by, remote=True)

    return session_streamed(settings, rig, folder, stop, MANUAL, say, jog)


def obeyed_by(desk: Desk) -> "Obey":
    """Return a function that hands a stream's commands to the desk of a campaign."""

    def obey(command: "Command") -> str:
        if command.name in JOGGING:
            return "a campaign moves the rig; jog it with `rig jog` when that has ended"
        request = Request.PAUSE if command.name == "hold" else Request(command.name)
        try:
            said = command.text[:LONGEST_TEXT]
            desk.ask(request, command.by, said, command.test, command.person)
        except RefusedError as error:
            return str(error)
        return ""

    return obey
