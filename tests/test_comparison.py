"""All algorithms of a task beside each other: roles, shares, ranks, the page and its script."""

import importlib.util
import json
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import CHROMIUM

from positioning.evaluation import comparison as c
from positioning.evaluation.comparison_lines import COLUMNS, StudyTables, roles
from positioning.evaluation.measures import PAIRED
from positioning.evaluation.measures import table as study_table
from positioning.evaluation.ranks import complete_block, difference_ranks, mean_ranks, worlds_won
from positioning.evaluation.statistics import mean_interval, paired_difference
from positioning.presentation import figures
from positioning.presentation.comparison import page
from positioning.presentation.comparison_figures import _decades, draw
from positioning.presentation.comparison_text import (
    TOO_NARROW,
    answer,
    answered,
    duration,
    fewer_worlds,
    reservation,
)

ROOT = Path(__file__).resolve().parents[1]
TEMPLATES = ROOT / "positioning/presentation/templates"
WORLDS, SAMPLES = 12, 20
ENTRIES = {
    "wknn": {"use": "wknn", "task": "fingerprinting", "parameters": {"k": 6}, "options": {}},
    "wknn_wide": {"use": "wknn", "task": "fingerprinting", "parameters": {"k": 20}, "options": {}},
    "knn": {"use": "knn", "task": "fingerprinting", "parameters": {}, "options": {}},
    "mine": {"use": "mine", "task": "fingerprinting", "parameters": {}, "options": {}},
    "mlp": {"use": "mlp", "task": "fingerprinting", "parameters": {}, "options": {}},
    "control_centre": {"use": "control_centre", "task": "fingerprinting", "parameters": {}, "options": {}},
}
MEANS = {"wknn": 2.0, "wknn_wide": 1.0, "knn": 2.4, "mine": 1.6, "mlp": 3.5, "control_centre": 9.0}
ACCEPTED = {("fingerprinting", row) for row in ENTRIES if row != "mine"}


def study(name="rooms", kind="synthetic", families=("a", "b", "c"), rows=tuple(ENTRIES), worlds=WORLDS):
    rng = np.random.default_rng(len(name))
    measures, pairs, times, means = [], [], [], {}
    for family in families:
        world = 0.1 * rng.standard_normal(worlds)
        for row in rows:
            means[(family, row)] = mean = MEANS[row] + world + 0.05 * rng.standard_normal(worlds)
            for number, value in enumerate(mean):
                values = dict.fromkeys(("mean_m", "rmse_m", "p50_m", "p75_m", "p90_m", "p95_m"), value)
                values |= {"n": SAMPLES, "se_m": 0.1, "max_m": value}
                measures += [(family, row, np.nan, number, metric, x) for metric, x in values.items()]
                times.append((family, row, np.nan, number, 0.01 * MEANS[row]))
        for row in rows:
            for against in rows:
                if row != against:
                    result = paired_difference(means[(family, row)], means[(family, against)])
                    pairs.append((family, row, against, *result, "world"))
    frame = pd.DataFrame(measures, columns=["family", "algorithm", "value", "world", "metric", "x"])
    own = frame[frame["metric"] == "mean_m"].rename(columns={"x": "mean_m"})
    return StudyTables(
        study=name,
        title=f"Study {name}",
        kind=kind,
        reference="wknn",
        entries={row: ENTRIES[row] for row in rows},
        table=study_table(frame, rows, families, {}, {}),
        paired=pd.DataFrame(
            pairs,
            columns=PAIRED,
        ),
        times=pd.DataFrame(times, columns=["family", "algorithm", "value", "world", "seconds"]),
        worlds=own[["family", "algorithm", "world", "mean_m"]],
    )


@pytest.fixture(scope="module")
def compared():
    return c.compare([study(), study("halls", "recorded", ("d", "e", "f"), worlds=1)], ACCEPTED)


@pytest.fixture(scope="module")
def built(compared, tmp_path_factory):
    folder = tmp_path_factory.mktemp("comparison")
    figures.save(draw(compared), folder)
    manifest = {"commit": "abc", "dirty": True, "packages": {"numpy": "2"}, "seconds_by_rule": {"run": 7}}
    return folder, page(compared, folder, manifest)


