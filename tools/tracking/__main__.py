"""The command line of the tracking studies: `python -m tools.tracking drawn | picture | leaks`."""

from pathlib import Path

import click

from rig.configuration import load_rig

from .drawn import tracked
from .leaks import table
from .pictures import sine_picture
from .runs import TRACKING


@click.group()
def main() -> None:
    """Measure what the tracking law is worth."""


@main.command()
@click.option("--rigs", default=100, show_default=True, help="Number of rigs.")
@click.option("--gain", default=50.0, show_default=True, help="Gain, V/m.")
def drawn(rigs: int, gain: float) -> None:
    """Follow a sine and hold on rigs drawn at random; every second has a hidden effect."""
    reached, near, swinging, hunting = 0, 0, 0, 0
    for each in tracked(load_rig("simulated"), TRACKING, gain, rigs):
        reached += each.reachable
        near += each.reachable and each.rms <= 5e-3
        swinging += each.unstable
        hunting += each.reachable and each.hunting > 1e-4
        click.echo(
            f"{each.number} {each.effect or '-'} reachable={each.reachable} "
            f"rms={1e3 * each.rms:.2f} mm worst={1e3 * each.worst:.2f} mm "
            f"hold={1e3 * each.hunting:.3f} mm"
        )
    click.echo(
        f"{rigs} rigs, {reached} reachable: {near} within 5 mm rms, {swinging} unstable, "
        f"{hunting} hunting by more than 0.1 mm"
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
