# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fits other methods to residual accelerations: runs under the Python of `make peers`.

Imports nothing of adk_ros, whose requirements contradict theirs. Reads lines `job<TAB>answer` from
standard input, each naming two .npz files, and says `done` or `failed <why>` on standard output.
A job has `method`, `features` (n, k) and `targets` (n, 3) to learn from, `later` (m, k), `names`
(k,). Its answer has `predicted` (m, 3), and where the method says so `coefficients` (k, 3) of the
features as they are and `expression` (3,).

Of each method a few usual settings are fitted to the first 80 % of what there is to learn from,
one that does best on the rest, or as good as best with less, is fitted to all of it; an equation
in which none gains 1 % there is left alone.
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
GAINS_LEAST = 0.01
AS_GOOD = 0.02
"""Less gain than the best has by this much is as good, for fewer features."""
THRESHOLDS = (0.01, 0.03, 0.1, 0.2, 0.4)
"""In usual deviations of the target, of features in theirs."""
RIDGES = (1e-3, 1e-1)
MODELS = 20
GP_ROWS = 700
SYMBOLIC_ROWS = 1500
SEED = 0
_PR_SET_PDEATHSIG = 1
"""Of linux/prctl.h."""

Predictor = Callable[[Any], Any]


def _stlsq(threshold: float, ridge: float, ensemble: bool, x: Any, y: Any) -> Any:
    """Coefficients (k,) of sequentially thresholded least squares, one model or the median."""
    pysindy = importlib.import_module("pysindy")
    plain = pysindy.STLSQ(threshold=threshold, alpha=ridge * len(y))
    if not ensemble:
        plain.fit(x, y[:, None])
        return np.asarray(plain.coef_).ravel()
    many = pysindy.EnsembleOptimizer(plain, bagging=True, n_models=MODELS)
    many.fit(x, y[:, None])
    return np.median(np.asarray(many.coef_list), axis=0).ravel()


def _validated(n: int) -> int:
    return round(n * (1.0 - VALIDATED))


def _better(y: Any, predicted: Any) -> float:
    """Share of the second moment of `y` that a prediction removes."""
    return 1.0 - float(np.sum((y - predicted) ** 2)) / max(float(np.sum(y**2)), 1e-30)


def sparse(ensemble: bool, x: Any, y: Any) -> Any:
    """
    Coefficients (k,) with a threshold and a ridge that were validated, zero where none gains.

    Of the settings that gain about as much as the best, the one that keeps the fewest features.
    """
    cut = _validated(len(y))
    tried = []
    for threshold in THRESHOLDS:
        for ridge in RIDGES:
            found = _stlsq(threshold, ridge, ensemble, x[:cut], y[:cut])
            gain = _better(y[cut:], x[cut:] @ found)
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


_SMOOTH = {"gplearn": _symbolic, "GP": _process, "neural network": _network}


def answer(job: dict[str, Any]) -> dict[str, Any]:
    """Fit what is asked for and predict the later part."""
    method = str(job["method"])
    x, y, later = job["features"], job["targets"], job["later"]
    names = [str(name) for name in job["names"]]
    scale = np.maximum(np.sqrt(np.mean(x**2, axis=0)), 1e-12)
    size = np.maximum(np.sqrt(np.mean(y**2, axis=0)), 1e-12)
    x, later, y = x / scale, later / scale, y / size
    predicted = np.zeros((len(later), y.shape[1]))
    coefficients = np.zeros((x.shape[1], y.shape[1]))
    expressions = []
    cut = _validated(len(y))
    for column in range(y.shape[1]):
        one = y[:, column]
        expression = ""
        if method.startswith("pysindy"):
            found = sparse(method.endswith("ensemble"), x, one)
            coefficients[:, column] = found * size[column] / scale
            predicted[:, column] = later @ found * size[column]
        else:
            fit = _SMOOTH[method]
            tried, _ = fit(x[:cut], one[:cut], names)
            if _better(one[cut:], tried(x[cut:])) > GAINS_LEAST:
                predict, expression = fit(x, one, names)
                predicted[:, column] = predict(later) * size[column]
        expressions.append(expression)
    return {
        "predicted": predicted,
        "coefficients": coefficients,
        "expression": np.array(expressions, dtype=str),
    }


def main() -> None:
    """Answer jobs until there are no more."""
    with contextlib.suppress(OSError, AttributeError):
        # Ends with the one that asks it, in the midst of a job too.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    # What other libraries print must not be taken for an answer.
    said, sys.stdout = sys.stdout, sys.stderr
    warnings.simplefilter("ignore")
    for line in sys.stdin:
        source, target = line.rstrip("\n").split("\t")
        try:
            with np.load(source) as job:
                found = answer(dict(job))
            np.savez(target, **found)
        except Exception as error:
            why = " ".join(str(error).split())
            print(f"failed {type(error).__name__}: {why}", file=said, flush=True)
        else:
            print("done", file=said, flush=True)


if __name__ == "__main__":
    main()
