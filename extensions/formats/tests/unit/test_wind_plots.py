"""The plot of a solve's history, and what is said where matplotlib is missing."""

import importlib

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, Outlet, solve_wind_report
from gslcosim_formats.wind_plots import plot_history

CELL_M = 0.25
SHAPE = (14, 10, 7)
INLET = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 0.75), velocity_m_s=(1, 0, 0))
OUTLET = Outlet(min_m=(3.5, 1.5, 0), max_m=(3.5, 2.5, 0.75))


def solved(end_time_s):
    return solve_wind_report(np.ones(SHAPE, bool), CELL_M, [INLET, OUTLET], end_time_s=end_time_s)


@pytest.mark.slow
def test_the_history_is_drawn(tmp_path):
    plot_history(solved(end_time_s=None), tmp_path / "history.png")
    assert (tmp_path / "history.png").read_bytes().startswith(b"\x89PNG")


def test_without_matplotlib_a_plot_says_what_to_install(tmp_path, monkeypatch):
    real = importlib.import_module

    def refuse(name, *args):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args)

    monkeypatch.setattr(importlib, "import_module", refuse)
    with pytest.raises(FlowError, match=r"pip install matplotlib"):
        plot_history(solved(end_time_s=0.1), tmp_path / "history.png")
