"""The command line of the tracking studies: `python -m tools.tracking drawn | picture | leaks`."""

from pathlib import Path

import click
import numpy as np

from rig.configuration import load_rig

from .drawn import SEED, tracked
from .leaks import table
from .pictures import sine_picture
from .runs import TRACKING


@click.group()
def main() -> None:
    """Measure what the tracking law is worth."""


@main.command()
@click.option("--rigs", default=100, show_default=True, help="Number of rigs.")
@click.option("--gain", default=50.0, show_default=True, help="Gain, V/m.")
@click.option("--seed", default=SEED, show_default=True, help="Which rigs are drawn.")
def drawn(rigs: int, gain: float, seed: int) -> None:
    """Follow a sine, hold and step on rigs drawn at random; every second has a hidden effect."""
    reached, near, swinging, hunting, creeping = 0, 0, 0, 0, 0
    overshoots, settled = [], []
    for each in tracked(load_rig("simulated"), TRACKING, gain, rigs, seed):
        reached += each.reachable
        near += each.reachable and each.rms <= 5e-3
        swinging += each.unstable
        hunting += each.reachable and each.hunting > 1e-4
        creeping += each.reachable and each.creep > 1e-4 >= each.hunting
        if each.reachable:
            overshoots.append(each.overshoot)
            settled.append(each.settling_s)
        click.echo(
            f"{each.number} {each.effect or '-'} reachable={each.reachable} "
            f"rms={1e3 * each.rms:.2f} mm worst={1e3 * each.worst:.2f} mm "
            f"hunting={1e3 * each.hunting:.3f} mm creep={1e3 * each.creep:.3f} mm "
            f"overshoot={each.overshoot:.1%} settled={each.settling_s:.2f} s"
        )
    click.echo(
        f"{rigs} rigs, {reached} reachable: {near} within 5 mm rms, {swinging} unstable, "
        f"{hunting} hunting by more than 0.1 mm, {creeping} held rams move as far one way"
    )
    over = np.percentile(overshoots, (50, 90))
    # Some are infinite, between which nothing can be interpolated.
    late = np.percentile(settled, (50, 90), method="higher")
    click.echo(
        "steps on reachable rigs, median and 90th percentile: "
        f"overshoot {over[0]:.1%} and {over[1]:.1%}, "
        f"settled within 5 % after {late[0]:.2f} and {late[1]:.2f} s"
    )


@main.command()
@click.argument("file", type=click.Path(path_type=Path), default="docs/images/tracking.png")
def picture(file: Path) -> None:
    """Draw the sine under both laws."""
    for law, rms in sine_picture(file).items():
        click.echo(f"{law}: {1e3 * rms:.2f} mm rms")


@main.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
def leaks(folder: Path) -> None:
    """Print the table of a run of tools/tracking/leaks.yaml."""
    for line in table(folder):
        click.echo(line)


if __name__ == "__main__":
    main()
