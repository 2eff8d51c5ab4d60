import pytest

from hil_bench.outside.realtime.scheduling import CAP_SYS_NICE, format_cpus, has_capability


@pytest.mark.parametrize(
    ("cpus", "text"),
    [({0}, "0"), ({0, 1}, "0-1"), ({3, 0, 1, 2, 6}, "0-3,6"), ({1, 3, 5}, "1,3,5"), (set(), "")],
)
def test_processors_are_written_as_the_kernel_does(cpus, text):
    assert format_cpus(cpus) == text


@pytest.mark.parametrize(
    ("mask", "uid_map", "has_it"),
    [
        # Bit 23 is CAP_SYS_NICE (linux/capability.h).
        ("0000000000800000", "         0          0 4294967295", True),
        ("00000000ff7fffff", "         0          0 4294967295", False),
        ("000001ffffffffff", "         0       1000          1", False),  # a user namespace
    ],
)
def test_a_capability_counts_over_the_whole_machine_only(tmp_path, mask, uid_map, has_it):
    (tmp_path / "status").write_text(f"Name:\tpython\nCapEff:\t{mask}\nCapBnd:\t0\n")
    (tmp_path / "uid_map").write_text(uid_map + "\n")
    assert has_capability(CAP_SYS_NICE, tmp_path) is has_it


def test_where_nobody_tells_there_is_none(tmp_path):
    assert not has_capability(CAP_SYS_NICE, tmp_path)
