"""The look of figures and pages: one colour an algorithm, one tone a verdict, the same bytes every time."""

import colorsys
from collections.abc import Iterator
from contextlib import contextmanager
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
    "wifi_fos": Stroke("#c63a14", "-", "o"),
    "wifi_pca": Stroke("#7a3b8f", "--", "o"),
    "wifi_strongest": Stroke("#5a6b00", "-.", "o"),
    "wifi_random": Stroke("#6f6f6f", ":", "o"),
    "adaptive_fast_mixture": Stroke("#00704f", "-", "D"),
    "adaptive_mixture_full": Stroke("#3aa57f", "--", "D"),
    "fast_mixture": Stroke("#a05a8a", "-.", "D"),
    "mixture": Stroke("#003f7f", ":", "D"),
    "plain": Stroke("#cc7400", "-", "^"),
    "plain_wide": Stroke("#8c5200", "--", "^"),
    "kalman_3": Stroke("#2c1f80", "-", "P"),
    "kalman_5": Stroke("#7666c8", "--", "P"),
    "kalman_5_full": Stroke("#aa4488", "-.", "P"),
    "control_calibrated_riss": Stroke("#444444", "-.", "x"),
    "control_oracle": Stroke("#000000", "--", "*"),
    "control_centre": Stroke("#767676", "--", "+"),
}
"""Colours that stay apart for colour-blind readers; variants share a marker and differ in line style."""

CONTROL = "control_"
"""How the names of rows begin that may see the truth."""

TONES: dict[str, str] = {
    "exact": "good",
    "reproduced": "good",
    "holds": "good",
    "depends": "mixed",
    "undecided": "mixed",
    "not reproduced": "bad",
    "fails": "bad",
    "contradicts itself": "bad",
    "calibrated": "plain",
    "none given": "plain",
    "not testable": "plain",
}
"""The tone in which a verdict is coloured; the word always stands beside it."""

PALETTES: dict[str, dict[str, tuple[str, str]]] = {
    "light": {
        "good": ("#1b5e20", "#e6f3e7"),
        "bad": ("#8e1b1b", "#fbe9e7"),
        "mixed": ("#6b4a00", "#fff3d1"),
        "plain": ("#37474f", "#eceff1"),
    },
    "dark": {
        "good": ("#a5d6a7", "#14301a"),
        "bad": ("#f6b8b2", "#3b1614"),
        "mixed": ("#ffd98a", "#382b08"),
        "plain": ("#cfd8dc", "#263238"),
    },
}
"""Text and background of each tone, on light and on dark pages."""

WIDTH_IN = 7.2
"""Width of figures, inches."""

GREY = "#5c6670"

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
    "svg.fonttype": "path",
    "svg.hashsalt": "reposition",
    "pdf.fonttype": 42,
}


@contextmanager
def drawing() -> Iterator[None]:
    """Draw in the project's style, whatever the user's own settings are; these come back afterwards."""
    with mpl.rc_context():
        mpl.rcdefaults()
        for name, value in _SETTINGS.items():
            mpl.rcParams[name] = value
        yield


def stroke(name: str) -> Stroke:
    """Return how an algorithm is drawn; the same name gives the same stroke in every figure.

    Parameters
    ----------
    name
        The row's name. One that is not in `KNOWN` gets a colour out of its own letters.
    """
    if name in KNOWN:
        return KNOWN[name]
    code = crc32(name.encode())
    red, green, blue = colorsys.hls_to_rgb((code % 360) / 360, 0.34 + 0.02 * (code // 360 % 5), 0.55)
    color = "#" + "".join(f"{round(255 * part):02x}" for part in (red, green, blue))
    return Stroke(color, ("-", "--", "-.")[code // 1800 % 3], "osD^v<>PX"[code // 5400 % 9])


def is_control(name: str) -> bool:
    """Say whether a row is a control, which may see the truth and competes with nobody."""
    return name.startswith(CONTROL)


def contrast(first: str, second: str) -> float:
    """Return the contrast ratio of two colours ``#rrggbb``, 1 to 21, as WCAG 2 defines it."""
    high, low = sorted((_luminance(first), _luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def _luminance(color: str) -> float:
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
