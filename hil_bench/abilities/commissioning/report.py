"""The report of a commissioning, and its plots."""

import base64
import importlib.util
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from hil_bench.abilities.commissioning import measures
from hil_bench.abilities.commissioning.identity import NodeDescription
from hil_bench.abilities.commissioning.session import Commissioning
from hil_bench.abilities.common.figure_style import BLUE, GREEN, GREY, ORANGE, RED
from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.common.page import POLICY, cell, plain
from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.abilities.recording.plot import save_figure
from hil_bench.errors import about_file
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# The pictures of a commissioning's report: a step's samples, and its characteristics.


class _Panel(NamedTuple):
    label: str
    symbol: str  # of the SI unit
    lines: tuple[tuple[str, str, str, str], ...]  # channel, label, colour, style


_PANELS = (
    _Panel("Position", "m", (("position", "", BLUE, "-"),)),
    _Panel("Speed", "m/s", (("speed", "", GREEN, "-"),)),
    _Panel("Pressure", "Pa", ((P_A, "$P_A$", ORANGE, "-"), (P_B, "$P_B$", GREEN, "-"))),
    _Panel(
        "Spool",
        "-",
        (("spool_setpoint", "set-point", GREY, "--"), ("spool_position", "actual", BLUE, "-")),
    ),
)


def plot_step(result: measures.StepResult, path: Path) -> None:
    """Write the samples of a step, and beside them its characteristics."""
    save_figure(lambda: _draw(result), path)


def _draw(result: measures.StepResult) -> "Figure":
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    figure = Figure(figsize=(11.0 if result.curves else 7.0, 6.4), layout="constrained")
    left, *right = figure.subfigures(1, 2 if result.curves else 1, squeeze=False)[0]
    if result.trace is not None:
        _draw_trace(left.subplots(len(_PANELS), 1, sharex=True), result.trace)
    left.align_ylabels()
    for side in right:
        places = side.subplots(len(result.curves), 1, squeeze=False)[:, 0]
        for place, curve in zip(places, result.curves, strict=True):
            _draw_curve(place, curve)
    return figure


def _draw_trace(places: "list[Axes]", trace: Recording) -> None:
    for place, panel in zip(places, _PANELS, strict=True):
        unit = display_unit(panel.symbol)
        for channel, label, colour, style in panel.lines:
            place.plot(
                trace["time"],
                trace[channel] / unit.factor,
                color=colour,
                label=label,
                linestyle=style,
                linewidth=2.2 if style == "--" else 1.1,
                zorder=1.5 if style == "--" else 2.0,
            )
        place.set_ylabel(f"{panel.label} [{unit.symbol}]")
        place.margins(x=0.01)
        if len(panel.lines) > 1:
            place.legend(loc="lower right", bbox_to_anchor=(1.0, 0.94), ncols=2, fontsize="small")
    places[-1].set_xlabel("Time [s]")


def _draw_curve(place: "Axes", curve: measures.Curve) -> None:
    place.plot(curve.x, curve.y, color=BLUE, linewidth=0.9, label="measured")
    if curve.fit_x.size:
        marker = "o" if curve.fit_x.size == 2 else ""
        place.plot(
            curve.fit_x,
            curve.fit_y,
            color=RED,
            linestyle="" if marker else "--",
            marker=marker,
            label="found" if marker else "fitted",
        )
        place.legend(loc="best", fontsize="small")
    place.set_title(curve.title, loc="left", fontsize="medium")
    place.set_xlabel(curve.x_label)
    place.set_ylabel(curve.y_label)
    if curve.is_frequency:
        place.set_xscale("log")
        place.grid(visible=True, which="minor", linewidth=0.3)


# The report of a commissioning: Markdown, and the same as one HTML file with its pictures.


@dataclass(frozen=True, slots=True)
class ReportHead:
    """The heading of a report.

    Attributes:
        title: of the report.
        facts: what, when, by which versions: name to text.
    """

    title: str
    facts: Mapping[str, str]


Row = Sequence[str]


