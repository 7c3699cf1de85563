"""Runs a test of a campaign that locks the cylinder and measures its leaks, and judges it."""

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import inf, isfinite

from estimator.leak_test import THRESHOLD, LeakTestError, Soak
from estimator.leaks import Decision
from faults import CampaignTest, LeakTestStep, Verdict, to_litres_per_minute
from rig.loop import StopRequestedError
from rig.plant import Reading
from rig.runner.leak_test import PLACES, LeakTest, Lockable, run_leak_test
from rig.runner.outcomes import CriterionResult, Figure, Status, TestOutcome

from .setting import Phase, Setting


class LeakStep:
    """One such test while it runs, with what came of it.

    Args:
        setting: what the tests of the campaign share.
        test: the test, which has a `leak_test`.
        deadline: is started when the rig begins to be made safe.
        go_on: raises an error if an operator or a condition ends the test.
    """

    def __init__(
        self,
        setting: Setting,
        test: CampaignTest,
        deadline: threading.Timer,
        go_on: Callable[[Setting], None],
    ) -> None:
        self._setting, self._test, self._deadline, self._go_on = setting, test, deadline, go_on
        self._step = test.leak_test or LeakTestStep()
        self._found: LeakTest | None = None
        self._why = ""
        self._last_s = 0.0

    def run(self) -> Status:
        """Run the test and return whether it passed; the rig is left with its valves open.

        A chamber that does not keep its pressure, so that nothing can be judged, fails the test.

        Raises:
            StopRequestedError: somebody asked for the end of the campaign.
            TripError: the rig tripped.
        """
        setting, test = self._setting, self._test
        setting.pacer.start()
        setting.enters(Phase.POSITIONING)
        self._look(0.0)
        locked = _Watched(setting.bench.lockable(test), self._look, self._cleans_up)
        setting.enters(Phase.MAIN)
        assumed = setting.campaign.model.parameters
        try:
            self._found = run_leak_test(setting.rig, assumed, locked, self._tell)
        except LeakTestError as error:
            self._why = str(error)
            return Status.FAILED
        is_expected = self._verdict == test.expect or not self._step.judges_verdict
        met = is_expected and all(each.met for each in self._criteria)
        return Status.PASSED if met else Status.FAILED

    def completed(self, outcome: TestOutcome) -> TestOutcome:
        """Return a copy of an outcome with the results of the test so far."""
        outcome = replace(outcome, recorded_s=self._last_s, message=outcome.message or self._why)
        if self._found is None:
            lacking = Decision(str(Verdict.INCONCLUSIVE)) if self._why else None
            return replace(outcome, decision=lacking)
        found = self._found.found.findings
        surest = max(found, key=lambda each: each.flow / each.standard_error)
        return replace(
            outcome,
            decision=Decision(
                self._verdict,
                statistic=surest.flow / surest.standard_error,
                threshold=THRESHOLD,
            ),
            figures={
                f"leak_test_{each.name}": Figure(
                    to_litres_per_minute(each.flow),
                    to_litres_per_minute(each.standard_error),
                    "L/min",
                )
                for each in found
            },
            criteria=self._criteria,
            leak_test=self._found,
        )

    @property
    def _verdict(self) -> str:
        """The place that leaks, `multiple` for several, or healthy; inconclusive before the end."""
        if self._found is None:
            return str(Verdict.INCONCLUSIVE)
        leaks = self._found.leaks
        return str(Verdict.MULTIPLE) if len(leaks) > 1 else (*leaks, str(Verdict.HEALTHY))[0]

    @property
    def _criteria(self) -> tuple[CriterionResult, ...]:
        results = []
        for each in self._found.found.findings if self._found else ():
            for what, value, most in (
                ("leak, upper end of its interval", each.upper, self._step.at_most_m3_per_s),
                ("smallest leak it could have seen", each.smallest, self._step.could_see_m3_per_s),
            ):
                if isfinite(most):
                    figure = f"{PLACES[each.name]}: {what}"
                    results.append(
                        CriterionResult(figure, value, "m^3/s", -inf, most, value <= most)
                    )
        return tuple(results)

    def _look(self, time_s: float) -> None:
        """End the test if somebody asks for it, keep the pace, and tell how far the test is."""
        setting = self._setting
        if setting.stop.requested:
            raise StopRequestedError(f"stopped by {setting.stop.reason}")
        self._go_on(setting)
        self._last_s = time_s
        setting.pacer.wait_until(self._test.settle_s + time_s)
        setting.observer.test_advances(time_s, None)

    def _tell(self, number: int, _: Soak) -> None:
        self._setting.observer.rig_tells(f"{self._test.name}: soak {number} of 3")

    def _cleans_up(self) -> None:
        if self._deadline.ident is None:
            # Where the system grants no thread, the rig is made safe without a time limit.
            with suppress(RuntimeError):
                self._deadline.start()
        # A full disk must not keep the rig from being made safe.
        with suppress(OSError):
            self._setting.enters(Phase.CLEANUP)


class _Watched:
    """A rig that is locked, whose test is looked after before each sample and before its end."""

    def __init__(
        self, rig: Lockable, look: Callable[[float], None], ends: Callable[[], None]
    ) -> None:
        self._rig, self._look, self._ends = rig, look, ends

    @property
    def time_s(self) -> float:
        return self._rig.time_s

    @property
    def arrived(self) -> bool:
        return self._rig.arrived

    def exchange(self, command_V: float) -> Reading:  # noqa: N803
        self._look(self._rig.time_s)
        return self._rig.exchange(command_V)

    def block(self, chamber_1: bool, chamber_2: bool) -> None:
        self._rig.block(chamber_1, chamber_2)

    def release(self) -> None:
        self._ends()
        self._rig.release()
