"""The function by which the compiled loop exchanges a sample with any fast driver's device.

The class of a plan has its exchange as a compiled method (`rig.io.driver.Plan`). The type of the
plan decides which exchange is compiled into the loop, so that the choice takes no time in a tick.
"""

from numba.extending import overload

from .driver import Floats, Plan


def exchange(
    fd: int, plan: Plan, sequence: int, outputs: Floats, inputs: Floats, deadline_ns: int
) -> tuple[int, int]:
    """Exchange one sample by the compiled method `exchange` of the plan's class.

    Fill `inputs`, and return the `ExchangeStatus` and the time in ns at which the command left. The
    arguments are those of `rig.io.driver.Plan.exchange`, with the plan as the second.
    """
    return plan.exchange(fd, sequence, outputs, inputs, deadline_ns)


@overload(exchange, inline="always")
def _compiled_exchange(fd, plan, sequence, outputs, inputs, deadline_ns):
    of_plan = plan.instance_class.exchange

    def call(fd, plan, sequence, outputs, inputs, deadline_ns):
        return of_plan(plan, fd, sequence, outputs, inputs, deadline_ns)

    return call
