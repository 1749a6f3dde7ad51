"""Method cards as files that a user writes: all problems at once, each with its line."""

import json
from pathlib import Path

from pydantic import ValidationError

from gslcosim.base.problems import Problem
from gslcosim.methods.card import MethodCard, is_list_of_shared_parameters, list_shared_parameters
from gslcosim.scenario.checks.registry import ValidFile, find_problems
from gslcosim.scenario.loader import read_text
from gslcosim.scenario.model_schema import format_value, problems_from_validation
from gslcosim.scenario.problems import InvalidScenarioError, locate
from gslcosim.scenario.serialization import read_yaml


def validate_card(path: str, seed: int | None) -> ValidFile:
    """Return the outcome of the check of a card for `gslcosim validate`."""
    del seed
    card = check_card_file(Path(path))
    return ValidFile(
        sentence=f"Method {card.title}, family {card.family}, {len(card.parameters)} parameters.",
        content={"card": json.loads(card.model_dump_json(by_alias=True))},
    )


def check_card_file(path: Path) -> MethodCard:
    """Return the card of a file, if neither the file nor its neighbours have problems.

    Agents and runs read cards with `gslcosim.methods.card.load_card`, without line numbers.
    """
    text = read_text(path, shown_path=str(path))
    tree = read_yaml(text, source=str(path))
    problems: list[Problem] = []
    card = None
    if tree.block is None:
        found = format_value(tree.values)
        problems.append(Problem(where="", expected="a block of keys with title, family and summary", found=found))
    else:
        included = tree.block.get("includes", [])
        if not is_list_of_shared_parameters(included):
            expected = f"a list of {', '.join(list_shared_parameters())}"
            problems.append(Problem(where="includes", expected=expected, found=format_value(included)))
        try:
            card = MethodCard.model_validate({key: value for key, value in tree.block.items() if key != "includes"})
        except ValidationError as error:
            problems += problems_from_validation(error, root=MethodCard)
    if card is not None:
        problems += find_problems("method", card, path.parent)
    if card is None or problems or tree.problems:
        raise InvalidScenarioError([*tree.problems, *locate(problems, tree.marks)], name=str(path))
    return card
