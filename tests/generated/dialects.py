"""The sorts of files, by dialect, and the verbs that read each."""

import json
from collections.abc import Mapping
from typing import Final, NamedTuple

from generated import seeds

ARGUMENTS: Final = "arguments"


class Dialect(NamedTuple):
    """A sort of file.

    Attributes:
        suffix: of its files.
        verbs: words of each verb that reads it; ``{}`` is the file, ``{0}`` its first line.
        seeds: sound files: their folder below the repository, and their text.
        edit: how it is edited: a "document" of TOML, "cells", "lines", or `ARGUMENTS`, lines that
            are no file but words of the command line, or answers to its questions.
        plays: whether a verb plays it, which is kept short.
    """

    suffix: str
    verbs: tuple[tuple[str, ...], ...]
    seeds: tuple[tuple[str, str], ...]
    edit: str = "document"
    plays: bool = True


def _verbs(*lines: str) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(line.split()) for line in lines)


DIALECTS: Final[Mapping[str, Dialect]] = {
    "bench": Dialect(
        ".toml",
        (
            *_verbs(
                "check {}",
                "check {} --json",
                "devices {}",
                "devices {} --json",
                "registers {}",
                "registers {} --csv",
                "bus-load {} --simulate 0.01",
                "bus-load {} --simulate 0.01 --json",
                "explain frames.log {}",
                "decode frames.log {}",
                "shadow --log frames.log {}",
                "boot --virtual {}",
                "conformance --virtual --node-id 1 {}",
                "replay recording.csv {} --virtual",
                "scenario check on_bench.scenario.toml",
                "test on_bench.scenario.toml",
                "campaign on_bench.scenario.toml --runs 1 --jobs 0 -o out",
                "identify measured.csv {} --columns columns.toml --starts 1 -o out",
                "identify --design {} --starts 1 --duration 2 -o out",
                "analyse linearisation {}",
                "analyse root-locus {} -o out",
                "analyse flow-pressure {}",
                "analyse trajectories {}",
                "export-fmu out.fmu {}",
                "evidence out {} --seconds 0",
            ),
            ("monitor", "{}", *seeds.BUS),
        ),
        tuple(seeds.benches()),
    ),
    "network": Dialect(
        ".toml",
        _verbs(
            "boot --virtual --network {}", "boot --virtual --network {} --concise-dcf out --json"
        ),
        (*seeds.examples("examples", "network.*"),),
    ),
    "plan": Dialect(
        ".toml",
        _verbs(
            "commission {} --virtual --json --output out",
            "identify --design --plan {} --starts 1 --duration 2 -o out",
        ),
        (("examples", seeds.PLAN),),
    ),
    "scenario": Dialect(
        ".scenario.toml",
        _verbs(
            "scenario check {}",
            "scenario list {}",
            "scenario convert {} out.csv",
            "test {}",
            "test {} --json",
            "judge {} recording.csv",
            "campaign {} --runs 2 --jobs 0 -o out",
            "falsify {} --runs 2 --jobs 0 --method random -o out",
        ),
        (("examples", seeds.SCENARIO), ("examples", seeds.STEPS)),
    ),
    "scenario of a minute": Dialect(
        ".scenario.toml",
        _verbs("scenario check {}", "scenario list {}", "scenario convert {} out.csv"),
        (
            *seeds.examples("examples/scenarios", "*.scenario.toml"),
            *seeds.examples("examples/machines", "*.scenario.toml"),
        ),
        plays=False,
    ),
    "campaign": Dialect(
        ".toml",
        _verbs("campaign {} --jobs 0 --runs 2 -o out", "campaign {} --merge -o out"),
        (
            ("examples", seeds.CAMPAIGN),
            *(
                ("examples", seeds.CAMPAIGN.replace('"grid"', f'"{name}"').replace("range", keys))
                for name, keys in (("sobol", "log_range"), ("monte_carlo", "normal"))
            ),
            (
                "examples",
                seeds.CAMPAIGN.replace("range = [6.0, 9.0]", "triangular = [6.0, 7, 9.0]"),
            ),
            ("examples", seeds.CAMPAIGN.replace("range = [6.0, 9.0]", "values = [6.0, 9.0]")),
        ),
    ),
    "set": Dialect(
        "",
        _verbs(
            "campaign steps.scenario.toml --runs 1 --jobs 0 -o out --set {0}",
            "test steps.scenario.toml --set {0}",
            "falsify steps.scenario.toml --runs 1 --jobs 0 --method random -o out --set {0}",
        ),
        (("examples", "load_n=10"), ("examples", "limit_bar=200")),
        ARGUMENTS,
    ),
    "requirements": Dialect(
        ".toml", _verbs("judge {} recording.csv"), (("examples", seeds.REQUIREMENTS),)
    ),
    "register map": Dialect(
        ".toml",
        _verbs("registers with_map.toml", "registers with_map.toml --csv", "check with_map.toml"),
        (
            ("examples", seeds.REGISTER_MAP),
            (
                "examples",
                (seeds.REPOSITORY / "device_profiles/registers/pressure_404.toml").read_text(),
            ),
        ),
    ),
    "columns": Dialect(
        ".toml",
        _verbs("identify measured.csv --columns {} --starts 1 -o out"),
        (("examples", seeds.COLUMNS),),
    ),
    "map": Dialect(
        "",
        _verbs(
            "identify measured.csv --map {0} --map {1} --map {2} --map {3} --map {4} --starts 1"
        ),
        tuple(("examples", text) for text in seeds.MAPS),
        ARGUMENTS,
    ),
    "answers": Dialect(
        "",
        (("new", "out.toml", "--force", *seeds.NEW.split()), ("new", "out.toml", "--force")),
        tuple(("examples", text) for text in seeds.ANSWERS),
        ARGUMENTS,
    ),
    "shell": Dialect("", _verbs("completion {0}"), (("examples", "bash"),), ARGUMENTS),
    "scenario sheet": Dialect(
        ".csv",
        _verbs("scenario check {}", "scenario list {}", "scenario convert {} out.toml", "test {}"),
        (("examples", seeds.SHEET), ("examples", seeds.SHEET.replace(",", ";"))),
        "cells",
    ),
    "course": Dialect(
        ".csv",
        _verbs("scenario check with_course.scenario.toml", "test with_course.scenario.toml"),
        (("examples", seeds.COURSE),),
        "cells",
    ),
    "recording": Dialect(
        ".csv",
        _verbs(
            "judge requirements.toml {}",
            "replay {} --virtual",
            "plot {} -o out.png",
            "identify {} --starts 1 -o out",
        ),
        (("examples", seeds.recording()),),
        "cells",
    ),
    "measured table": Dialect(
        ".csv",
        _verbs("identify {} --columns columns.toml --starts 1 -o out"),
        (("examples", seeds.measured()),),
        "cells",
    ),
    "EDS": Dialect(
        ".eds",
        (
            *_verbs(
                "check-eds {}",
                "check-eds {} --strict --json",
                "conformance --virtual --node-id 1 --eds {}",
                "conformance --virtual --node-id 10 with_eds.toml",
                "decode frames.log --eds 1={}",
                "explain frames.log --eds 1={}",
                "check with_eds.toml",
                "devices with_eds.toml",
                "bus-load with_eds.toml --simulate 0.01",
            ),
            ("monitor", "--eds", "1={}", *seeds.BUS),
        ),
        tuple(("examples", text) for _, text in seeds.EDS),
        "lines",
    ),
    "DBC": Dialect(
        ".dbc",
        _verbs(
            "check with_dbc.toml",
            "devices with_dbc.toml",
            "bus-load with_dbc.toml --simulate 0.01",
            "decode frames.log --dbc {}",
        ),
        (*seeds.examples("examples", "*.dbc"),),
        "lines",
    ),
    "log": Dialect(
        ".log",
        _verbs(
            "decode {}",
            "decode {} -o out.csv one_axis.toml",
            "decode {} --write-dbc out.dbc one_axis.toml",
            "explain {} one_axis.toml",
            "shadow --log {} one_axis.toml",
            "plot {} -o out.png",
        ),
        (("examples", seeds.LINES),),
        "lines",
    ),
    "ASC log": Dialect(
        ".asc",
        _verbs("decode {}", "explain {} one_axis.toml", "shadow --log {} one_axis.toml"),
        (("examples", seeds.ASC),),
        "lines",
    ),
    "results": Dialect(
        "",
        _verbs("evidence out --results {} --seconds 0"),
        (("examples", json.dumps(seeds.RESULTS, indent=1)), ("examples", seeds.JUNIT)),
        "lines",
    ),
}
"""Every dialect that a verb reads."""

COSTLY: Final = {"evidence", "analyse", "identify", "export-fmu", "commission", "falsify"}
"""Verbs that take over a second a file; they are played where they are named."""

SLOWER: Final = {"boot", "campaign", "conformance", "plot", "shadow"}
"""Verbs that take over 50 ms a file, and have fewer files."""
