"""Draws leaks that come and go, and records them on the product's and on the independent rig.

All of a trial follows from its seed and number. In two of three trials the leak opens and shuts by
time alone; in the others it is open while the ram is beyond a position, moves one way, or chamber 1
is above a pressure. The rig of an even number is the independent one of `tools.hidden_effects`,
with the tolerances of a healthy rig, and in every second trial also with air, oil or edges that
follow another formula than the product's; that of an odd number is drawn as in docs/detection.md.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion as ProductMotion
from rig.plant import FAULT_COLUMNS, LEAKS, LITRE_PER_MINUTE, Model
from rig.recording import Recording
from tools.hidden_effects import physics
from tools.hidden_effects.drawn_trials import drawn_nuisances
from tools.hidden_effects.motions import Motion, drawn
from tools.hidden_effects.recordings import COLUMNS, Recorded, record
from tools.hidden_effects.rig_values import TABLE, RigValues
from tools.simulated.drawn_rigs import MIDDLE, MOTIONS, OPEN_LOOP, drawn_rig
from tools.simulated.recordings import SETTLE_TICKS, TRUE_LEAKS, recorded

Array = NDArray[np.float64]

GATES: Final = ("time", "position", "direction", "pressure")
"""What decides whether a leak is open."""
SECONDS: Final = 100.0
ONSET_S: Final = 20.0
"""Time from which on the leak may open, s."""
LEAST_MEAN: Final = 0.03
"""Least product of flow and share of time open, L/min, from the first opening on."""
_WANTED: Final = (0.035, 0.15)
"""Range of that product, L/min, as it is drawn.

What a trial has comes out of its simulation, as the pressure that drives a leak depends on the
motion."""
_WANTED_LEAST: Final = (0.032, 0.04)
"""The same for trials at the edge of the condition."""
_DUTIES: Final = (0.15, 0.6)
_DUTIES_LEAST: Final = (0.3, 0.8)
_DRIVING: Final = (6.9e6, 6.9e6, 2.5e6)
"""Pressure drops in Pa for which the coefficients of `LEAKS` are drawn: half the pump's pressure,
and what the friction of the seals takes."""
_OPEN_WITH_MOTION: Final = 0.45
"""Share of time for which a leak that goes with the motion is open, roughly."""
_CHATTER_S: Final = 0.2
"""A leak that goes with the direction shuts for moments while the ram's speed is about zero, s."""
_HALF_PUMP: Final = 6.9e6
_TICK: Final = physics.TICK
_OTHER_MOTIONS: Final = ("multisine", "pseudorandom", "steps", "sines", "ramps")
_PLACES: Final = ("opening_leak_1", "opening_leak_2", "opening_leak_across")
"""Values of the independent rig that are the coefficients of `LEAKS`."""


@dataclass(frozen=True)
class Plan:
    """A trial before it is run; `leak` is None for a healthy rig.

    Attributes:
        seed, number: from which the rig, its motion, the leak and the noise are drawn.
        leak: the leak, one of `LEAKS`.
        gate: one of `GATES`.
        independent: whether the rig is the independent one.
        least: whether flow times duty is about the least of the condition, with duties up to 0.8.
    """

    seed: int
    number: int
    leak: str | None
    gate: str
    independent: bool
    least: bool = False

    def generator(self, purpose: int) -> Generator:
        """Return a generator for one purpose; those of different purposes are independent."""
        return np.random.default_rng([self.seed, self.number, purpose])


@dataclass(frozen=True)
class Course:
    """A trial's recording with the truth.

    Attributes:
        recording: what the sensors read.
        flow: true flow of the leak, float64 (n,), L/min; 0 while it is shut.
    """

    recording: Recording
    flow: Array

    @property
    def open(self) -> NDArray[np.bool_]:
        """Whether the leak is open, bool (n,)."""
        return np.abs(self.flow) > 0.0

    @property
    def openings(self) -> int:
        """How often the leak opened for 1 s or more; it may be shut for 0.2 s in between."""
        edges = np.flatnonzero(np.diff(np.r_[False, self.open, False].astype(np.int8)))
        starts, ends = edges[::2] * _TICK, edges[1::2] * _TICK
        apart = np.append(True, starts[1:] - ends[:-1] > _CHATTER_S)
        first = np.flatnonzero(apart)
        last = np.append(first[1:], starts.size) - 1
        return int((ends[last] - starts[first] >= 0.999).sum()) if starts.size else 0

    @property
    def duty(self) -> float:
        """Share of time open from the first opening to the end; 0 without one."""
        shown = self.open
        return float(shown[int(np.argmax(shown)) :].mean()) if shown.any() else 0.0

    @property
    def mean_flow(self) -> float:
        """Mean magnitude of the flow while the leak is open, L/min; 0 if it never is."""
        return float(np.abs(self.flow[self.open]).mean()) if self.open.any() else 0.0


