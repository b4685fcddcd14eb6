"""The form of every message, compiled from its annotations: types, shapes, ranges, and what holds between fields.

A kind checks one value on its way out (`packed`: what msgpack takes) and on its way in (`unpacked`: what the message
holds). Both raise WireError, whose reason names message, field and fault, never the value.
"""

import dataclasses
import types
import typing
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

from omnivert.messages import Array, Bearings, Frame, Message, Mount, PixelFormat, Within

MAX_ENTRIES = 1024  # of a map
MAX_ITEMS = 64  # of a list


class WireError(ValueError):
    """These bytes, or this object, are no message. `reason` is one of a bounded set of texts, fit for counting."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


Lengths = dict[str, int]  # letter of a shape -> the length that all fields of a message and of its parts share


class Kind(Protocol):
    def packed(self, value: Any, place: str, lengths: Lengths) -> Any: ...
    def unpacked(self, value: Any, place: str, lengths: Lengths) -> Any: ...


@dataclasses.dataclass(frozen=True, slots=True)
class _Whole:
    within: Within

    def packed(self, value: Any, place: str, lengths: Lengths) -> int:
        return self.unpacked(int(value) if isinstance(value, np.integer) else value, place, lengths)

    def unpacked(self, value: Any, place: str, lengths: Lengths) -> int:
        if not isinstance(value, int) or isinstance(value, bool):
            raise WireError(f"{place} is not a whole number")
        if not self.within.low <= value <= self.within.high:
            raise WireError(f"{place} is out of range")
        return value


@dataclasses.dataclass(frozen=True, slots=True)
class _Real:
    within: Within

    def packed(self, value: Any, place: str, lengths: Lengths) -> float:
        return self.unpacked(float(value) if isinstance(value, np.number) else value, place, lengths)

    def unpacked(self, value: Any, place: str, lengths: Lengths) -> float:
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            raise WireError(f"{place} is not a number")
        if not self.within.low <= value <= self.within.high:  # refuses NaN, too
            raise WireError(f"{place} is out of range")
        return float(value)


@dataclasses.dataclass(frozen=True, slots=True)
class _Bool:
    def packed(self, value: Any, place: str, lengths: Lengths) -> bool:
        return self.unpacked(bool(value) if isinstance(value, np.bool_) else value, place, lengths)

    def unpacked(self, value: Any, place: str, lengths: Lengths) -> bool:
        if not isinstance(value, bool):
            raise WireError(f"{place} is not true or false")
        return value


@dataclasses.dataclass(frozen=True, slots=True)
class _Text:
    within: Within

    def packed(self, value: Any, place: str, lengths: Lengths) -> str:
        return self.unpacked(value, place, lengths)

    def unpacked(self, value: Any, place: str, lengths: Lengths) -> str:
        if not isinstance(value, str):
            raise WireError(f"{place} is not a text")
        if not self.within.low <= len(value) <= self.within.high:
            raise WireError(f"{place} has a wrong length")
        return value


@dataclasses.dataclass(frozen=True, slots=True)
class _Choice:
    type: type[StrEnum]

    def packed(self, value: Any, place: str, lengths: Lengths) -> str:
        return self.unpacked(value, place, lengths).value

    def unpacked(self, value: Any, place: str, lengths: Lengths) -> StrEnum:
        try:
            return self.type(value)
        except (ValueError, TypeError):
            raise WireError(f"{place} is none of the known words") from None


@dataclasses.dataclass(frozen=True, slots=True)
class _Array:
    form: Array

    def packed(self, value: Any, place: str, lengths: Lengths) -> Any:
        return self.unpacked(value, place, lengths)

    def unpacked(self, value: Any, place: str, lengths: Lengths) -> Any:
        form = self.form
        if not isinstance(value, np.ndarray):
            raise WireError(f"{place} is not an array")
        if value.dtype.name != form.dtype:
            raise WireError(f"{place} has a wrong type of number")
        if value.ndim != len(form.shape):
            raise WireError(f"{place} has a wrong shape")
        for length, wanted in zip(value.shape, form.shape, strict=True):
            if length != (wanted if isinstance(wanted, int) else lengths.setdefault(wanted, length)):
                raise WireError(f"{place} has a wrong shape")
        if value.size == 0:
            return value
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            raise WireError(f"{place} is not finite")
        if form.low is not None and value.min() < form.low:
            raise WireError(f"{place} is out of range")
        if form.high is not None and value.max() > form.high:
            raise WireError(f"{place} is out of range")
        return value


@dataclasses.dataclass(frozen=True, slots=True)
class _Optional:
    inner: Kind

    def packed(self, value: Any, place: str, lengths: Lengths) -> Any:
        return None if value is None else self.inner.packed(value, place, lengths)

    def unpacked(self, value: Any, place: str, lengths: Lengths) -> Any:
        return None if value is None else self.inner.unpacked(value, place, lengths)


@dataclasses.dataclass(frozen=True, slots=True)
class _List:
    inner: Kind
    within: Within

    def packed(self, value: Any, place: str, lengths: Lengths) -> list[Any]:
        self._hold(value, place)
        return [self.inner.packed(item, place, lengths) for item in value]

    def unpacked(self, value: Any, place: str, lengths: Lengths) -> tuple[Any, ...]:
        self._hold(value, place)
        return tuple(self.inner.unpacked(item, place, lengths) for item in value)

    def _hold(self, value: Any, place: str) -> None:
        if not isinstance(value, (list, tuple)):
            raise WireError(f"{place} is not a list")
        if not self.within.low <= len(value) <= min(self.within.high, MAX_ITEMS):
            raise WireError(f"{place} has a wrong length")


@dataclasses.dataclass(frozen=True, slots=True)
class _Map:
    key: Kind
    value: Kind

    def packed(self, value: Any, place: str, lengths: Lengths) -> dict[str, Any]:
        """Sorted by key, so that equal messages have equal bytes."""
        checked = self.unpacked(value, place, lengths)
        return {key: self.value.packed(checked[key], place, lengths) for key in sorted(checked)}

    def unpacked(self, value: Any, place: str, lengths: Lengths) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise WireError(f"{place} is not a map")
        if len(value) > MAX_ENTRIES:
            raise WireError(f"{place} has a wrong length")
        return {
            self.key.unpacked(key, place, lengths): self.value.unpacked(item, place, lengths)
            for key, item in value.items()
        }


class Form:
    """A message, or a part of one: a kind for each field, and the rule between them."""

    def __init__(self, part: type[Any]) -> None:
        self.type = part
        self.name = part.__name__
        hints = typing.get_type_hints(part, include_extras=True)
        fields = dataclasses.fields(part)
        self._kinds = {field.name: _kind_from_hint(hints[field.name]) for field in fields}
        self._needed = tuple(
            field.name
            for field in fields
            if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )

    def packed(self, value: Any, place: str = "", lengths: Lengths | None = None) -> dict[str, Any]:
        if type(value) is not self.type:
            raise WireError(f"{place} is not a {self.name}")
        own: Lengths = {} if lengths is None else lengths
        body = {
            name: kind.packed(getattr(value, name), f"{self.name}.{name}", own) for name, kind in self._kinds.items()
        }
        _hold_between_fields(value)
        return body

    def unpacked(self, value: Any, place: str = "", lengths: Lengths | None = None) -> Any:
        if not isinstance(value, Mapping):
            raise WireError(f"{place or self.name} is not a map")
        for name in self._needed:
            if name not in value:
                raise WireError(f"{self.name}.{name} is missing")
        own: Lengths = {} if lengths is None else lengths
        message = self.type(
            **{
                name: kind.unpacked(value[name], f"{self.name}.{name}", own)
                for name, kind in self._kinds.items()
                if name in value
            }
        )
        _hold_between_fields(message)
        return message


def _hold_between_fields(message: Any) -> None:
    """What one field demands of another."""
    match message:
        case Frame(format=PixelFormat.GREY8 | PixelFormat.BGR8):
            channels = 3 if message.format is PixelFormat.BGR8 else 1
            if message.data.size != message.width_px * message.height_px * channels:
                raise WireError("Frame.data contradicts width and height")
        case Bearings():
            if np.unique(message.track_id).size != message.track_id.size:
                raise WireError("Bearings.track_id is not unique")
        case Mount():
            c = message.covariance
            sigma = np.sqrt(np.maximum(np.diag(c), 0.0))
            if np.any(np.diag(c) < 0.0) or np.any(np.abs(c - c.T) > 1e-6 * np.outer(sigma, sigma)):
                raise WireError("Mount.covariance is none")


_ANY_LENGTH = Within(0, MAX_ITEMS)


def _kind_from_hint(hint: Any) -> Kind:
    origin = typing.get_origin(hint)
    if origin in (types.UnionType, typing.Union):
        (inner,) = (part for part in typing.get_args(hint) if part is not type(None))
        return _Optional(_kind_from_hint(inner))
    if origin is typing.Annotated:
        inner, note = typing.get_args(hint)
        return _kind_from_note(inner, note)
    if origin is dict:
        key, value = typing.get_args(hint)
        return _Map(_kind_from_hint(key), _kind_from_hint(value))
    if hint is bool:
        return _Bool()
    if isinstance(hint, type) and issubclass(hint, StrEnum):
        return _Choice(hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return Form(hint)
    raise TypeError(f"a message field cannot be a {hint}")


def _kind_from_note(inner: Any, note: Any) -> Kind:
    match note:
        case Array():
            return _Array(note)
        case Within() if inner is int:
            return _Whole(note)
        case Within() if inner is float:
            return _Real(note)
        case Within() if inner is str:
            return _Text(note)
        case Within() if typing.get_origin(inner) is tuple:
            return _List(_kind_from_hint(typing.get_args(inner)[0]), note)
        case _:
            raise TypeError(f"a message field cannot be a {inner} with {note}")


FORMS: dict[str, Form] = {message.__name__: Form(message) for message in typing.get_args(Message)}
