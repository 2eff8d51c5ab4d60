"""The example's controller in C on real SocketCAN, tested by its own tests through the plugin."""

from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

EXAMPLE = Path(__file__).parents[2] / "examples" / "firmware"


def run_example(pytester, channel, *options):
    return pytester.runpytest_subprocess(
        EXAMPLE, "-p", "no:cacheprovider", "-rs", f"--hil-firmware-bus={channel}", *options
    )


def test_its_tests_pass_in_lock_step(pytester, channel):
    run_example(pytester, channel).assert_outcomes(passed=10, skipped=1)


@pytest.mark.slow
def test_its_tests_pass_in_real_time(pytester, channel):
    # One busy processor for the test, the bench and the controller: a cycle of 10 ms.
    config = pytester.makefile(".toml", bench="[bench]\nsync_period_us = 10000\n")
    options = "--hil-realtime", f"--hil-config={config}", "-k", "targets or stop or dead"
    run_example(pytester, channel, *options).assert_outcomes(passed=4, deselected=7)
