"""Declaration metrics: declared positions against the sources, and right or wrong answers to "is there a source?"."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gslcosim.bench.metrics.path_metrics import distances_m
from gslcosim.bench.metrics.series import as_points, as_series

Outcome = Literal["correct", "wrong_place", "silent", "false_alarm", "correct_silence"]


@dataclass(frozen=True, kw_only=True)
class DeclarationFigures:
    """The figures of all declarations of a run, of all its agents.

    `outcome` is the cell of the table that the first one falls into, `error_m` and `error_in_plane_m` are the distances
    of the first one to the nearest source, in space and with heights apart; absent without a declaration, and on a
    control, where there is nothing to be near to. `confidence` is the highest, 0 without one.
    """

    outcome: Outcome
    first_declared_s: float | None
    error_m: float | None
    error_in_plane_m: float | None
    confidence: float
    n_false: int


def classify_declaration(error_m: float | None, *, within_m: float, is_control: bool) -> Outcome:
    """Return the cell of the table of declarations that a run falls into.

    | | within r_s | elsewhere | none |
    |---|---|---|---|
    | source present | correct | wrong_place | silent |
    | control | false_alarm | false_alarm | correct_silence |

    Args:
        error_m: Distance of the first declaration to the nearest source [m], on a control any number; absent: none.
        within_m: Success radius r_s [m]; a distance equal to it is within.
        is_control: Whether no source gives off gas.
    """
    if is_control:
        return "correct_silence" if error_m is None else "false_alarm"
    if error_m is None:
        return "silent"
    return "correct" if error_m <= within_m else "wrong_place"


def score_declarations(
    t_s: ArrayLike,
    places_m: ArrayLike,
    confidences: ArrayLike,
    sources_m: ArrayLike,
    *,
    within_m: float,
    is_control: bool = False,
    is_horizontal: bool = False,
) -> DeclarationFigures:
    """Judge the declarations of a run, in any order; of several the earliest counts, for help would be sent there.

    Args:
        t_s: (n,) when they took effect [s]; may be empty.
        places_m: (n, 3) declared places, world frame [m].
        confidences: (n,) how sure the agents were, 0 to 1.
        sources_m: (m, 3) sources, world frame [m]; virtual ones on a control.
        within_m: Success radius [m].
        is_control: Whether no source gives off gas; then all declarations are false.
        is_horizontal: Whether heights do not count for success.

    Raises:
        ShapeError: there are not as many places or confidences as times.
    """
    if not np.size(t_s):
        outcome = classify_declaration(None, within_m=within_m, is_control=is_control)
        return DeclarationFigures(
            outcome=outcome, first_declared_s=None, error_m=None, error_in_plane_m=None, confidence=0.0, n_false=0
        )
    places = as_points("places_m", places_m)
    times_s = as_series("t_s", t_s, n=len(places))
    highest = float(as_series("confidences", confidences, n=len(places)).max())
    errors_m, in_plane_m = (distances_m(places, sources_m, is_horizontal=flat) for flat in (False, True))
    judged_m = in_plane_m if is_horizontal else errors_m
    first = int(times_s.argmin())
    return DeclarationFigures(
        outcome=classify_declaration(float(judged_m[first]), within_m=within_m, is_control=is_control),
        first_declared_s=float(times_s[first]),
        error_m=None if is_control else float(errors_m[first]),
        error_in_plane_m=None if is_control else float(in_plane_m[first]),
        confidence=highest,
        n_false=len(places) if is_control else int((judged_m > within_m).sum()),
    )
