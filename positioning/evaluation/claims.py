"""The verdict on each claim of a paper: printed numbers beside rebuilt ones, by the same rules for all.

A claim says where it stands in the paper, its digits as printed, what quantity of the study it
speaks of, and its kind:

======== ==========================================================================================
value    a number (also a share): ``reproduced`` where the printed digits lie inside the central 95 %
         of single experiments over the worlds, else ``not reproduced`` with the distance
ordering the quantities ascend in the order listed; smallest: a quantity is smaller than each of
         ``than``; ratio and bound: a quantity (or its ratio to another) keeps to ``at_least`` /
         ``at_most``, or is ``outside`` two limits. The share of worlds in which that is so decides:
         ``holds`` from 95 %, ``fails`` to 5 %, else ``depends``. A tie is no ascent.
exact    a deterministic scenario: ``exact`` where the rebuilt number has the printed digits
none     the paper gives no number: the rebuilt one is reported, ``none given``
words    nothing that a study here can measure: ``not testable``, with the reason
======== ==========================================================================================

A printed number stands for all numbers that round to its digits, half a unit of the last one to either
side; so does a limit, unless the claim says that it is ``exact``, as in "below 1 m", or ``assumed`` here.
The best setting of a sweep is one of those tried: it is not rounded, and its interval ends at settings
that were tried.

An interval that is wider than twice the printed number takes almost any number in: a claim that is
reproduced in it says so, ``a wide interval: a weak test``.

Before worlds decide a condition, the paper's own printed numbers are put into it: where none of the
numbers that they stand for fulfil it, the claim ``contradicts itself``. A number that set a free
parameter is ``calibrated``. Fewer than 39 worlds give no 95 % interval without an assumption: then a printed
number outside what they span is ``not reproduced`` only where it is also outside the 95 % prediction interval
of normal values, else ``undecided``. Fewer than `FEW` worlds decide nothing against a number, and no
condition; that happens in quick builds only.
"""

from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.evaluation.statistics import (
    CONFIDENCE,
    Interval,
    prediction_interval,
    share_interval,
    single_experiment_interval,
)

VERDICTS = (
    "exact",
    "reproduced",
    "holds",
    "depends",
    "not reproduced",
    "fails",
    "contradicts itself",
    "calibrated",
    "none given",
    "not testable",
    "undecided",
)
CONDITIONS = ("ordering", "smallest", "ratio", "bound")
"""Kinds of claims that worlds meet or do not: what is rebuilt is the share of them."""

WIDE = 2.0
"""An interval as wide as so many times the printed number tests it weakly."""

COLUMNS = ["claim", "paper", "study", "where", "what", "unit"]
COLUMNS += ["printed", "rebuilt", "low", "high", "worlds", "verdict", "reason"]


def judge(
    claims: Sequence[Mapping[str, Any]],
    measures: pd.DataFrame,
    *,
    paper: str,
    study: str,
    family: str,
    calibrated: Mapping[str, str],
) -> pd.DataFrame:
    """Return the ledger of a study: one row a claim, columns ``COLUMNS``.

    Parameters
    ----------
    claims
        The study's claims, as in ``data/papers/<key>.yaml``.
    measures
        One value a row: ``family, algorithm, value, world, metric, x``; ``value`` is the setting of a
        sweep, NaN for rows of the table.
    paper, study
        Keys of the paper and of the study.
    family
        The family of worlds that a claim speaks of unless it names another.
    calibrated
        Claims that set a free parameter, with the sentence that says which. Other claims on the
        same quantity are calibrated with them.

    Raises
    ------
    InputError
        For a metric that the study does not measure.
    """
    spoken_of = [(c["quantity"], calibrated[c["id"]]) for c in claims if c["id"] in calibrated]
    rows = []
    for claim in claims:
        because = next((why for quantity, why in spoken_of if quantity == claim.get("quantity")), None)
        rows.append(
            {
                "claim": claim["id"],
                "paper": paper,
                "study": study,
                "where": claim["where"],
                "what": claim["what"],
                # A condition has a share of worlds, whatever its limit is measured in.
                "unit": "" if claim["kind"] in CONDITIONS else claim.get("unit", ""),
                "printed": claim.get("printed", ""),
                **_judge_one(claim, claims, measures, family, because),
            }
        )
    return pd.DataFrame(rows, columns=COLUMNS)


