"""Figures of the flight study over time: the block with its map, the outage of GPS, consistency, height.

See Mirzababaei & Akbari, sections 3 to 5. The paper prints no result of a flight.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.ticker import LogLocator, NullFormatter
from scipy.stats import chi2

from positioning.evaluation.studies.sar_flight import LIMIT_M, SENSORS, nees_of
from positioning.evaluation.tracks import Answer, answers
from positioning.files import read_tree
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.style import GREY, stroke
from positioning.presentation.tables import central_of, metres

MAPS = ("slam", "slam_15")
"""Rows whose maps are drawn; the plan shows the first of them that ran."""

OUTAGE = ("gps_inertial", "slam", "slam_new_ground", "wlpf", "slam_wlpf")
PLACE = ("slam", "wlpf", "slam_wlpf", "wlpf_15", "slam_wlpf_15")
WEAK = {
    "white": ("gps_inertial_15", "slam_15", "slam_wlpf_15"),
    "weak": ("gps_inertial_15", "slam_weak_15", "slam_wlpf_weak_15"),
}
CONSISTENT = ("gps_inertial", "gps_inertial_15", "slam", "slam_15", "slam_wlpf", "slam_wlpf_15")
NINE, FIFTEEN = "9 states", "15 states"

BEFORE_S, AFTER_S = 10.0, 10.0
"""What is drawn before and after the outage."""

STATES = 9

NO_RESULT = "The paper prints no result of a flight."
ASSUMED = "Course, sensors and noises are assumed; what is assumed is told with the settings."

SENSOR_WORDS = {"gps": "GPS", "fix": "fingerprint fixes", "sighting": "sightings"}

TRUE_COLOR, WALL_COLOR, OUTAGE_COLOR = "#111111", "#9aa4ac", "#f0c48a"

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass
class Flight:
    """What a row answered in a family of worlds, as time series over all worlds of the first batch.

    Attributes
    ----------
    time_s
        From the begin of the outage, [w, n].
    length_s
        Of the outage, [w].
    error_m, height_error_m, nees
        Horizontal error, absolute error of the height, and normalised error squared of nine states, [w, n];
        the last two are empty where the row does not tell them.
    """

    time_s: Array
    length_s: Array
    error_m: Array
    height_error_m: Array
    nees: Array


class Panel(NamedTuple):
    """A panel over time: its title, its family of worlds, the rows in it."""

    title: str
    family: str
    rows: tuple[str, ...]


@dataclass
class Flights:
    """Time series of all rows, each archive read once.

    Attributes
    ----------
    study
        All results.
    """

    study: Study
    _found: dict[tuple[str, str], Flight] = field(default_factory=dict)
    _read: set[str] = field(default_factory=set)

    def get(self, family: str, row: str) -> Flight | None:
        """Return the time series of a row in a family; None where it has none."""
        if row not in self._read:
            self._read.add(row)
            for answer in self._answers(row):
                flight = _flight(answer)
                if flight is not None:
                    self._found[answer.family, row] = flight
        return self._found.get((family, row))

    def panels(self, panels: Iterable[Panel], quantity: str = "error_m") -> list[Panel]:
        """Return the panels with the rows that tell a quantity; those without any are left out."""
        kept = [
            panel._replace(rows=tuple(row for row in panel.rows if self._tells(panel.family, row, quantity)))
            for panel in panels
        ]
        return [panel for panel in kept if panel.rows]

    def _tells(self, family: str, row: str, quantity: str) -> bool:
        flight = self.get(family, row)
        return flight is not None and bool(np.size(getattr(flight, quantity)))

    def _answers(self, row: str) -> Iterator[Answer]:
        results = self.study.results
        own = [path for path in results.estimate_files if Path(path).parent.name == row]
        if not own or row not in results.rows:
            return
        path = min(own)
        # Worlds and estimates are those of the first batch; the names of its files do not matter.
        tree = {
            branch: step
            for branch, step in read_tree(path).items()
            if branch.endswith("/0") and branch.removesuffix("/0") in results.truth
        }
        batch = Path(path).stem
        sides = {f"{batch}/observed.npz": results.observed, f"{batch}/truth.npz": results.truth}
        yield from answers({path: tree}, sides)


def draw_flights(study: Study) -> dict[str, Drawn]:
    """Return the figures over time by name; what a configuration leaves out is left out.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    flights = Flights(study)
    drawn = [
        _block(study),
        _outage(flights),
        _outage_place(flights),
        _weak(flights),
        _consistency(flights),
        _height(flights),
    ]
    return {item.name: item for item in drawn if item is not None}


