"""Fits a linear model to the position loop of a ram that slides.

Tones upon a steady stroke show the integrator and the lag of that model (`control.stability`); the
oil's resonance lies above what they reach and is taken from the model.
"""

from collections.abc import Sequence
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from control import LoopModel
from rig.plant import TICK

Array = NDArray[np.float64]


def fitted_loop(
    position: Array, command: Array, frequencies: Sequence[float], extending: bool
) -> LoopModel:
    """Return the linear model of a stretch in which the ram slid one way.

    Position and command are both fitted by a line and the tones, the ratio of whose complex
    amplitudes is the measured response. Its gain gives the integrator, its phase the lag; slower
    tones, of which the encoder counts more, weigh more.

    Args:
        position: (ticks,) measured position, m.
        command: (ticks,) command, V, held from each tick on.
        frequencies: frequencies of the tones, Hz.
        extending: whether the ram extended.
    """
    time_s = TICK * np.arange(position.size)
    omega = 2.0 * pi * np.asarray(frequencies)
    angle = omega * time_s[:, None]
    known = np.column_stack([np.ones_like(time_s), time_s, np.cos(angle), np.sin(angle)])
    fits = np.linalg.lstsq(known, np.column_stack([position, command]), rcond=None)[0]
    count = omega.size
    tones = fits[2 : 2 + count] - 1j * fits[2 + count :]
    # A held command lags by half a tick, which is part of the rig as the loop sees it.
    answer = tones[:, 0] / tones[:, 1]
    integrated = answer * 1j * omega
    weight = np.abs(tones[:, 0])
    speed = float(np.average(np.abs(integrated), weights=weight))
    lag = float(-np.sum(weight * omega * np.angle(integrated)) / np.sum(weight * omega**2))
    model = speed * np.exp(-1j * omega * lag)
    misfit = float(sqrt(np.average(np.abs(integrated / model - 1.0) ** 2, weights=weight)))
    return LoopModel(
        position=float(position.mean()),
        extending=extending,
        speed_per_volt=speed,
        lag_s=max(lag, 0.0),
        misfit=misfit,
        mean_V=float(command.mean()),
        speed=float(np.polyfit(time_s, position, 1)[0]),
    )
