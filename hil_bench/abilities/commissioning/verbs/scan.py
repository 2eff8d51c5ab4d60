"""`hil-bench scan`: who is on a bus."""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict

from hil_bench.abilities.commissioning.discovery import (
    NODE_IDS,
    BusTraffic,
    Method,
    Traffic,
    listen,
)
from hil_bench.abilities.commissioning.identity import NodeDescription
from hil_bench.abilities.commissioning.survey import LssAddress, LssScan, Survey, survey
from hil_bench.abilities.common.arguments import add_network_arguments
from hil_bench.abilities.common.controller_side import OpenNetwork, open_network
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.cli.arguments import add_bench_arguments, load_bench_config
from hil_bench.cli.exit_codes import ExitCode, verdict_code
from hil_bench.cli.results import add_json_argument, print_lines
from hil_bench.errors import ConfigError

_EXAMPLES = """\
examples:
  hil-bench scan -i socketcan -c can0
  hil-bench scan -i socketcan -c can0 -b 500000     with the bus load in percent
  hil-bench scan -i socketcan -c can0 --lss         also devices that have no node-ID yet
  hil-bench scan -i socketcan -c can0 --ask         also where the bus is in operation
  hil-bench scan -i socketcan -c can0 --listen 5    send nothing, say what is heard in 5 s
  hil-bench scan --virtual bench.toml               the virtual bench, no bus needed
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "scan",
        description="Find the nodes of a CANopen bus, and print identity and state of each. One\n"
        "without heartbeat is asked for its state by node guarding, where that begins nothing.\n"
        "The scan listens first: to a bus in operation it sends nothing without --ask.\n"
        "Nothing is written to any node, and no node changes its state, but with --by boot-up,\n"
        "and with --by guarding where life guarding is set.",
        epilog=_EXAMPLES,
    )
    add_bench_arguments(parser)
    add_network_arguments(parser)
    parser.add_argument(
        "--by",
        choices=[method.value for method in Method],
        default=Method.SDO.value,
        help="how a node shows itself: by its answer to an SDO read or to node guarding (a device "
        "with 0x100C and 0x100D set then waits for more, and reports an error), by a heartbeat "
        "that it sends anyway, or by its boot-up message, for which the communication of all nodes "
        "is reset: motion stops (default: %(default)s)",
    )
    parser.add_argument(
        "--nodes",
        type=_node_ids,
        default=NODE_IDS,
        metavar="A-B",
        help="range of node-IDs (default: 1-127)",
    )
    parser.add_argument(
        "--patience",
        type=float,
        default=1.0,
        metavar="S",
        help="listen S seconds first, and wait as long for answers; with --lss, also for the one "
        "to each step (default: 1)",
    )
    parser.add_argument(
        "--lss", action="store_true", help="also find devices without node-ID (fastscan)"
    )
    parser.add_argument(
        "--ask", action="store_true", help="ask the nodes of a bus that is in operation, too"
    )
    parser.add_argument(
        "--listen", type=float, metavar="S", help="send nothing; print what is heard in S seconds"
    )
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Scan a bus, or listen to it.

    Raises:
        ConfigError: the time to listen makes no sense, or the bus has no remote frames to guard by.
    """
    if args.listen is not None and not 0.0 < args.listen < float("inf"):
        raise ConfigError(f"--listen {args.listen:g}: give a positive number of seconds")
    config = load_bench_config(args)
    with open_network(args, config) as opened, shown_work(args, Work("scan")):
        if args.listen is not None:
            traffic = listen(opened.network, args.listen)
            if args.json:
                print(_traffic_json(traffic))
            else:
                print_lines(args, _traffic_text(traffic, opened, args))
            return verdict_code(fails=False, passes=bool(traffic.frames))
        method = Method(args.by)
        if method is Method.GUARDING and not getattr(opened.network.bus, "carries_remote", True):
            raise ConfigError("--by guarding: this bus has no remote frames; give another --by")
        found = survey(
            opened.network,
            method,
            node_ids=args.nodes,
            patience=args.patience,
            lss=args.lss,
            insists=args.ask,
        )
        if args.json:
            print(_survey_json(found))
        else:
            print_lines(args, _survey_text(found, opened, args))
    if found.operation:
        return ExitCode.INCONCLUSIVE
    has_clash = any(node.clash for node in found.nodes)
    has_found = found.nodes or (found.unconfigured and found.unconfigured.devices)
    has_doubts = found.doubtful or (found.unconfigured and found.unconfigured.problem)
    return verdict_code(fails=has_clash, passes=bool(has_found) and not has_doubts)