def test_of_rows_built_alike_one_competes_and_a_new_one_takes_no_place():
    reduced = {"use": "reduced", "task": "fingerprinting", "options": {}}
    entries = {
        "later": {**ENTRIES["knn"], "use": "knn"},
        "knn": ENTRIES["knn"],
        "first": {**reduced, "parameters": {"access_points": {"use": "strongest", "columns": 4}}},
        "more": {**reduced, "parameters": {"access_points": {"use": "strongest", "columns": 8}}},
        "other": {**reduced, "parameters": {"access_points": {"use": "random_choice", "columns": 4}}},
        "newest": {**reduced, "parameters": {"access_points": {"use": "random_choice", "columns": 9}}},
        "chosen": {**ENTRIES["knn"], "parameters": {"k": 9}},
        "control_oracle": {"use": "control_oracle", "task": "fingerprinting"},
    }
    accepted = {("fingerprinting", row) for row in entries if row != "newest"}
    found = roles(entries, "chosen", accepted)
    assert {row: role for row, (role, _) in found.items()} == {
        "later": "variant",
        "knn": "main",
        "first": "main",
        "more": "variant",
        "other": "main",
        "newest": "variant",
        "chosen": "main",
        "control_oracle": "control",
    }
    assert [row for row, (_, new) in found.items() if new] == ["newest"]
    first = {"newest": entries["newest"], "other": entries["other"]}
    assert roles(first, "other", accepted)["newest"] == ("variant", True)


def test_ranks_and_shares_are_among_those_that_compete(compared):
    lines = compared[0].lines
    own = lines[lines["family"] == "a"].set_index("algorithm")
    assert own["rank"].to_dict() == pytest.approx(
        {"mine": 1, "wknn": 2, "knn": 3, "mlp": 4, "wknn_wide": np.nan, "control_centre": np.nan}, nan_ok=True
    )
    assert own.loc["wknn", "beaten_share"] == pytest.approx(2 / 3)
    assert own.loc["mine", "worlds_won_share"] == 1
    assert np.isnan(own.loc["wknn_wide", "worlds_won_share"])
    assert list(own.index[own["new"]]) == ["mine"]
    assert lines.columns.tolist() == COLUMNS


def test_intervals_of_means_are_over_worlds_or_over_samples(compared):
    lines = compared[0].lines.set_index(["family", "algorithm"])
    made, real = lines.loc[("a", "wknn")], lines.loc[("d", "wknn")]
    own = study().worlds
    values = own[(own["family"] == "a") & (own["algorithm"] == "wknn")]["mean_m"].to_numpy()
    low, high, _ = mean_interval(values)
    assert (made["interval_low_m"], made["interval_high_m"]) == pytest.approx((low, high))
    assert (made["interval_over"], real["interval_over"]) == ("worlds", "samples")
    # Student's quantile of 19 degrees of freedom is 2.093.
    assert real["interval_high_m"] - real["mean_m"] == pytest.approx(0.2093, abs=1e-4)


def test_a_world_is_shared_by_equal_errors_and_absent_rows_win_nothing():
    mean_m = np.array([[1.0, 1.0 + 5e-5, 2.0], [3.0, 1.0, np.nan], [np.nan, np.nan, 1.0], [np.nan] * 3])
    assert worlds_won(mean_m) == pytest.approx([0.5 / 3, 1.5 / 3, 1 / 3])
    assert worlds_won(np.array([[1.0, 1.0 + 3e-4]])) == pytest.approx([1, 0])


def differences(mean_m):
    mean_m = np.asarray(mean_m, dtype=float)
    return mean_m[..., :, None] - mean_m[..., None, :]


def test_ranks_of_equal_samples_are_those_of_the_means_and_ties_share_a_rank():
    mean_m = np.array([[3.0, 1.0, 2.0, 1.0 + 5e-5], [1.0, 2.0, 3.0, 4.0], [2.0, 2.0, 2.0, 2.0]])
    expected = [[4, 1.5, 3, 1.5], [1, 2, 3, 4], [2.5, 2.5, 2.5, 2.5]]
    assert difference_ranks(differences(mean_m), mean_m).tolist() == expected
    apart = np.array([1.0, 1.0 + 3e-4])
    assert difference_ranks(differences(apart), apart).tolist() == [1, 2]


def test_ranks_are_of_common_samples_and_nothing_common_is_a_tie():
    # The first has the smallest mean because it answers easy samples alone, at which the second is better.
    mean_m = np.array([1.0, 2.0, 3.0])
    difference_m = np.array([[0, 0.5, np.nan], [-0.5, 0, -1.0], [np.nan, 1.0, 0]])
    assert difference_ranks(difference_m, mean_m).tolist() == [2.5, 1, 2.5]


