"""Programs under check start in the short environment of a run: what works in a check works in a run."""

import pytest

from gslcosim_conformance import ConnectionSpec, SessionLimits, check_agent
from gslcosim_conformance.participant_check import check_participant

LIMITS = SessionLimits(join_s=60.0, answer_s=20.0, exit_s=20.0, settle_s=0.0)

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]


@pytest.mark.parametrize(
    ("check", "transport"),
    [(check_agent, "zenoh"), (check_agent, "stdio"), (check_agent, "unix"), (check_participant, "stdio")],
    ids=lambda each: getattr(each, "__name__", each),
)
def test_tokens_of_the_user_do_not_reach_a_program_under_check(tmp_path, monkeypatch, check, transport):
    monkeypatch.setenv("A_TOKEN", "of the user")
    monkeypatch.setenv("LC_TIME", "C")
    report = check(
        ConnectionSpec(command=("sh", "-c", "env > seen; exit 3"), transport=transport, directory=tmp_path), LIMITS
    )
    assert not report.has_passed
    names = {line.partition("=")[0] for line in (tmp_path / "seen").read_text().splitlines()}
    assert {"PATH", "LC_TIME"} <= names
    assert "A_TOKEN" not in names
