"""The problems of a room as one error."""

from collections.abc import Sequence

from gslcosim.errors import ScenarioError
from gslcosim.scenario.problems import ProblemLike


def raise_if_any(problems: Sequence[ProblemLike]) -> None:
    """Raise all problems as one error, one a line; do nothing when there are none.

    Raises:
        ScenarioError: there is at least one problem.
    """
    if problems:
        raise ScenarioError("\n".join(_line(problem) for problem in problems))


def _line(problem: ProblemLike) -> str:
    remedy = f" {problem.remedy}" if problem.remedy else ""
    return f"{problem.path}: expected {problem.expected}, was {problem.found}.{remedy}"
