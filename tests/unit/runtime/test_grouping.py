"""Which services share a process: by a word or by lists; what is no service of the run is told."""

import pytest

from gslcosim.errors import UsageError
from gslcosim.runtime.grouping import groups_of, process_name

SERVICES = ("world", "fields", "sensing", "referee")


def test_words_are_a_process_each_or_one_for_all():
    assert groups_of("separate", SERVICES) == (("world",), ("fields",), ("sensing",), ("referee",))
    assert groups_of("grouped", SERVICES) == (SERVICES,)


def test_lists_are_put_in_order_and_the_rest_is_separate():
    assert groups_of((("sensing", "world"), ()), SERVICES) == (("world", "sensing"), ("fields",), ("referee",))


@pytest.mark.parametrize("lists", [(("weather",),), (("world", "fields"), ("world",))])
def test_what_is_no_service_or_comes_twice_is_refused(lists):
    with pytest.raises(UsageError, match="processes: expected each service at most once, of world, fields"):
        groups_of(lists, SERVICES)


def test_a_process_is_called_by_its_services():
    assert process_name(("world", "fields")) == "world+fields"
