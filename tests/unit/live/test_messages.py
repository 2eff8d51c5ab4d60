"""Requests are hostile until checked; each refusal says what would be right."""

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import documents

from hil_bench.abilities.live.messages import RequestError, encode, parse_request

GOOD = [
    {"id": 1, "do": "status"},
    {"id": 2, "do": "watch", "rows_every_s": 0.1, "frames": True},
    {"id": 2, "do": "watch", "rows_every_s": None},
    {"id": 3, "do": "begin_fault", "kind": "freeze", "target": "a", "arguments": {"at": 1.5}},
    {"id": 4, "do": "clear_fault"},
    {"id": 5, "do": "clear_fault", "number": 3},
    {"id": 6, "do": "set_object", "node": "io", "name": "0x6401.01", "value": {"hex": "00ff"}},
    {"id": 7, "do": "set_plant", "axis": "axis1", "quantity": "load", "value": -5},
]


@pytest.mark.parametrize("message", GOOD, ids=lambda message: message["do"])
def test_a_request_keeps_its_fields(message):
    request = parse_request(encode(message))
    assert {"id": request.number, "do": request.action, **request.fields} == message


@pytest.mark.parametrize(
    "line", [line for block in documents.blocks("json") for line in block.text.splitlines()]
)
def test_a_request_of_the_documents_is_right(line):
    assert parse_request(line.encode()).action


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (b"", "is not JSON"),
        (b"\xff\xfe", "is not JSON"),
        (b"[" * 60000, "is not JSON"),
        (b'{"id": 1, "do": "set_plant", "axis": "a", "quantity": "b", "value": NaN}', "not JSON"),
        (b'{"id": 1' + b"0" * 5000 + b"}", "is not JSON"),
        (b"7", "is not a JSON object"),
        (b"{}", "id = None: give an integer"),
        (b'{"id": true, "do": "status"}', "id = True: give an integer"),
        (b'{"id": 1e3, "do": "status"}', "id = 1000.0: give an integer"),
        (b'{"id": 9223372036854775808, "do": "status"}', "give an integer"),
        (b'{"id": 1}', "do = None: give one of status, watch, begin_fault,"),
        (b'{"id": 1, "do": ["status"]}', "give one of status"),
        (b'{"id": 1, "do": "__init__"}', "do = '__init__': give one of"),
        (b'{"id": 1, "do": "status", "x": 1}', "status: unknown field 'x'; it takes none"),
        (b'{"id": 1, "do": "get_object", "node": "io"}', "name is missing; give a text"),
        (b'{"id": 1, "do": "get_object", "node": 1, "name": "a"}', "node = 1; give a text"),
        (b'{"id": 1, "do": "watch", "rows_every_s": -1}', "give seconds, 0 for every tick"),
        (b'{"id": 1, "do": "watch", "frames": 1}', "give true or false"),
        (b'{"id": 1, "do": "clear_fault", "number": 1.5}', "give its number, or null for all"),
    ],
)
def test_a_wrong_request_is_refused(line, text):
    with pytest.raises(RequestError, match=r".") as refusal:
        parse_request(line)
    assert text in str(refusal.value)
    assert len(str(refusal.value)) < 250
    assert str(refusal.value).isprintable()


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)
FIELDS = ["node", "name", "value", "axis", "quantity", "kind", "target", "arguments", "number"]
ACTIONS = ["watch", "begin_fault", "clear_fault", "get_object", "set_object", "set_plant"]


@given(
    st.binary()
    | st.fixed_dictionaries(
        {"id": st.integers(), "do": st.sampled_from(ACTIONS)},
        optional=dict.fromkeys([*FIELDS, "rows_every_s", "frames"], JSON),
    ).map(lambda message: json.dumps(message).encode())
)
def test_whatever_comes_is_a_request_or_refused(line):
    with contextlib.suppress(RequestError):
        request = parse_request(line)
        assert parse_request(encode({"id": request.number, "do": request.action, **request.fields}))


@pytest.mark.parametrize("value", ["1e999", "-1e999", "1" + "0" * 400, '"5"', "true", "null", "[]"])
def test_a_plant_takes_finite_numbers_only(value):
    line = f'{{"id": 9, "do": "set_plant", "axis": "a", "quantity": "b", "value": {value}}}'
    with pytest.raises(RequestError, match="give a number in SI") as refusal:
        parse_request(line.encode())
    assert refusal.value.number == 9


@pytest.mark.parametrize(
    "value", [None, [1], {"hex": "0g"}, {"hex": 5}, {"hex": "00", "x": 1}, {}, {"bytes": "00"}]
)
def test_an_object_takes_no_such_value(value):
    fields = {"do": "set_object", "node": "io", "name": "0x6401.01", "value": value}
    with pytest.raises(RequestError, match=r"value = .*; give a number, a text"):
        parse_request(json.dumps({"id": 1, **fields}).encode())


def test_the_arguments_of_a_fault_are_plain():
    fields = {"do": "begin_fault", "kind": "freeze", "target": "a", "arguments": {"at": [1]}}
    with pytest.raises(RequestError, match="give a table of numbers and texts"):
        parse_request(json.dumps({"id": 1, **fields}).encode())