_TITLES = {
    "communication": "Communication",
    "sensors": "Sensors at standstill",
    "direction": "Direction",
    "dead_band": "Valve zero and dead band",
    "ramp": "Slow ramp both ways",
    "steps": "Steps",
    "chirp": "Frequency response",
    "leakage": "Leakage at standstill",
}

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222;
       max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; margin: .8rem 0 }
th, td { border-bottom: 1px solid #ddd; padding: .25rem .8rem .25rem 0;
         text-align: left; vertical-align: top }
h1 { margin-bottom: .2rem }
h2 { margin-top: 2.2rem; border-top: 1px solid #ccc; padding-top: .8rem }
img { max-width: 100% } img.narrow { width: 40rem }
.verdict { display: inline-block; padding: 0 .6rem; border-radius: .3rem;
           color: #fff; background: #777 }
.passed { background: #00724f } .failed, .stopped { background: #b34100 }
.finding { border-left: 4px solid #b34100; padding: .2rem .8rem; margin: .6rem 0;
           background: #fbf2ec }
"""


def write_report(directory: Path, found: Commissioning, head: ReportHead) -> list[Path]:
    """Write ``report.md``, ``report.html`` and a picture a step, and return their paths.

    Without matplotlib the report has no pictures.
    """
    pictures = _draw_pictures(directory, found)
    files = {
        "report.md": _markdown(found, head, pictures),
        "report.html": _html(found, head, pictures),
    }
    paths = [directory / name for name in files]
    with about_file(directory):
        for path, text in zip(paths, files.values(), strict=True):
            with whole_file(path) as file:
                file.write_text(text, encoding="utf-8", errors="backslashreplace")
    return [*paths, *pictures.values()]


def _draw_pictures(directory: Path, found: Commissioning) -> dict[str, Path]:
    if importlib.util.find_spec("matplotlib") is None:
        return {}
    pictures = {}
    for result in found.results:
        if result.trace is not None and len(result.trace):
            pictures[result.kind] = directory / f"{result.kind}.png"
            plot_step(result, pictures[result.kind])
    return pictures


def _title(result: measures.StepResult) -> str:
    return _TITLES[result.kind]


def _summary_rows(found: Commissioning) -> Iterator[Row]:
    for number, result in enumerate(found.results, start=1):
        wrong = [measure.name for measure in result.measures if not measure.is_right]
        remark = result.problem or ", ".join([finding.name for finding in result.findings] or wrong)
        yield str(number), _title(result), result.verdict.value, f"{result.duration:.1f} s", remark


def _node_rows(nodes: Sequence[NodeDescription]) -> Iterator[Row]:
    for node in nodes:
        yield (
            str(node.node_id),
            node.device_name or "",
            node.profile or "",
            _hex(node.vendor_id),
            _hex(node.product_code),
            _hex(node.revision_number),
            _hex(node.serial_number),
            f"{node.hardware_version or '-'} / {node.software_version or '-'}",
        )


def _setting_rows(found: Commissioning) -> Iterator[Row]:
    for setting in found.returned.settings:
        yield (
            str(setting.node_id),
            str(setting),
            setting.text(setting.before),
            setting.text(setting.during),
            f"not restored: {setting.problem}" if setting.problem else "restored",
        )


_SETTING_HEAD = ("node", "object", "before", "during", "after")
_NODE_HEAD = ("node", "name", "profile", "vendor", "product", "revision", "serial", "HW / SW")
_SUMMARY_HEAD = ("", "step", "verdict", "time", "remark")
_MEASURE_HEAD = ("measure", "value", "right", "")


def _hex(number: int | None) -> str:
    return "-" if number is None else f"0x{number:08X}"


def _measure_row(measure: measures.Measure) -> Row:
    known = "pass" if measure.is_right else "FAIL" if measure.is_wrong else "unknown"
    mark = known if measure.is_judged else ""
    return measure.name, measure.text(), measure.range_text(), mark


def _markdown(found: Commissioning, head: ReportHead, pictures: Mapping[str, Path]) -> str:
    lines = [f"# {plain(head.title)}", "", f"**{found.verdict}**", ""]
    lines += _markdown_table(("", ""), list(head.facts.items()))
    for finding in found.findings:
        lines += ["", f"- {_markdown_finding(finding)}"]
    lines += ["", "## Steps", "", *_markdown_table(_SUMMARY_HEAD, list(_summary_rows(found)))]
    lines += ["", "## Nodes", "", *_markdown_table(_NODE_HEAD, list(_node_rows(found.nodes)))]
    if rows := list(_setting_rows(found)):
        lines += ["", "## Settings", "", *_markdown_table(_SETTING_HEAD, rows)]
    for number, result in enumerate(found.results, start=1):
        lines += ["", f"## {number}. {_title(result)}: {result.verdict}", ""]
        lines += [plain(result.problem), ""] if result.problem else []
        for finding in result.findings:
            lines += [_markdown_finding(finding), ""]
        if result.measures:
            lines += _markdown_table(_MEASURE_HEAD, [_measure_row(m) for m in result.measures])
        lines += ["", *(f"- {plain(note)}" for note in result.notes)] if result.notes else []
        if result.kind in pictures:
            lines += ["", f"![{_title(result)}]({pictures[result.kind].name})"]
    return "\n".join(lines) + "\n"


def _markdown_table(head: Row, rows: Sequence[Row]) -> list[str]:
    return [f"| {' | '.join(map(cell, row))} |" for row in (head, ["---"] * len(head), *rows)]


def _markdown_finding(finding: measures.Diagnosis) -> str:
    return f"**{plain(finding.name)}**: {plain(finding.evidence)}. {plain(finding.mend)}."


def _html(found: Commissioning, head: ReportHead, pictures: Mapping[str, Path]) -> str:
    parts = [
        (
            '<!doctype html><html lang="en"><head><meta charset="utf-8">'
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
            f"<title>{escape(head.title)}</title><style>{_STYLE}</style></head><body>"
        ),
        f"<h1>{escape(head.title)}</h1><p>{_badge(found.verdict)}</p>",
        _html_table((), list(head.facts.items())),
    ]
    parts += [
        _html_finding(finding.name, finding.evidence, finding.mend) for finding in found.findings
    ]
    parts += ["<h2>Steps</h2>", _html_table(_SUMMARY_HEAD, list(_summary_rows(found)))]
    parts += ["<h2>Nodes</h2>", _html_table(_NODE_HEAD, list(_node_rows(found.nodes)))]
    if rows := list(_setting_rows(found)):
        parts += ["<h2>Settings</h2>", _html_table(_SETTING_HEAD, rows)]
    for number, result in enumerate(found.results, start=1):
        parts.append(f"<h2>{number}. {escape(_title(result))} {_badge(result.verdict)}</h2>")
        parts.append(f"<p>{escape(result.problem)}</p>" if result.problem else "")
        parts += [_html_finding(f.name, f.evidence, f.mend) for f in result.findings]
        if result.measures:
            parts.append(_html_table(_MEASURE_HEAD, [_measure_row(m) for m in result.measures]))
        if result.notes:
            notes = "".join(f"<li>{escape(note)}</li>" for note in result.notes)
            parts.append(f"<ul>{notes}</ul>")
        if result.kind in pictures:
            parts.append(_html_picture(pictures[result.kind], result))
    return "\n".join((*filter(None, parts), "</body></html>\n"))


def _html_table(head: Row, rows: Sequence[Row]) -> str:
    body = "".join(f"<tr>{''.join(map(_html_cell, row))}</tr>" for row in rows)
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    return f"<table>{f'<tr>{names}</tr>' if head else ''}{body}</table>"


def _html_cell(text: str) -> str:
    is_verdict = text in {"pass", "FAIL", *(verdict.value for verdict in measures.Verdict)}
    return f"<td>{_badge(text) if is_verdict else escape(text)}</td>"


def _badge(text: str) -> str:
    kind = {"pass": "passed", "FAIL": "failed"}.get(text, text)
    return f'<span class="verdict {escape(kind)}">{escape(text)}</span>'


def _html_finding(name: str, evidence: str, mend: str) -> str:
    return f'<div class="finding"><b>{escape(name)}</b>: {escape(evidence)}. {escape(mend)}.</div>'


def _html_picture(path: Path, result: measures.StepResult) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    kind = "" if result.curves else ' class="narrow"'
    return f'<img{kind} alt="{escape(_title(result))}" src="data:image/png;base64,{data}">'
