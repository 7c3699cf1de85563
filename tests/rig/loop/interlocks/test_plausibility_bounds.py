"""The accounts of the plausibility checks against docs/safety.md, reckoned here by other means.

The product keeps them tick by tick in compiled code; `Reckoned` writes the same law down from the
page, with NumPy, and both must agree at every tick of motions drawn at random. The tests below it
say where each check begins to hold.
"""

from math import inf, isnan, nan, sqrt

import numpy as np
import pytest

from rig.io.signals import FAST_INPUTS
from rig.loop.interlocks.check_tolerances import Tolerances
from rig.loop.interlocks.ladder import Action, Cause
from rig.loop.interlocks.plausibility import Evidence
from rig.plant import NOMINAL

from .samples_by_hand import NOTHING, TOL, Found, Judge

T = TOL.period_s
AREA, SUPPLY = NOMINAL.piston_area, NOMINAL.supply_pressure
ACCOUNTS = (
    "spool_m", "spool_velocity", "pressure_1_Pa", "pressure_2_Pa", "gap_ticks", "high_m", "low_m",
    "account_ticks", "still_ticks", "work_J", "above_1_ticks", "above_2_ticks", "spool_ticks",
    "command_V", "exchange_ticks", "position_m", "started", "usual_ticks",
)  # fmt: skip


def trip(cause: Cause, channel: str) -> Found:
    return Action.TRIP, cause, channel


def orifice(opening: float, drop: float) -> float:
    """Flow through an edge of the valve (eq. 2.1), in m^3/s."""
    return TOL.conductance * opening * float(np.sign(drop) * np.sqrt(abs(drop)))


def settled_spool(command: float, ticks: int) -> tuple[float, float]:
    """Spool of the nominal valve, at rest before, after some ticks of a command (m, m/s).

    The second-order lag of docs/model.md by semi-implicit Euler, four steps in a tick, as powers
    of its matrix.
    """
    natural, damping, step = NOMINAL.valve_natural_frequency, NOMINAL.valve_damping, T / 4.0
    faster = np.array([[1.0, 0.0], [-step * natural**2, 1.0 - 2.0 * step * damping * natural]])
    move = np.array([[1.0, step], [0.0, 1.0]])
    target = np.array([NOMINAL.valve_gain * command, 0.0])
    state = target + np.linalg.matrix_power(move @ faster, 4 * ticks) @ -target
    return float(state[0]), float(state[1])


