"""Controllers in Python: a function that waits, a generator, an object, and what goes wrong."""

import os
import re
import sys
import threading
from types import SimpleNamespace

import pytest

from hil_bench import Surroundings, VirtualBench, load_config
from hil_bench.abilities.controllers import standstill
from hil_bench.abilities.controllers.python.kind import KIND, find_call
from hil_bench.errors import ConfigError, ControllerError

FILE = """
import can
import os
import struct
import time

def message(number):
    return can.Message(arbitration_id=number, data=[], is_extended_id=False)

def debugged(rig):
    import io, pdb, person
    pdb.Pdb(stdin=person, stdout=io.StringIO(), readrc=False).set_trace()
    rig.bus.send(message(0x1FF))

def blinks(rig):
    for number in range(3):
        rig.bus.send(message(0x100 + number))
        rig.sleep(0.01)
    rig.bus.send(message(0x1FF))

def starts(rig):
    print("starts the nodes")
    rig.bus.send(can.Message(arbitration_id=0, data=[1, 0], is_extended_id=False))
    rig.sleep(0.005)
    print("has started them")

def boots(rig):
    seen = {rig.bus.recv(0.01).arbitration_id for _ in range(4)}
    rig.bus.send(message(0x100 + len(seen)))
    rig.sleep(1)

class Echo:
    has_begun = True

    def __init__(self, rig):
        self.now = rig.now()

    def advance(self, until, received):
        if until == 5_000_000:
            raise OSError("no memory")
        return ()

    def reset(self): pass
    def tail(self): return ""
    def close(self): pass

def fails(rig):
    rig.sleep(0.25)
    raise RuntimeError("gone\\nwrong")

def unpacks(rig):
    rig.sleep(0.25)
    raise struct.error("no bytes")

def leaves(rig):
    rig.sleep(0.25)
    raise SystemExit("all done")

class Odd(BaseException): pass

def is_odd(rig):
    rig.sleep(0.25)
    raise Odd("no exception")

def never_ends(rig):
    while True:
        try:
            rig.sleep(0.01)
        except:
            pass

def forks(rig):
    if pid := os.fork():
        with open(__file__ + ".pid", "w") as file:
            file.write(str(pid))
    rig.sleep(1)

class Partial:
    has_begun = True
    def __init__(self, rig): pass
    def advance(self, until, received): return ()

class Given(Partial):
    given = ()
    def advance(self, until, received): return self.given
    def reset(self): pass
    def tail(self): return ""
    def close(self): raise OSError("no end")

class Starts(Given):
    has_begun = False

class GivesWords(Given):
    given = ["abc"]

class GivesNumber(Given):
    given = 5

class GivesNothing(Given):
    given = None

def loops(rig):
    rig.sleep(0.002)
    while True:
        pass

def sleeps(rig):
    rig.sleep(0.002)
    time.sleep(1e6)

def goes_on(rig):
    rig.sleep(0.002)
    for _ in range(2):
        try:
            while True:
                pass
        except BaseException:
            pass
    while True:
        pass

def unheard(rig):
    rig.bus.recv(None)

number = 5
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mine.py").write_text(FILE)
    return tmp_path


def make_bench(folder, call, **more):
    table = {"kind": "python", "call": call, "folder": str(folder), **more}
    return VirtualBench(load_config(tables={"controllers": {"mine": table}}))


def identifiers(bench):
    """Return when each frame acted [ms], and its identifier; without the boot-ups."""
    return [(f.now // 1_000_000, f.frame.can_id) for f in bench.frames if f.frame.can_id < 0x700]


def test_a_function_waits_on_its_bus_while_the_bench_goes_on(folder):
    with make_bench(folder, "mine.py:blinks") as bench:
        bench.run(0.1)
        # Sent at 0, 10, 20 and 30 ms; each acts in the tick behind.
        assert identifiers(bench) == [(1, 0x100), (11, 0x101), (21, 0x102), (31, 0x1FF)]


def test_a_controller_hears_the_boot_up_of_the_nodes_that_got_power_with_it(folder):
    with make_bench(folder, "mine.py:boots") as bench:
        bench.run(0.01)
        assert [number for _, number in identifiers(bench)] == [0x104]


def test_what_it_sends_first_meets_nodes_that_have_booted(folder, capsys):
    with make_bench(folder, "mine.py:starts") as bench:
        bench.run(0.01)
        assert [number for _, number in identifiers(bench)][:2] == [0x000, 0x181]  # a TPDO
        assert bench.signals["time"][0] == 0.0
    said = capsys.readouterr()  # results are on standard output, nothing else
    assert (said.out, said.err) == ("", "starts the nodes\nhas started them\n")


def test_who_reads_the_bus_of_the_bench_hears_the_controller_too(folder):
    with make_bench(folder, "mine.py:blinks") as bench:
        heard = []
        while (message := bench.bus.recv(0.05)) is not None:
            heard.append(message.arbitration_id)
        assert {0x100, 0x101, 0x102, 0x1FF} <= set(heard)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ("fails", "RuntimeError: gone wrong"),
        ("Echo", "OSError: no memory"),
        ("unpacks", "struct.error: no bytes"),
        ("leaves", "SystemExit: all done"),  # it does not end the bench with exit code 0
        ("is_odd", "Odd: no exception"),
    ],
)
def test_an_exception_is_a_line_with_its_place(folder, call, words):
    raised = words.replace(": ", '("').split()[0]
    line = next(n for n, text in enumerate(FILE.splitlines(), 1) if f"raise {raised}" in text)
    with make_bench(folder, f"mine.py:{call}") as bench, pytest.raises(ControllerError) as error:
        bench.run(1.0)
    assert str(error.value).endswith(f"mine.py:{line}: {words}")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ("mine.py", 'write it as "axis.py:control"'),
        ("mine.py:nobody", "mine.py: nobody is not there; give a function or a class"),
        ("mine.py:number", "mine.py: number is int; give a function or a class"),
        ("none.py:call", "there is no such file"),
        ("bad.py:call", "bad.py: cannot be imported: SyntaxError"),
        ("over.py:call", "over.py: cannot be imported: SystemExit: 0"),
        ("odd.py:call", "odd.py: cannot be imported: GeneratorExit: "),
        ("lone.py:call", "lone.py: call() does not fit; it is called with the rig, as in"),
        ("no_such_module:call", "no_such_module: cannot be imported: ModuleNotFoundError"),
    ],
)
def test_what_is_no_callable_is_one_line(folder, call, words):
    (folder / "bad.py").write_text("def call(:\n")
    (folder / "over.py").write_text("import sys\nsys.exit(0)\n")
    (folder / "odd.py").write_text("raise GeneratorExit\n")
    (folder / "lone.py").write_text("def call(): pass\n")
    with pytest.raises(ConfigError) as error:
        find_call(call, folder)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ("Partial", "Partial has no reset; a controller's object has advance, reset, tail, close"),
        ("GivesWords", "advance gives 'abc'; a sequence of TimedFrame is right"),
        ("GivesNumber", "advance gives 5; a sequence of TimedFrame is right"),
    ],
)
def test_an_object_that_is_no_controller_is_one_line(folder, call, words):
    with (
        make_bench(folder, f"mine.py:{call}") as bench,
        pytest.raises(ControllerError, match=re.escape(words)),
    ):
        bench.run(0.01)


def test_what_fails_as_it_is_closed_has_nothing_to_say(folder):
    with make_bench(folder, "mine.py:GivesNothing") as bench:
        bench.run(0.01)


def test_an_object_says_whether_it_has_begun(folder):
    for call, has_begun in (("GivesNothing", True), ("Starts", False)):
        surroundings = Surroundings("", "", folder, folder, ("can",), None, {}, 1_000_000)
        controller = KIND.build({"call": f"mine.py:{call}"}, surroundings)
        assert controller.advance(1_000_000, ()) == []
        assert controller.advance(2_000_000, ()) == []
        assert controller.has_begun is has_begun
        controller.close()


def test_one_that_takes_every_exception_for_its_own_does_not_hold_the_bench(folder):
    with make_bench(folder, "mine.py:never_ends") as bench:
        bench.run(0.1)
    assert bench.now() == pytest.approx(0.1)


class Lapsing:
    """Patience that is at its end with the second look at a call."""

    def __init__(self, *_, **__):
        self.looks = 0

    def find_lapse(self):
        self.looks += 1
        return standstill.Lapse.COMPUTES if self.looks > 1 else None


@pytest.mark.parametrize("call", ["loops", "sleeps", "goes_on"])
def test_one_that_never_comes_back_is_a_line_with_its_place(folder, monkeypatch, call):
    monkeypatch.setattr(standstill, "GLANCE", 0.01)
    monkeypatch.setattr(standstill, "GRACE", 0.05)
    monkeypatch.setattr(standstill, "Patience", Lapsing)
    with make_bench(folder, f"mine.py:{call}") as bench, pytest.raises(ControllerError) as error:
        bench.run(1.0)
    assert re.search(
        r"mine\.py:\d+: at 0\.003 s the controller did not come back: it took 60 s of processor "
        r"time; let it return when it has lived until then, or give patience_s above 60 s$",
        str(error.value),
    )


def test_one_that_stands_in_a_debugger_is_left_alone(folder, monkeypatch):
    """Its prompt is answered once the watch has looked a few times."""
    at_prompt, looked, looks, look = threading.Event(), threading.Event(), [], standstill.Guard.look

    class Ended(Lapsing):
        def find_lapse(self):
            return standstill.Lapse.IDLES if at_prompt.is_set() else None

    def count(guard):
        look(guard)
        looks.append(at_prompt.is_set())
        if sum(looks) == 5:
            looked.set()

    def answer():
        at_prompt.set()
        assert looked.wait(60.0)
        at_prompt.clear()
        return "continue\n"

    monkeypatch.setattr(standstill, "GLANCE", 0.01)
    monkeypatch.setattr(standstill, "Patience", Ended)
    monkeypatch.setattr(standstill.Guard, "look", count)
    monkeypatch.setitem(sys.modules, "person", SimpleNamespace(readline=answer))
    with make_bench(folder, "mine.py:debugged") as bench:
        bench.run(0.01)
        assert [number for _, number in identifiers(bench)] == [0x1FF]


def test_a_copy_of_the_bench_that_a_controller_forks_ends(folder):
    with make_bench(folder, "mine.py:forks") as bench:
        bench.run(0.01)
    pid = int((folder / "mine.py.pid").read_text())
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 1


def test_the_same_bench_gives_the_same_frames_twice(folder):
    runs = []
    for _ in range(2):
        with make_bench(folder, "mine.py:blinks") as bench:
            bench.run(0.05)
            runs.append([tuple(each) for each in bench.frames])
    assert runs[0] == runs[1]


def test_the_end_of_a_run_says_nothing_of_drivers_that_lose_their_bus(folder, caplog):
    (folder / "drive.py").write_text(
        "from hil_bench.abilities.controllers.python.examples import ControllerSettings, manual\n"
        "def control(rig):\n    return manual(rig, ControllerSettings())\n"
    )
    with make_bench(folder, "drive.py:control") as bench:
        bench.run(0.5)
        assert bench.nodes["valve"]["0x6041"] & 7 == 7  # enabled: CiA 408, status word
    assert not caplog.records


LATER = """
import can

