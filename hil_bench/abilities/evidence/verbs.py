"""`hil-bench evidence`: what this installation shows of itself on this machine, as a pack."""

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hil_bench.abilities.analysis.validation import validate
from hil_bench.abilities.common.progress import (
    Work,
    shown_work,
)
from hil_bench.abilities.doctor.machine import examine_machine, examine_permissions, read_file
from hil_bench.abilities.doctor.verbs import found_content, measure
from hil_bench.abilities.evidence import pack as packs
from hil_bench.abilities.evidence.content import (
    ResultsFile,
    classification,
    known_defects,
    page_html,
    read_results,
    summarise,
    trace,
)
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_results
from hil_bench.errors import ConfigError

_PAGE, _JSON = "index.html", "evidence.json"
_LONGEST = 20.0

_EXAMPLES = """\
exit code 1 where a check failed, 6 where none did, but a requirement is undecided or was never
exercised, or --results name none (the pack is written all the same); 1 where --verify finds a file
that was changed, is missing or was added

examples:
  hil-bench evidence pack
  hil-bench evidence pack bench.toml --results results.json pytest.xml
  hil-bench evidence --verify pack
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "evidence",
        description="Validate this installation on this machine, and write the evidence as a\n"
        "page that opens offline and as JSON: plant, devices, determinism, timing, requirements\n"
        "and results, versions, known defects, notes for a tool classification.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the pack, new or empty")
    parser.add_argument(
        "config", nargs="?", metavar="bench.toml", help="the bench (default: the built-in one)"
    )
    parser.add_argument(
        "--results",
        nargs="+",
        action="extend",
        type=Path,
        default=[],
        metavar="FILE",
        help="results of your tests: output of 'hil-bench test --json', or JUnit XML",
    )
    parser.add_argument(
        "--seconds",
        type=float,
        default=2.0,
        metavar="S",
        help="measure the lateness for S seconds (default: 2); 0 for not at all",
    )
    parser.add_argument(
        "--verify", action="store_true", help="check a pack against its manifest, offline"
    )
    parser.add_argument(
        "--digest",
        metavar="SHA256",
        help="with --verify: the manifest's SHA-256, as you have kept it",
    )
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make a pack, or check one.

    Raises:
        ConfigError: the arguments do not go together.
    """
    if args.verify:
        return _verify(args)
    if args.digest is not None:
        raise ConfigError("--digest: checks an existing pack; give --verify too")
    if not 0 <= args.seconds <= _LONGEST:
        raise ConfigError(f"--seconds {args.seconds:g}: give 0 to {_LONGEST:g} s")
    if find_spec("jinja2") is None:
        raise ConfigError("evidence needs Jinja2: pip install 'hil-bench[report]'")
    packs.check_folder(args.folder)
    results = read_results(args.results)
    config = load_config(args.config)
    traceability = trace(results)
    timing = _timing(args)  # first: whoever shows the work would be measured, too
    with shown_work(args, Work("evidence", 5)) as work:
        work.begin("devices")
        devices = packs.examine_devices(config)
        pack = _content(config, devices, traceability, timing, work)
        work.begin("writing")
        digest = packs.write_pack(args.folder, dict(_files(pack, config, devices, results)))
    print_results(
        args,
        _lines(pack["summary"], args.folder, digest),
        {"folder": str(args.folder), "manifest_sha256": digest, "summary": pack["summary"]},
    )
    verdicts = {line["verdict"] for line in pack["summary"]}
    if "failed" in verdicts:
        return ExitCode.CHECK_FAILED
    return ExitCode.INCONCLUSIVE if verdicts & {"inconclusive", "not exercised"} else ExitCode.DONE


def _verify(args: argparse.Namespace) -> int:
    differences = packs.verify_pack(args.folder, args.digest)
    lines = [f"{args.folder}/{line}" for line in differences]
    print_results(
        args,
        lines or [f"{args.folder}: every file is as the manifest has it"],
        {"folder": str(args.folder), "differences": differences},
    )
    return ExitCode.CHECK_FAILED if differences else ExitCode.DONE


def _timing(args: argparse.Namespace) -> Mapping[str, object]:
    permissions, machine = examine_permissions(read_file), examine_machine(read_file)
    return found_content((permissions, machine), measure(args, permissions))


def _content(
    config: BenchConfig,
    devices: list[packs.Examination],
    traceability: Mapping[str, object],
    timing: Mapping[str, object],
    work: Work,
) -> dict[str, Any]:
    """Return all that a pack says."""
    work.begin("plant")
    checks = validate(config.axes, config.step_ns * 1e-9)
    work.begin("software")
    software = packs.examine_software(config)
    work.begin("determinism")
    determinism = packs.examine_determinism(config)
    pack: dict[str, Any] = {
        "software": software,
        "plant": [{**asdict(check), "verdict": check.verdict.value} for check in checks],
        "conformance": [device.content for device in devices],
        "determinism": determinism,
        "timing": timing,
        "traceability": traceability,
        "known_defects": known_defects(),
        "classification": classification(),
    }
    return {"summary": summarise(pack), **pack}


def _files(
    pack: dict[str, Any],
    config: BenchConfig,
    devices: list[packs.Examination],
    results: list[ResultsFile],
) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each file of the pack.

    Yields:
        One after the other.
    """
    yield _PAGE, page_html(pack).encode()
    yield _JSON, (json.dumps(pack, indent=2, ensure_ascii=False) + "\n").encode()
    for number, device in enumerate(devices, start=1):
        if device.document:
            yield f"conformance-{number}.md", device.document.encode()
    if config.path:
        yield "inputs/bench.toml", config.path.read_bytes()
    for number, file in enumerate(results, start=1):
        suffix = ".xml" if file.content.lstrip()[:1] == b"<" else ".json"
        yield f"inputs/results-{number}{suffix}", file.content


def _lines(summary: list[dict[str, str]], folder: Path, digest: str) -> Iterator[str]:
    for line in summary:
        yield f"{line['section']:13}  {line['verdict']:14}  {line['text']}"
    yield f"{folder / _PAGE} opens in any browser"
    yield f"manifest SHA-256 {digest}: keep it elsewhere, for --verify --digest"
