"""The look of figures and pages: one colour an algorithm, one tone a verdict, the same bytes every time."""

import colorsys
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Any, NamedTuple
from zlib import crc32

import matplotlib as mpl


class Stroke(NamedTuple):
    """How one algorithm is drawn: colour, line style and marker."""

    color: str
    line: str
    marker: str


KNOWN: dict[str, Stroke] = {
    "svm": Stroke("#0072b2", "-", "o"),
    "wknn": Stroke("#d55e00", "-", "s"),
    "bayes_average": Stroke("#009e73", "-", "^"),
    "bayes_maximum_likelihood": Stroke("#5f8a00", "-", "v"),
    "mlp": Stroke("#b5478f", "-", "D"),
    "rbf_network": Stroke("#332288", "-", "P"),
    "nearest_neighbour": Stroke("#882255", "-", "<"),
    "knn": Stroke("#b87a00", "-", ">"),
    "rbf_network_nearest": Stroke("#2a93c9", "-", "X"),
    "rbf_resubstitution": Stroke("#7a6bc4", "--", "P"),
    "rbf_newrb": Stroke("#5a3fa0", "-.", "P"),
    "rbf_network_nearest_newrb": Stroke("#1b6f8f", "-.", "X"),
    "rbf_network_holdout": Stroke("#8077b0", ":", "P"),
    "rbf_network_nearest_holdout": Stroke("#4f8fae", ":", "X"),
    "wknn_holdout": Stroke("#c06a30", ":", "s"),
    "svm_holdout": Stroke("#4a8abb", ":", "o"),
    "gaussian_process": Stroke("#117733", "-", "h"),
    "curve_crossings": Stroke("#005f99", "-", "o"),
    "path_loss": Stroke("#c05a00", "-", "s"),
    "pseudo_inverse": Stroke("#114433", "-", "s"),
    "pseudo_inverse_crossings": Stroke("#333300", ":", "s"),
    "iterative_fractional_printed": Stroke("#2299ee", "-", "D"),
    "iterative_fractional_printed_crossings": Stroke("#5f9a4a", ":", "D"),
    "iterative_fractional": Stroke("#003355", "--", "^"),
    "iterative_absolute": Stroke("#1199bb", "-.", "v"),
    "iterative_fractional_printed_path_loss": Stroke("#995577", ":", "D"),
    "least_squares": Stroke("#0066dd", "--", "X"),
    "least_squares_printed": Stroke("#00aa55", "-.", "X"),
    "least_squares_fractional": Stroke("#5a3a00", ":", "X"),
    "particle_filter": Stroke("#00508a", "-", "o"),
    "particle_filter_product": Stroke("#553322", "--", "o"),
    "particle_filter_least_residual": Stroke("#7d8c5c", "-.", "o"),
    "particle_filter_heading_known": Stroke("#4a80f0", "--", "o"),
    "particle_filter_pseudo_inverse": Stroke("#6b1f55", ":", "o"),
    "particle_filter_fractional": Stroke("#5599bb", ":", "o"),
    "particle_filter_absolute": Stroke("#2b1499", "-.", "o"),
    "particle_filter_path_loss": Stroke("#d2449a", "-.", "o"),
    "particle_filter_crossings": Stroke("#889977", "-.", "o"),
    "trilateration_alone": Stroke("#c4401c", "-", "s"),
    "extended_kalman_filter": Stroke("#d07a00", "-", "^"),
    "riss": Stroke("#8a6d00", "-", "v"),
    "wifi_full": Stroke("#0070b8", "-", "s"),
    "wifi_full_scaled": Stroke("#4a9ad0", "--", "s"),
    "wifi_fos": Stroke("#cd1dcd", "-", "o"),
    "wifi_pca": Stroke("#7a3b8f", "--", "o"),
    "wifi_strongest": Stroke("#5a6b00", "-.", "o"),
    "wifi_random": Stroke("#6f6f6f", ":", "o"),
    "adaptive_fast_mixture": Stroke("#00704f", "-", "D"),
    "adaptive_mixture_full": Stroke("#3aa57f", "--", "D"),
    "fast_mixture": Stroke("#a05a8a", "-.", "D"),
    "mixture": Stroke("#1d1dcd", ":", "D"),
    "plain": Stroke("#7d1236", "-", "^"),
    "plain_wide": Stroke("#8c5200", "--", "^"),
    "kalman_3": Stroke("#2c1f80", "-", "P"),
    "kalman_5": Stroke("#7666c8", "--", "P"),
    "kalman_5_full": Stroke("#aa4488", "-.", "P"),
    "wknn_fos_64": Stroke("#052161", "-", "o"),
    "wknn_fos_16": Stroke("#1740a1", "--", "o"),
    "wknn_fos_4": Stroke("#4c7ae6", ":", "o"),
    "wknn_pca_64": Stroke("#610561", "-", "s"),
    "wknn_pca_16": Stroke("#a117a1", "--", "s"),
    "wknn_pca_4": Stroke("#cc66cc", ":", "s"),
    "wknn_strongest_64": Stroke("#056105", "-", "^"),
    "wknn_strongest_16": Stroke("#138613", "--", "^"),
    "wknn_strongest_4": Stroke("#36a136", ":", "^"),
    "wknn_random_64": Stroke("#613005", "-", "v"),
    "wknn_random_16": Stroke("#a15717", "--", "v"),
    "wknn_random_4": Stroke("#bc712f", ":", "v"),
    "wlan": Stroke("#0d58a6", "-", "s"),
    "wlan_latest": Stroke("#1010f9", "--", "s"),
    "wlan_literal": Stroke("#0f048b", "-.", "s"),
    "wlan_wknn": Stroke("#1b2937", ":", "s"),
    "wlan_one_access_point": Stroke("#7a5c00", "--", "s"),
    "wlan_every_5m": Stroke("#1f68f9", "-", "s"),
    "cascaded": Stroke("#a3127a", "-", "D"),
    "cascaded_tuned": Stroke("#f406f4", "--", "D"),
    "cascaded_survey_sigma": Stroke("#f40655", "-.", "D"),
    "cascaded_shoe": Stroke("#5e0219", ":", "D"),
    "cascaded_15": Stroke("#3d0a47", "-", "D"),
    "cascaded_every_5m": Stroke("#b4647f", "--", "D"),
    "cascaded_5_scans": Stroke("#9f38c2", "-.", "D"),
    "inertial": Stroke("#c2560a", "-", "o"),
    "inertial_shoe": Stroke("#1a7fa8", "--", "o"),
    "inertial_rate": Stroke("#7a4fc0", "-.", "o"),
    "inertial_15": Stroke("#9a8e04", ":", "o"),
    "inertial_no_magnetometer": Stroke("#b47f64", "-", "o"),
    "inertial_no_zupt": Stroke("#b63535", "--", "o"),
    "inertial_turned_10deg": Stroke("#4c3224", "-.", "o"),
    "inertial_15_shoe": Stroke("#35965a", ":", "o"),
    "joint": Stroke("#2c7a1f", "-", "P"),
    "joint_shoe": Stroke("#123f16", "--", "P"),
    "particle": Stroke("#0b7f78", "-", "^"),
    "gps_inertial": Stroke("#6a1b1b", "-", "s"),
    "slam": Stroke("#0646db", "-", "D"),
    "wlpf": Stroke("#048b0f", "-", "^"),
    "slam_wlpf": Stroke("#d105c7", "-", "P"),
    "slam_new_ground": Stroke("#04a093", "-.", "D"),
    "gps_inertial_15": Stroke("#ac8253", "--", "s"),
    "slam_15": Stroke("#6084d7", "--", "D"),
    "wlpf_15": Stroke("#4e7237", "--", "^"),
    "slam_wlpf_15": Stroke("#ac538e", "--", "P"),
    "slam_new_ground_15": Stroke("#023146", ":", "D"),
    "slam_weak_15": Stroke("#0c0250", "-", "v"),
    "slam_wlpf_weak_15": Stroke("#f90663", "-", "X"),
    "gps_inertial_raised": Stroke("#9b8c04", "-.", "s"),
    "slam_flat": Stroke("#a35cd6", ":", "v"),
    "gps_inertial_flat": Stroke("#f90606", ":", "s"),
    "gps_inertial_lagrange": Stroke("#2e2605", ":", "o"),
    "gps_inertial_radians": Stroke("#ae041b", "-.", "o"),
    "control_true_map": Stroke("#62860f", "-.", "*"),
    "dead_reckoning": Stroke("#96610f", "-", "o"),
    "graph_slam": Stroke("#c23a05", "-", "s"),
    "graph_slam_free": Stroke("#8c2d04", ":", "s"),
    "gtsam": Stroke("#5f7f06", "--", "s"),
    "ransac": Stroke("#7f2b8e", "-", "^"),
    "aligned": Stroke("#0a60b0", "-", "D"),
    "aligned_linear": Stroke("#02856c", "--", "D"),
    "aligned_cauchy": Stroke("#292a72", "-.", "D"),
    "aligned_later": Stroke("#0000f0", ":", "D"),
    "aligned_fixed": Stroke("#cf2878", ":", "D"),
    "aligned_no_wifi": Stroke("#6b5d50", "-", "D"),
    "control_true_neighbours": Stroke("#35404f", ":", "X"),
    "control_rigid": Stroke("#5b6b78", "-", "x"),
    "control_known_stances": Stroke("#2f4f4f", "-.", "X"),
    "control_calibrated_riss": Stroke("#444444", "-.", "x"),
    "control_oracle": Stroke("#000000", "--", "*"),
    "control_centre": Stroke("#767676", "--", "+"),
}
"""Colours that stay apart for colour-blind readers; variants share a marker and differ in line style."""