def per_world(measures: pd.DataFrame, quantity: Mapping[str, Any], family: str, name: str) -> pd.Series:
    """Return a quantity's value in every world, indexed by world.

    Parameters
    ----------
    measures, family
        As in `judge`.
    quantity
        ``{algorithm, metric}`` for a row of the table; ``{sweep, metric, at}`` for a point of a
        sweep; ``{sweep, argmin}`` for the setting at which a sweep's metric is smallest, of equal
        ones the smallest setting. With ``family`` where it is another one.
    name
        The claim, for the error.

    Raises
    ------
    InputError
        Where nothing of that name was measured.
    """
    metric = quantity.get("metric", quantity.get("argmin"))
    chosen = _of_row(measures, quantity, family)
    chosen = chosen[chosen["metric"] == metric]
    if "at" in quantity:
        chosen = chosen[chosen["value"] == quantity["at"]]
    if chosen.empty:
        raise InputError(
            f"claim {name}",
            f"the study measured no {dict(quantity)}",
            "Name a metric of the tables, and a value of the sweep",
        )
    if "argmin" in quantity:
        best = chosen.sort_values(["world", "x", "value"]).groupby("world").first()
        return pd.Series(best["value"])
    return pd.Series(chosen.set_index("world")["x"].sort_index())


def _of_row(measures: pd.DataFrame, quantity: Mapping[str, Any], family: str) -> pd.DataFrame:
    """Return what was measured of the row or sweep that a quantity names, in its family."""
    here = measures["family"] == quantity.get("family", family)
    row = quantity.get("algorithm", quantity.get("sweep"))
    return pd.DataFrame(measures[here & (measures["algorithm"] == row)])


