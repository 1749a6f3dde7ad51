import numpy as np
import pytest

from gslcosim.contract.record import DTYPES, NumericArray, validate_fields


@pytest.mark.parametrize("dtype", DTYPES)
def test_an_array_comes_back_with_values_shape_and_dtype(dtype):
    array = np.arange(24).reshape(2, 3, 4).astype(dtype)
    back = NumericArray.from_array(array).to_array()
    assert back.dtype == array.dtype
    assert np.array_equal(back, array)


def test_bytes_are_in_c_order_and_little_endian_whatever_the_source():
    array = np.array([[1, 2, 3], [4, 5, 6]], dtype=">i4")
    message = NumericArray.from_array(np.asfortranarray(array))
    assert message.data == b"".join(value.to_bytes(4, "little") for value in (1, 2, 3, 4, 5, 6))


def test_the_result_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        NumericArray.from_array(np.zeros(3)).to_array()[0] = 1.0


@pytest.mark.parametrize(
    "fields",
    [
        {"dtype": "float64", "shape": (3,), "data": bytes(23)},
        {"dtype": "float64", "shape": (3,), "data": bytes(25)},
        {"dtype": "float64", "shape": (-1, -3), "data": bytes(24)},
        {"dtype": "float64", "shape": (3.0,), "data": bytes(24)},
        {"dtype": "float16", "shape": (3,), "data": bytes(6)},
        {"dtype": "object", "shape": (3,), "data": bytes(24)},
        {"dtype": "float64", "shape": (3,), "data": "x" * 24},
        {"dtype": "float64", "shape": (3,)},
    ],
    ids=["short", "long", "negative", "float_shape", "float16", "object", "text", "missing"],
)
def test_inconsistent_arrays_are_refused(fields):
    with pytest.raises(ValueError, match=r"expected|[Ii]nput"):
        validate_fields(NumericArray, fields)


def test_a_shape_whose_size_overflows_is_refused():
    with pytest.raises(ValueError, match=r"expected|[Ii]nput"):
        NumericArray(dtype="uint8", shape=(2**32, 2**32), data=b"")


def test_more_dimensions_than_anyone_needs_are_refused():
    assert NumericArray(dtype="uint8", shape=(1,) * 8, data=b"x").to_array().ndim == 8
    with pytest.raises(ValueError, match="at most 8 dimensions"):
        NumericArray(dtype="uint8", shape=(1,) * 9, data=b"x")


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("n", [3, 100_000])
@pytest.mark.parametrize("poison", [(np.nan,), (np.inf,), (-np.inf,), (np.inf, -np.inf)])
def test_numbers_that_are_not_finite_are_refused(dtype, n, poison):
    with pytest.raises(ValueError, match="finite numbers"):
        NumericArray.from_array(np.array([*poison, *[1.0] * n], dtype))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_largest_numbers_are_finite(dtype):
    """Their squares are not."""
    largest = np.array([np.finfo(dtype).max, 1.0], dtype)
    assert np.array_equal(NumericArray.from_array(largest).to_array(), largest)
