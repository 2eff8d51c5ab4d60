"""The bench in pytest: its fixtures, options and markers, and reports of failed tests."""

from hil_bench.ability import Ability

ABILITY = Ability("bench_fixtures", fixtures="hil_bench.abilities.bench_fixtures.fixtures")
