"""Messages of policy servers, held to bytes that msgpack's and numpy's own documents give."""

from typing import Any

import msgpack
import numpy as np
import pytest

from robo47_qp.evaluation.serving.messages import MessageError, packed, unpacked


@pytest.mark.parametrize(
    "value",
    [
        np.arange(6.0).reshape(2, 3),
        np.arange(6, dtype=np.uint8).reshape(1, 2, 3)[:, ::-1],
        np.array(3.5),
        np.zeros((0, 4), np.float32),
        np.array([True, False]),
        np.array(["cube", "can"]),
        np.array([np.nan, np.inf, -0.0]),
    ],
)
def test_an_array_comes_back_as_it_was(value: np.ndarray[Any, Any]) -> None:
    back = unpacked(packed({"x": value}))["x"]
    assert (back.dtype, back.shape) == (value.dtype, value.shape)
    np.testing.assert_array_equal(back, value)


def test_numbers_text_and_maps_come_back() -> None:
    content = {"a": 1, "b": [1.5, None, True], "c": {"d": "e"}, "f": b"g"}
    assert unpacked(packed(content)) == content
    number = unpacked(packed({"x": np.float32(0.1)}))["x"]
    assert isinstance(number, np.float32)
    assert number == np.float32(0.1)


def test_the_encoding_is_the_one_that_clients_read() -> None:
    """The maps as openpi-client's documentation has them, read by msgpack alone."""
    plain = msgpack.unpackb(packed({"x": np.array([[1, 2]], np.int16), "y": np.int16(-3)}))
    assert plain["x"] == {
        b"__ndarray__": True,
        b"data": b"\x01\x00\x02\x00",
        b"dtype": "<i2",
        b"shape": [1, 2],
    }
    assert plain["y"] == {b"__npgeneric__": True, b"data": -3, b"dtype": "<i2"}


def array(**changed: object) -> bytes:
    names = {"data": bytes(8), "dtype": "<f8", "shape": [1]} | changed
    coded = {name.encode(): value for name, value in names.items() if value is not None}
    return msgpack.packb({"x": {b"__ndarray__": True, **coded}})  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"\xc1",
        b"\x81\xa1x",
        b"\x91" * 5000,
        msgpack.packb({"x": 1}) + b"\x00",
        array(dtype="|O"),
        array(dtype="O8"),
        array(dtype="V8"),
        array(dtype="<c16"),
        array(dtype="f8,f8"),
        array(dtype="<M8[s]"),
        array(dtype="|S0"),
        array(dtype="no such"),
        array(dtype=8),
        array(dtype=None),
        array(data="text"),
        array(data=None),
        array(shape=None),
        array(shape=[2]),
        array(shape=[-1]),
        array(shape=[2**40, 2**40]),
        array(shape=1),
        array(shape=[True]),
        msgpack.packb({"x": {b"__npgeneric__": True, b"dtype": "<f8", b"data": "text"}}),
        msgpack.packb({"x": {b"__npgeneric__": True, b"dtype": "<f8"}}),
        msgpack.packb({"x": {b"__npgeneric__": True, b"dtype": "|i1", b"data": 300}}),
    ],
)
def test_rubbish_is_refused(message: bytes) -> None:
    with pytest.raises(MessageError, match="must be msgpack"):
        unpacked(message)


@pytest.mark.parametrize("name", ["(,)f4", "f4,)", "{", "lambda"])
def test_names_of_no_type_are_refused(name: str) -> None:
    with pytest.raises(MessageError, match="must be msgpack"):
        unpacked(array(dtype=name))


def test_long_names_of_types_are_not_read() -> None:
    with pytest.raises(MessageError, match="without the name of its type"):
        unpacked(array(dtype="f8," * 1000 + "f8"))


def test_what_is_no_map_is_refused() -> None:
    with pytest.raises(MessageError, match=r"map of names to values; found a list"):
        unpacked(msgpack.packb([1]))


@pytest.mark.parametrize("value", [object(), np.array([object()]), np.zeros(1, "c16"), 2**70])
def test_what_does_not_cross_is_not_sent(value: object) -> None:
    with pytest.raises(MessageError, match="must hold numbers, text and arrays"):
        packed({"x": value})


@pytest.mark.parametrize("answer", [[1, 2], None, 3.5, "text", np.zeros(3)])
def test_an_answer_that_is_no_map_is_not_sent(answer: Any) -> None:
    with pytest.raises(MessageError, match="must be a map of names to values; found"):
        packed(answer)