WIDTH_IN = 7.2
"""Width of figures, inches."""

GREY = "#5c6670"

_MARKERS = "osD^v<>PX"

_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dde1e5",
    "grid.linewidth": 0.6,
    "xtick.color": "#333333",
    "ytick.color": "#333333",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "lines.markersize": 5.5,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    # Points no farther from a line than this, in 1/72 inch, are left out of it: no line is thinner.
    "path.simplify_threshold": 0.4,
    "svg.fonttype": "path",
    "svg.hashsalt": "reposition",
}


_CHOSEN: ContextVar[Mapping[str, Stroke]] = ContextVar("chosen", default={})  # noqa: B039 - never changed


@contextmanager
def drawing(rows: Iterable[str] = ()) -> Iterator[None]:
    """Draw in the project's style, whatever the user's own settings are; these come back afterwards.

    Parameters
    ----------
    rows
        Rows that are drawn together: those that are not in `KNOWN` get the strokes of `strokes`.
    """
    token = _CHOSEN.set(strokes(rows))
    try:
        with mpl.rc_context():
            mpl.rcdefaults()
            for name, value in _SETTINGS.items():
                mpl.rcParams[name] = value
            yield
    finally:
        _CHOSEN.reset(token)


def strokes(rows: Iterable[str]) -> dict[str, Stroke]:
    """Return how rows are drawn beside each other: as `KNOWN`, others unlike all before them.

    Parameters
    ----------
    rows
        Their names. Each that is not in `KNOWN` takes, in this order, the colour that is farthest from those
        in use, and the line style and marker that are used least.
    """
    rows = list(rows)
    found = {name: KNOWN[name] for name in rows if name in KNOWN}
    for name in rows:
        if name not in found:
            used = [_lab(look.color) for look in found.values()]
            color = max(_COLORS, key=lambda color: _nearest(color, used))
            lines, markers = (
                Counter(getattr(look, k) for look in found.values()) for k in ("line", "marker")
            )
            found[name] = Stroke(
                color,
                min(("-", "--", "-.", ":"), key=lines.__getitem__),
                min(_MARKERS, key=markers.__getitem__),
            )
    return {name: found[name] for name in rows}


