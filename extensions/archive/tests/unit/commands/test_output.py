"""What the commands of the archive show."""

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

from gslcosim_archive.commands.output import format_ranking

if TYPE_CHECKING:
    from gslcosim_archive.submissions import Ranking


def test_a_ranking_heads_what_follows_from_it_and_what_does_not() -> None:
    said = {"holds": ["a beats b."], "limits": ["Rooms are too few."]}
    ranking = SimpleNamespace(leaderboard={"views": [{"rows": []}], "conclusions": said})
    lines = format_ranking(cast("Ranking", ranking)).splitlines()
    assert lines[-5:] == [
        "What may be concluded:", "- a beats b.", "", "What may not be concluded:", "- Rooms are too few.",
    ]  # fmt: skip
