"""The steps by which a new rig is commissioned, each after the operator's word.

The first step moves the ram in open loop, by small commands, as nobody knows yet which way valve,
encoder and pressures count. Every later one runs with the signs that it found, under all checks of
a run. Between two steps after the first the rig is safe: valve at null and disabled, pump unloaded.
"""

from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, TypeVar

from control import Multisine
from estimator.baselines import BaselineError, learn_baseline, write_baseline
from estimator.filters import DEFAULT_FILTER
from estimator.friction import PARAMETERS
from rig.configuration import Rig, dump_model, show
from rig.loop import HomingError, StopRequestedError, TripError
from rig.plant import TICK, Model
from rig.recording import unit_of
from rig.runner.campaign import WITHOUT_TESTS, Needs, StopFlag, compile_for, plain_test
from rig.runner.experiments import (
    connected_parts,
    part_campaign,
    revised_model,
    run_friction_experiment,
    stroke_of,
)
from rig.runner.outcomes import Observer, model_spring
from rig.supervisor import Onlooker, Session, UnprovenRig, WatchedRig, checks_for, greatest_null_V

from .findings import Changes, Finding, Found
from .operator import DeclinedError, Operator
from .probing import NotFoundError, Probing, Signs
from .standing import LOOKED_AT, LOOKED_S, NOISES, SETTLE_S, Standing, standing_of

T = TypeVar("T")

SKIPPABLE: Final = ("friction", "baseline")
"""Steps that may be left out: those that nothing after them needs."""
LEAST_NULL_V: Final = 0.01
"""Null below this is not written, V: a thousandth of the range of a valve, as for `rig tune`."""
NOISE_PART: Final = 0.25
"""Part by which noise must differ from the file's to be written: the checks of a run compare with
six standard deviations, so that a fifth less is still one chance in a million in a sample."""
_ERRORS: Final = 4.0
"""Least difference from the file's noise in standard errors, where that is more."""
STROKE_M: Final = 1e-3
"""Least difference of the stroke from the file's that is written, m: each stop is found to within
five counts of the encoder, and gives way by two (`rig.loop.homing`)."""
BASELINE_S: Final = 60.0
"""Duration of each healthy motion, s; a baseline needs some 20 s of motion of centimetres."""
BASELINES: Final = 3
_TONES: Final = (0.1, 0.23, 0.41, 0.6)
"""Frequencies of the healthy motions, Hz, up to about the crossover of the thesis's loop."""
_PART_OF_RANGE: Final = 0.3
"""Greatest sum of their tones, in the range that experiments may use."""
_WITHIN_S: Final = 3.0

_FIRST: Final = (
    "The pump is loaded and the valve enabled. The ram makes small moves in open loop, to find "
    "which way valve, encoder and pressures count: by some 10 mm each, at most 60 mm, slower than "
    "50 mm/s. {sides}Keep clear of the rod, and the emergency stop within reach"
)
_SIDES: Final = "Then a small leak opens from either chamber in turn. "
_HOMING: Final = (
    "The ram goes to its {end} stop, slowly and gently, twice, and is then held for 8 s"
)
_OTHER_END: Final = "The ram goes to its other stop ({end}), in the same way, to measure the stroke"
_FRICTION: Final = (
    "The friction experiment: strokes up to the speed of the open valve, then slow ramps at ten "
    "places, 9 minutes in all, within the position limits"
)
_BASELINE: Final = "Healthy motion over a third of the stroke, {count} times {seconds:.0f} s"


Seen = tuple[Callable[[str], None], Onlooker]
"""What shows a line to the operator, and what follows the states of a session."""


def _unwatched(part: str) -> AbstractContextManager[Observer]:
    return nullcontext(Observer())


