"""Figures of the radio side of WiFi graph SLAM: distances of scans, and radio maps.

See Gu et al., Figures 1 and 8.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.evaluation.studies.graph_slam import (
    NEAR_M,
    NEIGHBOURS,
    SPAN_M,
    SPARSE,
    SURVEYED,
    TRUE_POSES,
    located_error_m,
)
from positioning.posegraph.similarity import rss_distance_db
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.studies.graph_slam_world import (
    ALIGNED,
    ASSUMED,
    PRINTED,
    Array,
    legend_above,
    long_walks,
    name_printed,
    where,
)
from positioning.presentation.tables import central
from positioning.tasks.alignment import fit_to

SITES = {"dense": ("#14507d", "o"), "sparse": ("#c8641a", "^")}
"""The two sites of Figure 1: colour and marker."""

SHOWN_PAIRS, BIN_M, LEAST_PAIRS = 700, 4.0, 10
"""Pairs of scans drawn of each site, width of the bins of their median, and pairs that a bin needs."""


class Map(NamedTuple):
    """A radio map of Figure 8: words, look, and the claim with its printed probability."""

    words: str
    color: str
    line: str
    claim: str


MAPS = {
    SURVEYED: Map("surveyed every 2 m", "#14507d", "-", "fig8.surveyed"),
    SPARSE: Map("surveyed every 5 m", "#5b8fb8", "--", "fig8.surveyed_sparse"),
    TRUE_POSES: Map("crowdsourced, true poses", "#4d7f58", "-.", ""),
    ALIGNED: Map("crowdsourced, aligned", "#c8641a", ":", "fig8.crowdsourced"),
}


def scans(study: Study) -> Drawn | None:
    """Draw the distance of scans in signal space over that in metres, at both sites.

    See Gu et al., Figure 1.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    family = study.families[0]
    observed = study.first_world("observed", family)
    present = [site for site in SITES if f"pairs.{site}_rss_dbm" in observed]
    if not present:
        return None
    figure = figures.new_figure(3.4)
    axes = figure.subplots()
    axes.axvspan(*SPAN_M, color="#eceff2", linewidth=0, zorder=0)
    told, counts, heard_by = [], [], []
    for site in present:
        color, marker = SITES[site]
        position_m, rss_dbm = observed[f"pairs.{site}_position_m"], observed[f"pairs.{site}_rss_dbm"]
        first, second = np.triu_indices(len(position_m), 1)
        apart_m = np.linalg.norm(position_m[first] - position_m[second], axis=-1)
        apart_db = rss_distance_db(rss_dbm)[first, second]
        kept = np.isfinite(apart_db) & np.isfinite(apart_m)
        apart_m, apart_db = apart_m[kept], apart_db[kept]
        if not len(apart_m):
            continue
        thin = slice(None, None, max(1, len(apart_m) // SHOWN_PAIRS))
        axes.plot(apart_m[thin], apart_db[thin], marker, color=color, markersize=2.2, alpha=0.28, mew=0)
        middle_m, median_db = running_median(apart_m, apart_db)
        axes.plot(middle_m, median_db, marker + "-", color=color, markersize=4.5, label=f"{site} WiFi")
        near = (apart_m >= SPAN_M[0]) & (apart_m <= SPAN_M[1])
        counts.append(f"{len(apart_m)} pairs of {len(position_m)} scans ({site})")
        heard = float(np.isfinite(rss_dbm).sum(axis=-1).mean())
        heard_by.append(f"{site} {heard:.0f}")
        if near.any():
            told.append(f"{site} {apart_db[near].mean():.1f} dB")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("distance in space (m)")
    axes.set_ylabel("distance of scans, eq. 9 (dB)")
    legend_above(figure, axes)
    span = f"{SPAN_M[0]:g} to {SPAN_M[1]:g} m"
    worlds = _sites_over_worlds(study, family)
    means = f"mean in the grey span, {span}: {', '.join(told)}" if told else ""
    return Drawn(
        name="fig1",
        figure=figure,
        title="Distance in space and in signal space",
        caption=f"Two short walks, {where(study, family)}: n = {', '.join(counts)}, of which an even part is"
        f" drawn. Line: median in bins of {BIN_M:g} m. A scan hears on average so many access points:"
        f" {', '.join(heard_by)}."
        + (f" {means[0].upper()}{means[1:]}{worlds}." if means else "")
        + " Sites, density of access points and propagation are assumed; the paper has no numbers.",
        alt=f"Scatter of the distance of scans in dB over their distance in metres. {'; '.join(counts)}."
        + (f" {means[0].upper()}{means[1:]}." if means else ""),
    )


def running_median(along: Array, values: Array) -> tuple[Array, Array]:
    """Return the middles of bins that hold enough pairs, and the median in each.

    Parameters
    ----------
    along
        Where the values lie, [m], metres.
    values
        [m].
    """
    number = np.floor(along / BIN_M).astype(int)
    kept = [index for index in np.unique(number) if np.count_nonzero(number == index) >= LEAST_PAIRS]
    medians = [float(np.median(values[number == index])) for index in kept]
    return (np.array(kept, dtype=float) + 0.5) * BIN_M, np.array(medians)


def radio_maps(study: Study) -> Drawn | None:
    """Draw the errors of k-NN on surveyed and crowdsourced radio maps.

    See Gu et al., Figure 8.

    Parameters
    ----------
    study
        Results, sorted by family, row and metric.
    """
    family = long_walks(study)
    errors = {} if family is None else _map_errors(study, family)
    shares = {} if family is None else {name: study.get(family, name, "map_within_10m") for name in MAPS}
    present = [name for name in MAPS if name in errors or len(shares.get(name, ()))]
    if family is None or not present:
        return None
    figure = figures.new_figure(3.8)
    axes = figure.subplots()
    told, queries, drawn_worlds = [], 0, 0
    printed: dict[str, list[str]] = {}
    for number, name in enumerate(present):
        own = MAPS[name]
        if name in errors:
            pooled_m = np.sort(np.concatenate(errors[name]))
            queries, drawn_worlds = max(map(len, errors[name])), len(errors[name])
            level = 100 * np.arange(1, len(pooled_m) + 1) / len(pooled_m)
            axes.step(pooled_m, level, where="post", color=own.color, linestyle=own.line, label=own.words)
        else:
            axes.plot([], [], color=own.color, linestyle=own.line, label=own.words)
        values = 100 * shares[name]
        if len(values):
            # Beside each other, about the error that they belong to.
            place_m = NEAR_M + 0.45 * (number - (len(present) - 1) / 2)
            low, high, _ = figures.interval_of(values)
            axes.plot([place_m, place_m], [low, high], color=own.color, linewidth=2.6, alpha=0.5)
            axes.plot(place_m, values.mean(), "o", color=own.color, markersize=5, zorder=4)
            told.append(f"{own.words} {values.mean():.0f} % ({low:.0f} to {high:.0f} %)")
        digits = figures.printed_or_none(study.results, own.claim) if own.claim else None
        if digits is not None:
            printed.setdefault(digits, []).append(name)
    for digits, names in printed.items():
        look = {**PRINTED, "markeredgecolor": MAPS[names[0]].color}
        axes.plot(NEAR_M, 100 * float(digits), **look)
    if printed:
        name_printed(axes, "printed")
    axes.set_xlim(0, 40)
    axes.set_ylim(0, 100)
    axes.set_xlabel("error of k-NN (m)")
    axes.set_ylabel("share of test fingerprints (%)")
    legend_above(figure, axes, columns=3)
    worlds = max((len(v) for v in shares.values()), default=0)
    stated = ", ".join(
        f"{100 * float(d):.0f} % on the {'surveyed' if n[0] in (SURVEYED, SPARSE) else 'crowdsourced'} map"
        for d, n in printed.items()
    )
    curves = (
        f"Curves: n = {queries} test fingerprints in each of the first {drawn_worlds} worlds, pooled."
        if drawn_worlds > 1
        else f"Curves: n = {queries} test fingerprints in one world."
    )
    bars = f"mean over {worlds} worlds, bar: {central(worlds)}" if worlds > 1 else "one world"
    return Drawn(
        name="fig8",
        figure=figure,
        title="Errors of k-NN on surveyed and crowdsourced radio maps",
        caption=f"{curves} Family {family}. Dots, side by side about {NEAR_M:g} m: share below {NEAR_M:g} m,"
        f" {bars}: {'; '.join(told)}."
        + (f" Hollow: printed, {stated}." if stated else "")
        + f" k = {NEIGHBOURS}, the distance of surveyed places and the way of the test are assumed."
        f" {ASSUMED}",
        alt=f"Cumulative errors of k-NN on radio maps. Share below {NEAR_M:g} m: {'; '.join(told)}."
        + (f" Printed: {stated}." if stated else ""),
    )


def _sites_over_worlds(study: Study, family: str) -> str:
    """Return in words the means of both sites over all worlds."""
    found = {site: study.get(family, f"pairs_{site}", "distance_near_db") for site in SITES}
    worlds = max(len(values) for values in found.values())
    if worlds < 2:
        return ""
    own = []
    for site, values in found.items():
        if len(values):
            low, high, _ = figures.interval_of(values)
            own.append(f"{site} {values.mean():.1f} dB ({low:.1f} to {high:.1f} dB)")
    return f"; over {worlds} worlds, with the {central(worlds)}: {', '.join(own)}"


def _map_errors(study: Study, family: str) -> dict[str, list[Array]]:
    """Return the errors of k-NN by map, an array for each world of the first batch."""
    observed = study.results.observed.get(family, {})
    truth = study.results.truth.get(family, {})
    needed = {"query.rss_dbm", "survey.rss_dbm", "survey.position_m", "walks.rss_dbm"}
    if not needed <= observed.keys() or not {"truth.query_m", "truth.path_m"} <= truth.keys():
        return {}

    def numbers(arrays: Mapping[str, NDArray[np.generic]], name: str) -> Array:
        return np.asarray(arrays[name], dtype=float)

    surveyed_dbm, surveyed_m = numbers(observed, "survey.rss_dbm"), numbers(observed, "survey.position_m")
    heard_dbm = numbers(observed, "walks.rss_dbm")
    heard_dbm = heard_dbm.reshape(len(heard_dbm), -1, heard_dbm.shape[-1])
    maps = {
        SURVEYED: (surveyed_dbm, surveyed_m),
        TRUE_POSES: (heard_dbm, numbers(truth, "truth.path_m").reshape(len(heard_dbm), -1, 2)),
    }
    if "survey.sparse" in observed:
        sparse = np.asarray(observed["survey.sparse"], dtype=bool)
        maps[SPARSE] = (surveyed_dbm, np.where(sparse[..., None], surveyed_m, np.nan))
    found = study.results.estimate(ALIGNED, family).get("position_m")
    if found is not None and len(found):
        worlds = min(len(found), len(heard_dbm))
        own_m, true_m = np.asarray(found[:worlds], dtype=float), numbers(truth, "truth.position_m")[:worlds]
        maps[ALIGNED] = (heard_dbm, fit_to(own_m, true_m).reshape(worlds, -1, 2))
    query_dbm, query_m = numbers(observed, "query.rss_dbm"), numbers(truth, "truth.query_m")
    errors = {}
    for name, (rss_dbm, place_m) in maps.items():
        own = [located_error_m(*parts) for parts in zip(rss_dbm, place_m, query_dbm, query_m, strict=False)]
        own = [error_m[~np.isnan(error_m)] for error_m in own]
        if any(len(error_m) for error_m in own):
            errors[name] = own
    return errors
