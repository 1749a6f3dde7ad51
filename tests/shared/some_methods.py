"""Which bundled methods the shorter tests run: one quick one of each family; `make soak` runs them all."""

from collections import defaultdict
from collections.abc import Collection

import pytest

from gslcosim.base.bundled import bundled_agents
from gslcosim.methods.card import find_card_beside

MAX_DECISION_MS = 1000.0


def _some():
    families = defaultdict(list)
    for name, program in sorted(bundled_agents().items()):
        card = find_card_beside(program)
        if card.decision_limit_ms <= MAX_DECISION_MS:
            families[card.family].append(name)
    return {names[-1] for names in families.values()}


SOME = _some()


def every_method(tour: Collection[str] = (), some: Collection[str] = SOME):
    """Return a parameter for each method, with the mark that says which tests it is part of."""

    def marks(name):
        return [pytest.mark.tour] if name in tour else [] if name in some else [pytest.mark.soak]

    return pytest.mark.parametrize("name", [pytest.param(n, marks=marks(n)) for n in sorted(bundled_agents())])
