"""Identifies friction from the samples of a test, and converts it for `results.json`."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import asdict
from typing import Any, Final

from estimator.filters import DEFAULT_FILTER, FilterRun
from estimator.friction import (
    BlockCollector,
    FrictionCurve,
    Spring,
    friction_changes,
    identify_friction,
    load_lag,
)
from estimator.leaks import Decision, Detector, Samples
from faults import CampaignTest
from rig.plant import Model, SensorParameters
from rig.surviving import threads_granted

from .outcome_record import named

_ALIVE_S: Final = 0.5
"""Time in s after which friction that is still being identified is waited for anew. Some six
seconds of a processor are needed for the samples of an hour, and a session with a real rig takes a
supervisor without a sign of life for lost after 5 s."""


class FrictionWatch:
    """A detector that passes all samples on to another one, and identifies friction from them.

    Args:
        detector: the other detector, which makes the decisions.
        test: the test, whose load gives the spring; if it has none, the model's spring is used.
        model: the model that the filter assumes.
        sensors: data sheet of the transducers.
        alive: is called every half second while friction is identified, so that a session with a
            real rig does not take its supervisor for lost.
    """

    def __init__(
        self,
        detector: Detector,
        test: CampaignTest,
        model: Model,
        sensors: SensorParameters,
        alive: Callable[[], None] = lambda: None,
    ) -> None:
        self._alive = alive
        self._detector = detector
        self._model = model
        self._sensors = sensors
        self._spring = model_spring(model)
        if test.load is not None:
            self._spring = Spring(test.load.stiffness, test.load.contact)
        self._collector = BlockCollector(model.parameters)
        self._watching = False
        self._curve: FrictionCurve | None = None

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Pass the next samples on, with the filter's run over them, and collect them for friction.

        They are only collected if the filter is the default one, which estimates the load.
        """
        self._detector.update(samples, run)
        self._watching = run.filter.name == DEFAULT_FILTER
        if self._watching:
            self._collector.take(samples, run)
            self._curve = None

    def decide(self) -> Decision:
        """Return the other detector's decision."""
        return self._detector.decide()

    @property
    def curve(self) -> FrictionCurve | None:
        """The friction identified from all samples so far, computed at the first access after them.

        It is None without samples, or if the filter does not estimate the load.
        """
        if self._watching and self._curve is None:
            self._curve = self._identified()
        return self._curve

    def _identified(self) -> FrictionCurve:
        """Identify friction in another thread, and call `alive` from this one meanwhile.

        Raises:
            OSError: the system grants no further thread.
        """
        lag, blocks = load_lag(self._model, self._sensors), self._collector.blocks
        known = blocks, lag, self._spring, self._model.parameters
        with ThreadPoolExecutor(1) as threads:
            with threads_granted():
                identified = threads.submit(identify_friction, *known)
            while not wait([identified], _ALIVE_S).done:
                self._alive()
            return identified.result()


def model_spring(model: Model) -> Spring:
    """Return the spring that a model's parameters describe."""
    return Spring(model.parameters.spring_stiffness, model.parameters.spring_contact)


def friction_figures(curve: FrictionCurve) -> dict[str, Any]:
    """Return a friction curve as JSON-able values in SI; other programs rely on the keys."""
    return {
        **{name: asdict(estimate) for name, estimate in curve.estimates.items()},
        **named(curve, slowest_m_per_s="slowest", fastest_m_per_s="fastest", strokes="strokes"),
        **named(curve.spring, spring_stiffness_N_per_m="stiffness", spring_contact_m="contact"),
        "filter_lag_s": curve.lag_s,
        "bins": [
            named(each, velocity_m_per_s="velocity", force_N="force", spread_N="spread")
            | {"count": each.count}
            for each in curve.bins
        ],
    }


def change_figures(first: FrictionCurve, last: FrictionCurve) -> dict[str, Any]:
    """Return by how much each parameter differs in two friction curves, as JSON-able values in SI.

    A parameter that one of the curves does not show is left out. For each other one, by its name,
    `difference` is that of `last` less that of `first`, `z` is the difference over its standard
    error, and `significant` says whether it is too large for chance.
    """
    return {
        change.name: {
            "difference": change.difference,
            "z": change.score,
            "significant": bool(change.significant),
        }
        for change in friction_changes(first, last)
    }
