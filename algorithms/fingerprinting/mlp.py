"""Multi-layer perceptron."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from positioning.estimator import clone
from positioning.fingerprints import (
    FingerprintRegressor,
    Index,
    Mask,
    checked_survey,
    fill_not_heard,
    standardisation,
    training_members,
)
from positioning.model import Array
from positioning.quasi_newton import minimise_together

# The largest component of the gradient at which training ends; scikit-learn's default.
_FLAT = 1e-4
# The layers of so many networks stay in a processor's cache together.
_NETWORKS_AT_ONCE = 32
# Inputs of more folds than fit into this train one part after the other.
_INPUT_BYTES = 2**27


class Mlp(FingerprintRegressor):
    """A perceptron with one hidden layer: readings in, eight neurons, two coordinates out.

    See Mirzababaei & Akbari, section 6.A ("three-layer model"). Readings and coordinates are
    standardised with the training fingerprints. Start, loss, gradient and training are those of
    scikit-learn's ``MLPRegressor(activation="tanh", solver="lbfgs")``; all folds of a leave-one-out train
    side by side.

    Parameters
    ----------
    hidden
        Neurons of the hidden layer; 8 in the paper.
    weight_decay
        Penalty on squared weights; not printed in the paper. 1e-4 is scikit-learn's default.
    iterations
        Largest number of steps of the quasi-Newton training (L-BFGS); not printed in the paper.
        100 is the limit that is customary for networks of this size; training mostly stops there.
    random_state
        Seed of the initial weights.
    not_heard_dbm
        What stands for an access point that was not heard, dBm; not printed in the paper.
    """

    def __init__(
        self,
        *,
        hidden: int = 8,
        weight_decay: float = 1e-4,
        iterations: int = 100,
        random_state: int = 0,
        not_heard_dbm: float = -100.0,
    ) -> None:
        self.hidden = hidden
        self.weight_decay = weight_decay
        self.iterations = iterations
        self.random_state = random_state
        self.not_heard_dbm = not_heard_dbm

    def fit(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Self:
        """Train the network.

        See Mirzababaei & Akbari, section 6.A.

        Parameters
        ----------
        rss_dbm
            Received signal strength, [n, ap], dBm; NaN = not heard.
        position_m
            Where each fingerprint was taken, [n, 2], metres.

        Raises
        ------
        InputError
            If the survey or a parameter cannot be used.
        """
        rss, position = self._training(rss_dbm, position_m)
        self._train(fill_not_heard(rss, self.not_heard_dbm), position, np.ones((1, len(rss)), dtype=bool))
        return self

    def predict(self, rss_dbm: ArrayLike) -> Array:
        """Return the estimated positions, [m, 2], metres, of fingerprints [m, ap], dBm.

        See Mirzababaei & Akbari, section 6.A.
        """
        reading = fill_not_heard(self._readings(rss_dbm), self.not_heard_dbm)
        return self._locate(reading, slice(None))

    def leave_one_out(self, rss_dbm: ArrayLike, position_m: ArrayLike) -> Array:
        """Return the estimate of each fingerprint with its reference point left out, [n, 2], metres.

        See Mirzababaei & Akbari, section 6. Each fold trains a network of its own from the same start.
        Parameters as in `fit`, whose network stays as it is.
        """
        rss, position = checked_survey(rss_dbm, position_m, least=2)
        reading = fill_not_heard(rss, self.not_heard_dbm)
        # Fingerprints taken at one place leave out the same ones, and share a network.
        _, place, of_place = np.unique(position, axis=0, return_index=True, return_inverse=True)
        member = training_members(position)[place]
        located = np.empty_like(position)
        networks = clone(self)
        at_once = max(1, _INPUT_BYTES // (8 * (rss.shape[1] + 1) * len(rss)))
        for begin in range(0, len(place), at_once):
            networks._train(reading, position, member[begin : begin + at_once])
            tested = np.flatnonzero((of_place >= begin) & (of_place < begin + at_once))
            located[tested] = networks._locate(reading[tested], of_place[tested] - begin)
        return located

    def _train(self, reading_dbm: Array, position_m: Array, member: Mask) -> None:
        """Train a network for each row of ``member`` [fold, n]."""
        # Fold by fold from its members alone, so that nothing of the others is left in the last digits.
        self.reading_scale_ = standardisation(reading_dbm, member)
        self.position_scale_ = standardisation(position_m, member)
        centre, scale = self.reading_scale_
        inputs = np.ones((len(member), reading_dbm.shape[1] + 1, len(reading_dbm)))
        inputs[:, :-1] = (reading_dbm.T - centre[:, :, None]) / scale[:, :, None]
        centre, scale = self.position_scale_
        targets = (position_m.T - centre[:, :, None]) / scale[:, :, None]
        # Columns of zeros, the one of the bias included, count for nothing.
        inputs = np.where(member[:, None], inputs, 0.0)
        targets = np.where(member[:, None], targets, 0.0)
        size = member.sum(axis=1)

        def objective(fold: Index, weights: Array) -> tuple[Array, Array]:
            value, gradient = np.empty(len(fold)), np.empty_like(weights)
            for first in range(0, len(fold), _NETWORKS_AT_ONCE):
                part = slice(first, first + _NETWORKS_AT_ONCE)
                some = fold[part]
                value[part], gradient[part] = self._loss(
                    weights[part], inputs[some], targets[some], member[some], size[some]
                )
            return value, gradient

        start = np.tile(self._start(reading_dbm.shape[1]), (len(member), 1))
        self.weights_ = minimise_together(
            objective, start, iterations=self.iterations, gradient_tolerance=_FLAT
        ).point

    def _start(self, readings: int) -> Array:
        """Return scikit-learn's initial weights (Glorot & Bengio, 2010) as one vector."""
        draw = np.random.RandomState(self.random_state).uniform
        layers = []
        for inputs, outputs in ((readings, self.hidden), (self.hidden, 2)):
            bound = np.sqrt(6.0 / (inputs + outputs))
            weight = draw(-bound, bound, (inputs, outputs))
            layers.append(np.column_stack([weight.T, draw(-bound, bound, outputs)]))
        return np.concatenate([layer.ravel() for layer in layers])

    def _layers(self, weights: Array) -> tuple[Array, Array]:
        """Return the two layers' weights, biases last, [fold, hidden, ap + 1] and [fold, 2, hidden + 1]."""
        split = weights.shape[1] - 2 * (self.hidden + 1)
        return (
            weights[:, :split].reshape(len(weights), self.hidden, -1),
            weights[:, split:].reshape(len(weights), 2, -1),
        )

    def _loss(
        self, weights: Array, inputs: Array, targets: Array, member: Mask, size: Index
    ) -> tuple[Array, Array]:
        """Return loss [fold] and gradient [fold, weight], as scikit-learn has them.

        Its loss is the mean over both coordinates and its gradient that of their sum; where training ends
        is a matter of the gradient.
        """
        first, second = self._layers(weights)
        hidden = np.empty((len(weights), self.hidden + 1, inputs.shape[2]))
        hidden[:, -1] = member
        neurons = hidden[:, :-1]
        np.tanh(np.matmul(first, inputs, out=neurons), out=neurons)
        error = second @ hidden
        error -= targets
        penalty = sum(np.sum(layer[:, :, :-1] ** 2, axis=(1, 2)) for layer in (first, second))
        value = (0.25 * np.sum(error * error, axis=(1, 2)) + 0.5 * self.weight_decay * penalty) / size
        back = second[:, :, :-1].swapaxes(1, 2) @ error
        back *= 1.0 - neurons * neurons
        gradient = np.empty_like(weights)
        for layer, found, product in zip(
            (first, second),
            self._layers(gradient),
            (back @ inputs.swapaxes(1, 2), error @ hidden.swapaxes(1, 2)),
            strict=True,
        ):
            product[:, :, :-1] += self.weight_decay * layer[:, :, :-1]
            found[...] = product / size[:, None, None]
        return value, gradient

    def _locate(self, reading_dbm: Array, network: Index | slice) -> Array:
        """Return positions [m, 2] from readings [m, ap], each by the network with that number, or by one."""
        centre, scale = (part[network] for part in self.reading_scale_)
        inputs = np.column_stack([(reading_dbm - centre) / scale, np.ones(len(reading_dbm))])
        first, second = (layer[network] for layer in self._layers(self.weights_))
        # A sum for each fingerprint by itself: the answer does not depend on the others beside it.
        hidden = np.tanh(np.einsum("mi,mhi->mh", inputs, first))
        hidden = np.column_stack([hidden, np.ones(len(hidden))])
        centre, scale = (part[network] for part in self.position_scale_)
        return np.asarray(np.einsum("mh,moh->mo", hidden, second) * scale + centre)