def quantities(claim: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return all quantities that a claim speaks of, in its order."""
    single = [claim[key] for key in ("quantity", "to") if key in claim]
    return [*claim.get("quantities", []), *single, *claim.get("than", [])]


def _judge_one(
    claim: Mapping[str, Any],
    claims: Sequence[Mapping[str, Any]],
    measures: pd.DataFrame,
    family: str,
    calibrated: str | None,
) -> dict[str, Any]:
    kind = claim["kind"]
    if kind == "words":
        return _row(verdict="not testable", reason=claim["reason"])
    absent = [q for q in quantities(claim) if _of_row(measures, q, family).empty]
    if absent:
        names = ", ".join(dict.fromkeys(str(q.get("algorithm", q.get("sweep"))) for q in absent))
        return _row(
            verdict="not testable", reason=f"nothing was measured of {names}: not configured, or skipped"
        )
    found = [per_world(measures, q, family, claim["id"]) for q in quantities(claim)]
    columns = pd.concat(found, axis=1, join="inner").to_numpy(dtype=float)
    if not len(columns):
        return _row(verdict="not testable", reason="the quantities were measured in no world in common")
    if kind not in ("value", "exact", "none"):
        return _condition(claim, claims, columns)
    values = columns[:, 0]
    if kind == "value" and calibrated is not None:
        return _row(values.mean(), single_experiment_interval(values), len(values), "calibrated", calibrated)
    if kind == "value" and "argmin" in claim["quantity"]:
        tried = np.unique(_of_row(measures, claim["quantity"], family)["value"].to_numpy(dtype=float))
        return _best_setting(claim, values, tried)
    return {"value": _value, "exact": _exact, "none": _none}[kind](claim, values)


FEW = 12
"""Fewer worlds than this judge no condition, and nothing against a printed number."""


def _value(claim: Mapping[str, Any], values: NDArray[np.float64]) -> dict[str, Any]:
    printed, interval, n = float(claim["printed"]), single_experiment_interval(values), len(values)
    half = _half_unit(claim["printed"])
    span = f"{_short(interval.low)} to {_short(interval.high)}"
    covers = f"the central {100 * interval.coverage:.0f} % of single experiments over {n} worlds"
    weak = "; a wide interval: a weak test" if interval.high - interval.low > WIDE * abs(printed) else ""
    if interval.low <= printed <= interval.high:
        reason = f"inside {span}, {covers}{weak}"
        return _row(values.mean(), interval, n, "reproduced", _with_note(reason, claim))
    if interval.low - half <= printed <= interval.high + half:
        reason = f"rounds to the end of {span}, {covers}{weak}"
        return _row(values.mean(), interval, n, "reproduced", _with_note(reason, claim))
    distance = printed - values.mean()
    spread = (
        f", {abs(distance) / values.std(ddof=1):.1f} standard deviations"
        if n > 1 and values.std() > 0
        else ""
    )
    side = "above" if distance > 0 else "below"
    reason = f"outside {span}, {covers}: {abs(distance):.3g} {side} the mean{spread}"
    verdict = _against(interval)
    if verdict == "undecided" and n >= FEW:
        normal = prediction_interval(values)
        ends = f"{_short(normal.low)} to {_short(normal.high)}, the 95 % prediction interval of normal values"
        within = normal.low <= printed + half and printed - half <= normal.high
        verdict = "undecided" if within else "not reproduced"
        reason += f"; {'inside' if within else 'outside'} {ends}"
    return _row(values.mean(), interval, n, verdict, _with_note(reason, claim))


def _best_setting(
    claim: Mapping[str, Any], values: NDArray[np.float64], tried: NDArray[np.float64]
) -> dict[str, Any]:
    """Judge the printed best setting of a sweep: all numbers told are settings that were tried."""
    printed, n, coverage = float(claim["printed"]), len(values), single_experiment_interval(values).coverage
    middle, low, high = np.quantile(
        values, [0.5, (1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], method="inverted_cdf"
    )
    interval = Interval(float(low), float(high), coverage)
    reason = (
        f"best in {np.count_nonzero(values == printed)} of {n} worlds, the other settings as printed;"
        f" the central {100 * coverage:.0f} % of worlds have their best from {low:g} to {high:g}"
    )
    ends = [
        f"{end:g} in {np.count_nonzero(values == end)}"
        for end in (tried[0], tried[-1])
        if (values == end).any()
    ]
    if ends:
        reason += f"; at an end of what was tried: {' and '.join(ends)}"
    verdict = "reproduced" if low <= printed <= high else _against(interval)
    return _row(float(middle), interval, n, verdict, _with_note(reason, claim))


def _against(interval: Interval) -> str:
    return "not reproduced" if interval.coverage >= CONFIDENCE else "undecided"


def _exact(claim: Mapping[str, Any], values: NDArray[np.float64]) -> dict[str, Any]:
    rebuilt = values[0]
    digits = -int(Decimal(claim["printed"]).as_tuple().exponent)
    if f"{rebuilt:.{digits}f}" == f"{Decimal(claim['printed']):.{digits}f}":
        return _row(rebuilt, None, len(values), "exact", _with_note("every printed digit", claim))
    reason = f"rebuilt {rebuilt:.{digits + 2}f}, a difference of {abs(rebuilt - float(claim['printed'])):.3g}"
    return _row(rebuilt, None, len(values), "not reproduced", _with_note(reason, claim))


def _none(claim: Mapping[str, Any], values: NDArray[np.float64]) -> dict[str, Any]:
    interval = single_experiment_interval(values)
    return _row(
        values.mean(), interval, len(values), "none given", _with_note("the paper prints no number", claim)
    )


def _condition(
    claim: Mapping[str, Any], claims: Sequence[Mapping[str, Any]], columns: NDArray[np.float64]
) -> dict[str, Any]:
    """Judge an ordering, a ratio or a bound by the share of worlds [world, quantity] in which it holds."""
    met = np.asarray([_possible(claim, row, row) for row in columns])
    successes, n = int(met.sum()), len(met)
    interval, share = share_interval(successes, n), successes / n
    verdict = "holds" if share >= CONFIDENCE else "fails" if share <= 1 - CONFIDENCE else "depends"
    reason = f"true in {successes} of {n} worlds"
    if n < FEW:
        verdict = "undecided"
    elif (n - 1) / (n + 1) < CONFIDENCE:
        # The verdict goes by the share that was seen; few worlds leave much room beside it.
        reason += f", a share of {interval.low:.2f} to {interval.high:.2f} with 95 %"
    own = [_printed_number(q, claims) for q in quantities(claim)]
    printed = [number for number in own if number is not None]
    if len(printed) == len(own):
        low = np.asarray([float(number) - _half_unit(number) for number in printed])
        high = np.asarray([float(number) + _half_unit(number) for number in printed])
        if not _possible(claim, low, high):
            verdict, reason = (
                "contradicts itself",
                f"the paper prints {_arithmetic(claim, printed)}; {reason}",
            )
        else:
            reason += f"; the paper prints {_arithmetic(claim, printed)}"
    return _row(share, interval, n, verdict, _with_note(reason, claim))


def _possible(claim: Mapping[str, Any], low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
    """Tell whether some numbers between ``low`` and ``high`` [quantity] fulfil a condition."""
    if claim["kind"] == "ordering":
        # Each number as small as those before it allow.
        return bool(np.all(np.maximum.accumulate(low)[:-1] < high[1:]))
    if claim["kind"] == "smallest":
        return bool(np.all(low[0] < high[1:]))
    smallest, largest = (
        (low[0] / high[1], high[0] / low[1]) if claim["kind"] == "ratio" else (low[0], high[0])
    )
    exact = claim.get("limit") in ("assumed", "exact")
    if "outside" in claim:
        below, above = claim["outside"]
        return bool(
            smallest < float(below) + (0 if exact else _half_unit(below))
            or largest > float(above) - (0 if exact else _half_unit(above))
        )
    at_least, at_most = claim.get("at_least"), claim.get("at_most")
    return (at_least is None or largest >= float(at_least) - (0 if exact else _half_unit(at_least))) and (
        at_most is None or smallest <= float(at_most) + (0 if exact else _half_unit(at_most))
    )


def _arithmetic(claim: Mapping[str, Any], printed: Sequence[str]) -> str:
    limits = [
        f"{word} {claim[key]}"
        for key, word in (("at_least", "at least"), ("at_most", "at most"))
        if key in claim
    ]
    wanted = f"outside {' to '.join(claim['outside'])}" if "outside" in claim else " and ".join(limits)
    if claim["kind"] == "ordering":
        return ", ".join(printed) + " (ascending is claimed)"
    if claim["kind"] == "smallest":
        return f"{printed[0]}, and {', '.join(printed[1:])} (the first as smallest is claimed)"
    if claim["kind"] == "ratio":
        return (
            f"{printed[0]} / {printed[1]} = {float(printed[0]) / float(printed[1]):.3f} ({wanted} is claimed)"
        )
    return f"{printed[0]} ({wanted} is claimed)"


def _printed_number(quantity: Mapping[str, Any], claims: Sequence[Mapping[str, Any]]) -> str | None:
    """Find the number that the paper prints for a quantity among its value claims."""
    return next((c["printed"] for c in claims if c["kind"] == "value" and c["quantity"] == quantity), None)


def _half_unit(printed: str) -> float:
    """Half a unit of the last printed digit: a rounded number stands for all that round to it."""
    return float(Decimal(5).scaleb(int(Decimal(printed).as_tuple().exponent) - 1))


def _short(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def _with_note(reason: str, claim: Mapping[str, Any]) -> str:
    return f"{reason}; {claim['note']}" if "note" in claim else reason


def _row(
    rebuilt: float | None = None,
    interval: Any = None,
    worlds: int = 0,
    verdict: str = "",
    reason: str = "",
) -> dict[str, Any]:
    nothing = float("nan")
    return {
        "rebuilt": nothing if rebuilt is None else float(rebuilt),
        "low": nothing if interval is None else interval.low,
        "high": nothing if interval is None else interval.high,
        "worlds": worlds,
        "verdict": verdict,
        "reason": reason,
    }
