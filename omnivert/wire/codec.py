"""A message as bytes: msgpack `[name, version, body]`, the body a map from field to value.

An array is one msgpack extension of type 1: numpy's type string (3 bytes, `<f8`), the number of dimensions (1 byte),
each length (4 bytes, little endian), zeros up to a multiple of 8, then the values, row by row, little endian. A nested
message is its body. Unknown fields of a body are ignored, missing ones take their default where they have one.

Any bytes decode to a message that keeps its form, or raise WireError.
"""

import math
import struct
from typing import Any, cast

import msgpack
import numpy as np
from numpy.typing import NDArray

from omnivert.messages import Message
from omnivert.wire.forms import FORMS, MAX_ENTRIES, MAX_ITEMS, WireError

__all__ = ["VERSION", "WireError", "decode", "encode"]

VERSION = 1

_ARRAY = 1  # msgpack's extension type for an array
_TYPES = {b"<f8": "float64", b"<f4": "float32", b"<i8": "int64", b"<i4": "int32", b"|u1": "uint8"}
_CODES = {dtype: code for code, dtype in _TYPES.items()}
_MAX_NESTED = 256  # lists and maps in one message


def encode(message: Message) -> bytes:
    """The bytes of a message; equal messages give equal bytes.

    raises  WireError, a ValueError, when the message does not keep its form
    """
    form = FORMS.get(type(message).__name__)
    if form is None:
        raise WireError(f"{type(message).__name__} is no message")
    return cast(bytes, msgpack.packb([form.name, VERSION, form.packed(message)], default=_ext_from_array))


def decode(data: bytes) -> Message:
    """The message in these bytes; its arrays are read-only.

    raises  WireError for any bytes that are none
    """
    match _unpacked(data):
        case [str() as name, int() as version, dict() as body]:
            form = FORMS.get(name)
            if form is None:
                raise WireError("no such message")
            if isinstance(version, bool) or version != VERSION:
                raise WireError(f"{name} of another version")
            return cast(Message, form.unpacked(body))
    raise WireError("not [name, version, body]")


def _unpacked(data: bytes) -> object:
    nested = 0

    def counted(value: Any) -> Any:
        nonlocal nested
        nested += 1
        if nested > _MAX_NESTED:
            raise WireError("too many lists and maps")
        return value

    try:
        # msgpack makes room for all items of a list before it reads the first; a map grows as it goes.
        return msgpack.unpackb(
            data,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_ENTRIES,
            ext_hook=_array_from_ext,
            list_hook=counted,
            object_hook=counted,
        )
    except WireError:
        raise
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as error:
        raise WireError("not msgpack") from error


def _ext_from_array(array: NDArray[Any]) -> msgpack.ExtType:
    code = _CODES[array.dtype.name]
    head = struct.pack(f"<3sB{array.ndim}I", code, array.ndim, *array.shape)
    values = np.ascontiguousarray(array, dtype=np.dtype(code.decode()))
    return msgpack.ExtType(_ARRAY, b"".join((head, bytes(-len(head) % 8), values.data)))


def _array_from_ext(kind: int, data: bytes) -> NDArray[Any]:
    """A read-only view of the bytes; the values begin at a multiple of 8, so that every number is aligned."""
    dimensions = data[3] if len(data) >= 4 else 5
    if kind != _ARRAY or dimensions > 4 or data[:3] not in _TYPES or len(data) < 4 + 4 * dimensions:
        raise WireError("an extension that is no array")
    shape = struct.unpack_from(f"<{dimensions}I", data, 4)
    start = -(-(4 + 4 * dimensions) // 8) * 8
    dtype = np.dtype(data[:3].decode())
    if start + math.prod(shape) * dtype.itemsize != len(data):
        raise WireError("an array whose length contradicts its shape")
    return np.frombuffer(data, dtype, offset=start).reshape(shape)
