"""A limit that was not judged is told with the reason, and does not read as one that was kept."""

import numpy as np

from control import Constant, Sequence, Steps, Stretch
from estimator.leaks import Decision
from faults import CampaignTest, Criterion, Expression, TestLimit
from rig.runner.campaign.bench import plain_test
from rig.runner.outcomes.limits import LimitWatch
from rig.runner.outcomes.measures import CriterionResult, Measures

from .test_measures import a_test, rows

CHANNELS = ("time_s", "setpoint_m", "position_m", "oil_temperature_K")
WAKEUP = Expression("percentile(wakeup_s, 99)")


def reasons(
    *limits: TestLimit, decision: Decision | None = None, samples: np.ndarray | None = None
) -> list[str]:
    watched = LimitWatch(a_test(limits=limits), CHANNELS)
    samples = rows() if samples is None else samples
    watched.take(samples, decision)
    watched.finish(decision, dict)
    return [str(each) for each in watched.not_judged(float(samples[-1, 0]), None)]


def test_timing_is_not_judged_where_no_clock_runs() -> None:
    limit = TestLimit("loop_wakeup_p99", "s", high=1e-3, over_s=1.0, expression=WAKEUP)
    assert reasons(limit) == [
        "the limit of loop_wakeup_p99 was not judged: the loop of a simulated rig runs by no clock"
    ]


def test_a_figure_that_never_became_known_is_not_judged() -> None:
    friction = TestLimit("friction_stiction", "N", high=1.0, each="test")
    assert "it was not known at the end of the test" in reasons(friction)[0]
    late = TestLimit("heat", "K", high=9.0, over_s=60.0, expression=Expression("max(position_m)"))
    assert "`over` 60 s had not passed" in reasons(late)[0]
    step = TestLimit("settling", "s", high=1.0, each="step")
    flat = rows()
    flat[:, 1] = 0.3
    assert "no step began in which it was known" in reasons(step, samples=flat)[0]


def test_a_limit_of_a_segment_that_did_not_begin_is_not_judged() -> None:
    limit = TestLimit("position_m", "m", high=1.0, during="late", windows_s=((11.0, 12.0),))
    assert reasons(limit) == ["the limit of position_m in late was not judged: the segment late "
                              "did not begin"]  # fmt: skip


def test_limits_that_were_judged_are_left_out() -> None:
    assert not reasons(TestLimit("oil_temperature_K", "K", high=9.0))
    assert not reasons(TestLimit("position_m", "m", high=9.0))
    healthy = Decision("healthy", 0.0, 1.0)
    assert not reasons(TestLimit("leak", "m^3/s", high=1.0), decision=healthy)


def stepping() -> tuple[CampaignTest, np.ndarray]:
    """Return a test whose step of 40 mm is not settled when its segment ends, and its rows."""
    motion = Sequence(
        (
            Stretch(Steps((0.3, 0.34), 0.5), 0.8, "stepping"),
            Stretch(Constant(0.34), 1.0, "rest"),
        )
    )
    plain = plain_test("a", motion, 1.8, 0.3, 1.0)
    time = 1e-3 * np.arange(1800)
    setpoint = np.where(time < 0.4995, 0.3, 0.34)
    position = np.where(time < 1.2995, 0.3, 0.34)
    return plain, np.column_stack([time, setpoint, position, np.full(1800, 5.0)])


def test_a_step_ends_with_its_segment() -> None:
    test, samples = stepping()
    limit = TestLimit("settling", "s", high=0.6, each="step", action="warn")
    watched = LimitWatch(CampaignTest(**{**vars(test), "limits": (limit,)}), CHANNELS)
    for batch in np.array_split(samples, 36):
        watched.take(batch, None)
    (passing,) = watched.passed
    assert str(passing).startswith(
        "settling of the step from 0.500 s did not settle, above 0.6 s at 0.799 s"
    )


def test_a_criterion_of_settling_ends_a_step_with_its_segment() -> None:
    test, samples = stepping()
    settling = Criterion("settling", -np.inf, 3.0, "s")
    measures = Measures(CampaignTest(**{**vars(test), "criteria": (settling,)}), CHANNELS)
    measures.take(samples)
    (result,) = measures.results({}, None)
    assert (result.value, result.met) == (np.inf, False)
    assert str(result) == "settling never, at most 3 s"


def test_an_infinite_figure_is_shown_as_it_is() -> None:
    def words(value: float) -> str:
        return str(CriterionResult("mine", value, "m", -np.inf, 3.0, value <= 3.0))

    assert words(np.inf) == "mine without bound, at most 3 m"
    assert words(-np.inf) == "mine -inf, at most 3 m"
    assert words(np.nan) == "mine not known, at most 3 m"