def _flight(answer: Answer) -> Flight | None:
    """Return the time series of an answer; None where its worlds have no outage."""
    if not {"recording.time_s", "recording.gps_outage_s"} <= answer.observed.keys():
        return None
    begin_s, end_s = np.asarray(answer.observed["recording.gps_outage_s"], dtype=float).T
    if np.isnan(begin_s).any():
        return None
    time_s = np.asarray(answer.observed["recording.time_s"], dtype=float)
    true_m = np.asarray(answer.truth["truth.position_m"], dtype=float)
    error_m = np.linalg.norm(np.asarray(answer.estimates["position_m"], dtype=float) - true_m, axis=-1)
    height_m, nees = np.empty((2, 0, 0))
    if "extra_height_m" in answer.estimates:
        found_m = np.asarray(answer.estimates["extra_height_m"], dtype=float)
        height_m = np.abs(found_m - np.asarray(answer.truth["truth.height_m"], dtype=float))
    if "extra_covariance_9" in answer.estimates:
        nees = nees_of(answer)
    return Flight(time_s - begin_s[:, None], end_s - begin_s, error_m, height_m, nees)


def _block(study: Study) -> Drawn | None:
    family = study.families[0]
    observed, truth = (study.first_world(side, family) for side in ("observed", "truth"))
    if not {"recording.time_s", "recording.gps_outage_s"} <= observed.keys() or "truth.path_m" not in truth:
        return None
    maps = {row: study.results.estimate(row, family) for row in MAPS if row in study.results.rows}
    maps = {row: found for row, found in maps.items() if len(found.get("extra_landmark_m", ()))}
    true_m = truth.get("truth.landmark_m", np.empty((0, 3)))
    known = {row: _map_errors(found, true_m) for row, found in maps.items()}
    known = {row: own for row, own in known.items() if len(own.error_m)}
    figure = figures.new_figure(4.3)
    if known:
        plan, side = figure.subfigures(1, 2, width_ratios=[2.1, 1], squeeze=False).ravel()
        axes = plan.subplots()
        beside = np.atleast_1d(side.subplots(len(known), 1))
    else:
        axes, beside = figure.subplots(), np.empty(0)
    for wall_m in observed.get("site.wall_m", np.empty((0, 2, 2))):
        axes.plot(*wall_m.T, color=WALL_COLOR, linewidth=1.4)
    begin_s, end_s = observed["recording.gps_outage_s"]
    path_m, time_s = truth["truth.path_m"], observed["recording.time_s"]
    away = (time_s > begin_s) & (time_s <= end_s)
    axes.plot(*path_m.T, color=TRUE_COLOR, linewidth=0.9, label="true path")
    axes.plot(
        *path_m[away].T,
        color=OUTAGE_COLOR,
        linewidth=5,
        solid_capstyle="butt",
        zorder=1,
        label="outage of GPS",
    )
    axes.plot(*true_m[:, :2].T, "x", color=TRUE_COLOR, markersize=4, label="landmarks")
    told = []
    for row, own in list(known.items())[:1]:
        axes.plot(*own.place_m.T, ".", color=stroke(row).color, markersize=4, label=f"map of {row}, 95 %")
        for place_m, covariance_m2 in zip(own.place_m, own.covariance_m2, strict=True):
            _ellipse(axes, place_m, covariance_m2, row)
    for panel, (row, own) in zip(beside, known.items(), strict=True):
        panel.axhline(0, color=GREY, linewidth=0.7)
        panel.axvline(0, color=GREY, linewidth=0.7)
        panel.plot(*own.error_m.T, ".", color=stroke(row).color, markersize=4)
        for error_m, covariance_m2 in zip(own.error_m, own.covariance_m2, strict=True):
            _ellipse(panel, error_m, covariance_m2, row)
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_xlabel("east error (m)")
        panel.set_title(f"{row}: {own.inside} of {len(own.error_m)}")
        panel.set_ylabel("north error (m)")
        median_m = metres(float(np.median(np.linalg.norm(own.error_m, axis=1))))
        told.append(
            f"{row}: median error of the map {median_m} m, the 95 % ellipse holds the landmark in"
            f" {own.inside} of {len(own.error_m)} cases"
        )
    if known:
        told.append(_in_their_ellipse(study, family, {row: maps[row] for row in known}))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2, borderaxespad=0.2)
    words = f"{'. '.join(told)}." if told else "No map was made."
    seen = f", {len(true_m)} landmarks" if len(true_m) else ""
    return Drawn(
        name="block",
        figure=figure,
        title="The flight around a block, and the map",
        caption=f"One flight, n = {len(time_s)} epochs of the first world of family {family}{seen}; GPS is"
        f" out from {begin_s:g} to {end_s:g} s. Ellipses are the 95 % ones of the horizontal covariance at"
        f" the end; beside, the errors of the same maps, with the number of ellipses that hold zero."
        f" {words} Errors of one map are not independent:"
        f" all hang on the same flight. {ASSUMED} {NO_RESULT}",
        alt=f"Plan of a block with a flight of {time_s[-1]:.0f} s around it{seen}, outage of"
        f" {end_s - begin_s:g} s. {words}",
    )


