"""`campaign.toml` to a record; a scenario's file is a campaign by itself."""

from collections.abc import Sequence
from pathlib import Path

from hil_bench.abilities.campaign.distributions import Sampler, read_distribution
from hil_bench.abilities.campaign.records import EACH, Campaign
from hil_bench.abilities.scenario.places import LocatedProblems, find_spots
from hil_bench.config.document import Sort, Tables, read_document
from hil_bench.config.settings import Key
from hil_bench.config.values import choice, describe, integer, number, text, texts
from hil_bench.errors import ConfigError
from hil_bench.units import SECOND

_TABLES = ("firmware", "parameters", "tolerances")
_MOST_RUNS = 10_000_000
_MOST_LEVELS = 1000


def read_campaign(path: Path) -> Campaign:
    """Return the campaign of a file; of a scenario, a campaign of it alone.

    Whatever is wrong comes as one `ConfigError`, a line a problem, with line and column.
    """
    if path.suffix.lower() == ".csv":
        return Campaign(path, (path,))
    document = read_document(path, Sort.CAMPAIGN, Sort.SCENARIO)
    if path.name.endswith(".scenario.toml") or "expect" in document:
        return Campaign(path, (path,))
    problems = LocatedProblems(str(path), find_spots(path.read_text(encoding="utf-8-sig")))
    file = Tables(document, problems)
    found = file.head(_KEYS, _TABLES)
    firmware = file.entries("firmware", _command)
    parameters = file.entries("parameters", read_distribution)
    tolerances = file.entries("tolerances", read_distribution)
    problems.raise_any()
    value = {name: setting.value for name, setting in found.items()}
    seeds = value["seeds"]
    return Campaign(
        path,
        tuple(path.parent / each for each in value["scenarios"]),
        title=value["title"],
        sampler=value["sampler"],
        runs=value["runs"],
        levels=value["levels"],
        seed=value["seed"],
        seeds=() if seeds == EACH else seeds,
        seed_each=seeds == EACH,
        benches=tuple(path.parent / each for each in value["benches"]),
        firmware=firmware,
        parameters=parameters,
        tolerances=tolerances,
        timeout=value["timeout_s"],
    )


def _some(value: object) -> tuple[str, ...]:
    found = texts(value)
    if not found:
        raise ConfigError("is empty; give one or more")
    if len(set(found)) < len(found):
        raise ConfigError("names one twice; give each once")
    return found


def _command(value: object) -> tuple[str, ...]:
    words = texts(value)
    if not words:
        right = 'give a command line, as in ["build/controller", "{bus}"]'
        raise ConfigError(f"is empty; {right}")
    return words


def _seeds(value: object) -> tuple[int, ...] | str:
    if value == EACH:
        return EACH
    if not isinstance(value, list) or not value:
        right = f'give a list of integers, or "{EACH}" for a seed of its own for each point'
        raise ConfigError(f"{describe(value)} is no list of seeds; {right}")
    return tuple(integer(0)(each) for each in value)


_KEYS: Sequence[Key] = (
    Key("title", text, ""),
    Key("scenarios", _some, example='["sag.scenario.toml"]'),
    Key("sampler", choice(Sampler), Sampler.SOBOL),
    Key("runs", integer(1, _MOST_RUNS), 64),
    Key("levels", integer(1, _MOST_LEVELS), 5),
    Key("seed", integer(0), 0),
    Key("seeds", _seeds, ()),
    Key("benches", _some, ()),
    Key("timeout_s", number(SECOND, low=0.1, high=1e6), 60.0, SECOND),
)