class Commissioning:
    """Commissions a rig; what it found stands in its attributes, also if it is ended early.

    Args:
        rig: a rig on hardware with the section `homing`, as its file describes it.
        assumed: the model that is assumed of it.
        directory: an existing folder, for recordings and trip reports.
        operator: is asked before each motion.
        skip: steps of `SKIPPABLE` that are left out.
        say: shows a line to the operator.
        stop: once a stop is requested on it, the rig is made safe and the command ends.
        watched: is called with words for a part with tests, such as "friction"; makes what
            follows these while they run.
        seen: is called with words for any other part; makes the context of its session, which
            gives what shows a line and what follows the session's states.

    Attributes:
        findings: what was looked for, in the order of the steps.
        changes: what follows for the rig file.
        signs: what the first motions showed; None before.
        model: the assumed model, with what was found added to it.
        files: files that were written for use in campaigns, in words -> path.
    """

    def __init__(
        self,
        rig: Rig,
        assumed: Model,
        directory: Path,
        operator: Operator,
        *,
        skip: Collection[str] = (),
        say: Callable[[str], None],
        stop: StopFlag,
        watched: Callable[[str], AbstractContextManager[Observer]] = _unwatched,
        seen: Callable[[str], AbstractContextManager[Seen]] | None = None,
    ) -> None:
        self._rig = rig
        self._directory = directory
        self._operator = operator
        self._skip = frozenset(skip)
        self._say = say
        self._stop = stop
        self._watched = watched
        self._seen = seen or (lambda part: nullcontext((say, Onlooker())))
        self.findings: list[Finding] = []
        self.changes = Changes()
        self.signs: Signs | None = None
        self.model = assumed
        self.files: dict[str, Path] = {}

    @property
    def rig(self) -> Rig:
        """The rig as it is known now."""
        return self.changes.applied(self._rig)

    @property
    def complete(self) -> bool:
        """Whether everything that was looked for was found."""
        return all(each.standing != "not found" for each in self.findings)

    def run(self) -> None:
        """Make all steps.

        Raises:
            NotFoundError: the signs were not found, without which nothing more may move.
            DeclinedError: the operator did not agree to a motion.
            DriverError: a device does not answer, or is not the configured one.
            TripError: the rig tripped or was stopped.
            ExperimentStoppedError: the rig tripped or was stopped in friction or baseline.
            OSError: a file cannot be written.
        """
        assumed = self.model
        compile_for(Needs(self._rig, DEFAULT_FILTER), WITHOUT_TESTS, self._say, self._stop)
        self._find_signs()
        first = self._find_standing()
        self._find_stroke(first)
        if "friction" not in self._skip:
            self._find_friction()
        if self.model != assumed:
            path = self._directory / "model.yaml"
            dump_model(self.model, path)
            self.files["model for campaigns"] = path
        if "baseline" not in self._skip:
            self._learn_baseline()

    def _ask(self, motion: str, alive: Callable[[], None] | None = None) -> None:
        if not self._operator.agrees(motion, alive or self._heed_stop):
            raise DeclinedError("not agreed to; nothing more is moved, and the file stays as it is")

    def _heed_stop(self) -> None:
        if self._stop.requested:
            raise StopRequestedError(f"stopped by {self._stop.reason}")

    # Signs

    def _find_signs(self) -> None:
        rig = self._rig
        leaks = {"external_leakage_1", "external_leakage_2"} <= set(rig.injectable)
        self._ask(_FIRST.format(sides=_SIDES if leaks else ""))
        (fast,) = (spec for spec in rig.drivers if spec.kind == "fast")
        greatest = greatest_null_V(
            checks_for(rig, self.model, frozenset(fast.inputs), 1.0 / rig.loop.rate)
        )
        with self._seen("first motions") as (say, onlooker):
            connected = UnprovenRig(
                rig, DEFAULT_FILTER, self.model, self._directory, self._stop, say, onlooker
            )
            connected.connect()
            try:
                connected.arm()
                self.signs = Probing(connected, self.model, greatest, self._operator, say).run()
            except NotFoundError as error:
                subject = "signs of valve, encoder and pressures"
                self.findings.append(Finding(subject, "", "", "not found", str(error)))
                raise
            finally:
                connected.leave()
        self._tell_signs(self.signs)

    def _tell_signs(self, signs: Signs) -> None:
        before, now = self._rig.wiring, self._rig.wiring.turned(signs.wiring)
        if now != before:
            self.changes = replace(self.changes, wiring=now)
        told = (
            f"told by {signs.sided_by}"
            if signs.sided_by
            else (
                "all channels agree with the file; nothing told that they are not all turned "
                "over, as the rig has no bypasses of both chambers and nobody looked"
            )
        )
        answers = signs.answers
        for subject, key, tells in (
            ("valve polarity", "valve", True),
            ("encoder sign", "encoder", True),
            ("pressure lines", "pressures", answers.load_pressure != 0),
            ("spool sensor's sign", "spool", answers.spool != 0),
        ):
            if key == "spool" and not self._rig.has_spool_sensor:
                continue
            was, found = getattr(before, key), getattr(now, key)
            if tells:
                self.findings.append(Finding(subject, found, was, _standing(was != found), told))
            else:
                remark = "it does not answer to the command: check the transducer and its line"
                self.findings.append(Finding(subject, "", was, "not found", remark))

    # Null and noise

    @contextmanager
    def _session(self, rig: Rig) -> Iterator[WatchedRig]:
        with self._seen("homing") as (say, onlooker):
            connected = WatchedRig(
                rig, DEFAULT_FILTER, self.model, self._directory, self._stop, say, onlooker
            )
            with Session(connected):
                yield connected

    def _homed(self, motion: str, rig: Rig, look: Callable[[WatchedRig], T]) -> T:
        """Return what `look` returns of a rig that is armed and homed.

        Homing that fails is repeated once, after the operator's word: a machine that stalls for
        half a second makes a ram look as if it stood.
        """
        self._ask(motion)
        try:
            with self._session(rig) as connected:
                return look(connected)
        except TripError as error:
            if not isinstance(error.__cause__, HomingError):
                raise
            self._say(f"{error}; once more")
        self._ask(motion)
        with self._session(rig) as connected:
            return look(connected)

    def _find_standing(self) -> float:
        """Find null and noise with the ram homed and held; return the offset of the encoder, m."""
        assert self.signs is not None
        rig = self.rig
        homing = rig.homing
        assert homing is not None
        # The null that the small motions told is needed for homing, whatever the file says.
        rough = replace(rig, control=replace(rig.control, null=self.signs.null_V))

        def look(connected: WatchedRig) -> tuple[Standing, float]:
            ticks = round((SETTLE_S + LOOKED_S) / TICK)
            begun = connected.rows
            connected.wait(
                lambda: connected.rows >= begun + ticks, 4.0 * (SETTLE_S + LOOKED_S),
                "the loop brings no rows", "look at the session's log",
            )  # fmt: skip
            standing = standing_of(connected.recent(LOOKED_S, LOOKED_AT), TICK)
            return standing, connected.offset_m

        standing, offset = self._homed(_HOMING.format(end=homing.end), rough, look)
        self._tell_null(standing.null_V)
        self._tell_noise(standing)
        return offset

    def _tell_null(self, null: float) -> None:
        before = self._rig.control.null
        found, was = f"{1e3 * null:.0f} mV", f"{1e3 * before:.0f} mV"
        if abs(null - before) < LEAST_NULL_V:
            self.findings.append(Finding("valve null", found, was, "as in the file"))
            return
        self.changes = replace(self.changes, null_V=round(null, 3))
        self.findings.append(Finding("valve null", found, was, "changed"))

    def _tell_noise(self, standing: Standing) -> None:
        sensors = self._rig.sensors
        noises: dict[str, float] = {}
        for key in dict.fromkeys(NOISES.values()):
            # Channels that share a key share the noise of the noisiest of them.
            shared = [standing.noise.get(name) for name, of in NOISES.items() if of == key]
            noisiest = max(filter(None, shared), key=lambda noise: noise.deviation, default=None)
            if noisiest is None:
                continue
            usual, value = getattr(sensors, key), float(f"{noisiest.deviation:.2g}")
            part = max(NOISE_PART, _ERRORS * noisiest.error)
            if not abs(value - usual) <= part * usual:
                noises[key] = value
        if noises:
            self.changes = replace(self.changes, noises=noises)
        for channel, key in NOISES.items():
            self._tell_noise_of(channel, getattr(sensors, key), key in noises, standing)
        for channel in ("position_m", "pressure_1_Pa", "pressure_2_Pa"):
            if channel in standing.silent and channel not in NOISES:
                remark = "it reads nothing: check the transducer and its line"
                self.findings.append(Finding(channel, "", "", "not found", remark))

    def _tell_noise_of(self, channel: str, usual: float, changed: bool, standing: Standing) -> None:
        subject, unit = f"noise of {channel}", unit_of(channel)
        noise, was = standing.noise.get(channel), show(usual, unit)
        if channel in standing.silent:
            if any(channel in spec.inputs for spec in self._rig.drivers):
                remark = "it reads nothing: check the transducer and its line"
                self.findings.append(Finding(subject, "", was, "not found", remark))
        elif noise is None:
            remark = "it stands still, or at an end of its range, where noise is cut off"
            self.findings.append(Finding(subject, "not judged", was, "as in the file", remark))
        else:
            found = show(noise.deviation, unit)
            self.findings.append(Finding(subject, found, was, _standing(changed)))

    # Stroke

    def _find_stroke(self, first_offset: float) -> None:
        """Find the stroke by homing at the other end.

        `first_offset` is the encoder's offset in m by the stop at which the rig is homed.
        """
        rig = self.rig
        homing = rig.homing
        assert homing is not None
        other: Literal["retract", "extend"] = "extend" if homing.end == "retract" else "retract"
        turned = replace(rig, homing=replace(homing, end=other))
        assumed, filed = self.model.parameters, rig.plant.parameters
        was = show(filed.stroke_max - filed.stroke_min, "m")
        try:
            motion = _OTHER_END.format(end=other)
            offset = self._homed(motion, turned, lambda connected: connected.offset_m)
        except TripError as error:
            if not isinstance(error.__cause__, HomingError):
                raise
            self.findings.append(Finding("stroke", "", was, "not found", str(error)))
            return
        # Either offset puts its stop where the assumed model has it.
        apart = first_offset - offset if other == "extend" else offset - first_offset
        stroke_max = round(assumed.stroke_max + apart, 4)
        found = show(stroke_max - filed.stroke_min, "m")
        if abs(stroke_max - assumed.stroke_max) >= STROKE_M:
            parameters = assumed._replace(stroke_max=stroke_max)
            name = f"{rig.name}-commissioned"
            self.model = replace(self.model, name=name, parameters=parameters)
        if abs(stroke_max - filed.stroke_max) < STROKE_M:
            self.findings.append(Finding("stroke", found, was, "as in the file"))
            return
        limits = rig.limits
        margin = max(filed.stroke_max - limits.position_max_m, 0.0)
        position_max = round(min(limits.position_max_m, stroke_max - margin), 4)
        self.changes = replace(self.changes, stroke_max=stroke_max)
        if position_max != limits.position_max_m:
            self.changes = replace(self.changes, position_max=position_max)
        remark = f"the upper position limit is {show(self.rig.limits.position_max_m, 'm')}"
        self.findings.append(Finding("stroke", found, was, "changed", remark))

    # Friction and baseline

    def _find_friction(self) -> None:
        self._ask(_FRICTION)
        folder = self._directory / "friction"
        folder.mkdir()
        with self._watched("friction") as observer:
            found = run_friction_experiment(
                self.rig, self.model, model_spring(self.model), folder,
                observer=observer, stop=self._stop,
            )  # fmt: skip
        revised = revised_model(found, folder, "while it was commissioned")
        if revised is None or found.fit is None:
            remark = "the strokes did not show all parameters; see the recordings in `friction`"
            self.findings.append(Finding("friction", "", "", "not found", remark))
            return
        estimates = found.fit.estimates
        for name in PARAMETERS:
            value, unit = estimates[name].value, estimates[name].unit
            error = estimates[name].standard_error
            was = getattr(self.model.parameters, name)
            text = "" if value is None else f"{value:.4g} ± {error or 0.0:.2g} {unit}"
            subject = f"friction: {name.replace('_', ' ')}"
            self.findings.append(Finding(subject, text, f"{was:.4g} {unit}", "new"))
        self.model = revised

    def _learn_baseline(self) -> None:
        rig = self.rig
        self._ask(_BASELINE.format(count=BASELINES, seconds=BASELINE_S))
        folder = self._directory / "baseline"
        folder.mkdir()
        low, high = stroke_of(rig)
        middle, amplitude = 0.5 * (low + high), 0.5 * _PART_OF_RANGE * (high - low)
        tests = []
        for number in range(BASELINES):
            motion = Multisine(middle, amplitude, _TONES, number)
            tests.append(
                plain_test(f"healthy {number + 1}", motion, BASELINE_S, middle, _WITHIN_S, number)
            )
        campaign = part_campaign("healthy", "Healthy motion.", rig, self.model, tests)
        with (
            self._watched("baseline") as observer,
            connected_parts(campaign, rig, folder, observer=observer, stop=self._stop) as parts,
        ):
            recordings = list(parts.run(campaign).values())
        try:
            baseline = learn_baseline(recordings, self.model)
        except BaselineError as error:
            self.findings.append(Finding("baseline", "", "", "not found", str(error)))
            return
        path = self._directory / "baseline.json"
        write_baseline(baseline, path)
        self.files["baseline for campaigns"] = path
        found = f"from {BASELINES * BASELINE_S:.0f} s of healthy motion"
        self.findings.append(Finding("baseline", found, "", "new"))


def _standing(changed: bool) -> Found:
    return "changed" if changed else "as in the file"
