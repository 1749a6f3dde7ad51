"""Score of a run, and its time as statistics count it."""


def counted_time_s(*, success: bool, time_to_source_s: float | None, limit_s: float) -> float:
    """Return the time of a run: min(time to source, T) with success, T for every failure, collisions too [s].

    Args:
        success: Whether the source was found.
        time_to_source_s: When [s]; absent without success.
        limit_s: Time limit T [s].
    """
    return min(time_to_source_s, limit_s) if success and time_to_source_s is not None else limit_s


def score(
    *, success: bool, time_s: float, limit_s: float, n_false_declarations: int = 0, n_collisions: int = 0
) -> float:
    """Return the score of a run.

    q = S (1 - t / (2 T)) / 2^f, and 0 after a collision        dimensionless; 0 without success, else up to 1

    Without false declarations a success has 1/2 to 1: no success is worth less than half, so that a slow one is
    better than none.

    Args:
        success: S, 1 with success, else 0.
        time_s: Time to source t [s], 0 to T.
        limit_s: Time limit T [s], > 0.
        n_false_declarations: Declarations of wrong places, f.
        n_collisions: Collisions of all agents.

    Raises:
        ValueError: a time is not in its range.

    Source:
        Chosen; a success counts more than any time, and a false alarm costs half.
    Held by:
        tests/unit/bench/metrics/test_scores.py
    """
    if not 0.0 <= time_s <= limit_s or limit_s <= 0.0:
        raise ValueError(
            f"score: expected a time from 0 to the limit of {limit_s:g} s, found {time_s:g} s. "
            "Count a failure with the limit."
        )
    if not success or n_collisions:
        return 0.0
    return (1.0 - 0.5 * time_s / limit_s) * 0.5**n_false_declarations
