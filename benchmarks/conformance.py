"""Benchmark of `hil-bench conformance` on two other Python responders, in virtual time.

    pip install '.[benchmark]'
    python benchmarks/conformance.py

`canopen.LocalNode` gets the objects of the tests' device, whose EDS it reads; its heartbeat, a
thread of python-can otherwise, follows the virtual time. `durand` gets some of the objects by hand,
and is judged by the EDS that it writes of itself, with one value mended ("0.0" of an UNSIGNED16).
"""

import argparse
import contextlib
import logging
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import canopen
from durand.datatypes import DatatypeEnum
from durand.node import MinimalNode
from durand.object_dictionary import ObjectDictionary, Variable
from durand.scheduler import VirtualScheduler, set_scheduler

import occasion
from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome, Result, run_suite
from hil_bench.abilities.conformance.wire import Wire
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node
from hil_bench.outside.transports.embedded import EmbeddedBus
from peers import CanopenNetwork, DurandNetwork, Sent

EDS = Path(__file__).parents[1] / "tests" / "unit" / "canopen_device" / "device.eds"
NODE_ID = 5

Tick = Callable[[Sequence[Frame], int], Sequence[Frame]]


def ours() -> tuple[Tick, Path]:
    """Return a node of this project, and its EDS."""
    node = Node(load_eds(EDS, NODE_ID), NODE_ID)
    node.start(0)

    def tick(frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        sent: list[Frame] = []
        for frame in frames:
            node.receive(frame, now)
        node.expire(now)
        node.events.clear()
        node.transmit_pdos(now, sent.append)
        node.serve(now, sent.append)
        return sent

    return tick, EDS


class Task:
    """A frame that is sent periodically, as python-can's tasks do, in virtual time."""

    def __init__(self, can_id: int, data: bytes, period: float) -> None:
        self.frame = Frame(can_id, bytes(data))
        self.period = round(period * 1e9)
        self.due = 0

    def stop(self) -> None:
        """Send no more."""
        self.period = 0

    def update(self, data: bytes) -> None:
        """Send other data from now on."""
        self.frame = self.frame._replace(data=bytes(data))

    def advance(self, now: int) -> Iterator[Frame]:
        """Yield the frame where it is due.

        Yields:
            The frame.
        """
        if self.period and now >= self.due:
            self.due = now + self.period
            yield self.frame


def local_node() -> tuple[Tick, Path]:
    """Return `canopen.LocalNode`, and its EDS."""
    network = CanopenNetwork()
    tasks: list[Task] = []

    def start_task(can_id: int, data: bytes, period: float, _remote: bool = False) -> Task:
        tasks.append(Task(can_id, data, period))
        return tasks[-1]

    network.send_periodic = start_task  # type: ignore[assignment,method-assign]
    canopen.LocalNode(NODE_ID, str(EDS)).associate_network(network)

    def tick(frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        for frame in only_data(frames):
            with contextlib.suppress(Exception):  # its listener logs what a frame raises
                network.notify(frame.can_id, bytearray(frame.data), now * 1e-9)
        return [*taken(network.sent), *(frame for task in tasks for frame in task.advance(now))]

    return tick, EDS


def durand_node() -> tuple[Tick, Path]:
    """Return `durand.MinimalNode`, and the EDS that it writes."""
    scheduler = VirtualScheduler()
    set_scheduler(scheduler)
    network, objects = DurandNetwork(), ObjectDictionary()
    objects[0x2000] = Variable(DatatypeEnum.UNSIGNED16, "rw", 0, name="Command")
    objects[0x2001] = Variable(
        DatatypeEnum.INTEGER16, "rw", 0, minimum=-1000, maximum=1000, name="Set-point"
    )
    objects[0x2010] = Variable(DatatypeEnum.UNSIGNED16, "ro", 0, name="Status")
    objects[0x2011] = Variable(DatatypeEnum.INTEGER16, "ro", 0, name="Actual value")
    objects[0x2020] = Variable(DatatypeEnum.VISIBLE_STRING, "rw", b"some text", name="Text")
    objects[0x2022] = Variable(DatatypeEnum.UNSIGNED32, "wo", 0, name="Key")
    node = MinimalNode(network, NODE_ID, objects)
    node.rpdo[0].mapping = [(0x2000, 0), (0x2001, 0)]
    node.tpdo[0].mapping = [(0x2010, 0), (0x2011, 0)]
    eds = Path(tempfile.mkdtemp()) / "durand.eds"
    text = node.eds.content.replace("=0.0", "=0").replace("DefaultValue=b'some text'", "")
    eds.write_text(text, encoding="utf-8")

    def tick(frames: Sequence[Frame], _now: int) -> Sequence[Frame]:
        for frame in only_data(frames):
            with contextlib.suppress(Exception):  # as its own listener does
                network.notify(frame.can_id, frame.data)
        scheduler.run(0.001)
        return taken(network.sent)

    return tick, eds


def only_data(frames: Sequence[Frame]) -> Iterator[Frame]:
    """Yield what the libraries hand to a node: neither remote nor 29-bit frames, nor empty ones.

    Yields:
        The others.
    """
    for frame in frames:
        is_sync = frame.can_id == 0x080
        if not frame.is_remote and not frame.is_extended and (frame.data or is_sync):
            yield frame


def taken(sent: Sent) -> list[Frame]:
    """Return the frames sent, and clear them."""
    frames = [Frame(can_id, bytes(data)) for can_id, data in sent]
    sent.clear()
    return frames


def results_of(device: tuple[Tick, Path]) -> list[Result]:
    """Return the results of the whole suite for a device."""
    tick, eds = device
    with EmbeddedBus(tick) as bus:
        bus.advance(0.01)
        dut = DeviceUnderTest(Wire(bus, bus.now), NODE_ID, load_eds(eds, NODE_ID))
        return list(run_suite(dut, Impact.STORE))


def main() -> None:
    """Print the outcomes by subject as a Markdown table."""
    occasion.arguments(argparse.ArgumentParser(description=__doc__.partition("\n")[0]))
    logging.disable(logging.CRITICAL)
    names = "here", "`canopen.LocalNode`", "`durand`"
    found = [results_of(make()) for make in (ours, local_node, durand_node)]
    print(f"| {' / '.join(Outcome)} | {' | '.join(names)} |\n|---|---|---|---|")
    for title in (*[chapter.title for chapter in CHAPTERS], "**all**"):
        cells = []
        for results in found:
            counts = Counter(r.outcome for r in results if title in {r.chapter, "**all**"})
            cells.append(" / ".join(str(counts[outcome]) for outcome in Outcome))
        print(f"| {title} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
