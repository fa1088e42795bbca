"""What the WiFi graph SLAM paper counts: headings of lines, landmark errors, radio maps, distances of scans.

See Gu et al., section IV and Figures 1, 4, 7 and 8.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.evaluation.statistics import mean_where
from positioning.evaluation.tracks import Answer, Named, Values, answers, lines, table
from positioning.files import Tree
from positioning.posegraph.similarity import rss_distance_db
from positioning.tasks.alignment import fit_to, lay_on_first_pose

NEIGHBOURS = 4
"""k of the k-NN that compares radio maps; not printed, assumed."""

NOT_HEARD_DBM = -110.0
"""See Gu et al., section III-B: what stands for an access point that was not heard."""

SURVEYED, SPARSE, TRUE_POSES = "surveyed", "surveyed_sparse", "crowdsourced_true_poses"
MAPS = (SURVEYED, SPARSE, TRUE_POSES)
"""Radio maps that no alignment made: total station at both densities, and walks with their true poses."""

SITES = ("pairs_dense", "pairs_sparse")
"""The two sites of Figure 1."""

ROWS = (*MAPS, *SITES)
"""What is measured beside the rows of the table."""

SPAN_M = (8.0, 12.0)
"""Where curves of Figure 1 are read off; assumed."""

NEAR_M = 10.0
"""The error of which Figure 8 tells the probability."""


def measures(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> pd.DataFrame:
    """Return the study's own measures of every row, one value a world, columns ``MEASURES``.

    Parameters
    ----------
    estimates
        Archives of all rows by path; the row is the name of the folder.
    worlds
        Archives of the worlds by path, ``.../<batch>/<side>.npz``.

    Returns
    -------
    DataFrame
        ``sd_m``: standard deviation of the errors at landmarks, tied by the fit over all visits;
        ``first_mean_m``, ``first_sd_m`` and ``first_max_m``: errors tied by the first pose of the first walk
        alone. ``own_first_max_m``: the largest error where each walk is tied by its own first pose.
        ``path_mean_m`` and ``path_max_m``: errors of all poses, tied by the fit. ``heading_mean_deg`` and
        ``heading_sd_deg``: error of the direction from start to end of each walk against the first walk,
        where walks are lines. ``map_within_10m``, ``map_mean_m``: k-NN positions of the query on the radio
        map that the aligned walks make, tied by the fit; also for the maps `MAPS`. ``distance_near_db`` of
        `SITES`: mean distance of scans taken `SPAN_M` apart. ``cost``, ``iterations``, ``converged``,
        ``edges`` and ``aligned_walks`` as the algorithm keeps them.
    """
    found = list(answers(estimates, worlds))
    parts = [lines(answer, _of_row(answer)) for answer in found]
    seen: set[tuple[str, str]] = set()
    for answer in found:
        # Once for each batch of a family: these need no row.
        if np.isnan(answer.value) and (answer.family, answer.batch) not in seen and _has_maps(answer):
            seen.add((answer.family, answer.batch))
            parts += [
                lines(answer._replace(row=name), _of_map(answer, *_surveyed(answer, name))) for name in MAPS
            ]
            if "pairs.dense_rss_dbm" in answer.observed:
                parts += [lines(answer._replace(row=site), _of_site(answer, site)) for site in SITES]
    return table(parts)


def _of_site(answer: Answer, site: str) -> Iterator[Named]:
    name = site.replace("pairs_", "pairs.")
    position_m, rss_dbm = (
        np.asarray(answer.observed[f"{name}_{part}"], float) for part in ("position_m", "rss_dbm")
    )
    apart_m = np.linalg.norm(position_m[:, :, None] - position_m[:, None], axis=-1)
    chosen = (apart_m >= SPAN_M[0]) & (apart_m <= SPAN_M[1])
    apart_db = rss_distance_db(rss_dbm)
    yield "distance_near_db", mean_where(apart_db, chosen & np.isfinite(apart_db), axis=(1, 2))


def _of_row(answer: Answer) -> Iterator[Named]:
    position_m = np.asarray(answer.estimates["position_m"], dtype=float)
    heading_rad = np.asarray(answer.estimates["heading_rad"], dtype=float)
    truth = {
        name: np.asarray(answer.truth[f"truth.{name}"], dtype=float)
        for name in ("position_m", "path_m", "heading_rad")
    }
    fitted_m = fit_to(position_m, truth["position_m"])
    error_m = _distance_m(fitted_m, truth["position_m"])
    asked = ~np.isnan(error_m)
    yield "sd_m", _deviation(error_m, asked)
    first_m = lay_on_first_pose(position_m, heading_rad, truth["path_m"], truth["heading_rad"])
    own_m = _distance_m(first_m, truth["position_m"])
    yield "first_mean_m", mean_where(own_m, asked)
    yield "first_sd_m", _deviation(own_m, asked)
    yield "first_max_m", np.max(np.where(asked, own_m, -np.inf), axis=1)
    each = (len(position_m) * position_m.shape[1], 1, *position_m.shape[2:])
    alone_m = lay_on_first_pose(
        *(values.reshape(*each[: values.ndim]) for values in (position_m, heading_rad)),
        *(truth[name].reshape(*each[: truth[name].ndim]) for name in ("path_m", "heading_rad")),
    ).reshape(position_m.shape)
    alone_error_m = _distance_m(alone_m, truth["position_m"])
    yield "own_first_max_m", np.max(np.where(asked, alone_error_m, -np.inf), axis=1)
    path_m = _distance_m(fitted_m, truth["path_m"])
    known = ~np.isnan(path_m)
    yield "path_mean_m", mean_where(path_m, known)
    yield "path_max_m", np.max(np.where(known, path_m, -np.inf), axis=1)
    if answer.family == "lines":
        yield from _of_lines(position_m, truth["position_m"])
    if _has_maps(answer) and answer.family != "lines":
        rss_dbm = np.asarray(answer.observed["walks.rss_dbm"], dtype=float)
        yield from _of_map(
            answer,
            rss_dbm.reshape(len(rss_dbm), -1, rss_dbm.shape[-1]),
            fitted_m.reshape(len(rss_dbm), -1, 2),
        )
    for name in ("cost", "iterations", "converged"):
        if f"extra_{name}" in answer.estimates:
            yield name, np.asarray(answer.estimates[f"extra_{name}"], dtype=float)[:, 0]
    if "extra_edges" in answer.estimates:
        # Every edge is counted at both of its ends.
        yield "edges", np.asarray(answer.estimates["extra_edges"], dtype=float).sum(axis=1) / 2
    if "extra_aligned" in answer.estimates:
        yield "aligned_walks", np.asarray(answer.estimates["extra_aligned"], dtype=float).sum(axis=1)


def _distance_m(first_m: Values, second_m: Values) -> Values:
    return np.asarray(np.linalg.norm(first_m - second_m, axis=-1).reshape(len(first_m), -1))


def _deviation(values: Values, asked: NDArray[np.bool_]) -> Values:
    mean = mean_where(values, asked)
    return np.asarray(np.sqrt(mean_where(np.square(values - mean[:, None]), asked)))


def _of_lines(position_m: Values, asked_m: Values) -> Iterator[Named]:
    """Yield how far directions of all walks but the first are from that of the first, which is the frame."""
    there = np.asarray(np.isfinite(asked_m).all(axis=-1))
    begin = np.argmax(there, axis=-1)[..., None, None]
    end = (there.shape[-1] - 1 - np.argmax(there[..., ::-1], axis=-1))[..., None, None]

    def direction(places_m: Values) -> Values:
        way = (np.take_along_axis(places_m, end, axis=2) - np.take_along_axis(places_m, begin, axis=2))[
            :, :, 0
        ]
        return np.asarray(np.arctan2(way[..., 1], way[..., 0]))

    off_rad = direction(position_m) - direction(asked_m)
    relative_deg = np.degrees(np.abs(np.angle(np.exp(1j * (off_rad - off_rad[:, :1])))))[:, 1:]
    yield "heading_mean_deg", relative_deg.mean(axis=1)
    yield "heading_sd_deg", relative_deg.std(axis=1)


def _has_maps(answer: Answer) -> bool:
    return "query.rss_dbm" in answer.observed and "survey.rss_dbm" in answer.observed


def _surveyed(answer: Answer, name: str) -> tuple[Values, Values]:
    """Return fingerprints [w, p, ap] and their places [w, p, 2], NaN where one does not belong to the map."""
    if name == TRUE_POSES:
        rss_dbm = np.asarray(answer.observed["walks.rss_dbm"], dtype=float)
        path_m = np.asarray(answer.truth["truth.path_m"], dtype=float)
        return rss_dbm.reshape(len(rss_dbm), -1, rss_dbm.shape[-1]), path_m.reshape(len(rss_dbm), -1, 2)
    position_m = np.asarray(answer.observed["survey.position_m"], dtype=float)
    if name == SPARSE:
        position_m = np.where(
            np.asarray(answer.observed["survey.sparse"], dtype=bool)[..., None], position_m, np.nan
        )
    return np.asarray(answer.observed["survey.rss_dbm"], dtype=float), position_m


def _of_map(answer: Answer, rss_dbm: Values, position_m: Values) -> Iterator[Named]:
    query_dbm = np.asarray(answer.observed["query.rss_dbm"], dtype=float)
    true_m = np.asarray(answer.truth["truth.query_m"], dtype=float)
    error_m = np.stack(
        [located_error_m(*parts) for parts in zip(rss_dbm, position_m, query_dbm, true_m, strict=True)]
    )
    asked = ~np.isnan(error_m)
    yield "map_mean_m", mean_where(error_m, asked)
    yield "map_within_10m", mean_where((error_m < NEAR_M).astype(float), asked)


def located_error_m(rss_dbm: Values, position_m: Values, query_dbm: Values, true_m: Values) -> Values:
    """Return the errors of k-NN on a radio map, [m], metres.

    See Gu et al., section IV-B: the mean place of the nearest fingerprints by eq. 9; k is not printed.

    Parameters
    ----------
    rss_dbm, position_m
        Radio map, [p, ap] and [p, 2]; rows that hear nothing or have no place do not belong to it.
    query_dbm, true_m
        Fingerprints to locate [m, ap] and their places [m, 2]; one that hears nothing is not located.
    """
    kept = np.isfinite(position_m).all(axis=-1) & np.isfinite(rss_dbm).any(axis=-1)
    heard = np.isfinite(query_dbm).any(axis=-1) & np.isfinite(true_m).all(axis=-1)
    error_m = np.full(len(query_dbm), np.nan)
    if kept.sum() < NEIGHBOURS or not heard.any():
        return error_m
    apart_db = rss_distance_db(query_dbm[heard], rss_dbm[kept])
    nearest = np.argpartition(apart_db, NEIGHBOURS - 1, axis=1)[:, :NEIGHBOURS]
    error_m[heard] = np.linalg.norm(position_m[kept][nearest].mean(axis=1) - true_m[heard], axis=-1)
    return error_m
