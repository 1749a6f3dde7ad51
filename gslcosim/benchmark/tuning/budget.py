"""How a budget of flights is shared between settings, and between search and validation."""

import math
from dataclasses import dataclass

from gslcosim.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Flights in all, for each setting in training, and for each of the two that are flown in validation."""

    flights: int
    per_setting: int
    per_validation: int

    @property
    def n_settings(self) -> int:
        """How many settings the search can fly, the default among them."""
        return (self.flights - self.validation) // self.per_setting

    @property
    def validation(self) -> int:
        """Flights that are kept for the validation of the best setting and the default."""
        return 2 * self.per_validation

    @property
    def search(self) -> int:
        """Flights of the search."""
        return self.n_settings * self.per_setting


def budget_of(flights: int, per_setting: int | None = None) -> Budget:
    """Return how a budget is shared.

    A setting flies half the square root of the budget, 2 at least: as the budget grows, settings get more in number
    and better known at the same rate. A fifth of it is kept for validation, where best and default fly as often as a
    setting at least.

    Args:
        flights: All flights.
        per_setting: Flights of each setting, if told.

    Raises:
        UsageError: it is too small for the default, one other setting, and their validation.
    """
    k = per_setting if per_setting is not None else max(2, round(math.sqrt(flights) / 2))
    budget = Budget(flights=flights, per_setting=k, per_validation=max(k, flights // 10))
    if budget.n_settings < 2:
        raise UsageError(
            f"--budget: expected at least {4 * k} flights, for the default, another setting and the validation of "
            f"both with {k} flights each; was {flights}. Give more, or fewer --flights-per-setting."
        )
    return budget
