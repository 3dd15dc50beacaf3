"""Figures of studies as PNG files. The only file of the simulator that knows matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.errors import UsageError

_WIDTH_IN = 10.0
_PANEL_HEIGHT_IN = 2.6
_DPI = 120
_MOST_POINTS = 4000
# Colours of Okabe and Ito, which colour-blind readers tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#666666")
_STYLE = {
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": "medium",
    "axes.formatter.useoffset": False,
    "font.size": 10.0,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
}


@dataclass(frozen=True)
class Curve:
    """One line, or points where ``style`` says so (matplotlib's words, such as ``--`` or ``o``; ``k`` before: black).

    ``colour`` is a number of ``COLOURS``, None for the next one; ``emphasis`` a width relative to the others.
    """

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    style: str = "-"
    colour: int | None = None
    emphasis: float = 1.0


@dataclass(frozen=True)
class Panel:
    """One pair of axes; ``scales`` as matplotlib names them, ``height`` relative to other panels."""

    y_label: str
    curves: Sequence[Curve]
    title: str = ""
    x_label: str = ""
    scales: tuple[str, str] = ("linear", "linear")
    is_map: bool = False
    height: float = 1.0
    notes: Sequence[tuple[float, float, str]] = ()


@dataclass(frozen=True)
class Bars:
    """Horizontal bars over a logarithmic axis that begins at ``least``; each group has a value for each label."""

    x_label: str
    labels: Sequence[str]
    groups: Sequence[tuple[str, Sequence[float]]]
    title: str = ""
    least: float = 1e-3


@dataclass(frozen=True)
class Chart:
    """A figure: panels in ``columns`` columns, row by row, that share their x axes when ``shares_x``; or bars.

    ``has_one_legend``: all panels have the same curves, and one legend below them.
    """

    name: str
    panels: Sequence[Panel] = ()
    bars: Bars | None = None
    title: str = ""
    columns: int = 1
    shares_x: bool = True
    has_one_legend: bool = False


def load_pyplot() -> Any:
    """matplotlib's pyplot, drawing to files. Raises UsageError where it is not installed."""
    try:
        import matplotlib as mpl

        mpl.use("Agg")
        from matplotlib import pyplot
    except ImportError:
        raise UsageError(
            "figures need matplotlib, which is not installed: pip install 'firmware-sim[figures]'"
        ) from None
    return pyplot


def draw(chart: Chart, directory: Path) -> Path:
    """Draw a chart into a folder; give the path of its PNG."""
    pyplot = load_pyplot()
    path = directory / f"{chart.name}.png"
    with pyplot.rc_context(_STYLE):
        figure = _bar_figure(pyplot, chart.bars) if chart.bars else _panel_figure(pyplot, chart)
        if chart.title:
            figure.suptitle(chart.title)
        # No time of making and no version in the file: the same study gives the same bytes.
        figure.savefig(path, dpi=_DPI, metadata={"Software": None})
        pyplot.close(figure)
    return path


def _panel_figure(pyplot: Any, chart: Chart) -> Any:
    rows = -(-len(chart.panels) // chart.columns)
    heights = [
        max(panel.height for panel in chart.panels[row * chart.columns :][: chart.columns]) for row in range(rows)
    ]
    figure, axes = pyplot.subplots(
        rows,
        chart.columns,
        figsize=(_WIDTH_IN, _PANEL_HEIGHT_IN * sum(heights) + 0.6),
        sharex="col" if chart.shares_x else False,
        squeeze=False,
        layout="constrained",
        gridspec_kw={"height_ratios": heights},
    )
    for place, panel in zip(axes.ravel(), chart.panels, strict=False):
        _draw_panel(place, panel, has_legend=not chart.has_one_legend)
    if chart.has_one_legend:
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
    for unused in axes.ravel()[len(chart.panels) :]:
        unused.set_visible(False)
    return figure


def _draw_panel(axes: Any, panel: Panel, has_legend: bool) -> None:
    for number, curve in enumerate(panel.curves):
        stride = max(1, len(curve.x) // _MOST_POINTS)
        axes.plot(
            curve.x[::stride],
            curve.y[::stride],
            curve.style.removeprefix("k"),
            label=curve.label or None,
            color=_colour(curve, number),
            linewidth=1.2 * curve.emphasis,
            markersize=5,
        )
    axes.set_xscale(panel.scales[0])
    axes.set_yscale(panel.scales[1])
    axes.set_ylabel(panel.y_label)
    axes.set_xlabel(panel.x_label)
    axes.set_title(panel.title, loc="left")
    if panel.is_map:
        axes.set_aspect("equal", adjustable="datalim")
    for x, y, text in panel.notes:
        axes.annotate(text, (x, y), textcoords="offset points", xytext=(6, 6), fontsize="small")
    if has_legend and any(curve.label for curve in panel.curves):
        axes.legend(loc="best", fontsize="small")


def _colour(curve: Curve, number: int) -> str:
    if curve.style.startswith("k"):
        return "black"
    return COLOURS[(number if curve.colour is None else curve.colour) % len(COLOURS)]


def _bar_figure(pyplot: Any, bars: Bars) -> Any:
    count = len(bars.groups)
    thickness = 0.8 / count
    height = len(bars.labels) * max(0.3, 0.16 * count) + 1.2
    figure, axes = pyplot.subplots(figsize=(_WIDTH_IN, height), layout="constrained")
    places = np.arange(len(bars.labels))
    for number, (label, values) in enumerate(bars.groups):
        shown = np.maximum(np.asarray(values, dtype=float), bars.least)
        offset = (number - 0.5 * (count - 1)) * thickness
        drawn = axes.barh(places + offset, shown, thickness, label=label or None, color=COLOURS[number % len(COLOURS)])
        axes.bar_label(drawn, [f"{value:.2g}" if value < 100 else f"{value:,.0f}" for value in values], padding=3)
    axes.set_yticks(places, bars.labels)
    axes.margins(y=0.01)
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlim(left=bars.least)
    axes.set_xlabel(bars.x_label)
    axes.set_title(bars.title, loc="left")
    axes.grid(False, axis="y")
    if any(label for label, _ in bars.groups):
        axes.legend(loc="best", fontsize="small")
    return figure
