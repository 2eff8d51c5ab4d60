"""Processor time of a tick without and with a bus like copper, in turns in one run.

python benchmarks/wire.py
"""

import argparse
import statistics
import time

import occasion
from hil_bench.abilities.copper.extension import Copper
from hil_bench.bench.configuration import load_config
from hil_bench.bench.session import Session, open_session
from hil_bench.canopen_device.frame import Frame

TICK = 1_000_000
BLOCK = 400
BLOCKS = 15
CYCLE = 10  # ticks between two SYNCs
BENCHES = ((None, 125_000), (None, 1_000_000), ("examples/sixteen_axes.toml", 1_000_000))


class Running:
    """A bench whose nodes are OPERATIONAL."""

    def __init__(self, path: str | None, bitrate: int, *, is_wired: bool) -> None:
        bus = {"bitrate": bitrate} | ({"wire": {}} if is_wired else {})
        self.session: Session = open_session(load_config(path, tables={"bus": bus}))
        self.session.start()
        self.ticks = 0
        for number in range(30):
            self.tick([Frame(0, b"\1\0")] if number == 20 else [])

    def tick(self, frames: list[Frame]) -> None:
        """Move on by one tick."""
        self.ticks += 1
        self.session.tick(frames, self.ticks * TICK)

    def block(self) -> float:
        """Return the processor time of a tick [us]."""
        begin = time.process_time()
        for number in range(BLOCK):
            self.tick([] if number % CYCLE else [Frame(0x80)])
        return (time.process_time() - begin) / BLOCK * 1e6


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--blocks", type=int, default=BLOCKS, help=f"of {BLOCK} ticks each")
    blocks = occasion.arguments(parser, blocks=1).blocks
    for path, bitrate in BENCHES:
        benches = [Running(path, bitrate, is_wired=is_wired) for is_wired in (False, True)]
        times = [[bench.block() for bench in benches] for _ in range(blocks)]
        off, on = map(statistics.median, zip(*times, strict=True))
        wiring = benches[1].session.bench.part(Copper).wiring
        passed = wiring.buses[0].wire.passed if wiring else 0
        frames = passed / benches[1].ticks
        print(
            f"{path or 'one axis'} {bitrate} bit/s: {frames:.1f} frames a tick, "
            f"off {off:.1f} us, on {on:.1f} us, {(on - off) / frames:.0f} us a frame"
        )


if __name__ == "__main__":
    main()
