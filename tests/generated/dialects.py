"""The sorts of files, by dialect, and the verbs that read each."""

import json
from typing import Final, NamedTuple

from generated import seeds

ARGUMENTS: Final = "arguments"
BYTES: Final = "bytes"


class Dialect(NamedTuple):
    """A sort of file.

    Attributes:
        name: of the sort.
        suffix: of its files.
        verbs: words of each verb that reads it; ``{}`` is the file, ``{0}`` its first line.
        seeds: sound files: their folder below the repository, and their text.
        edit: how it is edited: a "document" of TOML, "cells", "lines", `BYTES`, or `ARGUMENTS`,
            lines that are no file but words of the command line, or answers to its questions.
        plays: whether a verb plays it, which is kept short.
    """

    name: str
    suffix: str
    verbs: tuple[tuple[str, ...], ...]
    seeds: tuple[tuple[str, str | bytes], ...]
    edit: str = "document"
    plays: bool = True


def verbs_of(*lines: str) -> tuple[tuple[str, ...], ...]:
    """Return the words of lines."""
    return tuple(tuple(line.split()) for line in lines)


DIALECTS: Final = (
    Dialect(
        "bench",
        ".toml",
        (
            *verbs_of(
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
                "identify measured.csv {} --columns columns.toml --time-limit 1 -o out",
                "identify --design {} --time-limit 1 --duration 2 -o out",
                "analyse linearisation {}",
                "analyse root-locus {} -o out",
                "analyse flow-pressure {}",
                "analyse trajectories {}",
                "export-fmu out.fmu {}",
                "evidence out {} --seconds 0",
            ),
            ("monitor", "{}", *seeds.BUS),
            ("record", "out.csv", "{}", *seeds.BUS),
            ("run", "{}", *seeds.BUS, "--speed", "max", "--record", "out.csv"),
            *verbs_of("scan --virtual {} --nodes 1-2", "program {} --virtual --node 1"),
        ),
        tuple(seeds.benches()),
    ),
    Dialect(
        "network",
        ".toml",
        verbs_of(
            "boot --virtual --network {}", "boot --virtual --network {} --concise-dcf out --json"
        ),
        (*seeds.examples("examples", "network.*"),),
    ),
    Dialect(
        "plan",
        ".toml",
        verbs_of(
            "commission {} --virtual --json --output out",
            "identify --design --plan {} --time-limit 1 --duration 2 -o out",
        ),
        (("examples", seeds.PLAN),),
    ),
    Dialect(
        "scenario",
        ".scenario.toml",
        verbs_of(
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
    Dialect(
        "scenario of a minute",
        ".scenario.toml",
        verbs_of("scenario check {}", "scenario list {}", "scenario convert {} out.csv"),
        (
            *seeds.examples("examples/scenarios", "*.scenario.toml"),
            *seeds.examples("examples/machines", "*.scenario.toml"),
        ),
        plays=False,
    ),
    Dialect(
        "campaign",
        ".toml",
        verbs_of("campaign {} --jobs 0 --runs 2 -o out", "campaign {} --merge -o out"),
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
    Dialect(
        "set",
        "",
        verbs_of(
            "campaign steps.scenario.toml --runs 1 --jobs 0 -o out --set {0}",
            "test steps.scenario.toml --set {0}",
            "falsify steps.scenario.toml --runs 1 --jobs 0 --method random -o out --set {0}",
        ),
        (("examples", "load_n=10"), ("examples", "limit_bar=200")),
        ARGUMENTS,
    ),
    Dialect(
        "requirements",
        ".toml",
        verbs_of("judge {} recording.csv"),
        (("examples", seeds.REQUIREMENTS),),
    ),
    Dialect(
        "register map",
        ".toml",
        verbs_of("registers with_map.toml", "registers with_map.toml --csv", "check with_map.toml"),
        (
            ("examples", seeds.REGISTER_MAP),
            (
                "examples",
                (seeds.REPOSITORY / "device_profiles/registers/pressure_404.toml").read_text(),
            ),
        ),
    ),
    Dialect(
        "columns",
        ".toml",
        verbs_of("identify measured.csv --columns {} --time-limit 1 -o out"),
        (("examples", seeds.COLUMNS),),
    ),
    Dialect(
        "map",
        "",
        verbs_of(
            "identify measured.csv --map {0} --map {1} --map {2} --map {3} --map {4} --time-limit 1"
        ),
        tuple(("examples", text) for text in seeds.MAPS),
        ARGUMENTS,
    ),
    Dialect(
        "answers",
        "",
        (("new", "out.toml", "--force", *seeds.NEW.split()), ("new", "out.toml", "--force")),
        tuple(("examples", text) for text in seeds.ANSWERS),
        ARGUMENTS,
    ),
    Dialect("shell", "", verbs_of("completion {0}"), (("examples", "bash"),), ARGUMENTS),
    Dialect(
        "scenario sheet",
        ".csv",
        verbs_of(
            "scenario check {}", "scenario list {}", "scenario convert {} out.toml", "test {}"
        ),
        (("examples", seeds.SHEET), ("examples", seeds.SHEET.replace(",", ";"))),
        "cells",
    ),
    Dialect(
        "course",
        ".csv",
        verbs_of("scenario check with_course.scenario.toml", "test with_course.scenario.toml"),
        (("examples", seeds.COURSE),),
        "cells",
    ),
    Dialect(
        "recording",
        ".csv",
        verbs_of(
            "judge requirements.toml {}",
            "replay {} --virtual",
            "plot {} -o out.png",
            "identify {} --time-limit 1 -o out",
        ),
        (("examples", seeds.recording()),),
        "cells",
    ),
    Dialect(
        "measured table",
        ".csv",
        verbs_of("identify {} --columns columns.toml --time-limit 1 -o out"),
        (("examples", seeds.measured()),),
        "cells",
    ),
    Dialect(
        "EDS",
        ".eds",
        (
            *verbs_of(
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
    Dialect(
        "DBC",
        ".dbc",
        verbs_of(
            "check with_dbc.toml",
            "devices with_dbc.toml",
            "bus-load with_dbc.toml --simulate 0.01",
            "decode frames.log --dbc {}",
        ),
        (*seeds.examples("examples", "*.dbc"),),
        "lines",
    ),
    Dialect(
        "log",
        ".log",
        verbs_of(
            "decode {}",
            "decode {} -o out.csv one_axis.toml",
            "decode {} --write-dbc out.dbc one_axis.toml",
            "explain {} one_axis.toml",
            "shadow --log {} one_axis.toml",
            "plot {} -o out.png",
            f"replay {{}} --speed max {' '.join(seeds.BUS[:4])}",
        ),
        (("examples", seeds.LINES),),
        "lines",
    ),
    Dialect(
        "ASC log",
        ".asc",
        verbs_of("decode {}", "explain {} one_axis.toml", "shadow --log {} one_axis.toml"),
        (("examples", seeds.ASC),),
        "lines",
    ),
    Dialect(
        "results",
        "",
        verbs_of("evidence out --results {} --seconds 0"),
        (("examples", json.dumps(seeds.RESULTS, indent=1)), ("examples", seeds.JUNIT)),
        "lines",
    ),
)
"""Every dialect that a verb reads."""

COSTLY: Final = {"evidence", "analyse", "identify", "export-fmu", "commission", "falsify"}
"""Verbs that take over a second a file; they are played where they are named."""

SLOWER: Final = {"boot", "campaign", "conformance", "plot", "shadow"}
"""Verbs that take over 50 ms a file, and have fewer files."""
