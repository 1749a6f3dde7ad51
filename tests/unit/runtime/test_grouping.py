"""Which services share a process: by a word or by lists; what is no service of the run is reported."""

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.runtime.services import get_process_name, group_services

SERVICES = ("world", "fields", "sensing", "referee")


def test_words_are_a_process_each_or_one_for_all():
    assert group_services("separate", SERVICES) == (("world",), ("fields",), ("sensing",), ("referee",))
    assert group_services("grouped", SERVICES) == (SERVICES,)


def test_lists_are_put_in_order_and_the_rest_is_separate():
    assert group_services((("sensing", "world"), ()), SERVICES) == (("world", "sensing"), ("fields",), ("referee",))


@pytest.mark.parametrize("lists", [(("weather",),), (("world", "fields"), ("world",))])
def test_what_is_no_service_or_comes_twice_is_refused(lists):
    with pytest.raises(UsageError, match="processes: expected each service at most once, of world, fields"):
        group_services(lists, SERVICES)


def test_a_process_is_called_by_its_services():
    assert get_process_name(("world", "fields")) == "world+fields"
