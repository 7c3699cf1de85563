"""The exchange of whichever fast driver a rig has, for the compiled loop.

A plan's class brings the exchange as a compiled method (`rig.io.driver.Plan`), so that the type of
the plan says which one is compiled into the loop: the choice costs a tick nothing.
"""

from numba.extending import overload

from .driver import Floats, Plan


def exchange(
    fd: int, plan: Plan, sequence: int, outputs: Floats, inputs: Floats, deadline_ns: int
) -> tuple[int, int]:
    """Exchange as the plan's class does; see `rig.io.driver.Plan.exchange`."""
    return plan.exchange(fd, sequence, outputs, inputs, deadline_ns)


@overload(exchange, inline="always")
def _compiled_exchange(fd, plan, sequence, outputs, inputs, deadline_ns):
    of_plan = plan.instance_class.exchange

    def call(fd, plan, sequence, outputs, inputs, deadline_ns):
        return of_plan(plan, fd, sequence, outputs, inputs, deadline_ns)

    return call
