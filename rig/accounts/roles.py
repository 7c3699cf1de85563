"""The roles of the console's accounts, and the one table of which order needs which role."""

from enum import IntEnum
from typing import Final


class Role(IntEnum):
    """What an account may do; each role may also do what the roles below it may.

    A viewer sees everything and may stop. An operator also runs what is there: starts, holds, goes
    on, skips, acknowledges. An engineer also changes what a run is made of, such as a gain.
    """

    VIEWER = 1
    OPERATOR = 2
    ENGINEER = 3

    def __str__(self) -> str:
        return self.name.lower()


NEEDED: Final = {
    "stop": Role.VIEWER,
    "take": Role.OPERATOR,
    "take over": Role.OPERATOR,
    "release": Role.OPERATOR,
    "start": Role.OPERATOR,
    "go on": Role.OPERATOR,
    "hold": Role.OPERATOR,
    "resume": Role.OPERATOR,
    "skip": Role.OPERATOR,
    "retry": Role.OPERATOR,
    "abort": Role.OPERATOR,
    "acknowledge": Role.OPERATOR,
    "note": Role.OPERATOR,
    "jog": Role.OPERATOR,
    "beat": Role.OPERATOR,
    "queue add": Role.OPERATOR,
    "queue move": Role.OPERATOR,
    "queue remove": Role.OPERATOR,
    "queue start": Role.OPERATOR,
    "queue halt": Role.OPERATOR,
    "set": Role.ENGINEER,
}
"""By order of the console's page: the least role that may give it.

Stop is everybody's, as an emergency is. An order that is not here needs the highest role, so that
whoever adds one and forgets this table shuts it rather than opens it.
"""


def why_not(order: str, role: Role) -> str:
    """Return why a role may not give an order, as a sentence for people; "" if it may."""
    needed = NEEDED.get(order, Role.ENGINEER)
    return "" if role >= needed else f"this needs the role {needed}; yours is {role}"


def refusals(role: Role) -> dict[str, str]:
    """Return all orders that a role may not give, each with the reason of `why_not`."""
    return {order: why for order in NEEDED if (why := why_not(order, role))}
