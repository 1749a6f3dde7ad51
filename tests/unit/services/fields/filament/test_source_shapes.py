import numpy as np
import pytest

from gslcosim_services.fields.filament.release import SourceShape

SIZE_M = (3.0, 2.0, 1.0)


def offsets(kind, n=40_000, size_m=SIZE_M):
    return SourceShape(kind=kind, size_m=size_m).offsets_m(np.random.default_rng(1).random((n, 3)))


@pytest.mark.parametrize(
    ("kind", "variances"),
    [
        ("box", (1 / 12, 1 / 12, 1 / 12)),
        ("line", (1 / 12, 1 / 12, 1 / 12)),
        ("sphere", (1 / 20, 1 / 20, 1 / 20)),
        ("cylinder", (1 / 16, 1 / 16, 1 / 12)),
    ],
)
def test_offsets_fill_the_shape_evenly(kind, variances):
    found = offsets(kind)
    assert found.mean(0) == pytest.approx([0, 0, 0], abs=0.02)
    assert found.var(0) == pytest.approx(np.multiply(variances, np.square(SIZE_M)), rel=0.03)


def test_offsets_stay_within_their_shape():
    halves = np.divide(SIZE_M, 2)
    assert (abs(offsets("box")) <= halves).all()
    assert (((offsets("sphere") / halves) ** 2).sum(1) <= 1 + 1e-12).all()
    cylinder = offsets("cylinder") / halves
    assert ((cylinder[:, :2] ** 2).sum(1) <= 1 + 1e-12).all()
    assert (abs(cylinder[:, 2]) <= 1).all()
    line = offsets("line") / SIZE_M
    assert np.ptp(line, axis=1).max() < 1e-12


def test_a_point_has_no_extent():
    assert not offsets("point", 5).any()
