"""Frames a second that the reader of frames takes, and how often `explain` is right.

    python benchmarks/eyes.py [--seconds S] [--repeats N] [--frames N] [--half kept-apart|written]
                              [--series j1939]

First the logs of `tests/corpus`: those that were kept apart while `explain` was written, or the
others; with `--series j1939` those of J1939, which have faults and sound variants of their own.
Then memory for many frames, and rates for `monitor`, `decode` and `explain`.

The frames are a run of the built-in bench: TPDOs every 10 ms, set-points, heartbeats, the set-up by
SDO. Processor time, the fastest round. The peer in the same run is `cantools`, which decodes the
PDOs among them by the DBC file that `decode --write-dbc` writes; it gives values, and no text.
"""

import argparse
import io
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import cast

import can
import cantools

import occasion
from eyes_corpus import judge, memory_growth, print_judgement, reader_rate
from hil_bench.abilities.eyes.dbc import write_dbc
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.abilities.eyes.known_node import nodes_of
from hil_bench.abilities.eyes.listener import Listener
from hil_bench.abilities.eyes.verbs.sight_lines import SightLines
from hil_bench.abilities.recording.frames import message_of, open_frame_file
from hil_bench.bench.configuration import load_config
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.cli import build_parser
from hil_bench.cli import main as hil_bench
from hil_bench.cli.parser import own_verbs
from hil_bench.outside.recording.channels import LoggedFrame
from hil_drivers import Network, PositionSensor, PressureSensor, ProportionalValve

BITRATE = 1_000_000


def recorded(seconds: float) -> list[LoggedFrame]:
    """Return the frames of a controller at work."""
    with (
        VirtualBench(logged_frames=10_000_000) as bench,
        Network(bench.bus, clock=bench.now) as network,
    ):
        network.pump(0.05)
        valve = ProportionalValve(network, node_id=1)
        sensors = (
            PressureSensor(network, node_id=2),
            PressureSensor(network, node_id=3),
            PositionSensor(network, node_id=4),
        )
        for device in (valve, *sensors):
            device.setup(transmission_type=254, event_timer=0.01)
            network.start_node(device.node.id)
        valve.enable()
        for number in range(round(seconds * 100)):
            valve.spool_setpoint = 0.3 if number // 100 % 2 else -0.3
            network.pump(0.01)
        return list(bench.frames)


def rate(work: Callable[[], object], frames: int, repeats: int) -> float:
    """Return frames a second of processor time, of the fastest round."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return frames / min(times)


def decode(frames: Sequence[LoggedFrame], *, known: bool, text: bool) -> None:
    """Read all frames, with or without making their lines."""
    decoder = Decoder(nodes_of(load_config()) if known else [])
    for logged in frames:
        for sight in decoder.take(logged):
            if text:
                _ = sight.text


class _Messages:
    """A bus that has all its messages at hand."""

    def __init__(self, messages: Sequence[can.Message]) -> None:
        self._next = iter(messages).__next__

    def recv(self, _timeout: float) -> can.Message:
        """Return the next message."""
        return self._next()


def listen(messages: Sequence[can.Message]) -> None:
    """Take messages as python-can has them, and make their lines."""
    arguments = build_parser(["monitor"], own_verbs()).parse_args(["monitor"])
    lines, decoder = SightLines(arguments), Decoder(nodes_of(load_config()))
    listener = Listener(cast("can.BusABC", _Messages(messages)), "messages")
    for _ in messages:
        logged = listener.hear(0.0)
        for sight in decoder.take(logged) if logged else ():
            lines.of(sight)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--frames", type=int, default=1_000_000, help="for the memory")
    parser.add_argument("--half", choices=["kept-apart", "written"], default="kept-apart")
    parser.add_argument("--series", choices=["", "j1939"], default="", help="of the corpus")
    parser.add_argument("--logs", type=int, help="sound logs at most")
    args = occasion.arguments(parser, seconds=1.0, repeats=1, frames=2000, logs=2, half="written")
    found = judge(kept_apart=args.half == "kept-apart", most=args.logs, series=args.series)
    print_judgement(found, f"{args.half} half")
    frames = recorded(args.seconds)
    count = len(frames)
    print(f"{count} frames")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with open_frame_file(folder / "t.log") as file:
            file.write_frames(frames)
        decoder = Decoder(nodes_of(load_config()))
        write_dbc(folder / "t.dbc", decoder)
        database = cantools.database.load_file(folder / "t.dbc")
        ids = {message.frame_id for message in database.messages}
        pdos = [logged.frame for logged in frames if logged.frame.can_id in ids]

        def peer() -> None:
            for frame in pdos:
                database.decode_message(frame.can_id, frame.data)

        def verb(*words: str) -> Callable[[], object]:
            def call() -> None:
                with redirect_stdout(io.StringIO()):
                    hil_bench([*words])

            return call

        messages = [message_of(logged) for logged in frames]
        config = folder / "bench.toml"
        config.write_text("")
        log = str(folder / "t.log")
        ours = [logged for logged in frames if logged.frame.can_id in ids]
        rounds = max(args.frames // count, 1)
        once, often, peer_memory = memory_growth(frames, folder / "t.log", rounds)
        print(f"memory, explain: {once:.2f} MB for {count} frames, {often:.2f} MB for ", end="")
        print(f"{rounds * count}; python-can's reader alone {peer_memory:.2f} MB")
        print(f"{'python-can reader alone':28} {reader_rate(folder / 't.log'):10.0f} frames/s")
        for what, work, number in (
            ("read, with bench.toml", lambda: decode(frames, known=True, text=False), count),
            ("read, nothing known", lambda: decode(frames, known=False, text=False), count),
            ("read and text", lambda: decode(frames, known=True, text=True), count),
            ("PDOs alone, read", lambda: decode(ours, known=True, text=False), len(ours)),
            ("PDOs alone, cantools", peer, len(pdos)),
            ("explain", lambda: explain(frames, nodes_of(load_config()), BITRATE), count),
            ("what monitor does a frame", lambda: listen(messages), count),
            ("hil-bench decode, whole", verb("decode", log, str(config)), count),
            ("hil-bench decode --json", verb("decode", log, str(config), "--json"), count),
            ("hil-bench explain, whole", verb("explain", log, str(config)), count),
        ):
            print(f"{what:28} {rate(work, number, args.repeats):10.0f} frames/s")


if __name__ == "__main__":
    main()