def _node_ids(text: str) -> range:
    """Return the node-IDs of "5" or "1-16".

    Raises:
        argparse.ArgumentTypeError: it is neither.
    """
    first, _, last = text.partition("-")
    try:
        node_ids = range(int(first), int(last or first) + 1)
    except ValueError:
        node_ids = range(0)
    if not node_ids or node_ids[0] not in NODE_IDS or node_ids[-1] not in NODE_IDS:
        raise argparse.ArgumentTypeError(f"{text!r}: give 5 or 1-16, from 1 to 127")
    return node_ids


def _survey_text(found: Survey, opened: OpenNetwork, args: argparse.Namespace) -> str:
    lines = [f"bus    {opened.description}", f"load   {_load(found.traffic, args)}", ""]
    lines += _table(found.nodes)
    for node in found.nodes:
        lines += _node_lines(node)
    if found.unconfigured is not None:
        lines += _unconfigured_lines(found.unconfigured)
    if found.operation:
        return "\n".join([*lines, *_withheld_lines(found, args)])
    count = len(found.nodes)
    twice = ", ".join(str(node.node_id) for node in found.nodes if node.clash)
    more = f"; twice on the bus: {twice}" if twice else ""
    if found.doubtful:
        more += f"; perhaps twice on the bus: {', '.join(map(str, found.doubtful))}"
    lines.append(f"{count} node{'' if count == 1 else 's'} found{more}")
    if not count and not (found.unconfigured and any(found.unconfigured)):
        lines[-1] += f": {_advice(found.traffic)}"
    return "\n".join(lines)


def _advice(traffic: BusTraffic) -> str:
    """Return the advice for a bus on which no node was found."""
    if traffic.extended:
        return (
            f"{traffic.extended} frames with 29-bit identifiers were heard, as J1939 has them; "
            "`hil-bench monitor` reads them"
        )
    return (
        "is the bus powered and terminated, and the bit rate right? "
        "--listen 5 shows whether anything is heard at all"
    )


def _withheld_lines(found: Survey, args: argparse.Namespace) -> Iterator[str]:
    """Yield why nothing was sent, and what would be."""
    first, last = args.nodes[0], args.nodes[-1]
    requests = {
        Method.SDO: "a read of 0x1000 to each of the",
        Method.GUARDING: "a remote frame to each of the",
        Method.BOOT_UP: "reset communication to all nodes, which stops them; then asks the",
        Method.HEARTBEAT: "nothing to find the",
    }
    count = len(found.nodes)
    yield f"the bus is in operation: {', '.join(found.operation)}"
    yield (
        f"nothing was sent; {count} node{'' if count == 1 else 's'} heard, others may be silent. "
        "--ask would send:"
    )
    yield f"  {requests[Method(args.by)]} node-IDs {first} to {last}"
    yield "  some 15 reads to each node found (identity, name, versions, errors, heartbeat time),"
    yield "  on the channel that the master uses, too: a transfer of its own can break"
    yield "  one remote frame to each node without heartbeat, unless that begins life guarding"
    if args.lss:
        yield "  LSS fastscan, 129 requests for each device without node-ID"


