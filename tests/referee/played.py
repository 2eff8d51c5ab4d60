"""Requirements judged by `test` and by a campaign, beside the referee on what was recorded there.

The axis rests while loads pull at it. What it does is taken from the recording of the run; what the
requirements say of it is drawn, with constants from among the recorded values.
"""

import contextlib
import io
import json
import random
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from hil_bench import cli
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import read_campaign
from hil_bench.abilities.campaign.snapshot import perform_here
from hil_bench.abilities.campaign.store import Store
from hil_bench.abilities.campaign.table import collect, execute
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import PlayOptions, play, prepare
from referee.agreement import EXIT_CODES, differences, is_margin, marked
from referee.asking import refusals
from referee.cases import DrawOn
from referee.evaluator import FAILED, INCONCLUSIVE, NOT_EXERCISED, PASSED, Run
from referee.language import LENGTH, PLAIN, PRESSURE, SPEED

TICK = Fraction(1, 1000)
KINDS = {
    "axis1.position": LENGTH,
    "axis1.speed": SPEED,
    "axis1.P_A": PRESSURE,
    "axis1.P_B": PRESSURE,
    "axis1.spool_position": PLAIN,
}
SCENARIO = """\
title = "Pulled"
duration_s = {duration}
[parameters]
pull_kn = {{ value = {pull}, range = [-20.0, 20.0] }}
{parameters}
[[step]]
at_s = 0.005
set = {{ "axis1.load" = "pull_kn" }}
over_s = 0.01
[[step]]
at_s = 0.03
set = {{ "axis1.load" = "-3 kN" }}
"""
ANY = '[[expect]]\nid = "R-0"\nthat = "always axis1.P_A < 1 bar"\n'
WORST_FIRST = [FAILED, INCONCLUSIVE, NOT_EXERCISED, PASSED]


class Played:
    """A scenario with drawn requirements.

    Args:
        chance: the name of what is drawn.
        folder: where its file goes.
        count: how many requirements it has.
    """

    def __init__(self, chance: str, folder: Path, count: int) -> None:
        self.path = folder / "pulled.scenario.toml"
        draw = random.Random(chance)  # noqa: S311 - a sample, no secret
        self._duration = draw.choice(["0.04", "0.06", "0.0605", "0.15"])
        self._pull = str(draw.choice([-12.0, 5.0, 20.0]))
        self.stops = self._duration == "0.15" and draw.random() < 0.5
        self.ticks = int(Fraction(self._duration) / TICK) + 1
        self._write("", ANY)
        columns = self.recorded({})
        self.trees = []
        parameters, expects = "", ""
        while len(self.trees) < count:
            number = len(self.trees)
            on = DrawOn(f"{chance} {draw.random()}", KINDS, columns, TICK)
            tree, text, own = on.requirement()
            if refusals(tree, TICK, Fraction(self._duration)):
                continue
            for name, each in own.items():
                text = text.replace(name, f"r{number}{name}")
                parameters += f"r{number}{name} = {each.text}\n"
            self.trees.append(tree)
            expects += f'[[expect]]\nid = "R-{number}"\nthat = {json.dumps(text)}\n'
        self._write(parameters, expects)

    def _write(self, parameters: str, expects: str) -> None:
        head = SCENARIO.format(duration=self._duration, pull=self._pull, parameters=parameters)
        self.path.write_text(head + expects, encoding="utf-8")

    def _play(self, given: dict[str, float], *, stops: bool = False):
        options = PlayOptions(keeps_evidence=True, stops_at_failure=stops)
        return play(prepare(load_scenario(self.path), given), options)

    def recorded(self, given: dict[str, float]) -> dict[str, list[Fraction | None]]:
        """Return what a run with some parameters records; unknown behind its end."""
        return self._values(self._play(given))

    def _values(self, run) -> dict[str, list[Fraction | None]]:
        signals = run.evidence.signals
        unseen = [None] * (self.ticks - len(signals))
        return {n: [Fraction(repr(float(x))) for x in signals[n]] + unseen for n in KINDS}

    def _runs(self, signals: dict[str, list[Fraction | None]], seen: int | None = None):
        """Return a referee's run for each requirement, so that each knows its own rounding."""
        return [Run(signals, self.ticks, TICK, seen) for _ in self.trees]

    def differences_in_test(self) -> Iterator[str]:
        """Yield what the referee contradicts of what `test` finds."""
        run = self._play({}, stops=self.stops)
        referees = self._runs(self._values(run), len(run.evidence.signals))
        for referee, tree, (requirement, judgement) in zip(
            referees, self.trees, run.findings, strict=True
        ):
            found = [*differences(referee, tree, judgement, TICK, is_planned=True)]
            for each in marked(found, referee, is_exact=False):
                yield f"{each}: {requirement.that}"

    def differences_in_verb(self) -> Iterator[str]:
        """Yield what the referee contradicts of what the verb prints, and of its exit code."""
        referees = self._runs(self._values(self._play({}, stops=self.stops)))
        stops = ["--stop-at-failure"] if self.stops else []
        with contextlib.redirect_stdout(io.StringIO()) as written:
            code = cli.main(["test", str(self.path), "--json", *stops])
        (result,) = json.loads(written.getvalue()).values()
        found = [(each["id"], each["judgement"]["outcome"], None) for each in result["findings"]]
        yield from self._compared(referees, found)
        worst = min((outcome for _, outcome, _ in found), key=WORST_FIRST.index)
        if code != EXIT_CODES[worst]:
            yield f"exit code {code}, though the worst outcome is {worst}"

    def differences_in_campaign(self, folder: Path, runs: int) -> Iterator[str]:
        """Yield what the referee contradicts of what a campaign keeps of its runs."""
        plan = Plan(replace(read_campaign(self.path), runs=runs))
        store = Store(folder, {})
        execute(plan, store, perform_here)
        for result in collect(plan, store).results:
            referees = self._runs(self.recorded(dict(result.values)))
            found = [(each.id, each.outcome, each.margin) for each in result.verdicts]
            yield from self._compared(referees, found)
            worst = min((outcome for _, outcome, _ in found), key=WORST_FIRST.index)
            if result.outcome != worst:
                yield f"{result.values}: {result.outcome}, though the worst outcome is {worst}"

    def _compared(self, referees, found: list[tuple[str, str, float | None]]) -> Iterator[str]:
        """Yield in which ids, outcomes and margins the referee differs."""
        for referee, tree, (name, outcome, margin) in zip(referees, self.trees, found, strict=True):
            ruling = referee.rule(tree)
            bound = ruling.margin.high if ruling.outcome == FAILED else ruling.margin.low
            differs = []
            if outcome != ruling.outcome:
                differs = [f"{name}: {outcome}, the referee says {ruling.outcome}"]
            elif margin is not None and not is_margin(margin, bound):
                differs = [f"{name}: margin {margin}, the referee says {bound}"]
            yield from marked(differs, referee, is_exact=False)