def _in_their_ellipse(study: Study, family: str, maps: Mapping[str, Mapping[str, Any]]) -> str:
    """Return in words in how many cases of all worlds the ellipse holds the landmark, and why in few."""
    true_m = np.asarray(study.results.truth[family]["truth.landmark_m"], dtype=float)
    shares = []
    for row, found in maps.items():
        count = min(len(true_m), len(found["extra_landmark_m"]))
        own = [_map_errors(found, true_m[number], number) for number in range(count)]
        cases = sum(len(one.error_m) for one in own)
        percent = 100 * sum(one.inside for one in own) / cases
        shares.append(f"{row} {percent:.0f} % of {cases} ({_worlds(count)})")
    settings = study.results.paper.get("settings", {}).get("sar_flight", {})
    long = f" over {settings['gps_correlation_s']['value']:g} s" if "gps_correlation_s" in settings else ""
    return (
        f"Over all worlds: {', '.join(shares)}; 95 % would be right. Errors of GPS that are"
        f" correlated{long} shift a whole map, and the filter, which takes them for white, does not know it"
    )


def _worlds(count: int) -> str:
    return f"{count} worlds" if count > 1 else "1 world"


class _Map(NamedTuple):
    """Landmarks that a row estimated: places, errors and covariances in the plane, and how many fit."""

    place_m: Array
    error_m: Array
    covariance_m2: Array
    inside: int


def _map_errors(found: Mapping[str, Any], true_m: Array, world: int = 0) -> _Map:
    """Return the map of a world; a map may hold fewer landmarks than there are."""
    place_m = np.asarray(found["extra_landmark_m"][world], dtype=float)[:, :2]
    covariance_m2 = np.asarray(found["extra_landmark_covariance_m2"][world], dtype=float)[:, :2, :2]
    count = min(len(place_m), len(true_m))
    seen = np.isfinite(place_m[:count, 0])
    place_m, covariance_m2 = place_m[:count][seen], covariance_m2[:count][seen]
    error_m = place_m - true_m[:count, :2][seen]
    squared = np.einsum("li,li->l", error_m, np.linalg.solve(covariance_m2, error_m[..., None])[..., 0])
    return _Map(place_m, error_m, covariance_m2, int((squared <= chi2.ppf(0.95, 2)).sum()))


def _ellipse(axes: Axes, place_m: Array, covariance_m2: Array, row: str) -> None:
    values, vectors = np.linalg.eigh(covariance_m2)
    axes.add_patch(
        Ellipse(
            (float(place_m[0]), float(place_m[1])),
            *(2 * np.sqrt(np.maximum(values, 0) * chi2.ppf(0.95, 2))),
            angle=float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))),
            fill=False,
            edgecolor=stroke(row).color,
            linewidth=0.8,
        )
    )


