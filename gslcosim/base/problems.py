"""Problems of what a user writes: rules between the fields of a model that do not hold."""

from pydantic_core import PydanticCustomError

RULE = "scenario_rule"


def broken_rule_error(*, expected: str, found: str, remedy: str = "", key: str = "") -> PydanticCustomError:
    """Return what a model's own validator raises: a rule between the fields of a block that does not hold.

    `key` names the field inside the block that is to be changed; empty for the block as a whole.
    """
    return PydanticCustomError(
        RULE,
        "expected {expected}, was {found}. {remedy}",
        {"expected": expected, "found": found, "remedy": remedy, "key": key},
    )
