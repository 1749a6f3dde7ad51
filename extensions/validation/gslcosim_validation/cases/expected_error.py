"""Errors that the air of a run may have: intervals from all sets but one, beside the one that was held out."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gslcosim_data.text_tables import Markdown, format_markdown_table
from gslcosim_validation.air_kinds import AIR_KINDS, AirKind
from gslcosim_validation.expected_errors import QUANTITIES, RatioInterval
from gslcosim_validation.held_out_errors import (
    LEAST_SETS,
    HeldOut,
    collect_set_errors,
    compute_expected_errors,
    hold_out,
)
from gslcosim_validation.release_pairs import Quantity, ReleasePairs
from gslcosim_validation.results import Figure, Findings, plain_estimate

_HEADINGS = (
    "kind of air",
    "FAC2",
    "mean, modelled over measured [90 % interval]",
    "sets (releases)",
    "intensity, modelled over measured [90 % interval]",
    "sets (releases)",
)
_TICKS = (0.01, 0.1, 0.5, 1.0, 2.0, 10.0, 100.0)


def measure(pairs: Sequence[ReleasePairs]) -> Findings:
    """Return the coverage of intervals on sets that were held out, and the table of errors by kind of air."""
    held = list(hold_out(pairs))
    by_quantity = {words: [each for each in held if each.quantity == name] for name, words in QUANTITIES.items()}
    within, n = sum(each.n_within for each in held), sum(each.n for each in held)
    figures = [
        Figure("coverage", plain_estimate(within / n, n), of="releases", n_within=within),
        Figure("coverage", plain_estimate(float(np.mean([each.share_within for each in held])), len(held)), of="sets"),
    ]
    for words, some in by_quantity.items():
        if some:
            sets = ", ".join(f"{each.name} {each.n_within} of {each.n}" for each in some)
            share = sum(each.n_within for each in some) / sum(each.n for each in some)
            figures.append(Figure("coverage_of", plain_estimate(share, len(some)), quantity=words, sets=sets))
    return Findings(
        figures=figures,
        drawings={"held-out": lambda figure: _draw(figure, pairs, held)},
        remarks={
            "table": {"table": "\n".join(_build_table(compute_expected_errors(pairs)))},
            "reading": {"least_sets": LEAST_SETS},
            "models": {"behind": _describe_sets(pairs)},
            "runs": {},
        },
    )


def _draw(figure: Any, pairs: Sequence[ReleasePairs], held: Sequence[HeldOut]) -> None:
    present: list[Quantity] = [quantity for quantity in QUANTITIES if any(each.quantity == quantity for each in held)]
    for axes, quantity in zip(figure.subplots(1, len(present), squeeze=False)[0], present, strict=True):
        shown = [each for each in held if each.quantity == quantity]
        errors = {each.name: np.exp(each.log_ratios) for each in collect_set_errors(pairs, quantity)}
        for i, each in enumerate(shown):
            axes.plot([each.interval["low"], each.interval["high"]], [i, i], color="0.8", lw=6, solid_capstyle="butt")
            axes.plot(errors[each.name], np.full(each.n, i), "o", ms=3, alpha=0.6, color="C0")
        axes.axvline(1.0, color="0.4", lw=0.8)
        axes.set(xscale="log", xlabel=f"{QUANTITIES[quantity]}, modelled over measured", ylim=(len(shown) - 0.5, -0.5))
        low, high = axes.get_xlim()
        ticks = [tick for tick in _TICKS if low <= tick <= high]
        axes.minorticks_off()
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_yticks(range(len(shown)), [each.name for each in shown])


def _build_table(errors: Mapping[AirKind, Mapping[Quantity, RatioInterval]]) -> list[str]:
    rows = []
    for kind, found in errors.items():
        cells: list[str] = [AIR_KINDS[kind]]
        for quantity in QUANTITIES:
            interval = found.get(quantity)
            texts = ["-"] * (3 if quantity == "mean" else 2)
            if interval is not None:
                fac2 = interval.get("fac2")
                texts = [f"{fac2:.2f}"] if fac2 is not None else []
                texts.append(format_ratio(interval))
                texts.append(", ".join(f"{name} ({n})" for name, n in interval["sets"].items()))
                if interval["of_all_kinds"]:
                    texts = [Markdown(f"*{text}*") for text in texts]
            cells += texts
        rows.append(cells)
    return list(format_markdown_table(_HEADINGS, rows))


def format_ratio(interval: RatioInterval) -> str:
    """Return a ratio with its interval, such as `0.82 [0.33, 2.1]`."""
    return f"{interval['ratio']:.2g} [{interval['low']:.2g}, {interval['high']:.2g}]"


def _describe_sets(pairs: Sequence[ReleasePairs]) -> str:
    kinds = {each.get("measured_set", ""): each["kind_of_air"] for each in pairs}
    named = {words: sorted(name for name in kinds if kinds[name] == kind) for kind, words in AIR_KINDS.items()}
    return "; ".join(f"{words}: {', '.join(names)}" for words, names in named.items() if names)
