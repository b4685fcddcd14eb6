"""Any message survives the way through bytes; any bytes become a message that keeps its form, or a WireError."""

import dataclasses
import tracemalloc
import types
import typing
from collections.abc import Callable
from enum import StrEnum
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from omnivert.messages import (
    Array,
    Bearings,
    Extrinsics,
    Frame,
    Health,
    Looks,
    Message,
    Mount,
    PixelFormat,
    State,
    Ticks,
)
from omnivert.wire.codec import WireError, decode, encode

MESSAGES = typing.get_args(Message)


# ------------------------------------------------------------------ any message


def values(hint: Any, lengths: dict[str, int]) -> st.SearchStrategy[Any]:
    """Values that keep the form of a field."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        return st.none() | values(next(part for part in parts if part is not type(None)), lengths)
    if origin is dict:
        return st.dictionaries(values(parts[0], lengths), values(parts[1], lengths), max_size=4)
    if hint is bool:
        return st.booleans()
    if isinstance(hint, type) and issubclass(hint, StrEnum):
        return st.sampled_from(hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return messages(hint, lengths)
    inner, note = parts
    if isinstance(note, Array):
        shape = tuple(n if isinstance(n, int) else lengths[n] for n in note.shape)
        return arrays(note, shape)
    if inner is int:
        return st.integers(int(note.low), int(note.high))
    if inner is float:
        return st.floats(note.low, note.high, allow_nan=False)
    if inner is str:
        return st.text(min_size=int(note.low), max_size=min(int(note.high), 12))
    return st.lists(values(typing.get_args(inner)[0], lengths), max_size=min(int(note.high), 4)).map(tuple)


def arrays(form: Array, shape: tuple[int, ...]) -> st.SearchStrategy[Any]:
    if form.dtype.startswith("float"):
        width = 32 if form.dtype == "float32" else 64
        low, high = (-1e6 if form.low is None else form.low), (1e6 if form.high is None else form.high)
        if width == 32:  # the nearest ones inside
            low, high = (
                float(np.nextafter(np.float32(low), np.float32(1e9))),
                float(np.nextafter(np.float32(high), np.float32(-1e9))),
            )
        elements: st.SearchStrategy[Any] = st.floats(low, high, width=width, allow_nan=False)  # type: ignore[arg-type]
    else:
        span = np.iinfo(form.dtype)
        elements = st.integers(
            int(span.min if form.low is None else form.low), int(span.max if form.high is None else form.high)
        )
    return hnp.arrays(form.dtype, shape, elements=elements)


@st.composite
def messages(draw: st.DrawFn, kind: type[Any], given: dict[str, int] | None = None) -> Any:
    hints = typing.get_type_hints(kind, include_extras=True)
    lengths = given or {"N": draw(st.integers(0, 6)), "B": draw(st.integers(0, 40))}
    drawn = {field.name: draw(values(hints[field.name], lengths)) for field in dataclasses.fields(kind)}
    if kind is Frame:
        drawn["width_px"], drawn["height_px"] = draw(st.integers(1, 8)), draw(st.integers(1, 8))
        channels = {PixelFormat.GREY8: 1, PixelFormat.BGR8: 3}.get(drawn["format"])
        size = channels * drawn["width_px"] * drawn["height_px"] if channels else lengths["B"]
        drawn["data"] = draw(hnp.arrays(np.uint8, size))
    if kind is Bearings:
        drawn["track_id"] = draw(hnp.arrays(np.int64, lengths["N"], elements=st.integers(0, 2**62), unique=True))
    if kind is Mount:
        root = draw(hnp.arrays(np.float64, (3, 3), elements=st.floats(-10, 10)))
        drawn["covariance"] = root @ root.T
    return kind(**drawn)


def plain(value: Any) -> Any:
    """For comparing: arrays as type, shape and bytes."""
    if isinstance(value, np.ndarray):
        return value.dtype.name, value.shape, value.tobytes()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return type(value).__name__, {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, tuple):
        return tuple(plain(item) for item in value)
    return value


@pytest.mark.parametrize("kind", MESSAGES)
def test_any_message_comes_back_as_it_was(kind: Any) -> None:
    @settings(max_examples=40, suppress_health_check=list(HealthCheck))
    @given(message=messages(kind))
    def check(message: Any) -> None:
        data = encode(message)
        back = decode(data)
        assert plain(back) == plain(message)
        assert encode(back) == data

    check()


def test_equal_messages_have_equal_bytes() -> None:
    def health(order: Any) -> Any:
        return Health(1, "vision", "front", 1.0, refused=dict.fromkeys(order, 1))

    assert encode(health("abc")) == encode(health("cba"))
    grid = np.arange(12, dtype=np.uint8)
    assert encode(frame(grid)) == encode(frame(np.repeat(grid, 2)[::2]))


def test_arrays_come_back_aligned_and_read_only() -> None:
    back = decode(encode(bearings()))
    assert isinstance(back, Bearings)
    assert back.bearing_rad.flags.aligned
    assert not back.bearing_rad.flags.writeable


# ------------------------------------------------------------------ any bytes


@settings(max_examples=300)
@given(st.binary(max_size=200))
def test_any_bytes_decode_or_raise_wire_error(data: Any) -> None:
    tried(data)


json_like = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=200)
@given(
    st.sampled_from(MESSAGES),
    st.data(),
)
def test_any_msgpack_in_the_place_of_a_field_decodes_or_raises_wire_error(kind: Any, data: Any) -> None:
    names = [field.name for field in dataclasses.fields(kind)]
    body = data.draw(st.fixed_dictionaries({}, optional=dict.fromkeys(names, json_like)))
    tried(msgpack.packb([kind.__name__, 1, body]))


@settings(max_examples=300)
@given(st.integers(0, 10_000), st.integers(0, 255), st.booleans())
def test_a_message_with_a_changed_byte_decodes_or_raises_wire_error(place: Any, byte: Any, cut: Any) -> None:
    data = bytearray(encode(bearings()))
    place %= len(data)
    data[place] = byte
    tried(bytes(data[:place] if cut else data))


def tried(data: bytes) -> None:
    try:
        message = decode(data)
    except WireError as error:
        assert 0 < len(error.reason) < 100  # noqa: PT017 - either outcome is right
    else:
        assert decode(encode(message))


# ------------------------------------------------------------------ what is refused, and how it is called


def bearings(**changed: Any) -> Bearings:
    fields = {
        "stamp_ns": 5,
        "track_id": np.array([3, 1, 2]),
        "bearing_rad": np.array([0.1, -3.0, 3.0]),
        "std_rad": np.full(3, 0.01),
        "age_frames": np.zeros(3, np.int32),
        "strength": np.full(3, 0.5, np.float32),
        "reasons": ("dark",),
    }
    return Bearings(**{**fields, **changed})


def looks(count: int) -> Looks:
    of_image = np.zeros(count, np.float32)
    return Looks(np.ones(count, np.int32), of_image, of_image, of_image, np.zeros(count, np.uint8))


def frame(data: Any, width_px: int = 4, height_px: int = 3) -> Frame:
    return Frame(0, PixelFormat.GREY8, width_px, height_px, data)


def extrinsics(covariance: Any) -> Extrinsics:
    mount = Mount(0.0, 0.1, 0.0, covariance)
    return Extrinsics(0, "r", "c", mount, State.CALIBRATED, 1, (), "omnivert 0", "0")


WRONG: dict[str, tuple[Callable[[], Any], str]] = {
    "number type": (lambda: bearings(bearing_rad=np.zeros(3, np.float32)), "wrong type of number"),
    "length": (lambda: bearings(std_rad=np.full(4, 0.1)), "wrong shape"),
    "dimensions": (lambda: bearings(std_rad=np.full((3, 1), 0.1)), "wrong shape"),
    "not a number": (lambda: bearings(bearing_rad=np.array([0.0, np.nan, 0.0])), "not finite"),
    "infinite": (lambda: bearings(std_rad=np.array([0.1, np.inf, 0.1])), "not finite"),
    "low": (lambda: bearings(std_rad=np.zeros(3)), "out of range"),
    "high": (lambda: bearings(bearing_rad=np.array([0.0, 3.2, 0.0])), "out of range"),
    "twice the same track": (lambda: bearings(track_id=np.array([1, 2, 1])), "not unique"),
    "a part of another length": (lambda: bearings(looks=looks(2)), "Looks.polarity has a wrong shape"),
    "negative stamp": (lambda: bearings(stamp_ns=-1), "out of range"),
    "stamp that is true": (lambda: bearings(stamp_ns=True), "not a whole number"),
    "stamp that is a fraction": (lambda: bearings(stamp_ns=0.5), "not a whole number"),
    "long reason": (lambda: bearings(reasons=("x" * 1001,)), "wrong length"),
    "many reasons": (lambda: bearings(reasons=("x",) * 17), "wrong length"),
    "size of a frame": (lambda: frame(np.zeros(11, np.uint8)), "contradicts"),
    "negative variance": (lambda: extrinsics(-np.eye(3)), "covariance"),
    "lopsided covariance": (lambda: extrinsics(np.eye(3) + np.eye(3, k=1)), "covariance"),
    "no message": (lambda: "Ticks", "no message"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_message_that_does_not_keep_its_form_is_not_sent(name: Any) -> None:
    make, reason = WRONG[name]
    with pytest.raises(ValueError, match=reason):
        encode(make())


def packed(value: Any) -> bytes:
    return bytes(msgpack.packb(value))


def raw(name: str = "Ticks", version: Any = 1, **changed: Any) -> bytes:
    return packed([name, version, {"stamp_ns": 1, "left": 2, "right": 3, **changed}])


def ext(dtype: bytes, shape: tuple[int, ...], data: bytes) -> msgpack.ExtType:
    head = dtype + bytes([len(shape)]) + b"".join(n.to_bytes(4, "little") for n in shape)
    return msgpack.ExtType(1, head + bytes(-len(head) % 8) + data)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (raw(version=2), "Ticks of another version"),
        (raw(version=True), "Ticks of another version"),
        (raw(name="Tocks"), "no such message"),
        (raw(left="2"), "Ticks.left is not a whole number"),
        (raw(left=2**60), "Ticks.left is out of range"),
        (msgpack.packb(["Ticks", 1, {"stamp_ns": 1}]), "Ticks.left is missing"),
        (msgpack.packb(["Ticks", 1]), "not .name, version, body."),
        (msgpack.packb({}), "not .name, version, body."),
        (raw() + b"\x00", "not msgpack"),
        (raw()[:-1], "not msgpack"),
        (b"", "not msgpack"),
        (b"\xc1", "not msgpack"),
        (raw(more=ext(b"<f8", (3,), bytes(8))), "contradicts its shape"),
        (raw(more=ext(b"<f8", (2**31, 2**31), b"")), "contradicts its shape"),
        (raw(more=ext(b"|O8", (1,), bytes(8))), "no array"),
        (raw(more=ext(b"<f8", (1,) * 200, bytes(8))), "no array"),
        (raw(more=msgpack.ExtType(2, b"")), "no array"),
        (b"\x91" * 100_000, "not msgpack|too many"),
        (b"\x81\xa1a" * 100_000, "not msgpack|too many"),
        (msgpack.packb([[]] * 60) * 1, "not .name"),
    ],
)
def test_bytes_that_are_no_message_are_refused_with_the_reason(data: Any, reason: Any) -> None:
    with pytest.raises(WireError, match=reason):
        decode(data)


def test_fields_that_are_not_known_are_ignored_and_those_with_a_default_may_be_missing() -> None:
    assert decode(raw(colour="red", more=[1, {"a": 2}])).stamp_ns == 1
    health = decode(msgpack.packb(["Health", 1, {"stamp_ns": 1, "service": "a", "instance": "b", "uptime_s": 1}]))
    assert isinstance(health, Health)
    assert health.refused == {}


@pytest.mark.parametrize(
    "data",
    [
        b"\xdd\xff\xff\xff\xff",  # a list of 4 billion
        b"\xdf\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\xc9\xff\xff\xff\xff\x01",
        (b"\xdd\x00\xff\xff\xff") * 1000,
        msgpack.packb([[[[[] for _ in range(60)] for _ in range(60)] for _ in range(60)] for _ in range(5)]),
        b"\x93\xa5Ticks\x01" + b"\x81\xa1a" * 200_000,
    ],
)
def test_a_few_bytes_never_take_much_memory(data: Any) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(WireError):
            decode(data)
        assert tracemalloc.get_traced_memory()[1] < 20 * len(data) + 1_000_000
    finally:
        tracemalloc.stop()


def test_ticks_that_numpy_counted_are_sent_as_numbers() -> None:
    message = Ticks(np.int64(1), np.int32(2), np.int64(3))  # type: ignore[arg-type]
    assert plain(decode(encode(message))) == plain(Ticks(1, 2, 3))
