"""Figures of a recording, as PNG files or inside a page. The only file of the host that knows matplotlib."""

from __future__ import annotations

import copy
import io
import math
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from host.curves import (
    Columns,
    Floats,
    Panel,
    Plan,
    Thinner,
    described_plan,
    is_navigation,
    navigation_plans,
    on_the_main_branch,
)
from host.ellipsoid import metres_per_degree
from host.errors import UsageError
from host.files import replacing
from host.schema import Layout
from host.source import Recording, Source
from host.spectra import Spectra, Spectrum, is_spectrum
from host.stats import Survey, choose_frame, survey

TRACK = "track"
SPECTRUM = "spectrum"
_WIDTH_IN = 11.0
_DPI = 130
# A group of points for each pixel column of a figure.
PIXEL_COLUMNS = int(_WIDTH_IN * _DPI)
# x or east, y or north, z or up; the colours of Okabe and Ito, which colour-blind readers tell apart.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#666666")
_DARK_COLOURS = ("#56B4E9", "#FF9A4D", "#35C69B", "#E39AC6", "#7FA8FF", "#F0C24B", "#B0B0B0")
_MANY_CURVES = len(_COLOURS)
_STYLE = {
    "axes.prop_cycle": f"cycler('color', {_COLOURS})",
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": "medium",
    "font.size": 10.0,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "lines.linewidth": 1.0,
    "agg.path.chunksize": 10_000,
    # A text of the line is no formula.
    "text.parse_math": False,
    "svg.hashsalt": "nav-host",
}
_PALE = "#d8d8d8"
_DARK = {
    "axes.prop_cycle": f"cycler('color', {_DARK_COLOURS})",
    "axes.edgecolor": _PALE,
    "axes.labelcolor": _PALE,
    "axes.titlecolor": _PALE,
    "grid.color": "#80868c",
    "text.color": _PALE,
    "xtick.color": _PALE,
    "ytick.color": _PALE,
}
# A few units of the described position (6 mm).
_LEAST_HALF_SIDE_M = 0.05
_NEAR_LIMIT = 0.3
# Of a frame's name in a file's name, which has 255 bytes at the most.
_MOST_NAME = 200


@dataclass
class Chart:
    """A frame's figures while the recording is read: their plans, and the thinned points of each column."""

    plans: list[Plan]
    columns: Columns
    curves: dict[str, Thinner]
    track: Thinner | None
    spectra: Spectra | None = None


def plot(source: Source, directory: Path) -> list[Path]:
    """Draws the figures of a recording into a directory (made if it is not there); gives their paths.

    Raises UsageError when matplotlib is missing, the directory cannot be written, or nothing can be decoded.
    """
    pyplot = load_pyplot()
    found = survey(source)
    choose_frame(found, None)
    make_directory(directory)
    charts = _charts(found)
    _read(source, charts)
    return _save(pyplot, _drawn(pyplot, source, charts), source, directory)


def plot_curves(plans: Iterable[Plan], curves: dict[str, Thinner], source: Source, directory: Path) -> list[Path]:
    """Draws figures of curves over board time into a directory that is there; gives their paths."""
    pyplot = load_pyplot()
    chart = Chart(list(plans), Columns(), curves, None)
    return _save(pyplot, _drawn(pyplot, source, {"": chart}), source, directory)


def svg_figures(found: Survey) -> Iterator[tuple[str, bytes, bytes]]:
    """The figures of a surveyed recording as SVG on a transparent ground: name, for a light and for a dark page."""
    pyplot = load_pyplot()
    charts = _charts(found)
    _read(found.source, charts)
    # Drawing ends the curves.
    pages = [(copy.deepcopy(charts), _STYLE), (charts, _STYLE | _DARK)]
    drawn = [_svgs(pyplot, _drawn(pyplot, found.source, chart), style) for chart, style in pages]
    for (name, light), (_, dark) in zip(*drawn, strict=True):
        yield name, light, dark