def _table(nodes: Sequence[NodeDescription]) -> list[str]:
    """Return a line a node, and an empty one behind them; nothing for no nodes."""
    if not nodes:
        return []
    rows = [("node", "NMT state", "profile", "revision", "errors", "name")]
    for node in nodes:
        register = node.error_register
        rows.append(
            (
                str(node.node_id),
                (node.nmt_state or "not reported").replace("_", "-"),
                node.profile or "not reported",
                _hex(node.revision_number),
                "-" if register is None else f"0x{register:02X}",
                "twice on the bus" if node.clash else node.device_name or "-",
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in rows
    ]
    return [*(line.rstrip() for line in lines), ""]


def _node_lines(node: NodeDescription) -> Iterator[str]:
    yield f"node {node.node_id}"
    if node.clash:
        yield "  clash     more than one device answers under this node-ID"
    if node.device_type is not None:
        yield f"  type      0x{node.device_type:08X}, {node.profile}"
    if node.vendor_id is not None:
        yield (
            f"  identity  vendor 0x{node.vendor_id:08X}, product {_hex(node.product_code)}, "
            f"revision {_hex(node.revision_number)}, serial {_hex(node.serial_number)}"
        )
    if node.hardware_version is not None or node.software_version is not None:
        yield (
            f"  versions  hardware {node.hardware_version or '-'}, "
            f"software {node.software_version or '-'}"
        )
    if node.heartbeat_ms is not None:
        period = f"every {node.heartbeat_ms} ms" if node.heartbeat_ms else "off"
        yield f"  heartbeat {period}"
    if node.error_register is not None:
        codes = node.error_history
        listed = ", ".join(f"0x{code:08X}" for code in codes or ()) or "none"
        history = "not reported" if codes is None else listed
        yield f"  errors    register 0x{node.error_register:02X}, history {history}"
    if node.problem:
        yield f"  problem   {node.problem}"
    yield ""


def _hex(number: int | None) -> str:
    return "-" if number is None else f"0x{number:08X}"


def _unconfigured_lines(scan: LssScan) -> list[str]:
    lines = [_unconfigured_line(address) for address in scan.devices]
    if scan.problem:
        lines.append(scan.problem)
    return lines or ["no device without node-ID"]


def _unconfigured_line(address: LssAddress) -> str:
    vendor, product, revision, serial = map(_hex, address)
    return f"no node-ID  vendor {vendor}, product {product}, revision {revision}, serial {serial}"


def _traffic_text(traffic: BusTraffic, opened: OpenNetwork, args: argparse.Namespace) -> str:
    lines = [
        f"bus    {opened.description}",
        f"load   {_load(traffic, args)}",
        (
            f"heard  {traffic.frames} frames, {traffic.error_frames} error frames "
            + (f"and {traffic.fd_frames} of CAN FD " if traffic.fd_frames else "")
            + f"in {traffic.duration:.1f} s"
        ),
        "",
    ]
    lines += [
        _identifier_line(row, traffic.duration)
        for _, row in sorted(traffic.identifiers.items(), key=lambda item: item[0][::-1])
    ]
    if not traffic.frames:
        lines.append("nothing: is the bus powered and terminated, and the bit rate right?")
    return "\n".join(lines)


def _identifier_line(row: Traffic, duration: float) -> str:
    width = 8 if row.is_extended else 3
    node = f"node {row.node_id}" if row.node_id else ""
    data = "remote" if row.is_remote else row.data.hex(" ").upper()
    line = (
        f"0x{row.can_id:0{width}X}  {row.function:11}  {node:8}  {row.frames:7}  "
        f"{row.frames / duration:8.1f}/s  {data:23}  {row.meaning}"
    )
    return line.rstrip()


def _load(traffic: BusTraffic, args: argparse.Namespace) -> str:
    per_second = traffic.bits / traffic.duration if traffic.duration > 0.0 else 0.0
    bitrate = getattr(args, "bitrate", None)
    if not bitrate:
        return f"{per_second / 1000.0:.1f} kbit/s; -b gives the bit rate for a share of it"
    return f"{100.0 * traffic.load(bitrate):.1f} % of {bitrate / 1000.0:g} kbit/s"


def _survey_json(found: Survey) -> str:
    unconfigured = found.unconfigured
    return json.dumps(
        {
            "nodes": [{**asdict(node), "profile": node.profile} for node in found.nodes],
            "unconfigured": unconfigured and [each._asdict() for each in unconfigured.devices],
            "unconfigured_problem": unconfigured and unconfigured.problem,
            "operation": list(found.operation),
            "frames": found.traffic.frames,
            "bits": found.traffic.bits,
            "duration": found.traffic.duration,
        },
        indent=2,
    )


def _traffic_json(traffic: BusTraffic) -> str:
    return json.dumps(
        {
            "duration": traffic.duration,
            "bits": traffic.bits,
            "error_frames": traffic.error_frames,
            "fd_frames": traffic.fd_frames,
            "identifiers": [
                {
                    "can_id": row.can_id,
                    "is_extended": row.is_extended,
                    "function": row.function,
                    "node_id": row.node_id,
                    "frames": row.frames,
                    "data": row.data.hex(),
                    "meaning": row.meaning,
                }
                for _, row in sorted(traffic.identifiers.items())
            ],
        },
        indent=2,
    )