class Reckoned:
    """The accounts of docs/safety.md."""

    def __init__(self, tol: Tolerances = TOL) -> None:
        self.tol = tol
        self.spool = self.velocity = self.command = 0.0
        self.x = self.p1 = self.p2 = 0.0
        self.gap = self.exchange = self.still = self.account = self.usual = 0.0
        self.high = self.low = self.work = self.above_1 = self.above_2 = self.off = 0.0
        self.started = 0.0

    def step(
        self, row: dict[str, float], *, fresh: bool, elapsed: int, exchange: float, command: float,
        homed: bool,
    ) -> None:  # fmt: skip
        self.gap += elapsed
        self._valve(min(elapsed, 200))
        self.command = command
        if not fresh:
            return
        x, p1, p2 = (row[name] for name in ("position_m", "pressure_1_Pa", "pressure_2_Pa"))
        if not any(map(isnan, (x, p1, p2))):
            if self.started != 1.0 + homed:
                self.started = 1.0 + homed
                self.x, self.p1, self.p2 = x, p1, p2
            # In so much more time than is usual between samples, the ram may go 5 mm.
            longer = (self.gap - self.usual) * T
            known = 0.5 * self.tol.jump_speed_m_per_s * longer <= self.tol.flow_account_m
            if known and exchange + self.exchange <= min(self.gap, 2.5):
                self._flow(row, x, p1, p2, homed)
                timed = True
            else:
                timed = False
            if known:
                self._work(row, x, p1, p2)
            self._above(row, p1, p2)
            self.x = x
            if not timed:
                self.p1, self.p2 = p1, p2
        self._spool(row)
        self.usual = min(self.gap, self.usual + 1.0)
        self.gap, self.exchange = 0.0, exchange

    def _valve(self, ticks: int) -> None:
        natural, damping = NOMINAL.valve_natural_frequency, NOMINAL.valve_damping
        for _ in range(4 * ticks):
            lag = NOMINAL.valve_gain * self.command - self.spool
            self.velocity += T / 4 * (natural**2 * lag - 2 * damping * natural * self.velocity)
            self.spool += T / 4 * self.velocity

    def _flow(self, row: dict[str, float], x: float, p1: float, p2: float, homed: bool) -> None:
        tol, seconds = self.tol, self.gap * T
        supply = np.fmax(SUPPLY, row["supply_pressure_Pa"])
        opening = self.spool if isnan(row["spool_m"]) else row["spool_m"]
        # The pressures before this sample, and how they change, smoothed with 5 ms.
        before = np.array([self.p1, self.p2])
        change = seconds / (5e-3 + seconds) * (np.array([p1, p2]) - before)
        self.p1, self.p2 = before + change
        drops = (
            (supply - before[0], before[1]) if opening >= 0.0 else (before[0], supply - before[1])
        )
        q1, q2 = orifice(opening, drops[0]), orifice(opening, drops[1])
        volumes = NOMINAL.line_volume_1 + AREA * np.array(
            [x - NOMINAL.stroke_min, NOMINAL.stroke_max - x]
            if homed
            else [0.5 * (NOMINAL.stroke_max - NOMINAL.stroke_min)] * 2
        )
        oil = volumes * change / NOMINAL.bulk_modulus
        part = 0.3 if homed else 1.2
        # A blocked return throttles what leaves a chamber.
        throttled = 1.0 / sqrt(1.0 + tol.return_restriction * (tol.conductance * opening) ** 2)
        crossport = tol.leak_coefficient * sqrt(abs(before[1] - before[0]))
        null = tol.conductance * 1.3e-5 * np.sqrt(np.maximum(before, supply - before))
        most = q1 * (1.0 if q1 > 0.0 else throttled) + null[0] + 0.2 * abs(q1)
        least = q2 * (1.0 if q2 < 0.0 else throttled) - null[1] - 0.2 * abs(q2)
        most += crossport if before[1] > before[0] else 0.0
        least -= crossport if before[0] > before[1] else 0.0
        high = (most * seconds - oil[0] + part * abs(oil[0])) / AREA
        low = (least * seconds + oil[1] - part * abs(oil[1])) / AREA
        step = x - self.x
        self.still = 0.0 if step else self.still + self.gap
        self.high = max(self.high + step - high, 0.0) if before[0] >= 5e5 else 0.0
        self.low = max(self.low + low - step, 0.0) if before[1] >= 5e5 else 0.0
        self.account = self.account + self.gap if max(self.high, self.low) > 0.0 else 0.0

    def _work(self, row: dict[str, float], x: float, p1: float, p2: float) -> None:
        if isnan(row["load_N"]):
            return
        step = x - self.x
        done = (AREA * (p1 - p2) - row["load_N"]) * step + AREA * 1e5 * abs(step)
        self.work = max(self.work - done, 0.0)

    def _above(self, row: dict[str, float], p1: float, p2: float) -> None:
        supply = SUPPLY if isnan(row["supply_pressure_Pa"]) else row["supply_pressure_Pa"]
        limit = supply + self.tol.above_supply_Pa
        self.above_1 = self.above_1 + self.gap if p1 > limit else 0.0
        self.above_2 = self.above_2 + self.gap if p2 > limit else 0.0

    def _spool(self, row: dict[str, float]) -> None:
        if isnan(row["spool_m"]):
            return
        allowed = self.tol.spool_m + 0.15 * abs(self.spool) + 4e-3 * abs(self.velocity)
        away = abs(row["spool_m"] - self.spool) > allowed
        since = self.gap if self.off else min(self.gap, 1.0)
        self.off = self.off + since if away else 0.0

    @property
    def evidence(self) -> Evidence:
        return Evidence(
            self.started, self.spool, self.velocity, self.x, self.p1, self.p2, self.gap, self.high,
            self.low, self.account, self.still, self.work, self.above_1, self.above_2, self.off,
            self.command, self.exchange, self.usual,
        )  # fmt: skip


