# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Worker that fits baseline methods to residual accelerations.

It runs in the Python 3.11 environment that `make peers` makes for the libraries compared with.

Imports nothing of adk_ros, whose requirements conflict. Reads lines `job<TAB>answer` from standard
input, each naming two .npz files, and replies `done` or `failed <reason>` on standard output. A
job has `method`, training data `features` (n, k) and `targets` (n, 3), test data `later` (m, k),
and `names` (k,). An answer has `predicted` (m, 3), `coefficients` (k, 3) of the unscaled features
and `expression` (3,), zero or empty if the method has none.

Each method is tried with a few common settings on the first 80 % of the training data. The best
one on the rest, or the sparsest that is about as good, is fitted to all of it. A target
column whose mean square no setting reduces by 1 % gets a zero prediction.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

METHODS = ("pysindy STLSQ", "pysindy ensemble", "gplearn", "GP", "neural network")
VALIDATED = 0.2
"""Share of the training data used for validation."""
GAINS_LEAST = 0.01
"""Smallest validated reduction of the mean square at which a model is used."""
AS_GOOD = 0.02
"""Loss of validated reduction that is accepted for fewer features."""
THRESHOLDS = (0.01, 0.03, 0.1, 0.2, 0.4)
"""STLSQ thresholds, for features and target scaled to unit RMS."""
RIDGES = (1e-3, 1e-1)
MODELS = 20
"""Bootstrap models of the ensemble."""
GP_ROWS = 700
SYMBOLIC_ROWS = 1500
"""Most rows for methods whose cost grows fast with them."""
SEED = 0
_PR_SET_PDEATHSIG = 1
"""From linux/prctl.h."""

Predictor = Callable[[Any], Any]


def _stlsq(threshold: float, ridge: float, ensemble: bool, x: Any, y: Any) -> Any:
    """Return STLSQ coefficients (k,): of one model, or the median of an ensemble."""
    pysindy = importlib.import_module("pysindy")
    plain = pysindy.STLSQ(threshold=threshold, alpha=ridge * len(y))
    if not ensemble:
        plain.fit(x, y[:, None])
        return np.asarray(plain.coef_).ravel()
    many = pysindy.EnsembleOptimizer(plain, bagging=True, n_models=MODELS)
    many.fit(x, y[:, None])
    return np.median(np.asarray(many.coef_list), axis=0).ravel()


def _fitted_rows(n: int) -> int:
    """Return the number of rows before the validation part."""
    return round(n * (1.0 - VALIDATED))


def _reduction(y: Any, predicted: Any) -> float:
    """Return the relative reduction of the mean square of `y` by a prediction."""
    return 1.0 - float(np.sum((y - predicted) ** 2)) / max(float(np.sum(y**2)), 1e-30)


def sparse(ensemble: bool, x: Any, y: Any) -> Any:
    """
    Return coefficients (k,) with validated threshold and ridge; zero if no setting gains.

    Among the settings that are about as good as the best, the one with the fewest features.
    """
    cut = _fitted_rows(len(y))
    tried = []
    for threshold in THRESHOLDS:
        for ridge in RIDGES:
            found = _stlsq(threshold, ridge, ensemble, x[:cut], y[:cut])
            gain = _reduction(y[cut:], x[cut:] @ found)
            tried.append((int(np.count_nonzero(found)), -gain, threshold, ridge))
    best = -min(gain for _, gain, _, _ in tried)
    if best < GAINS_LEAST:
        return np.zeros(x.shape[1])
    _, _, threshold, ridge = min(t for t in tried if -t[1] > best - AS_GOOD)
    return _stlsq(threshold, ridge, ensemble, x, y)


def _symbolic(x: Any, y: Any, names: Sequence[str]) -> tuple[Predictor, str]:
    rows = np.linspace(0, len(y) - 1, min(SYMBOLIC_ROWS, len(y))).astype(int)
    model = importlib.import_module("gplearn.genetic").SymbolicRegressor(
        population_size=500,
        generations=12,
        parsimony_coefficient=0.002,
        function_set=("add", "sub", "mul"),
        random_state=SEED,
        feature_names=list(names),
        const_range=(-2.0, 2.0),
        metric="mse",
    )
    model.fit(x[rows], y[rows])
    return model.predict, str(model._program)


def _process(x: Any, y: Any, names: Sequence[str]) -> tuple[Predictor, str]:
    process = importlib.import_module("sklearn.gaussian_process")
    kernels = process.kernels
    rows = np.linspace(0, len(y) - 1, min(GP_ROWS, len(y))).astype(int)
    kernel = kernels.ConstantKernel(1.0) * kernels.RBF(5.0, (0.5, 100.0))
    kernel += kernels.WhiteKernel(1.0, (1e-3, 1e2))
    model = process.GaussianProcessRegressor(kernel, random_state=SEED).fit(x[rows], y[rows])
    return model.predict, ""


def _network(x: Any, y: Any, names: Sequence[str]) -> tuple[Predictor, str]:
    model = (
        importlib.import_module("sklearn.neural_network")
        .MLPRegressor(
            (32, 32),
            activation="tanh",
            alpha=1e-3,
            early_stopping=True,
            random_state=SEED,
            max_iter=200,
        )
        .fit(x, y)
    )
    return model.predict, ""


_REGRESSORS = {"gplearn": _symbolic, "GP": _process, "neural network": _network}


def answer(job: dict[str, Any]) -> dict[str, Any]:
    """Fit the method of a job and predict its test data."""
    method = str(job["method"])
    x, y, later = job["features"], job["targets"], job["later"]
    names = [str(name) for name in job["names"]]
    scale = np.maximum(np.sqrt(np.mean(x**2, axis=0)), 1e-12)
    size = np.maximum(np.sqrt(np.mean(y**2, axis=0)), 1e-12)
    x, later, y = x / scale, later / scale, y / size
    predicted = np.zeros((len(later), y.shape[1]))
    coefficients = np.zeros((x.shape[1], y.shape[1]))
    expressions = []
    cut = _fitted_rows(len(y))
    for column in range(y.shape[1]):
        target = y[:, column]
        expression = ""
        if method.startswith("pysindy"):
            found = sparse(method.endswith("ensemble"), x, target)
            coefficients[:, column] = found * size[column] / scale
            predicted[:, column] = later @ found * size[column]
        else:
            fit = _REGRESSORS[method]
            tried, _ = fit(x[:cut], target[:cut], names)
            if _reduction(target[cut:], tried(x[cut:])) > GAINS_LEAST:
                predict, expression = fit(x, target, names)
                predicted[:, column] = predict(later) * size[column]
        expressions.append(expression)
    return {
        "predicted": predicted,
        "coefficients": coefficients,
        "expression": np.array(expressions, dtype=str),
    }


def main() -> None:
    """Answer jobs until standard input ends."""
    with contextlib.suppress(OSError, AttributeError):
        # End with the parent process, even during a job.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    # Output of the libraries must not be mistaken for a reply.
    replies, sys.stdout = sys.stdout, sys.stderr
    warnings.simplefilter("ignore")
    for line in sys.stdin:
        source, target = line.rstrip("\n").split("\t")
        try:
            with np.load(source) as job:
                found = answer(dict(job))
            np.savez(target, **found)
        except Exception as error:
            reason = " ".join(str(error).split())
            print(f"failed {type(error).__name__}: {reason}", file=replies, flush=True)
        else:
            print("done", file=replies, flush=True)


if __name__ == "__main__":
    main()