def _outage(flights: Flights) -> Drawn | None:
    return _errors_over_time(
        flights,
        [
            Panel(NINE, "white", OUTAGE),
            Panel(FIFTEEN, "white", tuple(f"{row}_15" for row in OUTAGE)),
        ],
        "outage",
        "Errors through the outage",
        "Nine states as in the paper; fifteen, a modern baseline, have the biases of both sensors too. On new"
        " ground no landmark was mapped under GPS.",
    )


def _outage_place(flights: Flights) -> Drawn | None:
    return _errors_over_time(
        flights,
        [Panel(f"{family}: {words}", family, PLACE) for family, words in FIX_ERRORS.items()],
        "outage_place",
        "Fix errors that are independent, and fix errors of the place",
        "The filter takes errors of fixes for independent in both. Where they belong to the place this is"
        " wrong: the same error comes back at the same place.",
    )


FIX_ERRORS = {"white": "independent", "place": "of the place"}
"""What families of worlds say of the errors of fixes."""


def _weak(flights: Flights) -> Drawn | None:
    panels = [Panel(family, family, rows) for family, rows in WEAK.items()]
    if not any(p.family == "weak" for p in flights.panels(panels)):
        return None
    return _errors_over_time(
        flights,
        panels,
        "weak",
        "Few landmarks and a poor sensor",
        "Family weak has fewer landmarks, seen from a shorter distance and with larger errors, of which its"
        " filters know. All have fifteen states.",
    )


def _height(flights: Flights) -> Drawn | None:
    return _over_time(
        flights,
        [
            Panel(NINE, "white", OUTAGE),
            Panel(FIFTEEN, "white", tuple(f"{row}_15" for row in OUTAGE)),
        ],
        "height_error_m",
        "error of the height (m)",
        Drawn(
            name="height",
            figure=Figure(),
            title="Errors of the height through the outage",
            caption="Fixes by fingerprints tell nothing of the height, so lines with and without them lie on"
            " each other; landmarks do.",
            alt="",
        ),
    )


def _errors_over_time(
    flights: Flights, panels: Sequence[Panel], name: str, title: str, note: str
) -> Drawn | None:
    return _over_time(
        flights,
        panels,
        "error_m",
        "horizontal error (m)",
        Drawn(name=name, figure=Figure(), title=title, caption=note, alt=""),
        limit=True,
    )


