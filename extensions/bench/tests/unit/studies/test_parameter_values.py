"""Values and ranges as they are typed, checked against the method's card."""

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_bench.studies.target import ParameterRange, card_ranges, find_target, parse_ranges, parse_varied


@pytest.fixture(scope="module")
def beetle():
    return find_target("tiny_room", "dung_beetle")


@pytest.fixture(scope="module")
def surge():
    return find_target("tiny_room", "surge_cast")


def test_values_get_the_type_that_the_card_says(beetle, surge):
    assert parse_varied(["leg_m=0.4,1,1e1"], beetle) == {"leg_m": (0.4, 1.0, 10.0)}
    varied = parse_varied(["n_casts=2,4", "growth=growing,fixed", "aborts_legs=true,false"], surge)
    assert varied == {"n_casts": (2, 4), "growth": ("growing", "fixed"), "aborts_legs": (True, False)}
    assert all(isinstance(value, float) for value in parse_varied(["leg_m=1,2"], beetle)["leg_m"])


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        (["leg_m"], "--vary: expected PARAMETER=VALUE,VALUE and so on, was 'leg_m'. For example: "),
        (["leg_m="], "--vary: expected PARAMETER=VALUE,VALUE and so on, was 'leg_m='. For example: "),
        (["=1"], "--vary: expected PARAMETER=VALUE,VALUE and so on, was '=1'. For example: "),
        (["leg_m=1,[2"], "--vary: expected PARAMETER=VALUE,VALUE and so on, was 'leg_m=1,[2'. For example: "),
        (["leg_m=1,2", "leg_m=3"], "--vary: expected each parameter once, was leg_m twice. Put its values into one "),
        (["eps=0.1,0,0"], "--vary eps: expected each value once, was 0.0 twice. Leave one out."),
        (["leg_m=1,fast"], "--vary leg_m: expected a number, was 'fast'. Its default is 0.8."),
        (["leg_m=1,11"], "--vary leg_m: expected at most 10 m, was 11. Its default is 0.8."),
        (["wall_rule=random,climb"], "--vary wall_rule: expected one of random, bounce, was 'climb'. Its default is "),
    ],
)
def test_what_is_no_list_of_allowed_values_is_reported(beetle, texts, expected):
    with pytest.raises(UsageError) as caught:
        parse_varied(texts, beetle)
    assert str(caught.value).startswith(expected)


def test_an_unknown_parameter_is_reported_with_the_nearest_known_one(beetle):
    with pytest.raises(UsageError, match=r"^--vary leg: expected a parameter of Dung beetle \(leg_m, .* Did you mean"):
        parse_varied(["leg=1,2"], beetle)


def test_a_method_without_a_card_takes_any_value(tmp_path):
    (tmp_path / "mine.py").write_text("")
    subject = find_target("tiny_room", str(tmp_path / "mine.py"))
    assert subject.card is None
    assert parse_varied(["anything=1,[1, 2],word"], subject) == {"anything": (1, (1, 2), "word")}
    assert parse_ranges(["n=1:8", "x=1:8.5"], subject) == (
        ParameterRange(name="n", low=1, high=8, is_whole=True),
        ParameterRange(name="x", low=1, high=8.5),
    )
    with pytest.raises(UsageError, match="mine has no card"):
        card_ranges(subject)


def test_ranges_are_whole_where_the_card_says(surge):
    assert parse_ranges(["step_m=1:2", "n_casts=1:8", "cast_m=0.1:10:log"], surge) == (
        ParameterRange(name="step_m", low=1, high=2),
        ParameterRange(name="n_casts", low=1, high=8, is_whole=True),
        ParameterRange(name="cast_m", low=0.1, high=10, is_log=True),
    )


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        (["step_m=1"], "--range: expected PARAMETER=LEAST:MOST, or with :log behind it, was 'step_m=1'."),
        (["step_m=1:2:lin"], "--range: expected PARAMETER=LEAST:MOST, or with :log behind it, was 'step_m=1:2:lin'."),
        (["step_m=a:2"], "--range: expected PARAMETER=LEAST:MOST, or with :log behind it, was 'step_m=a:2'."),
        (["step_m=.inf:2"], "--range: expected PARAMETER=LEAST:MOST, or with :log behind it, was 'step_m=.inf:2'."),
        (["step_m=2:1"], "--range step_m: expected the least value before the most, was 2:1."),
        (["memory_s=0:1:log"], "--range memory_s: expected a least value above 0 for :log, was 0:1:log."),
        (["step_m=1:20"], "--range step_m: expected at most 5 m, was 20. Its default is 1.0."),
        (["n_casts=1:2.5"], "--range n_casts: expected a whole number, was 2.5. Its default is 4."),
        (["growth=1:2"], "--range growth: expected a parameter that is a number, was one that is not. Compare"),
        (["step=1:2"], "--range step: expected a parameter of Surge-cast ("),
        (["step_m=1:2", "step_m=1:3"], "--range: expected each parameter once, was step_m twice. Leave one out."),
    ],
)
def test_what_is_no_allowed_range_is_reported(surge, texts, expected):
    with pytest.raises(UsageError) as caught:
        parse_ranges(texts, surge)
    assert str(caught.value).startswith(expected)


def test_all_bounded_numbers_with_a_default_are_searched_unless_set_otherwise(beetle):
    """leg_s has bounds too, but its default leaves it to the scenario."""
    assert [str(each) for each in card_ranges(beetle)] == [
        "leg_m=0.05:10", "zigzag_rad=0.1:1.5", "wall_margin_m=0:5", "eps=0:0.5",
    ]  # fmt: skip


def test_a_tried_value_has_four_digits_and_stays_within_its_range():
    each = ParameterRange(name="x", low=0.12345, high=2.34567)
    assert each.rounded(1.234567) == 1.235
    assert each.rounded(0.1234501) == 0.1235
    assert each.rounded(2.34567) == 2.34567
    whole = ParameterRange(name="n", low=1, high=8, is_whole=True).rounded(3)
    assert whole == 3
    assert isinstance(whole, int)


def test_a_range_holds_numbers_only():
    each = ParameterRange(name="x", low=0, high=2)
    assert each.holds(0)
    assert each.holds(2.0)
    assert not any(each.holds(value) for value in (2.1, True, None, "1"))
