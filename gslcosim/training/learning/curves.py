"""Learning curves as a figure in the style of `gslcosim.data.figures`."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from gslcosim.data.figures.style import get_line_style, new_figure, save, styled

FIGURE = "curves"
_COSTS = {"best_cost": "best of a round", "mean_cost": "mean of a round", "validation_cost": "validation"}
_REWARDS = {"mean_reward": "mean of a leg", "reward": "mean of a search"}
_SUCCESS = {"success": "training", "validation_success": "validation"}
_ASPECT = 0.4


def draw_curves(curves: Sequence[Mapping[str, float]], folder: Path) -> list[Path]:
    """Draw cost or reward, and success, over rounds into `curves.svg` and `curves.png`.

    Raises:
        UsageError: matplotlib is not installed.
        MachineError: a file cannot be written.
    """
    with styled():
        figure = new_figure(2, _ASPECT)
        left, right = figure.subplots(1, 2)
        has_costs = any("mean_cost" in each for each in curves)
        _lines(left, curves, _COSTS if has_costs else _REWARDS)
        left.set(xlabel="round", ylabel="cost" if has_costs else "reward")
        _lines(right, curves, _SUCCESS)
        right.set(xlabel="round", ylabel="share of searches that succeed", ylim=(0, 1))
        return save(figure, folder / FIGURE, ("svg", "png"), dots_per_inch=150)


def _lines(axes: object, curves: Sequence[Mapping[str, float]], names: Mapping[str, str]) -> None:
    drawn = 0
    for i, (name, label) in enumerate(names.items()):
        points = [(each["round"], each[name]) for each in curves if name in each]
        if points:
            xs, ys = zip(*points, strict=True)
            marker = "o" if name.startswith("validation") else ""
            axes.plot(xs, ys, **get_line_style(i), marker=marker, ms=2.5, label=label, gid=f"curve/{name}")  # type: ignore[attr-defined]
            drawn += 1
    if drawn:
        axes.legend()  # type: ignore[attr-defined]
