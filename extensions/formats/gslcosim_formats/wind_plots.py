"""Plots of winds by matplotlib, where it is installed: the history of a solve."""

import importlib
from pathlib import Path
from typing import IO, Any

from gslcosim.base.errors import FlowError
from gslcosim.flow import WindReport

# A logarithmic axis has no zero, the value of still air [m/s].
LEAST_M_S = 1e-12


def plot_history(report: WindReport, path: str | Path | IO[bytes]) -> None:
    """Plot divergence, pressure iterations, mass balance and kinetic energy over time; the suffix sets the format.

    Args:
        report: Of `solve_wind_report`.
        path: File to write, or an open binary file, which gets PNG.
    """
    figure_type = matplotlib_figure_type()
    if figure_type is None:
        raise FlowError("plot_history: needs matplotlib. Install it: pip install matplotlib")
    history = report.history_columns()
    time_s = history["time_s"]
    figure = figure_type(figsize=(8, 10), layout="constrained")
    divergence, effort, mass, energy = figure.subplots(4, 1, sharex=True)
    for name, label in (("divergence_before_m_s", "before"), ("divergence_after_m_s", "after the pressure solve")):
        divergence.semilogy(time_s, [max(value, LEAST_M_S) for value in history[name]], label=label)
    divergence.set_ylabel("largest |div u| h [m/s]")
    effort.plot(time_s, history["pressure_iterations"], label="pressure iterations")
    effort.plot(time_s, history["courant"], label="Courant number")
    mass.plot(time_s, history["inflow_m3_s"], label="inflow")
    mass.plot(time_s, history["outflow_m3_s"], "--", label="outflow")
    mass.set_ylabel("[m³/s]")
    energy.plot(time_s, history["kinetic_energy_m2_s2"], label="mean kinetic energy")
    energy.set(ylabel="[m²/s²]", xlabel="time [s]")
    if (settling := report.settling) is not None:
        uncertain = settling.uncertainty_frac
        label = "mean wind" if uncertain is None else f"mean wind, uncertain by at least {uncertain:.0%}"
        energy.axvspan(settling.average_from_s, settling.average_until_s, alpha=0.2, label=label)
    for axes in (divergence, effort, mass, energy):
        axes.legend(loc="best")
    figure.savefig(path, dpi=120)


def matplotlib_figure_type() -> Any | None:
    """Return matplotlib's Figure, which needs neither window nor global state; None where it is not installed."""
    try:
        return importlib.import_module("matplotlib.figure").Figure
    except ImportError:
        return None