@pytest.mark.parametrize("homed", [True, False])
@pytest.mark.parametrize("seed", range(2))
def test_the_accounts_are_those_of_the_page(seed: int, homed: bool) -> None:
    rng = np.random.default_rng(seed)
    # No account trips, as the encoder's steps are small beside what trips.
    tol = TOL._replace(flow_account_m=inf, work_J=inf)
    judge, page = Judge(tol=tol), Reckoned(tol)
    x, p1, p2 = 0.3, 7e6, 7e6
    for tick in range(150):
        x += rng.choice([0.0, 1e-5, 1e-4]) * rng.standard_normal()
        p1 = float(np.clip(p1 + 4e5 * rng.standard_normal(), 1e5, 1.55e7))
        p2 = float(np.clip(p2 + 4e5 * rng.standard_normal(), 1e5, 1.55e7))
        command = float(0.4 * rng.standard_normal()) if tick % 7 == 0 else judge.evidence.command_V
        row = {
            "position_m": x,
            "pressure_1_Pa": p1,
            "pressure_2_Pa": p2,
            "spool_m": float(rng.choice([nan, 3e-5])) * float(rng.standard_normal()),
            "supply_pressure_Pa": 1.38e7 + 5e5 * float(rng.standard_normal()),
            "load_N": float(2e3 * rng.standard_normal()),
        }
        known = dict(row)
        if isnan(row["spool_m"]):
            known["spool_m"] = float(judge.memory.values[FAST_INPUTS.index("spool_m")])
        given = {
            "fresh": bool(rng.random() < 0.8),
            "elapsed": int(rng.choice([1, 1, 1, 1, 1, 2, 5, 5, 250])),
            "exchange": float(rng.choice([0.15, 0.15, 1.2, 3.0])),
            "command": float(np.clip(command, -0.5, 0.5)),
            "homed": homed,
        }
        judge.step(driving=False, **row, **given)  # type: ignore[arg-type]
        page.step(known, **given)  # type: ignore[arg-type]
        for name in ACCOUNTS:
            expected = getattr(page.evidence, name)
            assert getattr(judge.evidence, name) == pytest.approx(expected, rel=1e-9, abs=1e-15), (
                name
            )


def test_before_the_first_sample_nothing_is_known() -> None:
    assert Judge().evidence == Evidence() == (0.0,) * len(Evidence._fields)


def test_the_nominal_spool_follows_a_command_as_a_second_order_lag() -> None:
    judge = Judge()
    judge.step(command=0.5, fresh=False)
    for ticks in range(1, 12):
        judge.step(command=0.5, fresh=False)
        spool, velocity = settled_spool(0.5, ticks)
        assert judge.evidence.spool_m == pytest.approx(spool, rel=1e-9)
        assert judge.evidence.spool_velocity == pytest.approx(velocity, rel=1e-9)


# -- where each check begins to hold ---------------------------------------------------------------


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_encoder_may_go_as_far_as_its_speed_allows_and_two_counts(sign: float) -> None:
    for elapsed in (1, 3):
        farthest = TOL.jump_speed_m_per_s * (elapsed + 0.4) * T + 2.0 * TOL.count_m
        for part, expected in ((0.999, NOTHING), (1.001, trip(Cause.ENCODER_JUMP, "position_m"))):
            judge = Judge()
            judge.step(exchange=0.25)
            judge.interlock.memory.evidence[9] = 0.0
            found = judge.step(
                position_m=0.3 + sign * part * farthest, elapsed=elapsed, exchange=0.15
            )
            assert found == expected or (part < 1.0 and found[1] is Cause.POSITION_AGAINST_FLOW)


