"""What scikit-learn asks of an estimator, without importing it: that import takes longer than most jobs."""

import copy
import inspect
from typing import Any, Self, TypeVar, cast

Kind = TypeVar("Kind")


class Estimator:
    """A class whose settings are the keywords of its constructor, as scikit-learn wants to find them.

    The scikit-learn developer guide describes this protocol: ``get_params``, ``set_params`` and tags are all
    that its ``clone``, pipelines and searches use. A class may as well derive from
    ``sklearn.base.BaseEstimator``; this base only spares a job the import.
    """

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the settings by name, those of settings that are estimators as ``<name>__<setting>``.

        See scikit-learn's ``BaseEstimator``.

        Parameters
        ----------
        deep
            Whether settings of settings are told as well.
        """
        found: dict[str, Any] = {}
        for name in sorted(inspect.signature(type(self)).parameters):
            value = getattr(self, name)
            if deep and hasattr(value, "get_params") and not isinstance(value, type):
                found |= {f"{name}__{inner}": setting for inner, setting in value.get_params().items()}
            found[name] = value
        return found

    def set_params(self, **settings: Any) -> Self:
        """Change settings, also those of settings as ``<name>__<setting>``.

        See scikit-learn's ``BaseEstimator``.

        Raises
        ------
        ValueError
            For a name that is no setting.
        """
        known = self.get_params(deep=False)
        for key in settings:
            if key.partition("__")[0] not in known:
                raise ValueError(
                    f"Invalid parameter {key!r} for estimator {self}. Valid parameters are: {sorted(known)}."
                )
        # A setting that is exchanged and changed in one call is exchanged first.
        for key, value in sorted(settings.items(), key=lambda item: "__" in item[0]):
            name, nested, inner = key.partition("__")
            if nested:
                getattr(self, name).set_params(**{inner: value})
            else:
                setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        """Return a call that would make the estimator."""
        settings = (f"{name}={value!r}" for name, value in self.get_params(deep=False).items())
        return f"{type(self).__name__}({', '.join(settings)})"

    def __sklearn_tags__(self) -> Any:
        """Return scikit-learn's description of an estimator; only scikit-learn asks for it."""
        from sklearn.base import BaseEstimator

        return BaseEstimator.__sklearn_tags__(self)

    def _check_fitted(self) -> None:
        """Raise scikit-learn's error, a ValueError, where nothing was learned yet."""
        if any(name.endswith("_") and not name.startswith("__") for name in vars(self)):
            return
        from sklearn.exceptions import NotFittedError

        raise NotFittedError(
            f"This {type(self).__name__} instance is not fitted yet. Call 'fit' before using it."
        )


class Regressor(Estimator):
    """An estimator with ``fit`` and ``predict``.

    See scikit-learn's ``RegressorMixin``.
    """

    def score(self, X: Any, y: Any, sample_weight: Any = None) -> float:
        """Return the coefficient of determination of ``predict(X)``; names are scikit-learn's.

        See scikit-learn's ``RegressorMixin``.
        """
        from sklearn.metrics import r2_score

        return float(r2_score(y, self.predict(X), sample_weight=sample_weight))  # type: ignore[attr-defined]

    def __sklearn_tags__(self) -> Any:
        """Return scikit-learn's description of a regressor."""
        from sklearn.utils import RegressorTags

        tags = super().__sklearn_tags__()
        tags.estimator_type, tags.regressor_tags = "regressor", RegressorTags()
        tags.target_tags.required = True
        return tags


class Transformer(Estimator):
    """An estimator with ``fit`` and ``transform``.

    See scikit-learn's ``TransformerMixin``.
    """

    def fit_transform(self, X: Any, y: Any = None) -> Any:
        """Return ``fit(X, y).transform(X)``; names are scikit-learn's.

        See scikit-learn's ``TransformerMixin``.
        """
        return self.fit(X, y).transform(X)  # type: ignore[attr-defined]

    def __sklearn_tags__(self) -> Any:
        """Return scikit-learn's description of a transformer."""
        from sklearn.utils import TransformerTags

        tags = super().__sklearn_tags__()
        tags.transformer_tags = TransformerTags()
        return tags


def clone(estimator: Kind) -> Kind:
    """Return an estimator with the same settings that has learned nothing.

    See scikit-learn's ``clone``, which is called for the estimators of other libraries.

    Parameters
    ----------
    estimator
        An `Estimator`, or any estimator that scikit-learn can copy.
    """
    if not isinstance(estimator, Estimator):
        from sklearn.base import clone as of_library

        return cast(Kind, of_library(estimator))
    settings = estimator.get_params(deep=False)
    return type(estimator)(
        **{
            name: clone(value)
            if hasattr(value, "get_params") and not isinstance(value, type)
            else copy.deepcopy(value)
            for name, value in settings.items()
        }
    )