log = []

def message(number):
    return can.Message(arbitration_id=number, data=[], is_extended_id=False)

def works(rig):
    log.append("set up")
    rig.bus.send(message(0x100 + round(rig.now())))
    seen = {rig.bus.recv(0.01).arbitration_id for _ in range(4)}
    rig.bus.send(message(0x110 + len(seen)))
    log.append("working")
    rig.sleep(1)

def returns(rig):
    rig.bus.send(message(0x1FF))

def fails(rig):
    raise OSError("no model")

class Idle:
    has_begun = True
    log = log

    def __init__(self, rig):
        log.append("made")

    def advance(self, until, received): return ()
    def reset(self): pass
    def tail(self): return ""
    def close(self): pass
"""


def prepared(folder, name):
    """Return a bench with a controller that is prepared as before a paced run, and its log."""
    (folder / "later.py").write_text(LATER)
    bench = make_bench(folder, f"later.py:{name}")
    for prepare in bench.session.preparations:
        prepare()
    desk = bench.session.switches["mine"].args[0]
    call = desk._controller._call
    return bench, getattr(call, "log", None) or call.__globals__["log"]


def test_what_needs_no_time_is_done_before_the_first_tick_of_a_paced_run(tmp_path):
    bench, log = prepared(tmp_path, "works")
    with bench:
        assert log == ["set up"]
        bench.run(0.005)
        assert log == ["set up", "working"]
        frames = identifiers(bench)
    with make_bench(tmp_path, "later.py:works") as other:
        other.run(0.005)
        assert identifiers(other) == frames  # as without preparation
    assert [number for _, number in frames] == [0x100, 0x114]


def test_a_prepared_class_is_made_once(tmp_path):
    bench, log = prepared(tmp_path, "Idle")
    with bench:
        assert log == ["made"]
        bench.run(0.005)
        assert log == ["made"]


def test_a_prepared_function_that_returns_has_ended_with_what_it_sent(tmp_path):
    bench, _ = prepared(tmp_path, "returns")
    with bench:
        bench.run(0.005)
        assert [number for _, number in identifiers(bench)] == [0x1FF]
        assert not bench.session.switches["mine"].args[0].is_running


def test_a_preparation_that_fails_is_said_in_the_first_tick(tmp_path):
    bench, _ = prepared(tmp_path, "fails")
    with bench, pytest.raises(ControllerError, match=r"later.py:\d+: OSError: no model"):
        bench.run(0.005)
