import math

import pytest

from gslcosim_bench.report import number_formats
from gslcosim_bench.statistics.estimates import UNDEFINED, Estimate


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (0.667, number_formats.format_percent, "67"),
        (0.0667, number_formats.format_percent, "6.7"),
        (0.0, number_formats.format_percent, "0"),
        (0.12, number_formats.format_points, "+12"),
        (-0.12, number_formats.format_points, "\N{MINUS SIGN}12"),
        (0.001, number_formats.format_points, "0"),
        (-0.001, number_formats.format_score, "0.00"),
        (123.4, number_formats.format_three_digits, "123"),
        (99.96, number_formats.format_three_digits, "100"),
        (1.234, number_formats.format_three_digits, "1.23"),
        (-0.04, number_formats.format_one_digit, "0.0"),
    ],
)
def test_numbers_are_brief(value, form, text):
    assert form(value) == text


def test_a_figure_has_its_interval():
    text = number_formats.format_estimate(Estimate(0.5, 0.4, 0.6, 90), number_formats.format_percent, unit="%")
    assert text == "50 (40\N{EN DASH}60) %"
    assert number_formats.format_estimate(Estimate(-0.1, -0.2, 0.1, 9), number_formats.format_points) == (
        "\N{MINUS SIGN}10 (\N{MINUS SIGN}20 to +10)"
    )


def test_what_is_not_known_is_a_dash_and_what_is_never_is_infinite():
    assert number_formats.format_estimate(UNDEFINED, number_formats.format_score) == "\N{EN DASH}"
    assert (
        number_formats.format_estimate(Estimate(math.inf, 200.0, math.inf, 9), number_formats.format_three_digits)
        == "∞ (200\N{EN DASH}∞)"
    )
    assert number_formats.format_estimate(Estimate(1.0, math.nan, math.nan, 1), number_formats.format_score) == "1.00"


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.0123, "12.3 ms"), (12.34, "12.3 s"), (245.0, "4 min 5 s"), (7380.0, "2 h 3 min")]
)
def test_durations_are_said_as_people_say_them(seconds, text):
    assert number_formats.format_duration(seconds) == text
