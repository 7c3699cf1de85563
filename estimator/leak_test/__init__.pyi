from .columns import BlockingLeak as BlockingLeak
from .fit import (
    FALSE_ALARMS as FALSE_ALARMS,
    INTERVAL as INTERVAL,
    SMALLEST as SMALLEST,
    THRESHOLD as THRESHOLD,
    BlockingFinding as BlockingFinding,
    LeakFinding as LeakFinding,
    LeakTestError as LeakTestError,
    LeakTestResult as LeakTestResult,
    fit_leaks as fit_leaks,
    foreseen_limits as foreseen_limits,
    port_pressures as port_pressures,
)
from .soaks import (
    LEAST_PRESSURE as LEAST_PRESSURE,
    SOAK_S as SOAK_S,
    Levels as Levels,
    Soak as Soak,
    levels_of as levels_of,
)