def refusing(own, row, families, share, difference_m, mean_m):
    """Return a study in which a row answers a share of the samples, with a difference to all others."""
    table, paired, worlds = own.table.copy(), own.paired.copy(), own.worlds.copy()
    here = (table["algorithm"] == row) & table["family"].isin(families)
    table.loc[here, "n"] = round(SAMPLES * share)
    table.loc[here, "mean_m"] = mean_m
    worlds.loc[(worlds["algorithm"] == row) & worlds["family"].isin(families), "mean_m"] = mean_m
    inside = paired["family"].isin(families)
    paired.loc[inside & (paired["algorithm"] == row), "difference_m"] = difference_m
    paired.loc[inside & (paired["against"] == row), "difference_m"] = -difference_m
    return StudyTables(**{**vars(own), "table": table, "paired": paired, "worlds": worlds})


def test_who_refuses_hard_samples_gains_nothing():
    own = refusing(study(), "mlp", ("a",), 0.5, 1.5, 0.1)
    lines = c.compare([own], ACCEPTED)[0].lines
    here = lines[lines["family"] == "a"].set_index("algorithm")
    assert here.loc["mlp", ["coverage", "rank", "beaten_share"]].tolist() == [0.5, 4, 0]
    assert here.loc["knn", "coverage"] == 1
    assert np.isnan(here.loc["mlp", "worlds_won_share"])
    assert here.loc["mine", ["rank", "worlds_won_share", "over_best"]].tolist() == [1, 1, 1]
    # The smallest mean of those that answer everything, and the difference from it.
    best_m = here.loc["mine", "mean_m"]
    assert here.loc["mlp", "over_best"] == pytest.approx((best_m + 1.5) / best_m)


def hurried(own, row, families, ran_in):
    """Return a study in which a row ran in its first worlds alone."""
    table = own.table.copy()
    here = (table["algorithm"] == row) & table["family"].isin(families)
    table.loc[here, "worlds"] = ran_in

    def kept(frame):
        return frame[
            (frame["algorithm"] != row) | ~frame["family"].isin(families) | (frame["world"] < ran_in)
        ]

    return StudyTables(**{**vars(own), "table": table, "worlds": kept(own.worlds), "times": kept(own.times)})


def test_who_ran_in_fewer_worlds_refuses_nothing_and_wins_none_it_did_not_see(tmp_path):
    families = ("a", "b", "c", "d", "e")
    own = hurried(study(families=families), "mine", ("a",), 3)
    compared = c.compare([own], ACCEPTED)
    lines, group = compared[0].lines, compared[0].groups[0]
    here = lines[lines["family"] == "a"].set_index("algorithm")
    assert here.loc["mine", ["worlds", "of_worlds", "coverage", "rank"]].tolist() == [3, WORLDS, 1, 1]
    assert np.isnan(here.loc["mine", "worlds_won_share"])
    assert here.loc["wknn", "worlds_won_share"] == 1
    # Its mean is over other worlds than those of the others: the paired difference brings it to all.
    common_m = own.paired.set_index(["family", "algorithm", "against"])["difference_m"]
    likened_m = here.loc["wknn", "mean_m"] + common_m["a", "mine", "wknn"]
    assert here.loc["wknn", "over_best"] == pytest.approx(here.loc["wknn", "mean_m"] / likened_m)
    assert len(group.ranks.rank) == 5
    told = f"In fewer worlds, and compared with others in these alone: mine in 3 of the {WORLDS} of rooms: a."
    assert fewer_worlds(group.lines) == told
    drawn = draw(compared)
    assert all("fewer worlds" in item.caption or "hollow marker" in item.caption for item in drawn)
    figures.save(drawn, tmp_path)
    text = page(compared, tmp_path, {})
    assert told in text
    assert f"3 of {WORLDS} worlds" in text


