"""Other effects in the place of those that a search named: how near they come, which is better."""

from collections.abc import Mapping, Sequence
from typing import Final

from estimator.gap.prediction import Filtered, Fitted, Variable, freed

from .findings import CHANCE, Alternative, Found, Named, Screened, deviate
from .refits import Refits
from .screening import Screening

_TRIED: Final = 7
"""Effects that are tried in the place of one, at most."""
_NEAR: Final = 0.2
"""Part of an effect's gain that another must have had at some stage to be tried in its place."""
_ASTRAY: Final = 0.1
"""Part of an effect's gain that must be left where the model without it has filter gains of its
own: if less is left, the gains that were found led that model astray."""


class Rivals:
    """Tries other effects of the catalogue in the place of each that was named.

    Args:
        refits: of the records that were searched.
        screening: of the plant's catalogue.
    """

    def __init__(self, refits: Refits, screening: Screening) -> None:
        self._refits, self._screening = refits, screening
        self._fitter, self._plant = refits.fitter, refits.plant

    def exchange(self, found: Found, seen: Mapping[str, Sequence[Screened]]) -> bool:
        """Try other effects in the place of each that was named, and note them as its alternatives.

        Returns:
            Whether one was better and took its place.
        """
        taken = {named.effect for named in found.named}
        for position, named in enumerate(found.named):
            # With one and the same gains, or an equal rival would seem better by their difference.
            values = found.fitted.values
            found.filtered = found.filtered.at(values)
            found.fitted = Fitted(values, found.filtered.costs(values))
            variables, without = self._refits.without(found, named.effect)
            lost = self.lost(found, variables, without)
            without, filtered = lost or (without, found.filtered)
            # With gains of its own a model without the effect may seem better than it is.
            gain = max(without.cost - found.fitted.cost, named.bar)
            most = {name: max(c.gain for c in stages) for name, stages in seen.items()}
            near = {
                name
                for name, reached in most.items()
                if name not in taken and reached > _NEAR * most.get(named.effect, 0.0)
            }
            screened = self._screening.screen(
                filtered, without.values, variables, near | {named.effect}
            )
            own = next((c.gain for c in screened if c.effect == named.effect), 0.0)
            likely = [c for c in screened if c.effect != named.effect and c.gain > 0.4 * own]
            alternatives = []
            for candidate in likely[:_TRIED]:
                fitted = (
                    self._refits.with_effect(filtered, without.values, variables, candidate)
                    if lost is None
                    else self._led_with(found, lost, variables, candidate)
                )
                if found.fitted.cost - fitted.cost > CHANCE:
                    effect = self._plant.effects[candidate.effect]
                    found.variables = freed(variables, effect)
                    found.fitted, found.filtered = self._refits.settled(
                        fitted.values, found.variables
                    )
                    better = deviate(without.costs - fitted.costs)
                    found.named[position] = Named(
                        effect.name, without.cost - fitted.cost,
                        (without.cost - fitted.cost) / found.samples, named.bar, better,
                    )  # fmt: skip
                    return True
                alternatives.append(
                    Alternative(
                        candidate.effect, (without.cost - fitted.cost) / gain,
                        deviate(fitted.costs - found.fitted.costs), fitted,
                    )
                )  # fmt: skip
            alternatives.sort(key=lambda alternative: -alternative.share)
            found.named[position] = Named(
                named.effect, gain, gain / found.samples, named.bar,
                deviate(without.costs - found.fitted.costs), tuple(alternatives),
            )  # fmt: skip
        return False

    def lost(
        self, found: Found, variables: tuple[Variable, ...], without: Fitted
    ) -> tuple[Fitted, Filtered] | None:
        """Return the fit without an effect with gains of its own, if those found lead it astray.

        A ram held near break-away, that the model without the effect lets go, is corrected like one
        that sticks: no linearisation about that course tells of anything. None if all is well.
        """
        own = float(self._fitter.filtered(without.values).costs(without.values).sum())
        if own - found.fitted.cost > _ASTRAY * (without.cost - found.fitted.cost):
            return None
        settled, filtered = self._refits.settled(without.values, variables)
        filtered = filtered.at(settled.values)
        return Fitted(settled.values, filtered.costs(settled.values)), filtered

    def _led_with(
        self, found: Found, lost: tuple[Fitted, Filtered], variables: tuple[Variable, ...],
        candidate: Screened,
    ) -> Fitted:  # fmt: skip
        """Return the fit with a candidate with the gains of what was found, led to it by its own.

        Args:
            found: whose gains these are.
            lost: of the model without the effect that it takes the place of (`lost`).
            variables: of that model.
            candidate: to be added.
        """
        without, filtered = lost
        led = self._refits.with_own_gains(filtered, without.values, variables, candidate)
        effect = self._plant.effects[candidate.effect]
        return found.filtered.fit(led.values, freed(variables, effect))
