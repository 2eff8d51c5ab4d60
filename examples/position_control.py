"""Moves the cylinder of a bench back and forth over CANopen: a controller as a program of its own.

It needs the drivers only, so it does the same on any bus that python-can opens, in front of the
virtual bench or of a real one:

    python position_control.py -i socketcan -c vcan0
    python position_control.py -i socketcand -c can0 --bus-kwargs host=127.0.0.1 port=29536
    python position_control.py -i socketcan -c can0 --position-eds maker.eds --position-node 5

Exit codes: 0 done, 1 a device failed, 2 usage or a device that is not what its EDS says, 3 the bus
could not be opened or was lost, 130 interrupted.
"""

import argparse
import logging
import math
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import can
from can.cli import add_bus_arguments, create_bus_from_namespace

from device_profiles import ENCODER_406, PRESSURE_404, VALVE_408
from hil_drivers import (
    BusLostError,
    CycleRecord,
    DeviceMismatchError,
    DriverError,
    EdsError,
    MotionProfile,
    Network,
    NmtState,
    PositionLoop,
    PositionSensor,
    PressureSensor,
    ProportionalValve,
)

DONE, FAILED, USAGE, BUS, INTERRUPTED = 0, 1, 2, 3, 130

HEARTBEAT_PERIOD = 0.05


class BusOpenError(Exception):
    """The bus could not be opened; the message says why."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program and return its exit code."""
    parser = build_parser()
    options = parser.parse_args(arguments)
    # python-can logs what we say in one line of our own.
    logging.getLogger("can").setLevel(logging.DEBUG if options.verbose else logging.CRITICAL)
    for number in (signal.SIGINT, signal.SIGTERM):  # a shell starts what is in the background deaf
        signal.signal(number, interrupt)
    try:
        with open_bus(options) as bus, Network(bus) as network:
            control(network, options)
    except KeyboardInterrupt:
        return INTERRUPTED
    except (BusOpenError, BusLostError) as error:
        return report(parser, error, BUS)
    except (argparse.ArgumentError, EdsError, DeviceMismatchError, ValueError) as error:
        return report(parser, error, USAGE)
    except DriverError as error:
        return report(parser, error, FAILED)
    return DONE


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="position_control",
        description=(__doc__ or "").partition("\n")[0],
        epilog=(__doc__ or "").partition("real one:\n")[2],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_bus_arguments(parser)
    motion = parser.add_argument_group("motion")
    motion.add_argument("--duration", type=positive, default=10.0, metavar="S")
    motion.add_argument("--waypoints-mm", type=finite, nargs="+", default=[50.0, -50.0])
    motion.add_argument("--speed-mm-s", type=positive, default=150.0)
    motion.add_argument("--acceleration-mm-s2", type=positive, default=1000.0)
    motion.add_argument("--period-ms", type=positive, default=2.0, help="of the control loop")
    motion.add_argument(
        "--patience-ms",
        type=positive,
        default=100.0,
        help="how long values, and the valve's commands, may stay out; for our heartbeat it is "
        "twice as long (default: 100)",
    )
    devices = parser.add_argument_group("devices")
    for name, node_id, eds in (
        ("valve", 1, VALVE_408),
        ("pressure-a", 2, PRESSURE_404),
        ("pressure-b", 3, PRESSURE_404),
        ("position", 4, ENCODER_406),
    ):
        devices.add_argument(f"--{name}-node", type=int, default=node_id, metavar="ID")
        devices.add_argument(f"--{name}-eds", type=Path, default=eds, metavar="FILE")
    devices.add_argument("--node", type=int, default=127, metavar="ID", help="of this controller")
    parser.add_argument("-v", "--verbose", action="store_true", help="show what python-can logs")
    return parser


def positive(text: str) -> float:
    """Return a positive number.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    value = finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text}: a positive number is right")
    return value


def finite(text: str) -> float:
    """Return a finite number.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text}: a number is right")
    return value


def interrupt(signal_number: int, frame: FrameType | None) -> None:
    """Have SIGTERM end the program as Ctrl-C does, so that the valve is left safe.

    Raises:
        KeyboardInterrupt: always.
    """
    del signal_number, frame
    raise KeyboardInterrupt


