"""Problems in users' files: the place, the expected and the found value, and the remedy."""

from dataclasses import dataclass

from pydantic_core import PydanticCustomError

RULE = "scenario_rule"


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One problem in a user's file.

    Attributes:
        where: The place in the file, for example `agents[0].vehicle.start_m`; empty for the whole.
        expected: Allowed values there, as the rest of a sentence.
        found: Value found there.
        remedy: Remedy, a whole sentence, or empty.
    """

    where: str
    expected: str
    found: str
    remedy: str = ""

    def __str__(self) -> str:
        where, remedy = f"{self.where}: " if self.where else "", f" {self.remedy}" if self.remedy else ""
        return f"{where}expected {self.expected}, was {self.found}.{remedy}"


def broken_rule_error(*, expected: str, found: str, remedy: str = "", key: str = "") -> PydanticCustomError:
    """Return the error of a model's own validator for a broken rule between the fields of a block.

    `key` names the field inside the block that is to be changed; empty for the block as a whole.
    """
    return PydanticCustomError(
        RULE,
        "expected {expected}, was {found}. {remedy}",
        {"expected": expected, "found": found, "remedy": remedy, "key": key},
    )
