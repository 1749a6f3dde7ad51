"""Settings of a method, from its card and the briefing."""

from pathlib import Path
from types import SimpleNamespace

from gslcosim.base.errors import MethodError
from gslcosim.contract.messages import Briefing
from gslcosim.methods.card import CARD_FILE, find_unmet_needs, load_card


def load_settings(briefing: Briefing, program: str) -> SimpleNamespace:
    """Return a method's settings as attributes: the scenario's values, else the card's defaults.

    Args:
        program: The agent's file (`__file__`); its card is `method.yaml` beside it.

    Raises:
        MethodError: a sensor, a grant or a channel is missing, or a parameter is wrong; the text has all problems.
    """
    card = load_card(Path(program).with_name(CARD_FILE))
    grants = {"map": briefing.known_map, "plume": briefing.plume, "source": briefing.known_sources}
    shortages = find_unmet_needs(
        card,
        sensors=briefing.sensors,
        knows=tuple(name for name, grant in grants.items() if grant),
        n_channels=len(briefing.channels),
        parameters=briefing.parameters,
    )
    if shortages:
        raise MethodError("; ".join(str(shortage) for shortage in shortages))
    return SimpleNamespace(**card.settings(briefing.parameters))
