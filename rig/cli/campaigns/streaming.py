"""These functions set up the live stream of a run and pass its commands on to the desk."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rig.configuration import DEFAULT, OFF, ConfigError, Problem, Rig, load_stream
from rig.runner import Observer
from rig.runner.campaign import LONGEST_TEXT, Desk, RefusedError, Request
from rig.stream import StreamSettings


def stream_of(profile: str | None, *, paced: bool) -> StreamSettings | None:
    """Return the settings of a run's stream; None if the run has no stream.

    Args:
        profile: path or name of a profile, or "off". Without one, a run has the default profile if
            it is paced, and no stream otherwise.
        paced: whether the run goes at the wall clock.

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
    settings: StreamSettings | None,
    rig: Rig,
    directory: Path,
    desk: Desk,
    *,
    paced: bool,
) -> Iterator[Observer]:
    """Give the block an observer that passes a run on to `observer` and to its live stream.

    Without settings of a stream, the block gets `observer` itself. The stream's commands go to the
    desk; the stream ends with the block.
    """
    if settings is None:
        yield observer
        return
    from rig.runner.campaign import StreamedRun
    from rig.stream import Command, rig_id
    from rig.supervisor import LOG, Stream

    def obey(command: Command) -> str:
        """Hand a command to the desk; return why it is refused, or "" if it is obeyed."""
        request = Request.PAUSE if command.name == "hold" else Request(command.name)
        try:
            desk.ask(request, command.by, command.text[:LONGEST_TEXT], command.test)
        except RefusedError as error:
            return str(error)
        return ""

    stream = Stream(settings, rig_id(rig.name), directory / LOG, observer.rig_tells, obey)
    run = StreamedRun(stream, observer, simulated=rig.backend == "simulated", live=paced)
    try:
        yield run
    finally:
        run.ends()
