"""Half the difference of the forces of both directions, as measured and as a model of seal.py says.

    python docs/measured/seal_friction.py out/model.yaml o_ring_*.csv.gz

All means are over the samples at which the rod moves faster than 5 mm/s.
"""

import sys

import numpy as np
import yaml

MOVING = 5e-3
OVER = 5  # rows before and after, over which the velocity is taken


def si(text):
    """Return the number that a quantity such as "0.2 m/s" begins with."""
    return float(str(text).split()[0])


def friction(model, pressure, velocity):
    """Return the friction (N) at pressures (Pa) and velocities (m/s), by level and damping."""
    par = {name: si(value) for name, value in model["parameters"].items()}
    level = par["coulomb"] + par.get("pressing", 0.0) * (pressure - 4e5)
    along = {"pressure": pressure, "velocity": velocity}
    for each in model.get("discovered", ()):
        if each["to"] != "friction level" or each["form"] != "table":
            sys.exit(f"{each['to']}, {each['form']}: only tables of the friction level are counted")
        level = level + np.interp(
            along[each["of"]], *([si(v) for v in each[key]] for key in ("at", "values"))
        )
    return level * np.sign(velocity) + par["viscous"] * velocity, par["area"]


def main(model_file, *recordings):
    """Print a row of a table for each recording."""
    with open(model_file, encoding="utf-8") as file:
        model = yaml.safe_load(file)
    print("| bar | measured, N | model, N | of it pressure, N | friction, N |")
    print("|--:|--:|--:|--:|--:|")
    for name in recordings:
        data = np.genfromtxt(name, delimiter=",", names=True)
        data = data[np.all([np.isfinite(data[each]) for each in data.dtype.names], axis=0)]
        time, position, pressure, force = (
            data[each] for each in ("time_s", "position_m", "pressure_Pa", "force_N")
        )
        span = slice(OVER, -OVER)
        velocity = (position[2 * OVER :] - position[: -2 * OVER]) / (
            time[2 * OVER :] - time[: -2 * OVER]
        )
        modelled, area = friction(model, pressure[span], velocity)

        def half(values, out=velocity > MOVING, back=velocity < -MOVING):
            return 0.5 * (values[out].mean() - values[back].mean())

        pressed, rubbed = half(area * pressure[span]), half(modelled)
        print(
            f"| {np.median(pressure) / 1e5:.0f} | {half(force[span]):.1f} | {pressed + rubbed:.1f} "
            f"| {pressed:.1f} | {rubbed:.1f} |"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
