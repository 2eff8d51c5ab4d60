"""`hil-bench commission --lockstep`: our SYNC moves the bench on the bus."""

import argparse
import contextlib
from collections.abc import Iterator

from hil_bench.abilities.common.controller_side import OpenNetwork
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.errors import ConfigError
from hil_bench.outside.transports.opening import open_transport
from hil_drivers import Network

EXAMPLES = {
    "commission": """\
  hil-bench commission plan.toml -i socketcan -c vcan0 --lockstep --yes       beside
                                                       'hil-bench run other.toml ... --lockstep'
"""
}


def add_options(parser: argparse.ArgumentParser, _: "argparse._ActionsContainer") -> None:
    """Add what says that the bench on the bus is in lock-step."""
    parser.add_argument(
        "--lockstep",
        action="store_true",
        help="the bench on the bus runs with --lockstep: our SYNC lets its time pass",
    )
    parser.add_argument(
        "--sync-period-us",
        type=int,
        metavar="US",
        help="with --lockstep: the period that the bench was given",
    )


def check_options(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if args.lockstep and args.virtual:
        raise ConfigError("--lockstep: --virtual has virtual time already; give one of both")
    if args.sync_period_us is not None and not args.lockstep:
        raise ConfigError("--sync-period-us: belongs to --lockstep; give both")
    if args.lockstep and (args.on or FIRST_BUS) != FIRST_BUS:
        right = "in lock-step SYNC on [bus] lets time pass; leave --on out"
        raise ConfigError(f"--on {args.on}: {right}")


def open_network(
    args: argparse.Namespace, config: BenchConfig
) -> contextlib.AbstractContextManager[OpenNetwork] | None:
    """Open the bus of a configuration whose bench our SYNC moves; None where it does not."""
    return _open(config) if getattr(args, "lockstep", False) else None


@contextlib.contextmanager
def _open(config: BenchConfig) -> Iterator[OpenNetwork]:
    from hil_bench.abilities.lockstep.controller import (  # noqa: PLC0415 - half of a start
        LockStepController,
    )
    from hil_bench.outside.transports.embedded import EmbeddedBus  # noqa: PLC0415

    transport = open_transport(*config.bus.address)
    with contextlib.closing(transport):
        producer = LockStepController(transport, [node.node_id for node in config.nodes])
        producer.join()
        description = f"{transport.description} in lock-step"
        with (
            EmbeddedBus(producer.tick, config.sync_period_ns, description=description) as stepped,
            Network(stepped, clock=stepped.now) as network,
        ):
            yield OpenNetwork(network, description, None, is_stepped=True)