def test_a_jump_within_a_few_ticks_is_no_travel_against_the_flow() -> None:
    judge = Judge()
    judge.step()
    assert judge.step(position_m=0.302) == NOTHING


@pytest.mark.parametrize(("sign", "account"), [(1.0, "high_m"), (-1.0, "low_m")])
def test_travel_that_no_flow_explains_trips_beyond_five_millimetres(
    sign: float, account: str
) -> None:
    judge, x = Judge(), 0.3
    judge.step()
    found = NOTHING
    while found == NOTHING:
        before = getattr(judge.evidence, account)
        x += sign * 4e-4
        found = judge.step(position_m=x)
    assert before <= 5e-3 < getattr(judge.evidence, account)
    assert found == trip(Cause.POSITION_AGAINST_FLOW, "position_m")


def test_an_encoder_that_stood_still_all_the_while_is_frozen() -> None:
    judge = Judge()
    judge.step()
    found = NOTHING
    while found == NOTHING:
        found = judge.step(command=2.0)
    assert found == trip(Cause.ENCODER_FROZEN, "position_m")
    moved = Judge()
    moved.step()
    found = NOTHING
    while found == NOTHING:
        # It counts once, after the account has left zero.
        found = moved.step(command=2.0, position_m=0.3 if moved.counter < 12 else 0.30003)
    assert found == trip(Cause.POSITION_AGAINST_FLOW, "position_m")


def test_what_the_valve_can_have_done_between_two_samples_is_allowed_beside_the_account() -> None:
    for elapsed in (2, 4):
        unseen = 0.5 * TOL.jump_speed_m_per_s * (elapsed - 1) * T
        judge = Judge()
        judge.step()
        judge.memory.evidence[Evidence._fields.index("high_m")] = 5e-3 + 0.9 * unseen
        assert judge.step(elapsed=elapsed, position_m=0.30001) == NOTHING
        assert 5e-3 < judge.evidence.high_m < 5e-3 + unseen
        judge.memory.evidence[Evidence._fields.index("high_m")] = 5e-3 + 1.1 * unseen
        found = judge.step(elapsed=elapsed, position_m=0.30002)
        assert found == trip(Cause.POSITION_AGAINST_FLOW, "position_m")


def test_travel_and_work_in_a_gap_between_samples_are_no_evidence() -> None:
    # In the gap somebody nulls a valve that drove the ram, so that its end explains nothing of it.
    judge = Judge()
    judge.step(load_N=0.0)
    judge.steps(100, fresh=False)
    braking = {"pressure_1_Pa": 6e6, "pressure_2_Pa": 8e6, "load_N": 0.0}
    assert judge.step(braking, position_m=0.34) == NOTHING
    # As long a gap again is no more usual.
    judge.steps(100, fresh=False)
    assert judge.step(braking, position_m=0.38) == NOTHING
    assert judge.step(braking, position_m=0.38) == NOTHING
    assert (judge.evidence.high_m, judge.evidence.low_m, judge.evidence.work_J) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("longer", "is_kept"), [(5, True), (6, False)])
@pytest.mark.parametrize("usual", [1, 10])
def test_a_gap_is_what_is_longer_than_usual_by_the_time_of_five_millimetres(
    usual: int, longer: int, is_kept: bool
) -> None:
    judge = Judge()
    for ticks in range(1, usual + 1):
        # What is usual grows by a tick with each sample.
        judge.step(elapsed=usual)
        assert judge.evidence.usual_ticks == ticks
    judge.step(elapsed=usual + longer, position_m=0.303)
    assert (judge.evidence.high_m > 0.0) is is_kept
    judge.step(position_m=0.303)
    assert judge.evidence.usual_ticks == 1.0


