"""This module narrows the search of the catalogue, where one curve explains what is missing.

A disturbance that no catalogue holds is taken for one effect of it after the other, and for each
others are tried in its place. That takes most of the time of a workflow, and `choose` gives the
answer up for the one curve that explains nearly all. So that curve is looked for as soon as the
first effect leaves more than such a choice allows, and only effects whose own curve it may be are
tried to their end.
"""

from estimator.gap.search import DiscoveredModel, Discovering, Found

from .choosing import BEYOND, WHOLE, owners


class OneCurve:
    """Looks for one curve that explains what the effects of the catalogue do not.

    Args:
        discovering: discovers disturbances in the records that are searched.

    Attributes:
        first: model with the best curve and no effects of the catalogue; None if it was not looked
            for, or none earned its place.
        is_enough: whether that curve explains nearly all.
    """

    def __init__(self, discovering: Discovering) -> None:
        self._discovering = discovering
        self.first: DiscoveredModel | None = None
        self.is_enough = False

    def narrowed(self, found: Found, floor: float) -> set[str] | None:
        """Return the names of the effects worth looking at, if one curve explains nearly all.

        They are those whose own curve it is, or a rival that the recordings do not tell from it.
        The curve is looked for if the finding's effects leave `BEYOND` of the excess more than a
        curve may leave that explains `WHOLE` of it. None is returned, for all effects, if it is not
        looked for or does not explain that much. If a curve earns its place, `first` and
        `is_enough` are set.

        Args:
            found: finding of the search so far.
            floor: cost per reading of a rig that is exactly the model.
        """
        discovering = self._discovering
        least = floor * found.samples
        excess = found.refitted.cost - least
        if excess <= 0.0 or found.fitted.cost - least < (1.0 - WHOLE + BEYOND) * excess:
            return None
        model = discovering.run(found.refitted, discovering.nuisances, floor, most=1)
        if not model.discoveries:
            return None
        self.first = model
        self.is_enough = model.fitted.cost - least < (1.0 - WHOLE) * excess
        if not self.is_enough:
            return None
        (curve,) = model.discoveries
        wheres = [curve.explanation.where, *(each.where for each in curve.rivals)]
        return {e.name for place, of, _ in wheres for e in owners(discovering.plant, place, of)}