def stroke(name: str) -> Stroke:
    """Return how an algorithm is drawn; the same name gives the same stroke in all figures of a study.

    Parameters
    ----------
    name
        The row's name. One that is neither in `KNOWN` nor among the rows of `drawing` gets a colour out of
        its own letters.
    """
    chosen = _CHOSEN.get()
    if name in KNOWN or name in chosen:
        return KNOWN[name] if name in KNOWN else chosen[name]
    code = crc32(name.encode())
    color = _hls((code % 360) / 360, 0.34 + 0.02 * (code // 360 % 5), 0.55)
    return Stroke(color, ("-", "--", "-.")[code // 1800 % 3], _MARKERS[code // 5400 % 9])


def markers_apart(rows: Iterable[str]) -> dict[str, str]:
    """Return a marker a row, unlike all others as far as there are markers, for dots without lines.

    `stroke` gives variants one marker and tells them apart by their lines, which dots do not have; without
    colour they would be the same.

    Parameters
    ----------
    rows
        Names of rows. The first one with a marker keeps it; later ones take the next that is free.
    """
    found: dict[str, str] = {}
    for row in rows:
        own, used = stroke(row).marker, set(found.values())
        found[row] = own if own not in used else next((m for m in _MARKERS if m not in used), own)
    return found


def contrast(first: str, second: str) -> float:
    """Return the contrast ratio of two colours ``#rrggbb``, 1 to 21, as WCAG 2 defines it."""
    high, low = sorted((_luminance(first), _luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def difference(first: str, second: str) -> float:
    """Return how different two colours ``#rrggbb`` look: their distance in CIE L*a*b*; 2 is just seen."""
    return _nearest(first, [_lab(second)])


def _nearest(color: str, others: Iterable[tuple[float, float, float]]) -> float:
    return min((round(math.dist(_lab(color), other), 3) for other in others), default=0.0)


@cache
def _lab(color: str) -> tuple[float, float, float]:
    red, green, blue = _linear(color)
    # Of sRGB to CIE XYZ as shares of the white point D65.
    x = (0.4124 * red + 0.3576 * green + 0.1805 * blue) / 0.9505
    y = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    z = (0.0193 * red + 0.1192 * green + 0.9505 * blue) / 1.089
    f, g, h = (part ** (1 / 3) if part > 0.008856 else 7.787 * part + 16 / 116 for part in (x, y, z))
    return 116 * g - 16, 500 * (f - g), 200 * (g - h)


def _luminance(color: str) -> float:
    red, green, blue = _linear(color)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def _linear(color: str) -> list[float]:
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]


def _hls(hue: float, lightness: float, saturation: float) -> str:
    return "#" + "".join(
        f"{round(255 * part):02x}" for part in colorsys.hls_to_rgb(hue, lightness, saturation)
    )


_COLORS = [
    color
    for lightness in (0.38, 0.28, 0.46)
    for saturation in (0.75, 0.4)
    for hue in range(0, 360, 10)
    if contrast(color := _hls(hue / 360, lightness, saturation), "#ffffff") >= 3.5
]
"""Colours that can be seen on white, for rows that are not known."""
