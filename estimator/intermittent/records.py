"""The records of a leak that comes and goes: its openings, its duty, and what it goes with."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Episode:
    """One opening of a leak.

    Attributes:
        start_s, end_s: when the leak opened and shut, s, to about 0.2 s; `end_s` is None while it
            is open.
        flow_m3_per_s: mean magnitude of the flow while it was open.
    """

    start_s: float
    end_s: float | None
    flow_m3_per_s: float


@dataclass(frozen=True)
class Company:
    """What the openings of a leak go with.

    Attributes:
        what: "position", "direction", "pressure_1", "pressure_2", or "time" if the leak opens at
            regular intervals.
        sense: 1 if the leak is open where that is greater (for `direction`: while the ram
            extends), -1 where it is less, 0 for `time`.
        strength: difference between the mean ranks of the blocks with the leak open and shut, from
            0 (none) to 1 (the leak is open exactly beyond a value); for `time`, 1 less the
            coefficient of variation of the intervals between openings.
        chance: share of leaks that open independently of it which would show as much.
        beyond: position in m or pressure in Pa that divides open from shut best; None for the
            others.
        others: further names that do nearly as well and so cannot be ruled out.
        period_s: mean interval between openings, for `time`; None for the others.
    """

    what: str
    sense: int
    strength: float
    chance: float
    beyond: float | None = None
    others: tuple[str, ...] = ()
    period_s: float | None = None


@dataclass(frozen=True)
class Intermittent:
    """A leak that comes and goes, as far as the accounts tell up to now.

    Attributes:
        leak: one of `LEAKS`.
        evidence, limit: logarithm of the statistic for it, and the value it had to exceed.
        average_gain: logarithm of the likelihood ratio to a healthy rig, which is averaged over
            the blocks at which the leak may have come for the first time.
        episodes: the openings, oldest first; of more than 200 the latest 200.
        openings: number of all openings.
        duty: share of the time from the first opening up to now for which the leak was open.
        duty_interval: 95 % interval of that share, as cycles scatter.
        leak_m3_per_s, leak_std_m3_per_s: mean magnitude of the flow while open, and its standard
            error by noise alone.
        coefficient: leak coefficient while open, m^3/(s Pa^0.5).
        goes_with: what the openings go with; None if nothing is beyond chance.
    """

    leak: str
    evidence: float
    limit: float
    average_gain: float
    episodes: tuple[Episode, ...]
    openings: int
    duty: float
    duty_interval: tuple[float, float]
    leak_m3_per_s: float
    leak_std_m3_per_s: float
    coefficient: float
    goes_with: Company | None = None

    @property
    def onset_s(self) -> float:
        """Return when the first listed opening began, s."""
        return self.episodes[0].start_s

    @property
    def open_now(self) -> bool:
        """Return whether the leak is open in the latest block."""
        return self.episodes[-1].end_s is None
