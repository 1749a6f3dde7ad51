"""Cards of the programs that have flown, found by the hash of the program."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from gslcosim.base.bundled import bundled_agents
from gslcosim.base.errors import GslCosimError
from gslcosim.methods.card import MethodCard
from gslcosim_bench.cases.agent_setup import find_card, find_program
from gslcosim_bench.cases.suite_files import LoadedSuite, agent_hash, load_suite
from gslcosim_bench.store import ResultsFolder


def find_cards(folders: Sequence[Path], wanted: Collection[str]) -> Mapping[str, MethodCard]:
    """Return the card of each program that is as it was when it flew: bundled, or in the folder of the results.

    A program that has changed since has no card here, for the card may have changed with it.
    """
    found: dict[str, MethodCard] = {}
    bundled = {path.resolve() for path in bundled_agents().values()}
    for folder in folders:
        for suite in _suites(folder):
            for entry in suite.suite.entries:
                try:
                    program = find_program(entry, suite.directory)
                    is_own = program is not None and program.resolve().is_relative_to(folder.resolve())
                    if program is None or not (is_own or program.resolve() in bundled):
                        continue
                    digest = agent_hash(entry, suite.directory)
                    card = find_card(entry, suite.directory) if digest in wanted else None
                except (OSError, GslCosimError):
                    continue
                if card is not None:
                    found[digest] = card
    return found


# Results of a suite that this version cannot read have figures all the same.
def _suites(folder: Path) -> Iterator[LoadedSuite]:
    try:
        loaded = load_suite(ResultsFolder(folder).suite)
    except (OSError, GslCosimError):
        return
    waiting = [loaded]
    while waiting:
        suite = waiting.pop()
        yield suite
        waiting += suite.included
