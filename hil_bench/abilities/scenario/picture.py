"""The picture of a requirement: what it compares, the motion, faults and violations."""

import io
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import fields
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.common.figure_style import BLACK, BLUE, GREY, ORANGE, RED, settle_layout
from hil_bench.abilities.recording.plot import MotionPanel, motion_panels, styled
from hil_bench.abilities.scenario import nodes
from hil_bench.abilities.scenario.judgement import Evidence, show_atom, show_value, unit_of
from hil_bench.abilities.scenario.monitor import Span, StreamBuilder
from hil_bench.abilities.scenario.nodes import Atom, Comparison, Condition, Relation
from hil_bench.abilities.scenario.reach import names_in
from hil_bench.abilities.scenario.values import Block, Floats, build_values
from hil_bench.units import ONE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_SIGNS = {
    Relation.LESS: -1.0,
    Relation.LESS_EQUAL: -1.0,
    Relation.GREATER: 1.0,
    Relation.GREATER_EQUAL: 1.0,
}
_MOST_PANELS = 4  # of comparisons; the one that decides is always there
_LONGEST = 70  # characters of a legend
_MERGED = 1 / 2000  # of the run: times of violation that are closer are one patch


class Scene(NamedTuple):
    """The contents of a picture.

    Attributes:
        condition: the requirement.
        decider: the comparison that decides; None where none does.
        instant: when [s]; None where nothing decides.
        violated: begin and end of each time in which it is violated [s].
        evidence: of the run.
    """

    condition: Condition
    decider: Atom | None
    instant: float | None
    violated: tuple[tuple[float, float], ...]
    evidence: Evidence


def draw_scene(scene: Scene) -> bytes:
    """Return the picture as an SVG file; nothing where matplotlib or a run is missing."""
    if find_spec("matplotlib") is None or not scene.evidence.ticks:
        return b""
    file = io.BytesIO()

    def draw() -> "Figure":
        figure = _figure(scene)
        settle_layout(figure)
        figure.savefig(file, format="svg", metadata={"Date": None})
        return figure

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # names are anybody's
        styled(draw)
    return file.getvalue()


def atoms_in(condition: Condition) -> list[Atom]:
    """Return the comparisons, states, events and edges of a condition, each once."""
    found: list[Atom] = []
    waiting: list[object] = [condition]
    while waiting:
        node = waiting.pop(0)
        if isinstance(node, Atom) and not isinstance(node, nodes.ConditionEdge):
            found.append(node)
        elif isinstance(node, nodes.Node):
            waiting += (getattr(node, each.name) for each in fields(node))
        elif isinstance(node, tuple):
            waiting += node
    return list({show_atom(atom): atom for atom in found}.values())


def _figure(scene: Scene) -> "Figure":
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    panels = list(_panels(scene))
    figure = Figure(figsize=(9.0, 0.9 + 1.7 * sum(p.share for p in panels)), layout="constrained")
    places = figure.subplots(
        len(panels), 1, sharex=True, squeeze=False, height_ratios=[panel.share for panel in panels]
    )[:, 0]
    for place, panel in zip(places, panels, strict=True):
        panel.draw(place)
        _shade(place, scene)
    _label_shades(places[0], scene)
    places[-1].set_xlabel("Time [s]")
    places[-1].set_xlim(0.0, scene.evidence.ticks * scene.evidence.tick_ns * 1e-9)
    figure.align_ylabels([place for place in places if place.get_ylabel()])
    return figure


def _panels(scene: Scene) -> Iterator[MotionPanel]:
    atoms = atoms_in(scene.condition)
    if scene.decider in atoms:  # first of all
        atoms.sort(key=lambda atom: atom != scene.decider)
    comparisons = [atom for atom in atoms if isinstance(atom, Comparison)][:_MOST_PANELS]
    others = [atom for atom in atoms if not isinstance(atom, Comparison)]
    for comparison in comparisons:
        yield MotionPanel(1.3, partial(_draw_comparison, scene=scene, node=comparison))
        if comparison == scene.decider and comparison.relation in _SIGNS:
            yield MotionPanel(0.8, partial(_draw_margin, scene=scene, node=comparison))
    if others:
        yield MotionPanel(0.3 + 0.3 * len(others), partial(_draw_truths, scene=scene, atoms=others))
    signals = scene.evidence.signals
    if len(signals):
        owners = [name.partition(".")[0] for name in sorted(names_in([scene.condition]))]
        yield from motion_panels(signals, owners)


def _draw_comparison(place: "Axes", scene: Scene, node: Comparison) -> None:
    evidence = scene.evidence
    unit = unit_of(node.dimension, node.symbol)
    times = _times(evidence)
    left, right = (_values(side, evidence) / unit.factor for side in (node.left, node.right))
    name, limit = (_literal(_bare(show_value(side, unit))) for side in (node.left, node.right))
    place.plot(times, right, color=GREY, linestyle="--", linewidth=1.8, label=limit)
    place.plot(times, left, color=BLUE, linewidth=1.3, label=name)
    place.set_ylabel("Value" if unit is ONE else f"[{unit.symbol}]")
    place.set_title(_literal(show_atom(node)), loc="left", fontsize="medium")
    place.legend(loc="best", fontsize="small")
    place.margins(x=0.0)
    if node == scene.decider and scene.instant is not None:
        tick = min(round(scene.instant * 1e9 / evidence.tick_ns), evidence.ticks - 1)
        place.plot([scene.instant], [left[tick]], "o", color=RED, markersize=6, zorder=4)


