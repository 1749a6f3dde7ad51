import pytest
from policies import NAMES, gru

from gslcosim_search.learned.policy import PolicyError
from gslcosim_search.learned.policy_agent import match_observations


def test_a_policy_takes_what_it_names_in_its_own_order():
    assert match_observations(gru(), ("x", "wind.from_cos", "nose.amount", "refused", "wind.from_sin")) == [3, 2, 4, 1]


def test_a_sensor_of_another_name_fits_where_it_is_the_only_one_that_shows_this():
    assert match_observations(gru(), ("refused", "mox_ppm.amount", "vane.from_sin", "vane.from_cos")) == [0, 1, 2, 3]
    with pytest.raises(
        PolicyError, match=r"expected nose\.amount .*, was missing; not used are a\.amount, b\.amount\."
    ):
        match_observations(gru(), ("refused", "a.amount", "b.amount", "vane.from_sin", "vane.from_cos"))


def test_what_is_missing_and_what_is_there_instead_are_named():
    with pytest.raises(PolicyError, match=r"wind\.from_sin, wind\.from_cos .* not used are x, nose\.log_resistance\."):
        match_observations(gru(), ("x", "refused", "nose.log_resistance", "nose.amount"))
    assert len(NAMES) == 4