def _over_time(
    flights: Flights,
    panels: Sequence[Panel],
    quantity: str,
    label: str,
    drawn: Drawn,
    *,
    limit: bool = False,
) -> Drawn | None:
    """Draw the median over worlds and the upper end of single experiments, from before to behind the outage.

    Errors are not below zero, so that the lower end tells little.
    """
    panels = flights.panels(panels, quantity)
    if not panels:
        return None
    rows = list(dict.fromkeys(row for panel in panels for row in panel.rows))
    lines = -(-(len(rows) + limit) // 4)
    figure = figures.new_figure(3.2 + 0.2 * lines)
    shown = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    told, handles, lows, highs, lasts_s = [], {}, [], [], 0.0
    worlds: dict[str, int] = {}
    for axes, panel in zip(shown, panels, strict=True):
        own = []
        for row in panel.rows:
            flight = flights.get(panel.family, row)
            assert flight is not None
            lasts_s = float(flight.length_s[0])
            time_s, values = _aligned(flight, quantity)
            look = stroke(row)
            # Rows ask for worlds, whatever the family.
            worlds[row] = max(worlds.get(row, 0), len(values))
            middle = np.median(values, axis=0)
            marks = _marks(row, panel.rows, len(time_s))
            (handles[row],) = axes.plot(time_s, middle, look.line, color=look.color, linewidth=1.7, **marks)
            if len(values) > 1:
                # Filled bands of several rows cover each other, and what is below the median worries nobody.
                high = np.quantile(values, 0.975, axis=0, method="weibull")
                axes.plot(time_s, high, look.line, color=look.color, linewidth=0.6, alpha=0.7)
                highs.append(high)
            lows.append(middle)
            highs.append(middle)
            last = int(np.searchsorted(time_s, lasts_s, side="right")) - 1
            own.append(f"{row} {metres(float(middle[last]))} m")
        axes.axvspan(0, lasts_s, color=OUTAGE_COLOR, alpha=0.25, linewidth=0, zorder=0)
        if limit:
            handles["limit"] = axes.axhline(LIMIT_M, color=TRUE_COLOR, linestyle=(0, (5, 3)), linewidth=1)
        axes.set_title(panel.title)
        axes.set_xlabel("time from the begin of the outage (s)")
        axes.set_xlim(-BEFORE_S, lasts_s + AFTER_S)
        told.append(f"{panel.title}: {', '.join(own)}")
    least, most = float(np.min(np.concatenate(lows))), float(np.max(np.concatenate(highs)))
    if most > 10 * LIMIT_M:
        logarithmic(shown[0], max(0.3 * least, 1e-3), 1.3 * most)
    else:
        shown[0].set_ylim(0, 1.05 * most)
    shown[0].set_ylabel(label)
    words = {row: row for row in handles} | {"limit": f"limit {LIMIT_M} m"}
    figure.legend(handles.values(), [words[k] for k in handles], loc="outside upper left", ncols=4)
    most = max(worlds.values())
    few = ", ".join(f"{row}: {count}" for row, count in worlds.items() if count < most)
    number = (f"n = {most} worlds" if most > 1 else "n = 1 world") + (f" ({few})" if few else "")
    band = f"; thin lines: upper end of the {central_of(worlds)}, time by time" if most > 1 else ""
    ends = f"At the end of the outage, median over worlds: {'; '.join(told)}."
    return Drawn(
        name=drawn.name,
        figure=figure,
        title=drawn.title,
        caption=f"{label.removesuffix(' (m)').capitalize()}, median over {number} of each family{band}. The"
        f" outage of {lasts_s:g} s is shaded. {drawn.caption} {ends} {ASSUMED} {NO_RESULT}",
        alt=f"{label.removesuffix(' (m)').capitalize()} against time. {ends}",
    )


def _marks(row: str, rows: Sequence[str], count: int) -> dict[str, Any]:
    """Return what puts three markers on the curve of a row, elsewhere on each, for who sees no colours.

    ``rows`` are those of the panel, ``count`` the points of the curve.
    """
    between = max(1, count // 3)
    first = round(between * (rows.index(row) + 0.5) / len(rows))
    return {"marker": stroke(row).marker, "markevery": (first, between), "markersize": 4.5}


def three_digits(value: float) -> str:
    """Return a number with three digits that count, thousands set apart, no power of ten."""
    rounded = float(f"{value:.3g}")
    if abs(rounded) >= 1000:
        grouped = f"{rounded:,.0f}"
    elif 0 < abs(rounded) < 1e-4:
        grouped = np.format_float_positional(rounded, trim="-")
    else:
        grouped = f"{rounded:.3g}"
    return grouped.replace(",", "\N{NARROW NO-BREAK SPACE}").replace("-", "\N{MINUS SIGN}")


def _aligned(flight: Flight, quantity: str) -> tuple[Array, Array]:
    """Return times from the begin of the outage, [k], and a quantity at these times, [w, k]."""
    time_s = flight.time_s[0]
    kept = (time_s >= -BEFORE_S) & (time_s <= flight.length_s[0] + AFTER_S)
    values = getattr(flight, quantity)
    # An outage may begin at another time in another world.
    moved = [np.interp(time_s[kept], own_s, own) for own_s, own in zip(flight.time_s, values, strict=True)]
    return time_s[kept], np.stack(moved)


def logarithmic(axes: Axes, low: float, high: float) -> None:
    """Make the vertical axis logarithmic with plain numbers."""
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high / low > 100 else (1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def _consistency(flights: Flights) -> Drawn | None:
    """Draw the error squared against its covariance over time, and innovations against theirs."""
    study = flights.study
    panels = flights.panels([Panel(f, f, CONSISTENT) for f in ("ideal", "white")], "nees")
    innovations = [
        (sensor, f"{panel.family}: {row}", row, values)
        for panel in panels
        for row in panel.rows
        for sensor in SENSORS
        if len(values := study.get(panel.family, row, f"nis_{sensor}"))
    ]
    if not panels:
        return None
    lines = list(dict.fromkeys(words for _, words, _, _ in innovations))
    below = 0.7 + 0.2 * len(lines) if lines else 0.0
    figure = figures.new_figure(3.5 + below)
    over: Any = figure
    under: Any = None
    if lines:
        over, under = figure.subfigures(2, 1, height_ratios=[3.2, below], squeeze=False).ravel()
    shown = over.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    told, handles, levels, worlds = [], {}, [], 1
    for axes, panel in zip(shown, panels, strict=True):
        own = []
        for row in panel.rows:
            flight = flights.get(panel.family, row)
            assert flight is not None
            look, worlds = stroke(row), max(worlds, len(flight.nees))
            mean = flight.nees.mean(axis=0)
            marks = _marks(row, panel.rows, len(mean))
            (handles[row],) = axes.plot(
                flight.time_s[0], mean, look.line, color=look.color, linewidth=1.1, alpha=0.9, **marks
            )
            levels.append(mean[np.isfinite(mean) & (mean > 0)])
            under_gps = study.get(panel.family, row, "gps_nees")
            if len(under_gps):
                own.append(f"{row} {three_digits(float(under_gps.mean()))}")
            lasts_s = float(flight.length_s[0])
        low, high = chi2.ppf([0.025, 0.975], STATES * worlds) / worlds
        axes.axhspan(low, high, color="#7f8c95", alpha=0.35, linewidth=0)
        axes.axvspan(0, lasts_s, color=OUTAGE_COLOR, alpha=0.25, linewidth=0, zorder=0)
        axes.set_title(panel.title)
        axes.set_xlabel("time from the begin of the outage (s)")
        told.append(f"{panel.family}: {', '.join(own)}")
    values = np.concatenate(levels)
    logarithmic(shown[0], 0.7 * float(np.quantile(values, 0.002)), 1.3 * float(values.max()))
    shown[0].set_ylabel("normalised error squared (1)")
    over.legend(handles.values(), handles.keys(), loc="outside upper left", ncols=4)
    heard = _innovations(under, innovations, lines) if under is not None else ""
    number = f"n = {worlds} worlds" if worlds > 1 else "n = 1 world"
    nees = f"Under GPS, mean over worlds: {'; '.join(told)}."
    return Drawn(
        name="consistency",
        figure=figure,
        title="Consistency",
        caption="Above: normalised error squared of position, velocity and attitude, mean over"
        f" {number} of each family; a right covariance gives {STATES}, grey is where 95 % of such"
        " means lie. The outage is shaded. Family ideal has white noise alone, as the filters model it; in"
        " white sensors have biases and scale errors, and GPS wanders."
        + (
            " Below: normalised innovation squared for each degree of freedom, mean over worlds and"
            " flight, which should be 1."
            if heard
            else ""
        )
        + f" {nees} {ASSUMED} {NO_RESULT}",
        alt=f"Normalised error squared over time. {nees}{heard}",
    )


def _innovations(place: Any, innovations: Sequence[tuple[str, str, str, Array]], lines: Sequence[str]) -> str:
    """Draw a dot a sensor in a line for each family and row; return in words what is seen."""
    axes = place.subplots()
    looks = {"gps": ("o", "#14507d"), "fix": ("s", "#c8641a"), "sighting": ("^", "#4d7f58")}
    told: dict[str, list[str]] = {}
    for sensor, words, _, values in innovations:
        marker, color = looks[sensor]
        known = SENSOR_WORDS[sensor] in axes.get_legend_handles_labels()[1]
        axes.plot(
            values.mean(),
            lines.index(words),
            marker,
            color=color,
            markersize=5,
            label=None if known else SENSOR_WORDS[sensor],
        )
        told.setdefault(words, []).append(f"{SENSOR_WORDS[sensor]} {values.mean():.2f}")
    axes.axvline(1, color=TRUE_COLOR, linewidth=1, zorder=0)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    figures.label_rows(axes, list(lines))
    axes.set_xlabel("normalised innovation squared for each degree of freedom (1)")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0)
    return " Innovations: " + "; ".join(f"{words}: {', '.join(own)}" for words, own in told.items()) + "."