def _draw_margin(place: "Axes", scene: Scene, node: Comparison) -> None:
    """Draw how far a comparison is from its limit, cut where it is far from a violation."""
    evidence = scene.evidence
    unit = unit_of(node.dimension, node.symbol)
    times = _times(evidence)
    left, right = (_values(side, evidence) for side in (node.left, node.right))
    margin = _SIGNS[node.relation] * (left - right) / unit.factor
    place.plot(times, margin, color=BLUE, linewidth=1.3)
    counts = (margin < 0.0) & _violates(times, scene)
    place.fill_between(times, margin, 0.0, where=counts, color=RED, alpha=0.6)
    place.axhline(0.0, color=GREY, linestyle="--", linewidth=1.2)
    worst = float(np.nanmin(margin, initial=0.0, where=np.isfinite(margin) & counts))
    if worst < 0.0:  # a violation is seen however far the signal is from its limit elsewhere
        place.set_ylim(1.3 * worst, -3.0 * worst)
    place.set_ylabel("Margin" if unit is ONE else f"Margin [{unit.symbol}]")
    place.margins(x=0.0)


def _violates(times: Floats, scene: Scene) -> npt.NDArray[np.bool_]:
    """Return the ticks that violate the requirement; all where it says of none that they do."""
    if not scene.violated:
        return np.ones(len(times), dtype=np.bool_)
    inside = np.zeros(len(times), dtype=np.bool_)
    half = 0.5e-9 * scene.evidence.tick_ns
    for begin, end in scene.violated:
        inside |= (times >= begin - half) & (times < end - half)
    return inside


def _times(evidence: Evidence) -> Floats:
    """Return the time of each tick [s]."""
    return np.arange(evidence.ticks, dtype=np.float64) * (evidence.tick_ns * 1e-9)


def _values(side: nodes.Value, evidence: Evidence) -> Floats:
    return build_values(side, evidence.tick_ns)(Block(evidence.columns, evidence.ticks))


def _draw_truths(place: "Axes", scene: Scene, atoms: Sequence[Atom]) -> None:
    evidence = scene.evidence
    times = _times(evidence)
    for number, atom in enumerate(reversed(atoms)):
        stream = StreamBuilder(evidence.tick_ns).build(atom, Span(0, None))
        truths = stream.push(Block(evidence.columns, evidence.ticks)).low > 0.0
        place.fill_between(
            times, number, number + 0.8 * truths, step="post", color=ORANGE, linewidth=1.0
        )
    labels = [_literal(show_atom(atom)) for atom in reversed(atoms)]
    place.set_yticks([number + 0.4 for number in range(len(atoms))], labels, fontsize="small")
    place.set_ylim(-0.1, len(atoms))
    place.grid(visible=False, axis="y")


def _shade(place: "Axes", scene: Scene) -> None:
    for fault in scene.evidence.faults:
        place.axvspan(fault.begin, fault.end, color=ORANGE, alpha=0.15, linewidth=0.0)
    run = scene.evidence.ticks * scene.evidence.tick_ns * 1e-9
    for begin, end in _merged(scene.violated, run * _MERGED):
        place.axvspan(begin, end, color=RED, alpha=0.18, linewidth=0.0)
    if scene.instant is not None:
        place.axvline(scene.instant, color=BLACK, linewidth=0.9, linestyle=":")


def _merged(spans: Sequence[tuple[float, float]], gap: float) -> list[tuple[float, float]]:
    found: list[tuple[float, float]] = []
    for begin, end in spans:
        if found and begin - found[-1][1] <= gap:
            found[-1] = found[-1][0], end
        else:
            found.append((begin, end))
    return found


def _label_shades(place: "Axes", scene: Scene) -> None:
    """Name what is shaded: where only one of both colours is there, nobody knows them apart."""
    named = [(fault.begin, 0.04, "bottom", fault.label) for fault in scene.evidence.faults]
    named += [(begin, 0.96, "top", "violated") for begin, _ in scene.violated[:1]]
    for begin, height, side, words in named:
        place.annotate(
            f" {_literal(words)}",
            (begin, height),
            xycoords=("data", "axes fraction"),
            rotation=90.0,
            va=side,
            fontsize=8,
        )


def _bare(text: str) -> str:
    return text[1:-1] if text.startswith("(") else text


def _literal(text: str) -> str:
    """Return a text that matplotlib neither reads as mathematics nor fails to write as XML."""
    text = "".join(c if c.isprintable() else "�" for c in text)
    text = text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
    return text.replace("$", r"\$")
