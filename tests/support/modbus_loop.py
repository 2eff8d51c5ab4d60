"""A bench behind a Modbus server of its own, and the loop that feeds it."""

import contextlib
import threading

from support.bus_side import BusSide

from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.bench.configuration import load_config


def make_binding(tmp_path, port=0, extra=""):
    path = tmp_path / "bench.toml"
    path.write_text(f"[modbus]\nport = {port}\n{extra}\n")
    config = load_config(path)
    side = BusSide(config)
    return side, ModbusBinding(config, side.bench)


@contextlib.contextmanager
def ticking(side, binding):
    """A loop beside the test, as fast as it can."""
    ended = threading.Event()

    def tick():
        side.tick()
        binding.exchange(side.now)

    def loop():
        while not ended.wait(0.0005):
            tick()

    tick()  # so that there are values from the first request on
    thread = threading.Thread(target=loop)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
