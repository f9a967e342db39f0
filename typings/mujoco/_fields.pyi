"""How MuJoCo's attributes read and what they accept (of these stubs, not of MuJoCo)."""

from typing import (
    Generic,
    SupportsFloat,
    SupportsIndex,
    SupportsInt,
    TypeAlias,
    TypeVar,
)

import numpy as np
import numpy.typing as npt

Int: TypeAlias = SupportsInt | SupportsIndex
Float: TypeAlias = SupportsFloat | SupportsIndex
F64: TypeAlias = npt.NDArray[np.float64]
F32: TypeAlias = npt.NDArray[np.float32]
I32: TypeAlias = npt.NDArray[np.int32]
I64: TypeAlias = npt.NDArray[np.int64]
U8: TypeAlias = npt.NDArray[np.uint8]
Bool: TypeAlias = npt.NDArray[np.bool_]

_Scalar = TypeVar("_Scalar", bound=np.generic)

class _ArrayField(Generic[_Scalar]):
    """An attribute that reads as an array and may be set from anything like one."""

    def __get__(self, instance: object, owner: object = None, /) -> npt.NDArray[_Scalar]: ...
    def __set__(self, instance: object, value: npt.ArrayLike, /) -> None: ...

class IntField:
    """An attribute that reads as int and may be set from an enumeration."""

    def __get__(self, instance: object, owner: object = None, /) -> int: ...
    def __set__(self, instance: object, value: Int, /) -> None: ...

class FloatField:
    """An attribute that reads as float and may be set from any number."""

    def __get__(self, instance: object, owner: object = None, /) -> float: ...
    def __set__(self, instance: object, value: Float, /) -> None: ...

F64Field: TypeAlias = _ArrayField[np.float64]
F32Field: TypeAlias = _ArrayField[np.float32]
I32Field: TypeAlias = _ArrayField[np.int32]
I64Field: TypeAlias = _ArrayField[np.int64]
U8Field: TypeAlias = _ArrayField[np.uint8]
BoolField: TypeAlias = _ArrayField[np.bool_]
