"""Numeric arrays inside messages: raw little-endian bytes with dtype and shape."""

import math
from typing import Annotated, Any, Literal, Self, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ValidationInfo

from gslcosim.contract.record import Record, unchecked

DTYPES = {"float32": "<f4", "float64": "<f8", "uint8": "|u1", "int32": "<i4", "int64": "<i8"}
MAX_DIMENSIONS = 8
_DTYPE_OF = {name: np.dtype(code) for name, code in DTYPES.items()}
_NAME_OF = {dtype: name for name, dtype in _DTYPE_OF.items()}
# Products of longer ones may run in several threads.
_SHORT = 4096


def _check_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    if len(shape) > MAX_DIMENSIONS:
        raise ValueError(f"expected at most {MAX_DIMENSIONS} dimensions, was {len(shape)}")
    if any(n < 0 for n in shape):
        raise ValueError(f"expected lengths that are not negative, was {shape}")
    return shape


def _check_data(data: bytes, info: ValidationInfo) -> bytes:
    name, shape = info.data.get("dtype"), info.data.get("shape")
    if name is None or shape is None:  # which is wrong already
        return data
    dtype = _DTYPE_OF[name]
    # With Python's own integers: numpy's wrap around, and a hostile shape would pass for an empty one.
    expected = math.prod(shape) * dtype.itemsize
    if len(data) != expected:
        raise ValueError(f"expected {expected} bytes for {name} {shape}, was {len(data)}")
    if dtype.kind == "f" and not _are_finite(np.frombuffer(data, dtype)):
        raise ValueError("expected finite numbers, was NaN or infinity somewhere")
    return data


# One product takes a fraction of the time of asking each number; where the squares overflow, each is asked.
def _are_finite(values: NDArray[np.floating]) -> bool:
    is_sure = len(values) <= _SHORT and math.isfinite(np.vdot(values, values))
    return is_sure or bool(np.isfinite(values).all())


class NumericArray(Record):
    """An n-dimensional array, C order, little-endian, of finite numbers."""

    dtype: Literal["float32", "float64", "uint8", "int32", "int64"]
    shape: Annotated[tuple[int, ...], AfterValidator(_check_shape)]
    data: Annotated[bytes, AfterValidator(_check_data)]

    @classmethod
    def from_array(cls, array: NDArray[Any]) -> Self:
        """Copy a numpy array of one of the five dtypes into a message field."""
        name = _NAME_OF.get(array.dtype) or array.dtype.name
        if name not in DTYPES or (array.dtype.kind == "f" and not _are_finite(array.ravel())):
            return cls(dtype=cast(Any, name), shape=array.shape, data=array.tobytes())  # which is refused
        data = array.astype(_DTYPE_OF[name], copy=False).tobytes()
        return cast(Self, _new_array(dtype=cast(Any, name), shape=array.shape, data=data))

    def to_array(self) -> NDArray[Any]:
        """Return the values as a read-only numpy array with the message's shape."""
        return np.frombuffer(self.data, _DTYPE_OF[self.dtype]).reshape(self.shape)


_new_array = unchecked(NumericArray)