def _svgs(pyplot: Any, figures: Iterator[tuple[str, Any]], style: dict[str, Any]) -> Iterator[tuple[str, bytes]]:
    while True:
        with pyplot.rc_context(style):
            drawn = next(figures, None)
            if drawn is None:
                return
            name, figure = drawn
            file = io.BytesIO()
            try:
                _savefig(figure, file, format="svg", transparent=True, metadata={"Date": None})
            finally:
                pyplot.close(figure)
        yield name, file.getvalue()


def _save(pyplot: Any, figures: Iterator[tuple[str, Any]], source: Source, directory: Path) -> list[Path]:
    paths = []
    with pyplot.rc_context(_STYLE):
        for figure_name, figure in figures:
            path = directory / f"{figure_name}.png"
            try:
                with replacing(path, source.path) as partial:
                    _savefig(figure, partial, format="png", dpi=_DPI)
            finally:
                pyplot.close(figure)
            paths.append(path)
    return paths


def _savefig(figure: Any, file: Any, **how: Any) -> None:
    """A letter that no font has, or axes without room, are drawn as well as can be: no news for the terminal."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        figure.savefig(file, **how)


def load_pyplot() -> Any:
    try:
        import matplotlib as mpl

        mpl.use("Agg")
        from matplotlib import pyplot
    except ImportError:
        raise UsageError(
            "figures need matplotlib, which is not installed: pip install 'firmware-sim[figures]'"
        ) from None
    return pyplot


def make_directory(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise UsageError(f"{directory}: expected a directory for the figures, found a file") from None
    except OSError as error:
        raise UsageError(f"{directory}: cannot be made: {error.strerror}") from None


def _charts(found: Survey) -> dict[str, Chart]:
    """A chart for each frame name; the most frequent frame with a position gets the navigation figures."""
    charts: dict[str, Chart] = {}
    taken: set[str] = set()
    has_navigation = False
    for name in found.frame_names():
        layouts = found.layouts(name)
        layout = layouts[-1]
        seen = {field: words for (frame, field), words in found.words.items() if frame == name}
        stride = math.ceil(sum(found.frames[each] for each in layouts) / PIXEL_COLUMNS)
        navigation = is_navigation(layout) and not has_navigation
        spectra = Spectra(layout) if is_spectrum(layout) else None
        plans: list[Plan] = []
        if navigation:
            has_navigation = True
            plans = list(navigation_plans(layout, seen, found.board_rate(name)))
        elif spectra is None:
            plans = [described_plan(layout, _file_name(layout, taken), seen)]
        taken.update(plan.name for plan in plans)
        curves = {
            column: Thinner(stride, watched=[1]) for plan in plans for panel in plan.panels for column in panel.columns
        }
        charts[name] = Chart(
            plans,
            Columns(found.board_rate(name) or 1.0),
            curves,
            Thinner(stride, watched=[1, 2]) if navigation else None,
            spectra,
        )
    return charts


def _file_name(layout: Layout, taken: set[str]) -> str:
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", layout.name)[:_MOST_NAME]
    return f"frame_{layout.type}_{name}" if not name.strip("_") or name in taken else f"frame_{name}"


def _read(source: Source, charts: dict[str, Chart]) -> None:
    """The second reading: every point passes through the thinners of its frame."""
    sessions: dict[str, int] = {}
    for batch in source.batches(Recording()):
        name = batch.layout.name
        chart = charts[name]
        thinners = [*chart.curves.values()] + ([chart.track] if chart.track else [])
        if sessions.setdefault(name, batch.session) != batch.session:
            sessions[name] = batch.session
            for thinner in thinners:
                thinner.interrupt()
        columns = chart.columns.of(batch)
        time = columns[Columns.TIME]
        for column, thinner in chart.curves.items():
            if column in columns:
                known = ~np.isnan(columns[column])
                thinner.add(np.column_stack((time[known], columns[column][known])))
        if chart.spectra is not None:
            chart.spectra.add(batch)
        if chart.track is not None and is_navigation(batch.layout):
            chart.track.add(np.column_stack((time, columns["longitude"], columns["latitude"])))


def _drawn(pyplot: Any, source: Source, charts: dict[str, Chart]) -> Iterator[tuple[str, Any]]:
    for chart in charts.values():
        for plan in chart.plans:
            if plan.panels:
                yield plan.name, _draw_plan(pyplot, source, plan, chart)
        if chart.track is not None:
            yield TRACK, _draw_track(pyplot, source, chart.track.rows())
        if chart.spectra is not None and (spectra := list(chart.spectra.spectra())):
            yield SPECTRUM, _draw_spectra(pyplot, source, spectra, chart.spectra.unit)


def _draw_plan(pyplot: Any, source: Source, plan: Plan, chart: Chart) -> Any:
    heights = [_height_in(panel) for panel in plan.panels]
    figure, axes = pyplot.subplots(
        len(plan.panels),
        1,
        sharex=True,
        squeeze=False,
        layout="constrained",
        figsize=(_WIDTH_IN, sum(heights) + 0.8),
        height_ratios=heights,
    )
    _head(figure, source, plan.title)
    for axis, panel in zip(axes[:, 0], plan.panels, strict=True):
        draw = _draw_lanes if panel.lanes else _draw_curves
        draw(axis, panel, chart)
        for start in chart.columns.session_starts:
            axis.axvline(start, color="0.4", linewidth=0.8, linestyle=":")
    time_title = chart.columns.time_title
    if chart.columns.session_starts:
        time_title += "; sessions one after the other, divided by dotted lines"
    axes[-1, 0].set_xlabel(time_title)
    figure.align_ylabels()
    return figure


def _height_in(panel: Panel) -> float:
    return 0.6 + 0.24 * len(panel.columns) if panel.lanes else 2.1


def _head(figure: Any, source: Source, title: str) -> None:
    figure.suptitle(f"{title} — {source.path.name}", x=0.01, ha="left", fontsize="large")


def _draw_curves(axis: Any, panel: Panel, chart: Chart) -> None:
    drawn: list[Floats] = []
    for number, column in enumerate(panel.columns):
        rows = chart.curves[column].rows()
        known = ~np.isnan(rows[:, 1])
        if column in chart.columns.unwrapped and known.any():
            rows[:, 1] = on_the_main_branch(rows[:, 1])
        drawn.append(rows[known, 1])
        # A legend leaves out names that begin with a line.
        axis.plot(rows[:, 0], rows[:, 1], color=f"C{number}", label=f" {column}" if column.startswith("_") else column)
    axis.set_ylabel(panel.title)
    axis.margins(x=0.01)
    axis.ticklabel_format(axis="y", useOffset=False)
    values = np.concatenate(drawn)
    _scale(axis, values)
    if panel.note:
        axis.set_title(panel.note, loc="right")
    if panel.limit is not None and len(values):
        _draw_limit(axis, panel.limit, float(values.max()))
    if len(panel.columns) > 1:
        axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=_MANY_CURVES, borderaxespad=0.0)


def _scale(axis: Any, values: Floats) -> None:
    """Whole numbers get whole ticks, and what is always zero an axis from 0 to 1."""
    if not values.any():
        axis.set_ylim(-0.05, 1.05)
        axis.set_yticks((0, 1))
    elif np.array_equal(values, np.round(values)):
        axis.locator_params(axis="y", integer=True)


def _draw_limit(axis: Any, limit: float, peak: float) -> None:
    """Says how much of the limit the peak takes; draws the line only where it does not press the curve flat."""
    axis.set_title(f"peak {peak:,.0f} = {peak / limit:.1%} of the tick's {limit:,.0f}", loc="right")
    if peak > _NEAR_LIMIT * limit:
        axis.axhline(limit, color="C1", linewidth=1.0, linestyle="--")


def _draw_lanes(axis: Any, panel: Panel, chart: Chart) -> None:
    names = [column.removeprefix(f"{panel.title}: ") for column in panel.columns]
    for number, column in enumerate(panel.columns):
        rows = chart.curves[column].rows()
        axis.fill_between(
            rows[:, 0],
            number + 0.35,
            number + 0.35 - 0.7 * rows[:, 1],
            step="post",
            color=f"C{number}",
            linewidth=0.8,
        )
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_ylabel(panel.title)
    axis.margins(x=0.01)


def _draw_spectra(pyplot: Any, source: Source, spectra: list[Spectrum], unit: str) -> Any:
    size = (_WIDTH_IN, 2.1 * len(spectra) + 0.8)
    figure, axes = pyplot.subplots(len(spectra), 1, sharex=True, squeeze=False, layout="constrained", figsize=size)
    _head(figure, source, "Spectrum")
    for axis, spectrum in zip(axes[:, 0], spectra, strict=True):
        for number, (label, amplitudes) in enumerate((("greatest", spectrum.greatest), ("mean", spectrum.mean))):
            # Nothing has no place on a logarithmic scale.
            shown = np.where(amplitudes > 0.0, amplitudes, np.nan)
            axis.semilogy(spectrum.frequency_hz, shown, color=f"C{1 - number}", label=label)
        axis.yaxis.set_major_formatter("{x:g}")
        axis.set_ylabel(f"{spectrum.axis} [{unit}]")
        axis.margins(x=0.01)
    axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
    axes[-1, 0].set_xlabel("frequency [Hz]")
    return figure


def _draw_track(pyplot: Any, source: Source, rows: Floats) -> Any:
    """Longitude against latitude with one scale in metres, which the upper and right axes show from the start."""
    figure, axis = pyplot.subplots(figsize=(9.0, 8.0), layout="constrained")
    _head(figure, source, "Track")
    longitude, latitude = on_the_main_branch(rows[:, 1]), rows[:, 2]
    known = ~np.isnan(longitude)
    axis.plot(longitude, latitude, color="C0")
    axis.plot(longitude[0], latitude[0], "o", color="C2", markersize=13, label="start")
    axis.plot(longitude[-1], latitude[-1], "s", color="C1", markersize=6, label="end")
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.07), ncols=2, borderaxespad=0.0)
    east_m, north_m = metres_per_degree(float(latitude[0]))
    # At a pole there should still be something to draw.
    east_m = max(east_m, math.radians(1.0))
    # A square of one scale in metres, with a margin around the longer side.
    half_m = max(0.55 * np.ptp(longitude[known]) * east_m, 0.55 * np.ptp(latitude[known]) * north_m, _LEAST_HALF_SIDE_M)
    for values, metres, set_limits in ((longitude, east_m, axis.set_xlim), (latitude, north_m, axis.set_ylim)):
        middle = (np.min(values[known]) + np.max(values[known])) / 2
        set_limits(middle - half_m / metres, middle + half_m / metres)
    axis.set_aspect(north_m / east_m)
    axis.set(xlabel="longitude [deg]", ylabel="latitude [deg]")
    axis.ticklabel_format(useOffset=False, style="plain")
    axis.locator_params(nbins=6)
    for make, origin, metres, label in (
        (axis.secondary_xaxis, longitude[0], east_m, "east of the start [m]"),
        (axis.secondary_yaxis, latitude[0], north_m, "north of the start [m]"),
    ):
        where = "top" if make == axis.secondary_xaxis else "right"
        make(where, functions=_metre_scale(origin, metres)).set(**{f"{'xy'[where == 'right']}label": label})
    return figure


def _metre_scale(origin_deg: float, degree_m: float) -> tuple[Any, Any]:
    return lambda degrees: (degrees - origin_deg) * degree_m, lambda metres: metres / degree_m + origin_deg
