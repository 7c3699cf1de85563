from .content import (
    LARGEST as LARGEST,
    LEAST_BASE as LEAST_BASE,
    MOST_DEAD_ZONE as MOST_DEAD_ZONE,
    STATED_RATES as STATED_RATES,
    expected_alarms as expected_alarms,
    noise_content as noise_content,
    noise_of as noise_of,
)
from .measuring import (
    Residuals as Residuals,
    careful as careful,
    joined as joined,
    measured_noise as measured_noise,
)
from .noise import LearntNoise as LearntNoise, RegimeNoise as RegimeNoise
from .regimes import (
    NEAR_STOP as NEAR_STOP,
    REGIMES as REGIMES,
    STANDSTILL as STANDSTILL,
    regime_of as regime_of,
)
from .tail import RegimePeaks as RegimePeaks, Tail as Tail, tail_of as tail_of