def worked(work_j: float) -> Found:
    """Give a ram's account of work a value, and judge a sample at rest."""
    judge = Judge()
    judge.step(load_N=0.0)
    judge.memory.evidence[Evidence._fields.index("work_J")] = work_j
    return judge.step(load_N=0.0)


def test_work_against_the_motion_trips_beyond_its_limit_and_needs_the_load_cell() -> None:
    assert worked(TOL.work_J) == NOTHING
    assert worked(1.0001 * TOL.work_J) == trip(Cause.PRESSURES_CROSSED, "pressure_1_Pa")
    judge = Judge()
    judge.step()
    judge.memory.evidence[Evidence._fields.index("work_J")] = 2.0 * TOL.work_J
    assert judge.step() == NOTHING


@pytest.mark.parametrize("channel", ["pressure_1_Pa", "pressure_2_Pa"])
def test_a_chamber_may_stand_above_the_supply_for_fifty_ticks(channel: str) -> None:
    # Without a supply transducer the nominal supply counts; with one, what it reads.
    for supply in (nan, 1.2e7):
        limit = (SUPPLY if isnan(supply) else supply) + TOL.above_supply_Pa
        judge = Judge()
        for level, ticks in ((limit - 10.0, 60), (limit + 10.0, 50), (limit - 10.0, 1)):
            judge.sample[channel] = level
            judge.sample["supply_pressure_Pa"] = supply
            judge.memory.evidence[7:9] = 0.0
            for _ in range(ticks):
                judge.memory.evidence[7:9] = 0.0
                found = judge.step(supply_pressure_Pa=supply)
                judge.memory.repeated[:] = 0
                assert found == NOTHING, (level, judge.evidence)
        judge.sample[channel] = limit + 10.0
        for _ in range(51):
            judge.memory.evidence[7:9] = 0.0
            judge.memory.repeated[:] = 0
            found = judge.step(supply_pressure_Pa=supply)
        assert found == trip(Cause.PRESSURE_ABOVE_SUPPLY, channel)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_spool_may_be_away_from_the_nominal_valve_s_for_twenty_five_ticks(sign: float) -> None:
    judge = Judge()
    judge.step(command=sign * 0.4)
    settled = NOMINAL.valve_gain * 0.4
    allowed = TOL.spool_m + 0.15 * settled
    judge.steps(60, command=sign * 0.4, fresh=False)

    def stands(part: float) -> Found:
        judge.memory.evidence[7:9] = 0.0
        judge.memory.repeated[:] = 0
        return judge.step(command=sign * 0.4, spool_m=sign * (settled + part * allowed))

    assert [stands(0.99) for _ in range(40)] == [NOTHING] * 40
    judge.memory.evidence[Evidence._fields.index("spool_ticks")] = 0.0
    assert [stands(1.01) for _ in range(25)] == [NOTHING] * 25
    assert stands(1.01) == (Action.TRIP, Cause.SPOOL_NOT_FOLLOWING, "spool_m")


def test_a_spool_that_is_elsewhere_after_a_gap_is_given_the_time_to_follow() -> None:
    # While exchanges fail, the device does not take the commands that the nominal valve follows.
    judge, away = Judge(), 1.01 * TOL.spool_m
    judge.step()
    judge.steps(185, fresh=False)
    assert judge.step(spool_m=away) == NOTHING
    assert judge.evidence.spool_ticks == 1.0
    assert judge.step(spool_m=0.0) == NOTHING
    assert judge.evidence.spool_ticks == 0.0


def test_the_time_between_two_samples_counts_if_the_spool_is_away_in_both() -> None:
    judge, away = Judge(), 1.01 * TOL.spool_m
    judge.step()
    assert judge.step(spool_m=away) == NOTHING
    judge.steps(24, fresh=False)
    assert judge.step(spool_m=away) == (Action.TRIP, Cause.SPOOL_NOT_FOLLOWING, "spool_m")


def test_without_a_position_only_the_spool_is_checked() -> None:
    judge = Judge()
    judge.step()
    x_before = judge.evidence.position_m
    judge.steps(3, position_m=nan)
    assert judge.evidence.position_m == x_before
    assert judge.evidence.gap_ticks == 0.0


