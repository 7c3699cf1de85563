"""A short oscillator with a hidden term, for the tests of the comparison."""

from pathlib import Path

import numpy as np

from estimator.gap.plant.compile_plant import build
from estimator.gap.plant.interface import Plant
from estimator.gap.plant.records import Record, made_of
from tools.peers.oscillator_plant import oscillator
from tools.peers.oscillators import FORMS, NOISE, Hidden, drive, simulated

VALUES = {"stiffness": 60.0, "damping": 1.2, "offset": 0.0}


def plant() -> Plant:
    """Return the plant with the known part."""
    return build(oscillator, VALUES)


def hidden(text: str, size: float) -> Hidden:
    """Return a hidden term of one form without a parameter."""
    (form,) = [form for form in FORMS if form.text == text]
    return Hidden(((form, 0.0),), (size,))


def records(of: Plant, term: Hidden, count: int = 3, seconds: float = 4.0) -> list[Record]:
    """Return records of an oscillator with this term, each of another motion."""
    found = []
    for seed in range(count):
        rng = np.random.default_rng([5, seed])
        push = drive(rng, round(seconds * 1e3))
        motion = simulated(60.0, 1.2, term, push, (0.0, 0.0))
        read = motion[:, :1] + NOISE * rng.standard_normal((len(push), 1))
        found.append(made_of(str(Path(str(seed))), push[:, None], read, of))
    return found
