"""The fixture `controller`: controllers of any kind on the bench of a test."""

from hil_bench.cli.exit_codes import ExitCode

pytest_plugins = ["pytester"]

FILE = """
import can

def message(number):
    return can.Message(arbitration_id=number, data=[], is_extended_id=False)

def blinks(rig):
    while True:
        rig.bus.send(message(int(rig.parameters.get("id", 0x111))))
        rig.sleep(0.01)

def answers(rig):
    while True:
        if rig.bus.recv(None).arbitration_id == 0x111:
            rig.bus.send(message(0x222))
"""


def test_a_test_puts_controllers_on_its_bench(pytester):
    pytester.makepyfile(mine=FILE)
    pytester.makepyfile(
        """
        import pytest
        from hil_bench import ConfigError

        def test_it(controller, bench):
            lamp = controller("python", call="mine.py:blinks")
            controller("python", call="mine.py:answers")
            bench.run(0.05)
            assert lamp.is_running and not lamp.ending
            lamp.kill()
            bench.run(0.05)
            assert not lamp.is_running
            ids = [each.frame.can_id for each in bench.frames]
            assert ids.count(0x111) == ids.count(0x222) == 5
            lamp.start()
            bench.run(0.001)
            assert bench.frames[-1].frame.can_id == 0x111

        def test_bad(controller):
            with pytest.raises(ConfigError, match="controller.kind: \\"x\\" is no kind"):
                controller("x")
        """
    )
    pytester.runpytest("-p", "no:cacheprovider").assert_outcomes(passed=2)


def test_the_words_on_one_that_never_comes_back_are_not_captured(pytester):
    pytester.makepyfile(
        """
        from hil_bench.abilities.controllers import standstill

        def test_it():
            standstill.leave("it did not come back", lambda: print("bye", flush=True))
        """
    )
    ended = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    assert ended.ret == ExitCode.BUS
    assert ended.errlines == ["hil-bench: error: it did not come back"]
