"""What the error of an edge costs: squared, linear or robust, and with which settings.

See Gu et al., eqs. 5 and 10.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from positioning.errors import InputError, check_number
from positioning.model import Array
from positioning.posegraph.residuals import D_MAX_M, D_MIN_M

Cost = Literal["squared", "linear"]
Loss = Literal["cauchy", "huber", "dcs"]
COSTS: Final = ("squared", "linear")
LOSSES: Final = ("cauchy", "huber", "dcs")


@dataclass(frozen=True, kw_only=True)
class NearCost:
    """What the error of a proximity edge costs.

    See Gu et al., eqs. 5 and 10. With "linear", a pair adds weight * e, as eq. 5 is printed; with "squared",
    weight * e^2, as a least-squares library minimises. Each pair counts once; eq. 5 counts it in both orders,
    which is a factor of two in the weight.

    Attributes
    ----------
    weight
        Omega of eq. 5, without unit; the paper gives no value.
    d_min_m, d_max_m
        Ends of the straight line of eq. 10, metres.
    e_max
        Largest error; only weight * e_max, or weight * e_max^2, counts.
    cost
        "linear" or "squared".
    loss
        Robust loss in place of the square, with "squared" alone: "cauchy", "huber" or "dcs" (dynamic
        covariance scaling); None = the square itself.
    loss_scale
        Error from which the loss grows less than the square, in the unit of ``e_max``.
    rounding
        With "linear", the corner at ``d_min_m`` is rounded: e becomes sqrt(e^2 + r^2) - r with
        r = rounding * e_max, which is below e by less than r. Reported costs are those of e itself.
    """

    weight: float
    d_min_m: float = D_MIN_M
    d_max_m: float = D_MAX_M
    e_max: float = 1.0
    cost: Cost = "squared"
    loss: Loss | None = None
    loss_scale: float = 0.1
    rounding: float = 1e-2

    @classmethod
    def of_distance(
        cls,
        sigma_m: float,
        *,
        d_min_m: float = D_MIN_M,
        d_max_m: float = D_MAX_M,
        loss: Loss | None = None,
        scale_m: float = 1.0,
    ) -> "NearCost":
        """Return the squared cost of pairs that are known to be near up to a standard deviation.

        Where motions have information in metres, so has this cost: a pair adds the square of its distance
        beyond ``d_min_m`` as a multiple of the standard deviation, and no more beyond ``d_max_m``.

        Parameters
        ----------
        sigma_m
            Standard deviation of the distance beyond ``d_min_m``, metres, of a pair of weight one.
        d_min_m, d_max_m
            As of the class.
        loss, scale_m
            Robust loss, and the distance beyond ``d_min_m`` from which it grows less than the square, metres.

        Raises
        ------
        InputError
            For values outside their range.
        """
        check_number("sigma_m", sigma_m, above=0)
        _check_ends(d_min_m, d_max_m)
        check_number("scale_m", scale_m, above=0)
        span_m = d_max_m - d_min_m
        return cls(
            weight=(span_m / sigma_m) ** 2,
            d_min_m=d_min_m,
            d_max_m=d_max_m,
            loss=loss,
            loss_scale=scale_m / span_m,
        ).check()

    def check(self) -> "NearCost":
        """Return this cost if it can be used.

        Raises
        ------
        InputError
            For values outside their range, unknown names, or a loss with the linear cost.
        """
        check_number("weight", self.weight, least=0)
        for name in ("e_max", "loss_scale", "rounding"):
            check_number(name, getattr(self, name), above=0)
        _check_ends(self.d_min_m, self.d_max_m)
        if self.cost not in COSTS:
            raise InputError(f"cost={self.cost!r}", f"it is none of {', '.join(COSTS)}", "Correct it")
        check_loss("loss", self.loss)
        if self.loss is not None and self.cost != "squared":
            raise InputError(
                f"loss={self.loss!r}",
                "a loss replaces the square",
                "Use it with cost='squared', or leave it out",
            )
        return self


def of_error(error: Array, near: NearCost) -> tuple[Array, Array]:
    """Return first derivative and curvature of the cost by the error, for a weight of one, each [f].

    Parameters
    ----------
    error
        On the straight line of eq. 10, [f], in the unit of ``near.e_max``; may be negative.
    near
        The cost. With "linear" that of the rounded error.
    """
    if near.cost == "linear":
        root = np.hypot(error, near.rounding * near.e_max)
        return error / root, 1.0 / root
    if near.loss is None:
        return 2.0 * error, np.full_like(error, 2.0)
    slope = robust(error * error, near.loss, near.loss_scale)[1]
    return 2.0 * slope * error, 2.0 * slope


def robust(squared: Array, loss: Loss, scale: float) -> tuple[Array, Array]:
    """Return a robust loss of a squared residual, and its derivative by it, each as ``squared``.

    See Agarwal et al. (2013), "Robust map optimization using dynamic covariance scaling", for the third.

    Parameters
    ----------
    squared
        Squares of residuals, [...].
    loss
        "cauchy", "huber" or "dcs".
    scale
        Residual from which the loss grows less than the square.
    """
    limit = scale * scale
    if loss == "cauchy":
        return limit * np.log1p(squared / limit), limit / (limit + squared)
    if loss == "huber":
        root = np.sqrt(np.maximum(squared, limit))
        return np.where(squared <= limit, squared, 2.0 * scale * root - limit), scale / root
    beyond = limit * (3.0 * squared - limit) / (limit + squared)
    slope = np.minimum(1.0, 2.0 * limit / (limit + squared))
    return np.where(squared <= limit, squared, beyond), slope * slope


def check_loss(name: str, loss: str | None) -> None:
    """Check that there is a robust loss of this name; None = no loss.

    Raises
    ------
    InputError
        Saying ``name``, that of the setting, where there is none.
    """
    if loss is not None and loss not in LOSSES:
        raise InputError(f"{name}={loss!r}", f"it is none of {', '.join(LOSSES)}", "Correct it")


def _check_ends(d_min_m: float, d_max_m: float) -> None:
    check_number("d_min_m", d_min_m, least=0)
    check_number("d_max_m", d_max_m, above=0)
    if d_min_m >= d_max_m:
        limit = "they are not 0 <= d_min_m < d_max_m"
        raise InputError(f"d_min_m={d_min_m} and d_max_m={d_max_m}", limit, "Correct them")
