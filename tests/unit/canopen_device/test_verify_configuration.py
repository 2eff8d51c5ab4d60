"""0x1020: what a master wrote of its configuration, until something changes (CiA 301)."""

from pathlib import Path

import pytest
from support.eds_sections import VERIFY_CONFIGURATION

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.node import Node

PLAIN = Path(__file__).parent / "device.eds"


@pytest.fixture
def objects(make_file):
    text = PLAIN.read_text(encoding="utf-8")
    text = text.replace("SupportedObjects=29\n", "SupportedObjects=30\n30=0x1020\n", 1)
    path = make_file("device.eds", text + VERIFY_CONFIGURATION)
    dictionary = load_eds(path, 5)
    Node(dictionary, 5)
    for subindex, value in ((1, 15000), (2, 3_600_000)):
        dictionary.download(0x1020, subindex, value.to_bytes(4, "little"))
    return dictionary


def stamps(objects):
    return [objects.number(0x1020, subindex) for subindex in (1, 2)]


def test_it_keeps_what_the_master_wrote(objects):
    assert stamps(objects) == [15000, 3_600_000]


def test_a_changed_parameter_clears_both(objects):
    objects.download(0x1017, 0, b"\x64\x00")
    assert stamps(objects) == [0, 0]


def test_to_clear_the_history_of_errors_changes_no_configuration(objects):
    objects.download(0x1003, 0, b"\x00")
    assert stamps(objects) == [15000, 3_600_000]


def test_a_device_without_it_watches_nothing():
    dictionary = load_eds(PLAIN, 5)
    Node(dictionary, 5)
    assert 0x1020 not in dictionary
