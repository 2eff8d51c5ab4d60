"""`hil-bench test`: scenarios played on the virtual bench, and judged."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from hil_bench.cli.arguments import add_seed_argument
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_results
from hil_bench.errors import ConfigError, HilBenchError
from hil_bench.scenario.judgement import RequirementOutcome
from hil_bench.scenario.junit import write_junit
from hil_bench.scenario.load import load_scenario
from hil_bench.scenario.recorded import Finding
from hil_bench.scenario.report import ScenarioResult, reason_of
from hil_bench.scenario.run import PlayOptions, PreparedScenario, play, prepare

SUFFIX = ".scenario.toml"
"""How the name of a scenario's file ends, which is looked for in folders."""

_EXAMPLES = """\
exit code 1 where a requirement failed, or the firmware did; 6 where none did, but one could not be
decided, or its trigger never became true

examples:
  hil-bench test examples/scenarios
  hil-bench test sag.scenario.toml -k SRS-42 --set sag_bar=45
  hil-bench test sag.scenario.toml --stop-at-failure --junit result.xml --json
"""
