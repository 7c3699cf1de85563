"""This module tries other effects in the place of those that a search named, and compares them."""

from collections.abc import Mapping, Sequence
from typing import Final

from estimator.gap.prediction import Filtered, Fitted, Variable, freed

from .findings import CHANCE, Alternative, Found, Named, Screened, deviate
from .refits import Refits
from .screening import Screening

_TRIED: Final = 7
"""Greatest number of effects that are tried in the place of one."""
_NEAR: Final = 0.2
"""An effect is tried in the place of another if at some stage it promised more than this part of
the other's gain."""
_ASTRAY: Final = 0.1
"""Part of an effect's gain that must remain if the model without it gets filter gains of its own.
If less remains, the gains of the finding led that model astray."""


class Rivals:
    """Tries other effects of the catalogue in the place of each effect that was named.

    Args:
        refits: refits of the records that were searched.
        screening: screening of the plant's catalogue.
    """

    def __init__(self, refits: Refits, screening: Screening) -> None:
        self._refits, self._screening = refits, screening
        self._fitter, self._plant = refits.fitter, refits.plant

    def exchange(self, found: Found, seen: Mapping[str, Sequence[Screened]]) -> bool:
        """Try other effects in the place of each named one, and note them as its alternatives.

        At most seven effects that are not named are tried for each: those that promise most, more
        than 0.4 times the gain of the named effect, and that came near it (`_NEAR`) at some stage.
        The first whose fit costs less than the finding by more than `CHANCE` takes its place.

        Args:
            found: the finding; changed in place.
            seen: for each effect, its candidates at all stages of the search.

        Returns:
            Whether another effect was better and took the place of a named one. The named effects
            after that one are then not tried.
        """
        taken = {named.effect for named in found.named}
        for position, named in enumerate(found.named):
            # All fits have the same gains; otherwise an equal rival could seem better by the
            # difference.
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
        """Return a fit without an effect with filter gains of its own, if it needs them.

        Near break-away, a ram may stick in a model with the effect and slip in one without it. Then
        the gains of the filter that sticks correct the model without the effect in the wrong way,
        and no linearisation about its course shows anything. This is so if with gains of its own
        the model without the effect keeps at most the part `_ASTRAY` of what it costs more than the
        finding.

        Args:
            found: the finding, with the effect.
            variables: variables of the model without the effect.
            without: fit of that model with the finding's gains.

        Returns:
            The fit and the records with its gains; None if the finding's gains serve it as well.
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
        """Return the fit with a candidate, with the finding's gains.

        The fit starts from another one, whose gains are those of the model with the candidate.

        Args:
            found: the finding whose gains are used in the end.
            lost: fit and gains of the model without the effect that the candidate replaces, as
                the method `lost` returns them.
            variables: variables of that model.
            candidate: effect to be added.
        """
        without, filtered = lost
        led = self._refits.with_own_gains(filtered, without.values, variables, candidate)
        effect = self._plant.effects[candidate.effect]
        return found.filtered.fit(led.values, freed(variables, effect))
