"""The function by which the compiled loop exchanges a sample with any fast driver's device.

The class of a plan has its exchange as a compiled method (`rig.io.driver.Plan`). The type of the
plan decides which exchange is compiled into the loop, so that the choice takes no time in a tick.
"""

from numba.extending import overload

from .driver import Floats, Plan


def exchange(
    fd: int, plan: Plan, sequence: int, outputs: Floats, inputs: Floats, deadline_ns: int
) -> tuple[int, int]:
    """Exchange by the method of the plan's class; see `rig.io.driver.Plan.exchange`."""
    return plan.exchange(fd, sequence, outputs, inputs, deadline_ns)


@overload(exchange, inline="always")
def _compiled_exchange(fd, plan, sequence, outputs, inputs, deadline_ns):
    of_plan = plan.instance_class.exchange

    def call(fd, plan, sequence, outputs, inputs, deadline_ns):
        return of_plan(plan, fd, sequence, outputs, inputs, deadline_ns)

    return call
