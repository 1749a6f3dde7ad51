"""What passes a tap: all of a release, none of it, or the same release at another rate."""

import numpy as np
import pytest

from gslcosim_services.fields.filament.release import ConstantRelease, PoissonRelease, SourceChange, SourceValve

STEP_S = 0.1


def born_s(plan, changes, n_steps, seed=1):
    """Return all births of a release whose tap changes before some steps."""
    births, tap = plan.start(np.random.default_rng(seed)), SourceValve()
    found = []
    for i in range(n_steps):
        if i in changes:
            tap.change(changes[i], i * STEP_S)
        found += tap.births_s(births, i * STEP_S, (i + 1) * STEP_S)
    return np.array(found)


def test_a_closed_valve_keeps_back_what_is_born_and_changes_nothing_after():
    plan = PoissonRelease(filaments_per_s=20.0)
    open_s = born_s(plan, {}, 100)
    closed_s = born_s(plan, {30: SourceChange(is_open=False), 60: SourceChange(is_open=True)}, 100)
    np.testing.assert_array_equal(closed_s, open_s[(open_s <= 30 * STEP_S) | (open_s > 60 * STEP_S)])


@pytest.mark.parametrize("plan", [ConstantRelease(filaments_per_s=10.0), PoissonRelease(filaments_per_s=10.0)])
@pytest.mark.parametrize("share", [0.5, 3.0])
def test_a_share_changes_the_rate_and_stretches_the_same_births(plan, share):
    # An instant at which no birth falls, so that rounding decides nothing.
    before_s = 33 * STEP_S
    changed_s = born_s(plan, {33: SourceChange(share=share)}, 133)
    own_s = born_s(plan, {}, 33 + round(100 * share))
    expected_s = np.where(own_s <= before_s, own_s, before_s + (own_s - before_s) / share)
    np.testing.assert_allclose(changed_s, expected_s[: len(changed_s)], rtol=1e-12)
    assert abs(len(changed_s) - len(expected_s)) <= 1
    assert (np.diff(changed_s) >= 0).all()