def test_a_ram_that_is_homed_anew_keeps_no_step_across_it() -> None:
    judge = Judge()
    assert judge.step(homed=False, position_m=-0.2) == NOTHING
    assert judge.evidence.started == 1.0
    assert judge.step(homed=True, position_m=0.3) == NOTHING
    assert judge.evidence.started == 2.0
    assert judge.evidence.high_m == 0.0


# -- on the very bound -----------------------------------------------------------------------------


def remembers(judge: Judge, **values: float) -> None:
    """Give a judge's `Evidence` some values."""
    for name, value in values.items():
        judge.memory.evidence[Evidence._fields.index(name)] = value


@pytest.mark.parametrize(
    ("pressure", "side", "sign", "account"),
    [(5e5, 1, 1.0, "high_m"), (5e5, 2, -1.0, "low_m"), (8e5, 1, 1.0, "high_m")],
)
def test_a_chamber_of_five_bar_is_not_dry(
    pressure: float, side: int, sign: float, account: str
) -> None:
    judge = Judge()
    at = {f"pressure_{side}_Pa": pressure}
    judge.step(at)
    judge.step(at, position_m=0.3 + sign * 1e-3)
    assert getattr(judge.evidence, account) > 0.0
    dry = Judge()
    at = {f"pressure_{side}_Pa": 4.99e5}
    dry.step(at)
    dry.step(at, position_m=0.3 + sign * 1e-3)
    assert getattr(dry.evidence, account) == 0.0


def test_an_account_is_kept_if_the_time_between_samples_is_as_unsure_as_it_is_long() -> None:
    for exchange, is_kept in ((0.5, True), (0.51, False)):
        judge = Judge()
        judge.step(exchange=exchange)
        judge.step(exchange=exchange, position_m=0.301)
        assert (judge.evidence.high_m > 0.0) is is_kept


def test_an_encoder_that_stopped_as_the_account_left_zero_is_frozen_and_one_after_is_not() -> None:
    for still, cause in ((3.0, Cause.ENCODER_FROZEN), (2.0, Cause.POSITION_AGAINST_FLOW)):
        judge = Judge()
        judge.step()
        remembers(judge, high_m=6e-3, account_ticks=3.0, still_ticks=still)
        assert judge.step() == trip(cause, "position_m")


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_step_of_the_farthest_that_the_encoder_may_go_is_no_jump(sign: float) -> None:
    judge = Judge()
    judge.step(position_m=0.0, exchange=0.25)
    farthest = TOL.jump_speed_m_per_s * ((1.0 + (0.15 + 0.25)) * T) + 2.0 * TOL.count_m
    found = judge.step(position_m=sign * farthest, exchange=0.15)
    assert found[1] is not Cause.ENCODER_JUMP


def test_an_account_of_the_travel_allowed_does_not_trip() -> None:
    # A closed valve without tolerances lets nothing through, so that the account stays as it is.
    judge = Judge(tol=TOL._replace(null_m=0.0))
    pressures = {"pressure_1_Pa": 7e6, "pressure_2_Pa": 7e6}
    judge.step(pressures)
    remembers(judge, high_m=TOL.flow_account_m)
    assert judge.step(pressures) == NOTHING
    assert judge.evidence.high_m == TOL.flow_account_m


@pytest.mark.parametrize("side", [1, 2])
def test_a_chamber_at_the_allowed_excess_is_not_above_the_supply(side: int) -> None:
    judge = Judge()
    judge.step({f"pressure_{side}_Pa": SUPPLY + TOL.above_supply_Pa})
    assert getattr(judge.evidence, f"above_{side}_ticks") == 0.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_spool_at_the_allowed_distance_is_not_away(sign: float) -> None:
    judge = Judge()
    judge.step(spool_m=sign * TOL.spool_m)
    assert judge.evidence.spool_ticks == 0.0
