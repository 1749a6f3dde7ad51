import pytest

from gslcosim_bench.metrics.path_metrics import classify_declaration, score_declarations

SOURCE = (3.0, 4.0, 2.0)


@pytest.mark.parametrize(
    ("error_m", "is_control", "outcome"),
    [
        (1.0, False, "correct"),
        (1.01, False, "wrong_place"),
        (None, False, "silent"),
        (0.0, True, "false_alarm"),
        (9.0, True, "false_alarm"),
        (None, True, "correct_silence"),
    ],
)
def test_the_table_of_outcomes(error_m, is_control, outcome):
    assert classify_declaration(error_m, within_m=1.0, is_control=is_control) == outcome


def test_the_earliest_declaration_decides_the_highest_confidence_is_kept_and_false_ones_are_counted():
    figures = score_declarations(
        [50.0, 20.0, 30.0], [SOURCE, (0.0, 0.0, 2.0), (9.0, 9.0, 9.0)], [0.4, 0.9, 0.1], [SOURCE], within_m=1.0
    )
    assert figures.outcome == "wrong_place"
    assert (figures.first_declared_s, figures.error_m, figures.confidence, figures.n_false) == (20.0, 5.0, 0.9, 2)


def test_the_error_in_the_plane_leaves_heights_out():
    figures = score_declarations([9.0], [(3.0, 4.0, 5.0)], [1.0], [SOURCE], within_m=1.0)
    assert (figures.outcome, figures.error_m, figures.error_in_plane_m) == ("wrong_place", 3.0, 0.0)
    flat = score_declarations([9.0], [(3.0, 4.0, 5.0)], [1.0], [SOURCE], within_m=1.0, is_horizontal=True)
    assert (flat.outcome, flat.error_m, flat.n_false) == ("correct", 3.0, 0)


def test_the_nearest_of_several_sources_counts():
    figures = score_declarations([9.0], [(3.0, 4.0, 2.5)], [1.0], [(0.0, 0.0, 0.0), SOURCE], within_m=1.0)
    assert (figures.outcome, figures.error_m) == ("correct", 0.5)


def test_on_a_control_every_declaration_is_false_even_at_the_virtual_source():
    figures = score_declarations([9.0, 10.0], [SOURCE, SOURCE], [0.2, 0.3], [SOURCE], within_m=1.0, is_control=True)
    assert (figures.outcome, figures.n_false, figures.confidence) == ("false_alarm", 2, 0.3)
    assert figures.error_m is None
    assert figures.error_in_plane_m is None


@pytest.mark.parametrize(("is_control", "outcome"), [(False, "silent"), (True, "correct_silence")])
def test_without_a_declaration_there_is_no_error_and_no_confidence(is_control, outcome):
    figures = score_declarations([], [], [], [SOURCE], within_m=1.0, is_control=is_control)
    assert (figures.outcome, figures.first_declared_s, figures.error_m) == (outcome, None, None)
    assert (figures.confidence, figures.n_false) == (0.0, 0)
