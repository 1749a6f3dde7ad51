"""Error of an environment that cannot be built, with all its problems."""

from collections.abc import Sequence

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.problems import Problem


class ImpossibleEnvironmentError(ScenarioError):
    """A room cannot be built; the text lists all `problems`, one a line. The scenario or its files have to change."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(_line(problem) for problem in problems))


def raise_if_any(problems: Sequence[Problem]) -> None:
    """Raise all problems as one error; do nothing when there are none.

    Raises:
        ImpossibleEnvironmentError: there is at least one problem.
    """
    if problems:
        raise ImpossibleEnvironmentError(problems)


def _line(problem: Problem) -> str:
    remedy = f" {problem.remedy}" if problem.remedy else ""
    return f"{problem.path}: expected {problem.expected}, was {problem.found}.{remedy}"
