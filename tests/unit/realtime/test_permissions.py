import pytest

from hil_bench.realtime.permissions import format_cpus


@pytest.mark.parametrize(
    ("cpus", "text"),
    [({0}, "0"), ({0, 1}, "0-1"), ({3, 0, 1, 2, 6}, "0-3,6"), ({1, 3, 5}, "1,3,5"), (set(), "")],
)
def test_processors_are_written_as_the_kernel_does(cpus, text):
    assert format_cpus(cpus) == text
