"""Numeric arrays inside messages: raw little-endian bytes with dtype and shape."""

import math
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, model_validator

DTYPES = {"float32": "<f4", "float64": "<f8", "uint8": "|u1", "int32": "<i4", "int64": "<i8"}
MAX_DIMENSIONS = 8


class NumericArray(BaseModel):
    """An n-dimensional array, C order, little-endian, of finite numbers."""

    model_config = ConfigDict(frozen=True, strict=True, extra="ignore", val_json_bytes="base64")

    dtype: Literal["float32", "float64", "uint8", "int32", "int64"]
    shape: tuple[int, ...]
    data: bytes

    @model_validator(mode="after")
    def _check_size(self) -> Self:
        if len(self.shape) > MAX_DIMENSIONS:
            raise ValueError(f"expected at most {MAX_DIMENSIONS} dimensions, was {len(self.shape)}")
        # With Python's own integers: numpy's wrap around, and a hostile shape would pass for an empty one.
        expected = math.prod(self.shape) * np.dtype(DTYPES[self.dtype]).itemsize
        if any(n < 0 for n in self.shape) or len(self.data) != expected:
            raise ValueError(f"expected {expected} bytes for {self.dtype} {self.shape}, was {len(self.data)}")
        if self.dtype.startswith("float") and not np.isfinite(np.frombuffer(self.data, DTYPES[self.dtype])).all():
            raise ValueError("expected finite numbers, was NaN or infinity somewhere")
        return self

    @classmethod
    def from_array(cls, array: NDArray[Any]) -> Self:
        """Copy a numpy array of one of the five dtypes into a message field."""
        name = array.dtype.name
        return cls(dtype=name, shape=array.shape, data=np.ascontiguousarray(array, DTYPES[name]).tobytes())  # type: ignore[arg-type]

    def to_array(self) -> NDArray[Any]:
        """Return the values as a read-only numpy array with the message's shape."""
        return np.frombuffer(self.data, DTYPES[self.dtype]).reshape(self.shape)
