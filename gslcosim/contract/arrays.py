"""Numeric arrays inside messages: raw little-endian bytes with dtype and shape."""

import math
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, model_validator

DTYPES = {"float32": "<f4", "float64": "<f8", "uint8": "|u1", "int32": "<i4", "int64": "<i8"}
MAX_DIMENSIONS = 8
_DTYPE_OF = {name: np.dtype(code) for name, code in DTYPES.items()}
_NAME_OF = {dtype: name for name, dtype in _DTYPE_OF.items()}


class NumericArray(BaseModel):
    """An n-dimensional array, C order, little-endian, of finite numbers."""

    model_config = ConfigDict(frozen=True, strict=True, extra="ignore", val_json_bytes="base64")

    dtype: Literal["float32", "float64", "uint8", "int32", "int64"]
    shape: tuple[int, ...]
    data: bytes

    # Once: validators that come after would be run again by every record that the array becomes a part of.
    @model_validator(mode="wrap")
    @classmethod
    def _check_once(cls, value: Any, build: ModelWrapValidatorHandler[Self]) -> Self:
        return value if isinstance(value, cls) else build(value)._checked()

    def _checked(self) -> Self:
        if len(self.shape) > MAX_DIMENSIONS:
            raise ValueError(f"expected at most {MAX_DIMENSIONS} dimensions, was {len(self.shape)}")
        # With Python's own integers: numpy's wrap around, and a hostile shape would pass for an empty one.
        dtype = _DTYPE_OF[self.dtype]
        expected = math.prod(self.shape) * dtype.itemsize
        if any(n < 0 for n in self.shape) or len(self.data) != expected:
            raise ValueError(f"expected {expected} bytes for {self.dtype} {self.shape}, was {len(self.data)}")
        if dtype.kind == "f" and not np.isfinite(np.frombuffer(self.data, dtype)).all():
            raise ValueError("expected finite numbers, was NaN or infinity somewhere")
        return self

    @classmethod
    def from_array(cls, array: NDArray[Any]) -> Self:
        """Copy a numpy array of one of the five dtypes into a message field."""
        name = _NAME_OF.get(array.dtype) or array.dtype.name
        data = array.astype(_DTYPE_OF[name], copy=False).tobytes()
        if array.ndim <= MAX_DIMENSIONS and np.isfinite(array).all():
            return cls.model_construct(dtype=name, shape=array.shape, data=data)
        return cls(dtype=name, shape=array.shape, data=data)  # type: ignore[arg-type]  # refuses it, and says why

    def to_array(self) -> NDArray[Any]:
        """Return the values as a read-only numpy array with the message's shape."""
        return np.frombuffer(self.data, _DTYPE_OF[self.dtype]).reshape(self.shape)
