import gc

import pytest

from hil_bench import cli
from hil_bench.cli.exit_codes import collection_put_off


def test_nothing_is_collected_within_the_block_and_all_is_as_before_after_it():
    def fail():
        with collection_put_off():
            assert not gc.isenabled()
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert gc.isenabled()


def test_who_has_switched_it_off_finds_it_off():
    gc.disable()
    try:
        with collection_put_off():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_a_verb_runs_with_it(monkeypatch):
    seen = []
    monkeypatch.setattr(
        "hil_bench.cli._set_up_logging", lambda *_, **__: seen.append(gc.isenabled())
    )
    cli.main(["devices"])
    assert seen == [True]


@pytest.mark.parametrize(("argv", "frozen"), [(None, True), (["devices"], False)])
def test_only_a_process_of_its_own_leaves_what_was_imported_out_of_later_collections(
    monkeypatch, argv, frozen
):
    monkeypatch.setattr("sys.argv", ["hil-bench", "devices"])
    before = gc.get_freeze_count()
    try:
        cli.main(argv)
        assert (gc.get_freeze_count() > before) == frozen
    finally:
        gc.unfreeze()
