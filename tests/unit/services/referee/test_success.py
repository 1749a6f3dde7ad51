"""The judges of success, fed with hand-made evidence."""

import pytest
from built_messages import build_body

from gslcosim.base.errors import ModelError
from gslcosim.contract.messages import BeliefScore
from gslcosim.scenario.models.success import (
    AllSourcesSuccess,
    MapSuccess,
    SuccessSpec,
)
from gslcosim_services.referee.success import Evidence, build_criterion

SOURCES_M = ((2.0, 1.0, 2.0), (8.0, 1.0, 2.0))


def seen(*distances_m: float, **more) -> Evidence:
    return Evidence(time_s=1.0, body=build_body(), distances_m=distances_m or (9.0, 9.0), **more)


def belief(mass: float) -> BeliefScore:
    return BeliefScore(expected_distance_m=1.0, mass_near_frac=mass, cell_frac=0.0, entropy_bits=1.0)


def test_all_sources_are_remembered_in_any_order_and_each_is_news_once():
    criterion = build_criterion(AllSourcesSuccess(within_m=1.0), SOURCES_M)
    assert criterion.news(seen(9.0, 0.5)) == ["comes within 0.50 m of the source at (8.00, 1.00, 2.00) m: 1 of 2"]
    assert criterion.news(seen(9.0, 0.4)) == []
    assert not criterion.is_met(seen(9.0, 0.4))
    assert criterion.news(seen(1.0, 9.0)) == ["comes within 1.00 m of the source at (2.00, 1.00, 2.00) m: 2 of 2"]
    assert criterion.is_met(seen(1.0, 9.0))


def test_each_agent_finds_all_sources_for_itself():
    first, second = (build_criterion(AllSourcesSuccess(within_m=1.0), SOURCES_M) for _ in range(2))
    first.news(seen(0.0, 0.0))
    second.news(seen(9.0, 9.0))
    assert first.is_met(seen(9.0, 9.0))
    assert not second.is_met(seen(9.0, 9.0))


@pytest.mark.parametrize(("mass", "is_met"), [(0.79, False), (0.8, True), (1.0, True)])
def test_a_map_is_met_by_enough_probability_near_the_source(mass, is_met):
    criterion = build_criterion(MapSuccess(within_m=1.0, mass_at_least=0.8), SOURCES_M)
    assert criterion.is_met(seen(belief=belief(mass))) == is_met


def test_a_block_without_a_judge_is_named():
    class Unjudged(SuccessSpec):
        of: str = "unjudged"

        def task_text(self, gas: str) -> str:
            return gas

        @property
        def summary_text(self) -> str:
            return ""

    with pytest.raises(ModelError, match=r"a judge for 'unjudged', found none\. Register one for Unjudged"):
        build_criterion(Unjudged(), SOURCES_M)