def test_a_world_without_any_answer_is_refused_not_left_out():
    own = study(families=("a",))
    table = own.table.copy()
    table.loc[table["algorithm"] == "mlp", "worlds"] = WORLDS // 2
    silent = (own.worlds["algorithm"] == "mlp") & (own.worlds["world"] >= WORLDS // 2)
    part = StudyTables(**{**vars(own), "table": table, "worlds": own.worlds[~silent]})
    lines = c.compare([part], ACCEPTED)[0].lines.set_index("algorithm")
    assert lines.loc["mlp", ["worlds", "of_worlds", "coverage"]].tolist() == [WORLDS // 2, WORLDS, 0.5]


def test_a_mean_over_easy_samples_has_a_hollow_marker():
    compared = c.compare([refusing(study(families=("a",)), "mlp", ("a",), 0.5, 1.5, 0.1)], ACCEPTED)
    times = next(item for item in draw(compared) if item.name.endswith("times"))
    assert "less than 98 % of the samples" in times.caption
    whole = c.compare([study(families=("a",))], ACCEPTED)
    assert "hollow" not in next(item for item in draw(whole) if item.name.endswith("times")).caption


def test_data_sets_with_refusals_leave_the_ranks_and_the_answer_says_so(tmp_path):
    families = ("a", "b", "c", "d", "e", "f")
    full = refusing(study(families=families), "mlp", families, 0.99, 1.5, 3.0)
    assert len(c.compare([full], ACCEPTED)[0].groups[0].ranks.rank) == 6
    part = refusing(study(families=families), "mlp", ("b",), 0.9, 1.5, 3.0)
    compared = c.compare([part], ACCEPTED)
    group = compared[0].groups[0]
    assert [family for _, family in group.ranks.rank.index] == ["a", "c", "d", "e", "f"]
    assert group.left_out.to_dict("records") == [
        {"study": "rooms", "family": "b", "kind": "synthetic", "reason": c.REFUSED}
    ]
    assert "left out of the ranks: 1 where a ranked row answers less than 98 %" in answer(group)
    assert group.summary.set_index("label").loc["mlp", "least_coverage"] == pytest.approx(0.9)
    figures.save(draw(compared), tmp_path)
    text = page(compared, tmp_path, {})
    assert "of the samples: rooms: b (synthetic)" in text
    assert "98 %<small>least 90 %</small>" in text


def test_a_data_set_of_one_error_has_no_ranks_but_stands_on_the_page(tmp_path):
    own = study("attic", "recorded", ("g",), worlds=1)
    alone = StudyTables(**{**vars(own), "table": own.table.assign(n=1)})
    joined = c.compare([study(families=("a", "b", "c", "d", "e")), alone], ACCEPTED)
    lines = joined[0].lines
    here = lines[(lines["family"] == "g") & (lines["role"] == "main")]
    assert here["competes"].all()
    assert here[["rank", "beaten_share", "worlds_won_share", "over_best"]].isna().all(axis=None)
    group = joined[0].groups[0]
    assert len(group.ranks.rank) == 5
    assert group.left_out["reason"].tolist() == [c.ONE_SAMPLE]
    figures.save(draw(joined), tmp_path)
    assert 'data-set="attic/g"' in page(joined, tmp_path, {})


def test_block_is_the_largest_that_is_complete():
    present = {("s", f"{i}"): {"x", "y", "z"} for i in range(5)}
    present |= {("s", "6"): {"x", "y", "z", "w"}, ("s", "7"): {"x", "y"}, ("t", "8"): {"x", "y", "w"}}
    block = complete_block(present)
    assert block.algorithms == ["x", "y", "z"]
    assert block.data_sets == [*(("s", f"{i}") for i in range(5)), ("s", "6")]
    assert complete_block({("s", f"{i}"): {"x", "y"} for i in range(9)}) is None
    assert complete_block({("s", f"{i}"): {"x", "y", "z"} for i in range(4)}) is None


@pytest.mark.parametrize(
    ("algorithms", "quantile"), [(3, 2.343), (4, 2.569), (5, 2.728), (6, 2.850), (10, 3.164)]
)
def test_critical_difference_is_that_of_the_printed_table(algorithms, quantile):
    """The quantiles are those of Demsar (2006), Table 5a, at the level of 5 %."""
    rank = pd.DataFrame(np.random.default_rng(0).random((8, algorithms))).rank(axis=1)
    expected = quantile * np.sqrt(algorithms * (algorithms + 1) / (6 * 8))
    assert mean_ranks(rank).critical_difference == pytest.approx(expected, abs=5e-3)


def test_mean_ranks_and_friedman_of_a_worked_example():
    # Four data sets in one order: chi square is 12 / (4 * 3 * 4) * (16 + 64 + 144) - 3 * 4 * 4 = 8.
    found = mean_ranks(pd.DataFrame({"slow": [3.0] * 4, "good": [1.0] * 4, "fair": [2.0] * 4}))
    assert found.mean.to_dict() == {"good": 1, "fair": 2, "slow": 3}
    assert found.friedman_p == pytest.approx(np.exp(-8 / 2))
    assert found.best() == ["good"]
    assert found.unlike_best() == ["slow"]


@pytest.mark.filterwarnings("error")
def test_ranks_that_are_equal_everywhere_tell_no_difference():
    found = mean_ranks(pd.DataFrame({name: [2.0] * 5 for name in ("x", "y", "z")}))
    assert found.friedman_p == 1
    assert found.best() == ["x", "y", "z"]
    assert found.unlike_best() == []


def test_outcomes_count_intervals_clear_of_zero_on_each_side():
    pairs = pd.DataFrame(
        [
            ("x", "y", "world", -2.0, -1.0, 9),
            ("x", "y", "world", -1.0, 1.0, 9),
            ("x", "y", "world", 1.0, 2.0, 9),
            ("x", "y", "world", -2.0, -1.0, 9),
            ("x", "y", "sample", 1.0, 2.0, 9),
            ("x", "y", "sample", np.nan, np.nan, 1),
        ],
        columns=["label", "against", "unit", "low_m", "high_m", "n"],
    )
    assert c.paired_outcomes(pairs).to_dict("records") == [
        {"label": "x", "against": "y", "unit": "world", "better": 2, "worse": 1, "n": 4},
        {"label": "x", "against": "y", "unit": "sample", "better": 0, "worse": 1, "n": 1},
    ]


def test_studies_stand_together_where_their_algorithms_meet():
    apart = study("tower", rows=("mlp", "mine"))
    near = study("attic", rows=("wknn", "knn"), families=("a",))
    alone = study("cellar", rows=("wknn",), families=("a",))
    far = StudyTables(
        **{**vars(apart), "entries": {r: {**ENTRIES[r], "use": f"x_{r}"} for r in apart.entries}}
    )
    groups = c.compare([near, far, study(), alone], ACCEPTED)[0].groups
    assert [list(group.titles) for group in groups] == [["attic", "rooms", "cellar"], ["tower"]]


def test_one_name_for_two_algorithms_is_two_rows_and_other_settings_are_told():
    other = study("attic", rows=("wknn", "knn", "mlp"), families=("a",))
    entries = {**other.entries, "mlp": {**ENTRIES["mlp"], "use": "deep"}}
    entries["knn"] = {**ENTRIES["knn"], "parameters": {"k": 2}}
    group = c.compare([study(), StudyTables(**{**vars(other), "entries": entries})], ACCEPTED)[0].groups[0]
    summary = group.summary.set_index("label")
    assert {"mlp (mlp)", "mlp (deep)"} <= set(summary.index)
    assert summary["unlike_settings"].to_dict()["knn"]
    assert not summary["unlike_settings"].to_dict()["wknn"]


def test_summary_counts_every_data_set_alike(compared):
    summary = compared[0].groups[0].summary.set_index("label")
    assert list(summary.index) == ["mine", "wknn", "knn", "mlp"]
    assert summary.loc["mine", ["synthetic", "recorded", "new"]].tolist() == [3, 3, True]
    assert summary.loc["mine", "over_best"] == pytest.approx(1)
    assert summary.loc["mlp", "over_best"] == pytest.approx(3.5 / 1.6, rel=0.1)


def test_rows_that_did_not_run_are_told_with_their_reason_and_counted_nowhere():
    own = study()
    table = own.table.copy()
    table.loc[(table["algorithm"] == "mlp") & (table["family"] == "a"), ["note", "worlds", "n"]] = [
        "too big",
        None,
        None,
    ]
    worlds = own.worlds[~((own.worlds["algorithm"] == "mlp") & (own.worlds["family"] == "a"))]
    task = c.compare([StudyTables(**{**vars(own), "table": table, "worlds": worlds})], ACCEPTED)[0]
    line = task.lines.set_index(["family", "algorithm"]).loc[("a", "mlp")]
    assert (line["note"], line["worlds"]) == ("too big", 0)
    assert np.isnan(line["rank"])
    assert task.groups[0].summary.set_index("label").loc["mlp", "synthetic"] == 2


def test_a_study_without_errors_is_told_and_compared_with_nothing(tmp_path):
    own = study(families=("a",))
    table = own.table.assign(note="nobody knows the true places here", worlds=None, n=None)
    silent = StudyTables(
        **{**vars(own), "table": table, "worlds": own.worlds.iloc[:0], "paired": own.paired[:0]}
    )
    compared = c.compare([silent], ACCEPTED)
    assert compared[0].groups == []
    figures.save(draw(compared), tmp_path)
    assert "nobody knows the true places here" in page(compared, tmp_path, {})


@pytest.mark.parametrize(
    ("low", "high", "most", "ticks"),
    [
        *((0.5, 2000, 3, [1, 100]), (0.9, 12, 5, [1, 10]), (2.1, 7, 5, [3, 4, 5, 6, 7])),
        *((2.31, 2.34, 5, [2.31, 2.32, 2.33, 2.34]), (1.6, 1.95, 5, [1.6, 1.8])),
    ],
)
def test_axes_have_few_round_numbers(low, high, most, ticks):
    assert _decades(low, high, most) == pytest.approx(ticks)


class Page(HTMLParser):
    """Collects what a page is made of, and checks that elements nest."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.bad = [], [], []
        self.feed(text)
        self.close()
        assert self.open == []
        self.ids = [values["id"] for _, values in self.tags if "id" in values]

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.tags.append((tag, values))
        if tag == "th" and "scope" not in values:
            self.bad.append(values)
        if tag not in {"meta", "br", "link", "img", "hr", "input"}:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_whole_and_needs_no_network(built):
    _, text = built
    page = Page(text)
    assert page.bad == []
    assert len(page.ids) == len(set(page.ids))
    links = [values["href"] for tag, values in page.tags if tag == "a"]
    assert {link[1:] for link in links if link.startswith("#")} <= set(page.ids)
    site = {"index.html", "claims.html", "comparison.html", "method.html", "reposition.pdf"}
    assert {link for link in links if not link.startswith("#")} == site | {"rooms.html", "halls.html"}
    assert not re.search(r"(src|href|url)\s*[=(]\s*[\"']?(https?:)?//", text)
    assert all(
        values.get("role") == "img" and values["aria-label"] for tag, values in page.tags if tag == "svg"
    )
    fields = [values for _, values in page.tags if "data-table" in values]
    assert fields
    assert all(values["data-table"] in page.ids for values in fields)


def test_new_rows_stand_out_and_controls_are_shaded(built):
    _, text = built
    rows = re.findall(
        r'<tr class="([a-z ]+)" data-role="(\w+)"[^>]*><th[^>]*><code>(\w+)</code>(.*?)</th>', text
    )
    assert {(css, role) for css, role, row, _ in rows if row == "mine"} == {("main new", "main")}
    assert {css for css, _, row, _ in rows if row == "control_centre"} == {"control"}
    assert {css for css, _, row, _ in rows if row == "wknn_wide"} == {"variant"}
    assert all((">new<" in rest) == (row == "mine") for _, _, row, rest in rows)
    assert len(rows) == 6 * 6
    assert "not in the project\N{RIGHT SINGLE QUOTATION MARK}s list" in text


def test_the_page_tells_the_numbers(built, compared):
    _, text = built
    group = compared[0].groups[0]
    assert f"Lowest mean rank over 6 data sets: mine ({group.ranks.mean['mine']:.1f} of 4)" in text
    assert "; wknn is not told apart from it by mean ranks alone." in text
    assert (
        "next in rank, the error of mine is smaller on 3, larger on 0, open on 0 of 3 data sets over worlds."
        in text
    )
    caption = re.search(r"<caption><span>Over all data sets.*?</caption>", text)[0]
    assert f"critical difference: {group.ranks.critical_difference:.2f} ranks" in caption
    assert "These 6 are of 2 sources" in caption
    line = compared[0].lines.iloc[0]
    assert f'data-value="{line["mean_m"]}">{line["mean_m"]:.2f}' in text
    assert "6:0<small>of 6</small>" not in text  # single recordings of one sample pair decide nothing
    assert "3:0<small>of 3</small>" in text
    assert "<dd>yes</dd>" in text


def test_recordings_of_one_collection_are_one_source_and_worlds_and_samples_stand_apart(tmp_path):
    halls, attic = (study(name, "recorded", (name[0], name[1]), worlds=1) for name in ("halls", "attic"))
    made = study()
    for own in (halls, attic):
        # As of one recording of several samples each.
        own.paired[["unit", "n", "low_m", "high_m"]] = ["sample", 9, 1.0, 2.0]
    sources = {halls.study: {"h": "one", "a": "two"}, attic.study: {"a": "one", "t": "one"}}
    studies = [StudyTables(**{**vars(own), "sources": sources[own.study]}) for own in (halls, attic)]
    compared = c.compare([made, *studies], ACCEPTED)
    group = compared[0].groups[0]
    assert (len(group.ranks.rank), group.sources) == (7, 3)
    units = group.outcomes.set_index(["label", "against", "unit"])
    assert units.loc[("mine", "mlp", "world")].tolist() == [3, 0, 3]
    assert units.loc[("mine", "mlp", "sample")].tolist() == [0, 4, 4]
    figures.save(draw(compared), tmp_path)
    text = page(compared, tmp_path, {})
    for unit in ("worlds", "samples"):
        assert f"<caption><span>Data sets decided over {unit}: " in text
    assert "0:4<small>of 4</small>" in text
    # In the matrix over samples, in that of each of the four recordings, and under "paired difference".
    assert text.count(TOO_NARROW) == 6
    assert "These 7 are of 3 sources" in text


def test_equal_inputs_give_equal_bytes(compared, built, tmp_path):
    folder, text = built
    figures.save(draw(compared), tmp_path)
    assert page(compared, tmp_path, {"commit": "abc"}).splitlines()[:200] == text.splitlines()[:200]
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted(path.name for path in tmp_path.iterdir())
    assert all((folder / name).read_bytes() == (tmp_path / name).read_bytes() for name in names)


def test_variants_ahead_of_all_ranked_rows_are_told():
    group = c.compare([study()], ACCEPTED)[0].groups[0]
    assert group.better_variants == {"wknn_wide": 3}
    assert "than every ranked row on 3 of 3 data sets: wknn_wide on 3." in answer(group)
    learned = study()
    learned.entries["wknn_wide"] = {**ENTRIES["wknn_wide"], "options": {"protocol": "resubstitution"}}
    assert c.compare([learned], ACCEPTED)[0].groups[0].better_variants == {}


def test_run_times_are_of_the_data_sets_of_the_ranks():
    families = ("a", "b", "c", "d", "e")
    own = study(families=families)
    alone = study(name="halls", families=("x",), rows=("wknn", "knn", "control_centre"))
    slow = StudyTables(**{**vars(alone), "times": alone.times.assign(seconds=100.0)})
    group = c.compare([own, slow], ACCEPTED)[0].groups[0]
    assert [study for study, _ in group.ranks.rank.index] == ["rooms"] * 5
    assert group.summary.set_index("label").loc["wknn", "seconds"] == pytest.approx(0.02)


def test_too_few_data_sets_have_no_rank_drawing():
    compared = c.compare([study(families=("a",))], ACCEPTED)
    assert [item.name for item in draw(compared)] == ["fingerprinting_times"]
    assert "paired differences decide" in answer(compared[0].groups[0])


def test_algorithms_that_are_equal_everywhere_share_the_lowest_rank():
    own = study(families=("a", "b", "c", "d", "e"))
    table, paired = own.table.assign(mean_m=2.0), own.paired.assign(difference_m=0.0)
    worlds = own.worlds.assign(mean_m=2.0)
    alike = StudyTables(**{**vars(own), "table": table, "paired": paired, "worlds": worlds})
    group = c.compare([alike], ACCEPTED)[0].groups[0]
    assert group.summary["won_share"].tolist() == pytest.approx([0.25] * 4)
    assert answer(group).startswith("Lowest mean rank over 5 data sets: knn, mine, mlp and wknn (2.5 of 4). ")
    assert "p = 1;" in reservation(group)


@pytest.mark.parametrize(
    ("share", "told"), [(1.0, "100 %"), (0.9999, "99 %"), (0.29, "29 %"), (np.nan, "\N{EN DASH}")]
)
def test_only_all_samples_are_a_hundred_per_cent(share, told):
    assert answered(share) == told


@pytest.mark.parametrize(
    ("seconds", "told"),
    [(12.3, "12 s"), (0.99, "1.0 s"), (0.0123, "12 ms"), (2e-6, "2.0 µs"), (np.nan, "\N{EN DASH}")],
)
def test_run_times_have_two_digits(seconds, told):
    assert duration(seconds) == told


def test_the_list_of_algorithms_names_rows_of_the_configuration_once():
    known = pd.read_csv(ROOT / "data/algorithms.csv", dtype=str)
    assert not known.duplicated().any()
    assert known.equals(known.sort_values(["task", "algorithm"], ignore_index=True))
    studies = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))["studies"]
    rows = {row for values in studies.values() for row in values["algorithms"]}
    assert set(known["algorithm"]) <= rows


def test_the_script_reads_the_files_of_studies_and_writes_a_table_a_task(tmp_path):
    spec = importlib.util.spec_from_file_location(
        "comparison_script", ROOT / "workflow/scripts/comparison.py"
    )
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    own = study()
    own.table.to_csv(tmp_path / "t.csv", index=False)
    own.paired.to_csv(tmp_path / "p.csv", index=False)
    own.times.to_csv(tmp_path / "s.csv", index=False)
    swept = own.worlds.assign(value=3.0, metric="mean_m", mean_m=0.0)
    measures = pd.concat([own.worlds.assign(value=np.nan, metric="mean_m"), swept]).rename(
        columns={"mean_m": "x"}
    )
    measures.to_parquet(tmp_path / "m.parquet", index=False)
    (tmp_path / "known.csv").write_text("task,algorithm\nfingerprinting,wknn\n")
    (tmp_path / "manifest.json").write_text(json.dumps({"commit": "abc"}))
    plan = {"title": "Rooms", "recordings": {}, "reference": "wknn", "entries": ENTRIES, "quick": True}
    script.main(
        {"rooms": plan},
        {
            name: [str(tmp_path / file)]
            for name, file in (
                ("table", "t.csv"),
                ("paired", "p.csv"),
                ("times", "s.csv"),
                ("measures", "m.parquet"),
            )
        },
        str(tmp_path / "known.csv"),
        str(tmp_path / "manifest.json"),
        {"html": str(tmp_path / "comparison.html"), "folder": str(tmp_path / "comparison")},
    )
    lines = pd.read_csv(tmp_path / "comparison/fingerprinting.csv")
    assert set(lines.loc[~lines["new"], "algorithm"]) == {"wknn"}
    assert lines.loc[lines["algorithm"] == "wknn_wide", "rank"].tolist() == [1, 1, 1]
    assert "Quick build" in (tmp_path / "comparison.html").read_text(encoding="utf-8")


SORTED = """<!DOCTYPE html><meta charset="utf-8"><pre id="told"></pre>
<p class="filters" hidden><select data-filter="kind" data-table="t"><option value="">all</option>
<option value="a|b">ab</option><option value="c">c</option></select>
<input type="search" data-table="t"></p><output data-count="t"></output>
<table class="sortable" id="t"><thead><tr><th data-sort="text">name</th><th>kind</th>
<th data-sort="number">size</th></tr></thead><tbody>
<tr data-kind="a"><th>row10</th><td>a</td><td data-value="1000">1 km</td></tr>
<tr data-kind="b"><th>Row9</th><td>b</td><td>\u2212 2.5</td></tr>
<tr data-kind="c" id="hidden"><th>row1</th><td>c</td><td>\u2013</td></tr>
<tr data-kind="a"><th>row2</th><td>a</td><td>1 000</td></tr>
<tr data-kind="a"><th></th><td colspan="2">none</td></tr></tbody></table>
<script>%s</script>
<script>
const told = [];
const rows = () => [...document.querySelectorAll("tbody tr")].filter((row) => !row.hidden)
  .map((row) => row.cells[0].textContent || "-").join(" ");
const note = (what) => told.push(what + ": " + rows());
const heads = document.querySelectorAll("th[data-sort]");
const press = (n) => heads[n].querySelector("button").click();
note("start"); press(1); note("up " + heads[1].getAttribute("aria-sort"));
press(1); note("down " + heads[1].getAttribute("aria-sort"));
press(0); note("text " + heads[1].getAttribute("aria-sort"));
const select = document.querySelector("select"), search = document.querySelector("input");
const choose = (field, value) => { field.value = value; field.dispatchEvent(new Event("input")); };
choose(select, "a|b"); note("two " + document.querySelector("output").textContent);
choose(search, "ROW2  a"); note("words");
location.hash = "#hidden";
told.push("filters " + document.querySelector(".filters").hidden);
setTimeout(() => { note("link"); document.getElementById("told").textContent = told.join("\\n"); }, 50);
</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason="chromium (or google-chrome) is not installed")
def test_the_script_sorts_and_filters_in_a_browser(tmp_path):
    page = tmp_path / "page.html"
    page.write_text(SORTED % (TEMPLATES / "sort.js").read_text(encoding="utf-8"), encoding="utf-8")
    options = (
        "--headless --no-sandbox --disable-gpu --disable-background-networking --virtual-time-budget=2000"
    )
    command = [
        CHROMIUM,
        *options.split(),
        f"--user-data-dir={tmp_path / 'profile'}",
        "--dump-dom",
        page.as_uri(),
    ]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    told = re.search(r'<pre id="told">(.*?)</pre>', shown, re.DOTALL)[1].splitlines()
    assert told == [
        "start: row10 Row9 row1 row2 -",
        "up ascending: Row9 row10 row2 row1 -",
        "down descending: row10 row2 Row9 row1 -",
        "text null: row1 row2 Row9 row10 -",
        "two 4 of 5 rows: row2 Row9 row10 -",
        "words: row2",
        "filters false",
        "link: row1 row2 Row9 row10 -",
    ]


def test_the_script_is_small_and_plain():
    text = (TEMPLATES / "sort.js").read_text(encoding="utf-8")
    assert len(text.encode()) < 6000
    assert not re.search(r"https?:|import |require\(|eval|</", text)