def least_plans(seed: int, count: int) -> list[Plan]:
    """Return the plans of `count` leaks by time at the edge of the condition, in turn by place."""
    return [
        Plan(seed, 200_000 + k, LEAKS[k // 2 % 3], "time", k % 2 == 0, least=True)
        for k in range(count)
    ]


def plans(seed: int, count: int, healthy: int = 0) -> list[Plan]:
    """Return the plans of `count` leaks, all places in turn, and of `healthy` healthy rigs."""
    found = []
    for number in range(count):
        turn = number // 6
        gate = GATES[1 + turn // 2 % 3] if turn % 2 else "time"
        independent = number % 2 == 0 or gate != "time"
        found.append(Plan(seed, number, LEAKS[number // 2 % 3], gate, independent))
    found += [Plan(seed, 100_000 + k, None, "time", k % 2 == 0) for k in range(healthy)]
    return found


def openings(
    rng: Generator, n: int, duties: tuple[float, float] = _DUTIES
) -> tuple[NDArray[np.bool_], float, float]:
    """Return when a leak is open by time, bool (n,), with its period and stay (s), both drawn.

    The period is 3 to 12 s and the stay 1 s or more, a share of the period on average that is
    uniform in `duties`; every stay is between 1 s and 1.4 times that, and every period within 20 %.
    """
    period = float(rng.uniform(3.0, 12.0))
    stay = max(1.0, float(rng.uniform(*duties)) * period)
    shown = np.zeros(n, dtype=np.bool_)
    at = ONSET_S
    while at < n * _TICK:
        stays = max(1.0, stay * float(rng.uniform(0.6, 1.4)))
        shown[round(at / _TICK) : round((at + stays) / _TICK)] = True
        at += max(period * float(rng.uniform(0.8, 1.2)), stays + 0.5)
    return shown, period, stay


def simulated(plan: Plan, seconds: float = SECONDS) -> Course:
    """Return the recording of a plan, with the truth."""
    n = round(seconds / _TICK)
    return _independent(plan, n) if plan.independent else _product(plan, n)


def _product(plan: Plan, n: int) -> Course:
    rng = plan.generator(0)
    rig = drawn_rig(rng)
    kind = tuple(MOTIONS)[int(rng.integers(len(MOTIONS)))]
    setpoint, open_loop = MOTIONS[kind](rng, n), kind in OPEN_LOOP
    faults = np.zeros((n, len(FAULT_COLUMNS)))
    made = simulated_rig(Model(parameters=rig), plan.number + 1000 * plan.seed)
    if plan.leak is None:
        motion = ProductMotion(setpoint, open_loop, faults, MIDDLE, SETTLE_TICKS)
        return Course(recorded(made, motion), np.zeros(n))
    shown, _, _ = openings(rng, n, _DUTIES_LEAST if plan.least else _DUTIES)
    duty = float(shown[round(ONSET_S / _TICK) :].mean())
    coefficient = _coefficient(plan, rng, duty)
    faults[:, FAULT_COLUMNS.index(plan.leak)] = coefficient * shown
    motion = ProductMotion(setpoint, open_loop, faults, MIDDLE, SETTLE_TICKS)
    recording = recorded(made, motion)
    return Course(recording, recording[TRUE_LEAKS[plan.leak]] / LITRE_PER_MINUTE * shown)


def _coefficient(plan: Plan, rng: Generator, duty: float) -> float:
    """Return a coefficient (SI) for a plan with a leak; its flow times `duty` is log-uniform."""
    wanted = _WANTED_LEAST if plan.least else _WANTED
    flow = float(np.exp(rng.uniform(*np.log(wanted)))) / duty
    return flow * LITRE_PER_MINUTE / sqrt(_DRIVING[LEAKS.index(plan.leak or "")])


def _independent(plan: Plan, n: int) -> Course:
    rng = plan.generator(0)
    rig = healthy_rig(rng, other_forms=plan.number // 2 % 2 == 1)
    name = _OTHER_MOTIONS[int(rng.integers(len(_OTHER_MOTIONS)))]
    motion = drawn(name, rng, n) if plan.gate == "time" else _slow(rng, n)
    noise = plan.generator(1)
    if plan.leak is None:
        return Course(_shown(record(rig, motion, noise)), np.zeros(n))
    gate = _gate(plan, rng)
    duty = gate["stays_for"] / gate["comes_every"] if plan.gate == "time" else _OPEN_WITH_MOTION
    coefficient = _coefficient(plan, rng, duty)
    place = {_PLACES[LEAKS.index(plan.leak)]: coefficient}
    rig = rig._replace(opens_at=ONSET_S, **gate, **place)
    made = record(rig, motion, noise)
    drop = _drops(plan.leak, made)
    flow = coefficient * np.sqrt(np.abs(drop)) / LITRE_PER_MINUTE
    return Course(_shown(made), flow * _is_open(rig, made))


def healthy_rig(rng: Generator, other_forms: bool) -> RigValues:
    """Return an independent rig within the tolerances of a healthy one.

    With `other_forms` its air, oil, edges and lines follow other formulas than the product's, with
    sizes within the tolerances of docs/detection.md.
    """
    rig = TABLE._replace(**drawn_nuisances(rng, ()))
    rig = rig._replace(
        null_shift=float(rng.uniform(-3e-6, 3e-6)),
        air=float(rng.uniform(0.0, 0.005)),
        pump_droop=float(rng.uniform(0.0, 1e12)),
        tank_rise=float(rng.uniform(0.0, 1e12)),
        spring=1e4 if rng.random() < 0.4 else 0.0,
        direction_friction=float(rng.uniform(-200.0, 200.0)),
    )
    if not other_forms:
        return rig
    return rig._replace(
        air_exponent=float(rng.uniform(1.0, 1.4)),
        stiffening=float(rng.integers(2)),
        droop_exponent=float(rng.choice([1.75, 2.0])),
        rise_exponent=float(rng.choice([1.0, 1.75, 2.0])),
        round_underlap=float(rng.uniform(0.0, 1e-6)),
        stribeck_exponent=float(rng.choice([0.5, 1.0, 2.0])),
        direction_drag=float(rng.uniform(0.0, 100.0)),
    )


def _slow(rng: Generator, n: int) -> Motion:
    """Return a motion slow enough for a leak that goes with it to stay open for more than 1 s.

    The ram goes to and fro at speeds of 30 to 150 mm/s, and turns at places that are all drawn.
    """
    turns, times = [MIDDLE], [0.0]
    while times[-1] < n * _TICK:
        side = 1.0 if len(turns) % 2 else -1.0
        turns.append(MIDDLE + side * float(rng.uniform(0.05, 0.15)))
        speed = float(np.exp(rng.uniform(np.log(0.03), np.log(0.15))))
        times.append(times[-1] + max(abs(turns[-1] - turns[-2]) / speed, 1.2))
    setpoint = np.interp(np.arange(n) * _TICK, times, turns)
    return Motion(setpoint, np.zeros(n), float(rng.uniform(25.0, 70.0)))


def _gate(plan: Plan, rng: Generator) -> dict[str, float]:
    """Return the values of the independent rig that open and shut its leak."""
    gate = plan.gate
    if gate == "time":
        _, period, stay = openings(rng, 1, _DUTIES_LEAST if plan.least else _DUTIES)
        return {"comes_every": period, "stays_for": stay}
    if gate == "position":
        return {"opens_beyond": MIDDLE + float(rng.uniform(-0.02, 0.05))}
    if gate == "direction":
        return {"opens_moving": float(rng.choice([-2e-3, 2e-3]))}
    return {"opens_above": _HALF_PUMP + float(rng.uniform(0.0, 1e6))}


def _is_open(rig: RigValues, made: Recorded) -> NDArray[np.bool_]:
    """Return whether the leak of an independent rig is open, bool (n,), as `physics` decides."""
    time_s, truth = made.table[:, 0], made.truth
    shown = time_s >= rig.opens_at
    if rig.comes_every:
        shown &= (time_s - rig.opens_at) % rig.comes_every < rig.stays_for
    shown &= rig.opens_moving * truth[:, physics.SPEED] >= rig.opens_moving**2
    shown &= truth[:, physics.P1] >= rig.opens_above
    return np.asarray(shown & (truth[:, physics.POSITION] >= rig.opens_beyond))


def _drops(leak: str, made: Recorded) -> Array:
    """Return the pressure drop in Pa that drives a leak, float64 (n,)."""
    p1, p2, tank = (made.truth[:, at] for at in (physics.P1, physics.P2, physics.TANK))
    return np.asarray((p1 - tank, p2 - tank, p1 - p2)[LEAKS.index(leak)])


def _shown(made: Recorded) -> Recording:
    return Recording({name: made.table[:, i].copy() for i, name in enumerate(COLUMNS)})
