import gc

import pytest

from hil_bench.realtime.scheduling import undisturbed_by_garbage_collection


@pytest.fixture(autouse=True)
def _collector_as_before():
    was_enabled = gc.isenabled()
    yield
    if was_enabled:
        gc.enable()
    else:
        gc.disable()


def test_the_collector_is_off_inside_and_on_again_after():
    gc.enable()
    with undisturbed_by_garbage_collection():
        assert not gc.isenabled()
        assert gc.get_freeze_count() > 0
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_a_collector_that_was_off_stays_off():
    gc.disable()
    with undisturbed_by_garbage_collection():
        pass
    assert not gc.isenabled()


def test_the_collector_is_on_again_after_an_error():
    gc.enable()
    with pytest.raises(KeyError), undisturbed_by_garbage_collection():
        raise KeyError
    assert gc.isenabled()
