"""Background beside plumes: medians where nothing is predicted, by group, with what stands in for too few."""

import numpy as np

from gslcosim_search.fixed_sensors.background import background_beside_plumes


def test_each_group_has_its_median_of_clean_readings():
    readings = np.array([[2.0], [2.1], [2.2], [2.0], [2.3], [9.0], *[[3.0]] * 6])
    predicted = np.array([[0.0]] * 5 + [[5.0]] + [[0.0]] * 6)
    day = np.array([1] * 6 + [2] * 6)
    background = background_beside_plumes(readings, predicted, day, negligible_ppm=0.01)
    assert background[:6, 0].tolist() == [2.1] * 6
    assert background[6:, 0].tolist() == [3.0] * 6


def test_too_few_clean_readings_take_the_sensor_of_all_days_or_the_other_sensors():
    readings = np.array([[2.0, 7.0]] * 6 + [[4.0, 8.0]] * 2)
    predicted = np.array([[0.0, 1.0]] * 8)
    day = np.array([1] * 6 + [2] * 2)
    background = background_beside_plumes(readings, predicted, day, negligible_ppm=0.01)
    assert background[7].tolist() == [2.0, 2.0]