def report(parser: argparse.ArgumentParser, error: Exception, code: int) -> int:
    """Say in one line what went wrong, and return the exit code."""
    print(f"{parser.prog}: error: {error}", file=sys.stderr)
    return code


def open_bus(options: argparse.Namespace) -> can.BusABC:
    """Return the bus that the command line or python-can's own configuration names.

    Raises:
        ValueError: they name none, or none that there is.
        BusOpenError: it could not be opened.
    """
    try:
        return create_bus_from_namespace(options)
    except argparse.ArgumentError as error:
        cause = error.__cause__
        reason = f"cannot open the bus: {cause}"
        names_none = isinstance(cause, can.CanInterfaceNotImplementedError | TypeError | ValueError)
        if names_none:
            raise ValueError(f"{reason}; -i and -c name one, as in --help") from error
        raise BusOpenError(reason) from error


def control(network: Network, options: argparse.Namespace) -> None:
    """Set the devices up, and follow the profile until the time is over."""
    with ProportionalValve(network, options.valve_node, options.valve_eds) as valve:
        pressures = (
            PressureSensor(network, options.pressure_a_node, options.pressure_a_eds),
            PressureSensor(network, options.pressure_b_node, options.pressure_b_eds),
        )
        position = PositionSensor(network, options.position_node, options.position_eds)
        patience = options.patience_ms / 1000
        for device in (valve, position, *pressures):
            device.max_age = patience
        network.start_heartbeat(options.node, HEARTBEAT_PERIOD)
        for sensor in (*pressures, position):
            sensor.setup()
        valve.setup(command_timeout=patience, heartbeat_timeout=2 * patience)
        for node_id in network.nodes:
            network.start_node(node_id)
        network.wait_for_state(network.nodes, NmtState.OPERATIONAL, timeout=10 * patience)
        loop = PositionLoop(
            network,
            valve=valve,
            position=position,
            pressures=pressures,
            period=options.period_ms / 1000,
        )
        valve.reset_fault()
        profile = make_profile(loop.sample(), options)
        valve.enable()
        follow(loop, profile, options.duration)


def make_profile(start: float, options: argparse.Namespace) -> MotionProfile:
    """Return the motion that the command line asks for, from where the piston is [m]."""
    return MotionProfile(
        start,
        [waypoint / 1000 for waypoint in options.waypoints_mm],
        speed=options.speed_mm_s / 1000,
        acceleration=options.acceleration_mm_s2 / 1000,
        repeat=True,
    )


def follow(loop: PositionLoop, profile: MotionProfile, duration: float) -> None:
    """Run the loop, with a line each second, and a summary at the end whatever ends it."""
    tracking = TrackingError()
    next_line = 0.0
    try:
        for record in loop.run(profile, duration):
            tracking.add(record.position_setpoint - record.position)
            if record.time >= next_line:
                next_line += 1.0
                print_record(record)
    finally:
        print(
            f"{tracking.cycles} cycles: tracking error RMS {tracking.rms * 1e3:.3f} mm, "
            f"maximum {tracking.largest * 1e3:.3f} mm; "
            f"{loop.overruns} overruns, {loop.missed_samples} missed samples"
        )


@dataclass(slots=True)
class TrackingError:
    """Statistics of the tracking error [m]."""

    cycles: int = 0
    squares: float = 0.0
    largest: float = 0.0

    def add(self, error: float) -> None:
        """Count the error of one cycle [m] in."""
        self.cycles += 1
        self.squares += error * error
        self.largest = max(self.largest, abs(error))

    @property
    def rms(self) -> float:
        """Root mean square [m], 0 before the first cycle."""
        return math.sqrt(self.squares / self.cycles) if self.cycles else 0.0


def print_record(record: CycleRecord) -> None:
    """Print what one cycle saw and did."""
    print(
        f"{record.time:6.1f} s  set-point {record.position_setpoint * 1e3:8.3f} mm  "
        f"position {record.position * 1e3:8.3f} mm  "
        f"P_A {record.pressure_a / 1e5:6.1f} bar  P_B {record.pressure_b / 1e5:6.1f} bar  "
        f"spool {record.spool_position:+7.1%} of {record.spool_setpoint:+7.1%}",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
