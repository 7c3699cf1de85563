"""The calibrations of a rig's transducers: which a rig file names, and whether they may be used."""

import datetime
from collections.abc import Iterator
from datetime import timedelta
from typing import Any, Final, Literal

from rig.channels import READINGS
from rig.configuration.reading import Field, Located, QuantityError, reference_in, resolve, show
from rig.io import RENEW, DriverSpec, TransducerCalibration, calibration_doubts
from rig.plant import NOMINAL, Model
from rig.recording import unit_of

from .limits import Limits
from .transducers import CALIBRATED, SOON, read_transducer

Expired = Literal["warn", "refuse"]
"""What is done about a calibration that does not hold today."""


class TransducerFiles(Field):
    """The annotation of a list of transducer files, each given by name or path.

    `parse` returns the list as it is; `read_calibrations` reads its elements.
    """

    def parse(self, raw: object) -> list[Any]:
        """Return a list as it is.

        Raises:
            QuantityError: it is no list.
        """
        if not isinstance(raw, list):
            remedy = "write a list of transducer files: [../transducers/pressure_1.yaml]"
            raise QuantityError("is not a list", remedy)
        return raw

    def json_schema(self) -> dict[str, Any]:
        """Return a list of texts."""
        text = {"type": "string", "description": "name or path of a transducer file"}
        return {"type": "array", "items": text}


def read_calibrations(
    root: Located, measured: frozenset[str] | None, homed: bool, day: datetime.date
) -> tuple[TransducerCalibration, ...]:
    """Return the usable calibrations that a rig file names under `calibrations`.

    Problems are recorded: a file that cannot be used, a channel or a transducer that another file
    describes already, a channel that the rig does not measure, and, with
    `expired_calibrations: refuse`, a calibration that does not hold today.

    Args:
        root: mapping of the rig file.
        measured: channels that the rig measures; None if that is not known.
        homed: whether the rig finds the zero of its encoder by homing.
        day: the day on which the calibrations are to hold.
    """
    strict = root.find("expired_calibrations").value == "refuse"
    channels: dict[str, str] = {}
    labels: dict[tuple[str, str], str] = {}
    found = []
    for element in root.find("calibrations").elements():
        calibration = _read_named(element)
        if calibration is None:
            continue
        found.append(calibration)
        channel = calibration.channel
        # A device may measure two quantities, such as pressure and temperature, but not one twice.
        label = calibration.transducer, unit_of(channel)
        if channel in channels:
            limit = f"is a second calibration of {channel}, beside {channels[channel]}"
            element.refuse(limit, "keep the one of the transducer that is fitted")
        elif label in labels:
            limit = f"is of transducer {label[0]}, which reads {labels[label]} already"
            element.refuse(limit, "correct the serial number in one of the files")
        elif measured is not None and channel not in measured:
            limit = f"is of {channel}, which this rig does not measure"
            element.refuse(limit, "correct the channel in that file, or remove it from the list")
        elif homed and channel == "position_m":
            limit = "is of an encoder whose zero is found anew in every session"
            element.refuse(limit, "remove it; correct its scale in the register map")
        elif strict and (doubt := calibration.doubt(day)):
            limit = f"{doubt}, as the {calibration}"
            element.refuse(limit, f"{RENEW}, or write `expired_calibrations: warn`")
        channels.setdefault(channel, element.shown)
        labels.setdefault(label, channel)
    return tuple(found)


def _read_named(element: Located) -> TransducerCalibration | None:
    if reference_in(element) is None:
        element.refuse("is not the name or path of a transducer file", "write one")
        return None
    root = element.sources.read_yaml(resolve("transducer", element), element)
    return read_transducer(root) if root is not None else None


def measured_by(
    simulated: bool,
    drivers: tuple[DriverSpec, ...],
    *,
    supply_pressure_sensor: bool,
    load_cell: bool,
    spool_sensor: bool,
) -> frozenset[str] | None:
    """Return the channels that a rig measures; None for hardware whose drivers are unusable.

    Args:
        simulated: whether the rig is simulated.
        drivers: usable drivers of a rig on hardware.
        supply_pressure_sensor: whether a simulated rig measures its supply pressure.
        load_cell: whether it measures the load.
        spool_sensor: whether it measures its spool.
    """
    if not simulated:
        signals = (signal for spec in drivers for signal in spec.inputs)
        return frozenset(signals) if drivers else None
    fitted = {
        "supply_pressure_Pa": supply_pressure_sensor,
        "load_N": load_cell,
        "spool_m": spool_sensor,
    }
    return frozenset(name for name in READINGS if fitted.get(name, True))


def uncalibrated(
    calibrations: tuple[TransducerCalibration, ...], measured: frozenset[str]
) -> tuple[str, ...]:
    """Return the measured channels without calibration, if any channel has one; else ()."""
    having = {each.channel for each in calibrations}
    return tuple(name for name in CALIBRATED if having and name in measured - having)


_OF_MODELS: Final = {
    "position_m": ("position_gain",),
    "pressure_1_Pa": ("pressure_1_bias", "pressure_1_gain"),
    "pressure_2_Pa": ("pressure_2_bias", "pressure_2_gain"),
}
"""Channel -> effects by which a model says how its transducer errs."""


def corrected_twice(calibrations: tuple[TransducerCalibration, ...], model: Model) -> Iterator[str]:
    """Yield a warning for each calibrated transducer of which the model undoes an error, too.

    Args:
        calibrations: the calibrations of a rig.
        model: the model by which filter and detector judge the rig's readings.
    """
    for each in calibrations:
        for effect in _OF_MODELS.get(each.channel, ()):
            if getattr(model.parameters, effect) != getattr(NOMINAL, effect):
                yield (
                    f"the model {model.name} has {effect}, and the {each} corrects the same "
                    "transducer; keep the effect only if it was found in corrected readings"
                )


def calibration_warnings(
    calibrations: tuple[TransducerCalibration, ...],
    limits: Limits,
    day: datetime.date,
    lasting: timedelta = timedelta(0),
) -> Iterator[str]:
    """Yield what `rig check` warns of about a rig's calibrations.

    That is a calibration that does not hold, or that expires within 30 days or within the time that
    a campaign takes; and limits of the rig that let a channel leave the range that was calibrated.

    Args:
        calibrations: the calibrations.
        limits: the limits of the rig.
        day: the day on which they are to hold.
        lasting: how long a campaign takes.
    """
    yield from calibration_doubts(calibrations, day, max(SOON, lasting))
    allowed = {
        "position_m": (limits.position_min_m, limits.position_max_m),
        "pressure_1_Pa": (0.0, limits.pressure_max_Pa),
        "pressure_2_Pa": (0.0, limits.pressure_max_Pa),
    }
    for each in calibrations:
        low, high = each.points[0].reference, each.points[-1].reference
        lower, upper = allowed.get(each.channel, (low, high))
        if lower < low or upper > high:
            unit = unit_of(each.channel)
            yield (
                f"the {each} reaches from {show(low, unit)} to {show(high, unit)}, and the limits "
                f"allow {show(lower, unit)} to {show(upper, unit)}: beyond the calibrated range "
                "the correction of its end is used"
            )
