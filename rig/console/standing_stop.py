"""A stop that nobody has heard stands for some seconds, and is said until somebody hears it.

While a session connects, or the rig changes hands, nobody answers for the rig; nothing moves yet.
"""

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from rig.stream import Answer, KeyFileError, StreamClient

STANDS_S: Final = 15.0
"""Time in s for which a stop stands. A rig changes hands, and is heard again, in 2 to 5 s, and in
more on a busy machine."""


class StandingStop:
    """Says stops until they are heard, each in a thread of its own.

    Args:
        client: sends them.
        say: is called with a sentence on what came of one.
    """

    def __init__(self, client: StreamClient, say: Callable[[str], None]) -> None:
        self._client = client
        self._say = say
        self._standing: dict[str, threading.Thread] = {}

    def stand(self, rig: str, said: str, person: str, wait_s: float) -> Answer | None:
        """Have a stop stand; return the rig's answer, or None if there is none within `wait_s`.

        The first stop of a rig stands; who asks for another one meanwhile waits for the same.

        Args:
            rig: id of the rig; empty for the only one that is known by then.
            said: text for the journal: who stops, and why.
            person: who stops.
            wait_s: time in s for which the answer is awaited here.
        """
        answers: list[Answer] = []

        def saying() -> None:
            with suppress(KeyFileError):  # told of with the first attempt
                answer = self._client.send_until_heard("abort", rig or None, said, STANDS_S, person)
                answers.append(answer)
                came = "was heard, and is obeyed" if answer.accepted else "stands no longer"
                why = "" if answer.accepted else f": {answer.reason}"
                self._say(f"{rig or 'the rig'}: the stop of {person} {came}{why}")

        thread = self._standing.get(rig)
        if thread is None or not thread.is_alive():
            thread = threading.Thread(target=saying, name="standing stop", daemon=True)
            self._standing[rig] = thread
            with suppress(RuntimeError):  # without a thread the answer is that nobody hears it
                thread.start()
        if thread.ident is not None:
            thread.join(wait_s)
        return answers[0] if answers else None
