"""Which values of a cyclic master's block are commands."""

import pytest

from hil_bench.abilities.modbus.protocol.register_map import Assignment
from hil_bench.abilities.modbus.protocol.unit_image import ClientMemory

ENABLE, WORD, OTHER, FLOAT, SCALED = range(5)
RIVALS = {ENABLE: ENABLE, WORD: ENABLE, FLOAT: FLOAT, SCALED: FLOAT}


class Client:
    def __init__(self):
        self._memory = ClientMemory()

    def write(self, **values):
        """Write some values by one request; returns which of them are meant."""
        names = {"enable": ENABLE, "word": WORD, "other": OTHER, "float": FLOAT, "scaled": SCALED}
        assignments = [Assignment(names[name], value) for name, value in values.items()]
        meant = self._memory.choose(assignments, RIVALS)
        known = {position: name for name, position in names.items()}
        return [known[assignment.position] for assignment in meant]


@pytest.fixture
def client():
    return Client()


def test_what_has_no_rival_is_always_meant(client):
    for _ in range(3):
        assert client.write(other=0.0) == ["other"]
        assert client.write(other=1.0, word=0.0) == ["other", "word"]


def test_a_value_that_stays_as_it_was_leaves_its_rival_in_charge(client):
    for _ in range(3):
        assert client.write(enable=1.0, other=0.0) == ["enable", "other"]
        assert client.write(word=0.0, other=0.0) == ["other"]


def test_the_one_that_changes_takes_charge_and_the_other_one_back(client):
    client.write(enable=1.0, other=0.0)
    assert client.write(word=7.0, other=0.0) == ["word", "other"]
    assert client.write(enable=1.0, other=0.0) == ["other"]
    assert client.write(enable=0.0, other=0.0) == ["enable", "other"]
    assert client.write(word=7.0, other=0.0) == ["other"]


def test_before_anything_has_changed_all_are_meant(client):
    for _ in range(2):
        assert client.write(float=0.0, scaled=0.0) == ["float", "scaled"]


def test_rivals_in_one_block(client):
    for _ in range(2):
        assert client.write(float=0.0, scaled=0.5)[-1] == "scaled"
        assert "float" not in client.write(float=0.0, scaled=0.5)
    assert client.write(float=0.25, scaled=0.5) == ["float"]
    assert client.write(float=0.25, scaled=0.5) == ["float"]


def test_a_value_that_is_written_alone_is_meant(client):
    client.write(enable=1.0, other=0.0)
    assert client.write(word=0.0) == ["word"]
    assert client.write(enable=1.0) == ["enable"]


def test_groups_do_not_meet(client):
    client.write(enable=1.0, other=0.0)
    assert client.write(float=0.0, scaled=0.0) == ["float", "scaled"]


def test_another_client_has_a_memory_of_its_own(client):
    client.write(enable=1.0, other=0.0)
    assert Client().write(word=0.0, other=0.0) == ["word", "other"]
