"""The command line of the tracking studies, `python -m tools.tracking --help`."""

from pathlib import Path

import click

from rig.configuration import load_rig
from tools.simulated.tracking_guide import TRACKING

from .detection import large_table, other_table, pairs, small_table
from .drawn import tracked
from .leaks import table
from .pictures import sine_picture


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


@main.command()
@click.option("--small", default=300, show_default=True, help="Leaks of 0.005 to 0.5 L/min, 80 s.")
@click.option("--large", default=500, show_default=True, help="Leaks of 0.03 to 2 L/min, 40 s.")
@click.option("--jobs", default=2, show_default=True, help="Processes.")
@click.option("--kept", type=click.Path(path_type=Path), default="runs/tracking", show_default=True,
              help="Folder of finished trials.")  # fmt: skip
def detection(small: int, large: int, jobs: int, kept: Path) -> None:
    """Compare what the detector makes of drawn leaks under both laws; interrupted, it goes on."""
    found = pairs(small, large, kept, jobs)
    for table_of in (small_table, large_table, other_table):
        click.echo(f"{table_of(found)}\n")


if __name__ == "__main__":
    main()
