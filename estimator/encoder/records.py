"""The record of an encoder that drifts, with the causes that may explain the accounts as well."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EncoderDrift:
    """A drift of the encoder that stands out from the oil accounts.

    Attributes:
        rate_m_per_s, deviation_m_per_s: speed at which the reading runs away from the ram, positive
            towards extension, and its standard error, m/s.
        onset_s: time at which the drift began, s, to two seconds.
        statistic: the rate beyond the dead zone, divided by its standard error; computed without
            the block that supports the drift most.
        limit: value that the statistic exceeds on a healthy rig at the stated rate.
        gain: what the drift explains, as a gain in twice the log likelihood; infinite once the
            reading has passed a stroke end, which proves that the encoder is wrong.
        could_also_be: other causes that explain the accounts about as well, likeliest first: names
            of `rig.plant.FAULTS`, and `null_shift` for a shift of the spool's null. It is empty
            once the accounts or a stroke end have ruled them all out.
    """

    rate_m_per_s: float
    deviation_m_per_s: float
    onset_s: float
    statistic: float
    limit: float
    gain: float
    could_also_be: tuple[str, ...] = ()

    @property
    def is_sure(self) -> bool:
        """Return whether all other causes are ruled out."""
        return not self.could_also_be
