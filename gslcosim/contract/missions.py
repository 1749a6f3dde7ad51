"""Words of missions by which an agent knows what it is asked for."""

_DECLARE = "declare a position within "


def word_declaration(within_m: float) -> str:
    """Return the part of a mission that asks for a declaration within so many metres of the source."""
    return f"{_DECLARE}{within_m:g} m of it"


def asks_for_declaration(mission: str) -> bool:
    """Return whether a mission asks for the source's position, so that silence cannot succeed."""
    return _DECLARE in mission
