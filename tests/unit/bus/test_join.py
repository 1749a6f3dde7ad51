"""Names in join data: those that runs give, and nothing that could end elsewhere than in a name."""

import pytest
from pydantic import ValidationError

from gslcosim.bus.port import Join

REST = {"endpoint": "unixsock-stream/nowhere", "namespace": "gsl/none", "user": "service", "password": "none"}


@pytest.mark.parametrize("name", ["world", "agent_1", "world+fields+sensing+referee+recorder"])
def test_a_process_has_the_names_of_all_its_services(name):
    assert Join(name=name, **REST).name == name


@pytest.mark.parametrize("name", ["", "+world", "world+", "world++fields", "../world", "world+../fields", "a b", "w\n"])
def test_other_names_are_refused(name):
    with pytest.raises(ValidationError, match="name"):
        Join(name=name, **REST)
