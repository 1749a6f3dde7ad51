"""Names in join data: those that runs give, and nothing that could end elsewhere than in a name."""

import pytest
from pydantic import ValidationError

from gslcosim.bus.interface import JoinData

REST = {"endpoint": "unixsock-stream/nowhere", "namespace": "gsl/none", "user": "service", "password": "none"}


@pytest.mark.parametrize("name", ["world", "agent_1", "world+fields+sensing+referee+recorder"])
def test_a_process_has_the_names_of_all_its_services(name):
    assert JoinData(name=name, **REST).name == name


@pytest.mark.parametrize("name", ["", "+world", "world+", "world++fields", "../world", "world+../fields", "a b", "w\n"])
def test_other_names_are_refused(name):
    with pytest.raises(ValidationError, match="name"):
        JoinData(name=name, **REST)
