"""Words and numbers in which the comparison of all algorithms is told, on its page and under its figures."""

import math

import pandas as pd

from positioning.evaluation.comparison import ABSENT, ONE_SAMPLE, REFUSED, SAMPLE, WORLD, Group
from positioning.evaluation.ranks import LEAST_ALGORITHMS, LEAST_COVERAGE, Ranks
from positioning.presentation import tables

TOO_NARROW = (
    "Samples of one place depend on each other: these intervals are too narrow, and clear of zero more often"
    " than those over worlds."
)
OVER = {
    WORLD: "Synthetic families of several worlds, intervals over independent worlds.",
    SAMPLE: (
        f"Recordings and single worlds, intervals over samples. {TOO_NARROW} Several recordings of one place"
        " count as several."
    ),
}
"""What is said of paired differences, by what they are over."""

LEFT_OUT = {
    REFUSED: f"where a ranked row answers less than {100 * LEAST_COVERAGE:.0f} % of the samples",
    ABSENT: "where a ranked row did not run",
    ONE_SAMPLE: "of one error alone",
}
"""Which data sets are not in the mean ranks, in the order of telling."""


def percent(share: float) -> str:
    """Return a share in per cent, a dash where there is none."""
    return tables.NOTHING if math.isnan(share) else f"{100 * share:.0f} %"


def answered(share: float) -> str:
    """Return a share of samples in per cent, rounded down: only all of them are 100 %."""
    return tables.NOTHING if math.isnan(share) else f"{math.floor(100 * share + 1e-9)} %"


def duration(seconds: float) -> str:
    """Return a run time with two digits and the unit that suits it."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.95 * size:
            value = seconds / size
            return f"{value:.1f} {unit}" if value < 9.95 else f"{value:.0f} {unit}"
    return tables.NOTHING if math.isnan(seconds) else "below 1 µs"


def answer(group: Group) -> str:
    """Return which algorithm is ahead, how it does against the next one, and what the ranks leave out."""
    if group.ranks is None:
        return (
            f"{counted(group)}; too few data sets share {LEAST_ALGORITHMS} algorithms that answer the same"
            " samples for a critical difference, so that the paired differences decide."
            f" {_better_variants(group)}"
        ).rstrip()
    mean, best = group.ranks.mean, group.ranks.best()
    told = (
        f"Lowest mean rank over {len(group.ranks.rank)} data sets: {tables.listed(best)}"
        f" ({mean.iloc[0]:.1f} of {len(mean)})"
    )
    unlike = group.ranks.unlike_best()
    alike = [str(name) for name in mean.index if name not in unlike and name not in best]
    if alike:
        told += (
            f"; {tables.listed(alike)} {'is' if len(alike) == 1 else 'are'} not told apart from"
            f" {'it' if len(best) == 1 else 'them'} by mean ranks alone"
        )
    elif unlike:
        told += ", told apart from all others"
    parts = [f"{told}.", _against_second(group, mean), _better_variants(group), _left_out(group)]
    return " ".join(part for part in parts if part)


def _against_second(group: Group, mean: "pd.Series[float]") -> str:
    """Return the paired outcomes of the best mean rank against the next one, by unit."""
    first, second = str(mean.index[0]), str(mean.index[1])
    own = group.outcomes[(group.outcomes["label"] == first) & (group.outcomes["against"] == second)]
    found = {line["unit"]: line for line in tables.records(own)}
    told = []
    for unit in (WORLD, SAMPLE):
        if (line := found.get(unit)) is not None:
            smaller, larger, sets = (int(line[name]) for name in ("better", "worse", "n"))
            told.append(
                f"smaller on {smaller}, larger on {larger}, open on {sets - smaller - larger} of {sets}"
                f" data set{'s' * (sets != 1)} over {unit}s"
            )
    return f"Paired with {second}, next in rank, the error of {first} is {'; '.join(told)}." if told else ""


def _better_variants(group: Group) -> str:
    """Return where a variant of settings, which is not ranked, is ahead of all that are."""
    if not group.better_variants:
        return ""
    told = [f"{row} on {count}" for row, count in group.better_variants.items()]
    sets = group.lines.loc[group.lines["competes"], ["study", "family"]].drop_duplicates()
    number = len(sets)
    return (
        "Variants of settings are not ranked; one has a smaller mean error than every ranked row on"
        f" {sum(group.better_variants.values())} of {number} data set{'s' * (number != 1)}:"
        f" {tables.listed(told)}."
    )


def _left_out(group: Group) -> str:
    counts = group.left_out["reason"].value_counts()
    told = [f"{counts[reason]} {text}" for reason, text in LEFT_OUT.items() if counts.get(reason, 0)]
    return f"Data sets left out of the ranks: {tables.listed(told)}." if told else ""


def reservation(group: Group) -> str:
    """Return Friedman's p and Nemenyi's critical difference, with what they cannot know."""
    if group.ranks is None:
        return ""
    return (
        f"Friedman's test: p = {probability(group.ranks.friedman_p)}; Nemenyi's critical difference:"
        f" {group.ranks.critical_difference:.2f} ranks. {dependent(group, group.ranks)}"
        + (
            " Rows without a mean rank ran, or answered enough samples, in too few of the data sets."
            if group.summary["rank"].isna().any()
            else ""
        )
    )


def fewer_worlds(lines: pd.DataFrame) -> str:
    """Return which rows have answers in fewer worlds than others of a data set; empty where none has.

    Parameters
    ----------
    lines
        Of a group, with the column ``label``.
    """
    few = tables.records(lines[lines["worlds"] < lines["of_worlds"]])
    told = [
        f"{line['label']} in {line['worlds']} of the {line['of_worlds']:.0f}"
        f" of {line['study']}: {line['family']}"
        for line in few
    ]
    return f"In fewer worlds, and compared with others in these alone: {tables.listed(told)}." if told else ""


def dependent(group: Group, ranked: Ranks) -> str:
    """Return how far from independent the data sets are that the tests take for independent."""
    data_sets = len(ranked.rank)
    told = "Both take data sets for independent."
    if group.sources < data_sets:
        told += (
            f" These {data_sets} are of {group.sources} source{'s' * (group.sources != 1)}, collections of"
            " recordings or synthetic studies: several of one place, device or simulation count as several,"
            " so that p and the critical difference are too small."
        )
    return told


def counted(group: Group) -> str:
    """Return how many algorithms compete in a group, on how many data sets."""
    algorithms, data_sets = len(group.summary), len(data_sets_of(competing(group.lines)))
    return f"{algorithms} algorithm{'s' * (algorithms != 1)} on {data_sets} data set{'s' * (data_sets != 1)}"


def data_sets_of(lines: pd.DataFrame) -> list[tuple[str, str]]:
    """Return study and family of the lines that were measured, in their order."""
    own = lines[lines["worlds"] > 0]
    return list(dict.fromkeys(zip(own["study"].astype(str), own["family"].astype(str), strict=True)))


def competing(lines: pd.DataFrame) -> pd.DataFrame:
    """Return the lines that were measured and compete: only these may have a rank."""
    return lines[lines["competes"]]


def probability(value: float) -> str:
    """Return a probability with two digits, a very small one with one."""
    return f"{value:.2g}" if value >= 1e-3 else f"{value:.0e}".replace("e-0", "e-")
