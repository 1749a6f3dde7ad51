"""Colours of figures are distinguished by colour-blind readers and in grey print: computed, not looked at."""

import itertools
import sys

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_data.figures.style import OKABE_ITO, gas_map, get_line_style, matplotlib_for, part_of_matplotlib

# Machado, Oliveira and Fernandes 2009, severity 1, for linear RGB.
SIGHT = {
    "full": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
XYZ_OF_RGB = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = XYZ_OF_RGB @ np.ones(3)
# A difference in CIELAB that is seen at a glance in thin lines; 2.3 is just noticeable.
APART = 12.0
APART_IN_GREY = 10.0


def linear(color):
    rgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(linear_rgb):
    f = np.cbrt(np.maximum(XYZ_OF_RGB @ np.clip(linear_rgb, 0, 1), 1e-6) / WHITE)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", SIGHT)
def test_lines_are_distinguished_by_colour_or_dashes_in_every_sight(sight):
    for i, j in itertools.combinations(range(len(OKABE_ITO)), 2):
        a, b = (lab(SIGHT[sight] @ linear(get_line_style(k)["color"])) for k in (i, j))
        assert np.linalg.norm(a - b) > APART or get_line_style(i)["ls"] != get_line_style(j)["ls"], (i, j)


def test_the_first_four_lines_differ_by_colour_alone_in_every_sight():
    for sight in SIGHT.values():
        for i, j in itertools.combinations(range(4), 2):
            a, b = (lab(sight @ linear(OKABE_ITO[k])) for k in (i, j))
            assert np.linalg.norm(a - b) > APART, (i, j)


def test_lines_are_distinguished_in_grey_by_lightness_or_dashes():
    for i, j in itertools.combinations(range(len(OKABE_ITO)), 2):
        a, b = (lab(linear(get_line_style(k)["color"]))[0] for k in (i, j))
        assert abs(a - b) > APART_IN_GREY or get_line_style(i)["ls"] != get_line_style(j)["ls"], (i, j)


@pytest.mark.parametrize("name", ["gas", "PuBu", "Greys"])
def test_maps_become_darker_with_every_step_in_every_sight_and_lie_below_tracks(name):
    colormap = gas_map() if name == "gas" else part_of_matplotlib("pyplot").get_cmap(name)
    to_hex = part_of_matplotlib("colors").to_hex
    for sight in SIGHT.values():
        lightness = [lab(sight @ linear(to_hex(colormap(x))))[0] for x in np.linspace(0, 1, 24)]
        assert np.all(np.diff(lightness) < 0)
    if name == "gas":
        track = lab(linear(OKABE_ITO[0]))
        darkest = lab(linear(to_hex(colormap(1.0))))
        assert np.linalg.norm(track - darkest) > 50


def test_a_missing_matplotlib_is_reported_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError, match=r"found none\. Install it with pip install 'gslcosim-data\[plot\]'\."):
        matplotlib_for("figures")
