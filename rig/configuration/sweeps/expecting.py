"""What `rig check` expects of the motions of a sweep: how far a ram will be from its setpoint."""

from collections.abc import Iterator
from dataclasses import replace
from math import inf

from control import Chirp, Setpoint, Sine, Trapezoid, Triangle
from faults import CampaignTest, Verdict
from rig.configuration.campaigns import expected_following, valve_speed

from .sweep_plan import Sweep, SweptMotion


def following_lines(sweep: Sweep) -> Iterator[str]:
    """Yield a line for each closed-loop motion that a speed can be told of, and any warning.

    The motion is taken as fast as it may be drawn, with the least gain that may be drawn, and the
    rig as it is before anything is drawn.
    """
    fastest = valve_speed(sweep.rig.plant.parameters, sweep.rig.limits.command_V)
    for motion in sweep.motions:
        setpoint = fastest_setpoint(motion, sweep.duration_s)
        if setpoint is None or motion.quantity != "position":
            continue
        drawn = motion.values.get("position_gain")
        gain = drawn[0].support[0] if drawn else sweep.gain_of(motion)
        test = CampaignTest(
            name=motion.name,
            test_name=motion.name,
            duration_s=sweep.duration_s,
            start_position_m=0.0,
            settle_s=0.0,
            setpoint=setpoint,
            load=None,
            faults=(),
            expect=Verdict.HEALTHY,
            repeat=1,
            seed=0,
            control=replace(sweep.control_of(motion), gain=gain),
        )
        expected = expected_following(test, sweep.rig, sweep.model)
        how = "" if motion.sequence is not None else ", at its fastest"
        yield f"  {motion.name}{how}: {expected}"
        speed = setpoint.peak_rate(sweep.duration_s)
        if fastest < speed < inf:
            yield (
                f"  warning: {motion.name} moves at up to {speed:.2g} m/s, the valve delivers "
                f"{fastest:.2g} m/s; the ram will lag"
            )


def fastest_setpoint(motion: SweptMotion, duration_s: float) -> Setpoint | None:
    """Return the setpoint of a motion with the largest amplitude and the highest frequency drawn.

    A trapezoid rests for the longest time, so that it moves fastest. The mean is the middle of what
    may be drawn. A motion with segments is the same in all cases. The result is None for other
    motions that jump, and for a multisine, whose frequencies are drawn one by one.
    """
    if motion.sequence is not None:
        return motion.sequence
    highest = {key: laws[0].support[1] for key, laws in motion.values.items()}
    if motion.type not in ("sine", "triangle", "trapezoid", "chirp"):
        return None
    mean = 0.5 * sum(motion.values["mean"][0].support)
    amplitude = max(map(abs, motion.values["amplitude"][0].support))
    phase = motion.values["phase"][0].support[0]
    if motion.type == "chirp":
        begin, end = highest["start_frequency"], highest["end_frequency"]
        return Chirp(mean, amplitude, begin, (end - begin) / duration_s, phase, motion.quantity)
    frequency = highest["frequency"]
    if motion.type == "trapezoid":
        return Trapezoid(mean, amplitude, frequency, highest["hold"], phase, motion.quantity)
    kind = Sine if motion.type == "sine" else Triangle
    return kind(mean, amplitude, frequency, phase, motion.quantity)
