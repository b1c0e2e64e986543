"""The report: one Markdown page with figures and tables, the paper's words next to what was measured."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

from companion.errors import LandslopeError

COLOURS = {"quadratic": "#d95f02", "map": "#1f6fb4"}
OTHER_COLOUR = "#6a6a6a"


@dataclass(frozen=True)
class Table:
    """A table with a caption; all cells are text."""

    caption: str
    header: list[str]
    rows: list[list[str]]


@dataclass(frozen=True)
class Comparison:
    """One line of "paper says / we measure"."""

    what: str
    paper: str
    measured: str


@dataclass
class Section:
    """One experiment's part of the report."""

    title: str
    text: str
    figures: list[tuple[str, str]] = field(default_factory=list)
    """(file name, caption)."""
    tables: list[Table] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)


def new_figure(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple["Figure", Any]:
    """A figure and its axes (rows, columns), drawn without a display."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise LandslopeError("the report's figures need matplotlib: pip install 'landslope[plot]'") from error
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for axis in axes.ravel():
        axis.grid(True, color="0.92", linewidth=0.8)
        axis.set_axisbelow(True)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    return figure, axes


def _few(value: float, _: float) -> str:
    """A label at 2 and 5 of a decade."""
    text = f"{value:g}"
    return text if text.strip("0.")[:1] in ("2", "5") and len(text.strip("0.")) == 1 else ""


def save(figure: "Figure", out: Path, name: str) -> str:
    """Write a figure beside the report; returns the file's name."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_scale() == "log":
                axis.set_major_formatter("{x:g}")
                low, high = sorted(axis.get_view_interval())
                # Over less than two decades the decades alone are too few labels.
                axis.set_minor_formatter(_few if high < 100 * low else "")
    figure.savefig(out / name, dpi=110)
    return name


def markdown_table(table: Table) -> str:
    """The table in Markdown."""
    lines = [table.caption, "", "| " + " | ".join(table.header) + " |", "|" + "---|" * len(table.header)]
    lines += ["| " + " | ".join(row) + " |" for row in table.rows]
    return "\n".join(lines)


def write_report(out: Path, sections: list[Section], settings: str) -> Path:
    """Write ``report.md``; returns its path."""
    lines = ["# The paper's experiments, run again", "", settings, "", "## Paper says / we measure", ""]
    summary = [[s.title.split(":")[0], c.what, c.paper, c.measured] for s in sections for c in s.comparisons]
    lines += [markdown_table(Table("", ["figure", "what", "paper says", "we measure"], summary)).lstrip(), ""]
    for section in sections:
        lines += [f"## {section.title}", "", section.text, ""]
        for name, caption in section.figures:
            lines += [f"![{caption}]({name})", "", f"*{caption}*", ""]
        for table in section.tables:
            lines += [markdown_table(table), ""]
    path = out / "report.md"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path
