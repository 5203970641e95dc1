# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Worker that fits pykoop and pykoopman and predicts with them, under the Python of `make peers`.

Imports nothing of adk_ros, whose requirements conflict. Reads lines `job<TAB>answer` from standard
input, each naming two .npz files, and replies `done` or `failed <reason>` on standard output.
A fit job has `peers`, `x` (n, 3), `u` (n, 2), `episode` (n,), all rows finite; its answer has
`<peer>_settings` and `<peer>_check` for each library. A prediction job has `peer`, `x`, `u`,
`episode`, `rows`, `ahead`; its answer `predicted` (rows, ahead, 3), NaN where the prediction
diverged or history is missing.

Each library is fitted with several common settings to 80 % of the episodes (`split`); the one with
the smallest errors on the rest, over all horizons and channels, is fitted to all data. Predictions
are computed for all starts at once; `check` is the largest difference from the library's own
prediction function for some starts, in standard deviations of the channels.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import itertools
import signal
import sys
import types
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

Episodes = list[tuple[Any, Any]]
"""x (n, 3) and u (n, 2) of each episode."""

PAST = 2
"""Past samples used as delays."""
HORIZONS = (1, 10, 20, 40, 80)
VALIDATED = 0.2
"""Share of the episodes used for validation (`split`)."""
STARTS = 400
"""Approximate number of rollouts for validation."""
CHECKED = 3
"""Starts that are compared with the library's own function."""
DIVERGED = 1e3
"""Magnitude of a scaled state above which a prediction has diverged."""
BATCH = 4096
_PR_SET_PDEATHSIG = 1
"""From linux/prctl.h."""


class _Absent(types.ModuleType):
    """
    Placeholder for a module that a library imports but does not need here.

    These are torch and lightning for the neural networks of pykoopman (gigabytes), and picos for
    the semidefinite programs of pykoop (no wheel).
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.__path__: list[str] = []

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})


def _library(name: str, *absent: str) -> Any:
    for other in absent:
        sys.modules.setdefault(other, _Absent(other))
        if "." in other:
            parent, _, child = other.rpartition(".")
            setattr(sys.modules[parent], child, sys.modules[other])
    return importlib.import_module(name)


class Pykoop:
    """
    EDMD with Tikhonov regularisation on two delays and all monomials of degree 2.

    The lifted states include a constant. `predict_trajectory` re-lifts at each step by default.
    """

    labels = "scaler", "alpha"

    def __init__(self) -> None:
        self._library = _library("pykoop", "picos")
        self._scalers = importlib.import_module("sklearn.preprocessing")

    @staticmethod
    def candidates() -> Iterator[tuple[Any, ...]]:
        """Values of the labels."""
        alphas = (0.0, 1e-6, 1e-4, 1e-2, 1.0, 100.0)
        return itertools.product(("StandardScaler", "MaxAbsScaler"), alphas)

    def fit(self, episodes: Episodes, setting: tuple[Any, ...]) -> None:
        """Fit one set-up."""
        scaler, alpha = setting
        library = self._library
        lifting = [
            ("scale", library.SkLearnLiftingFn(getattr(self._scalers, scaler)())),
            ("delay", library.DelayLiftingFn(n_delays_state=PAST, n_delays_input=PAST)),
            ("powers", library.PolynomialLiftingFn(order=2)),
            ("constant", library.ConstantLiftingFn()),
        ]
        self._model = library.KoopmanPipeline(
            lifting_functions=lifting, regressor=library.Edmd(alpha=alpha)
        )
        table = [np.column_stack([np.full(len(x), i), x, u]) for i, (x, u) in enumerate(episodes)]
        self._model.fit(np.concatenate(table), n_inputs=2, episode_feature=True)
        fitted = dict(self._model.lifting_functions_)
        self._scale = fitted.pop("scale")
        del fitted["delay"]
        self._after = list(fitted.values())
        self._matrix = self._model.regressor_.coef_.T

    def predict(self, x: Any, u: Any) -> Any:
        """From pasts x (n, 3, 3), newest last, under u (n, 2 + ahead, 2): (n, ahead, 3)."""
        n, ahead = len(x), u.shape[1] - PAST
        out = np.full((n, ahead, 3), np.nan)
        samples = np.concatenate([x, u[:, : PAST + 1]], axis=2).reshape(-1, 5)
        past = self._scale.lift(samples, episode_feature=False).reshape(n, PAST + 1, 5)
        # Newest sample first, states before inputs: the order of the delay lifting function.
        states = past[:, ::-1, :3].reshape(n, -1)
        inputs = past[:, ::-1, 3:].reshape(n, -1)
        for step in range(ahead):
            alive = np.abs(states).max(axis=1) < DIVERGED
            states[~alive] = 0.0
            if step:
                pad = np.zeros((n, 3))
                fresh = np.column_stack([pad, u[:, PAST + step]])
                scaled = self._scale.lift(fresh, episode_feature=False)[:, 3:]
                inputs = np.column_stack([scaled, inputs[:, :-2]])
            lifted = np.column_stack([states, inputs])
            for function in self._after:
                lifted = function.lift(lifted, episode_feature=False)
            new = (lifted @ self._matrix.T)[:, :3]
            states = np.column_stack([new, states[:, :-3]])
            states[~alive] = 2.0 * DIVERGED
            out[alive, step] = self._scale.retract_state(new[alive], episode_feature=False)
        return out

    def library_prediction(self, x: Any, u: Any) -> Any:
        """Predict from one start with the library's function: x (3, 3), u (2 + ahead, 2)."""
        # The function needs an input at the last predicted state, which has no effect.
        padded = np.concatenate([u, u[-1:]])
        return self._model.predict_trajectory(x, padded, episode_feature=False)[PAST + 1 :]


class Pykoopman:
    """
    DMDc and EDMDc on polynomial observables, of the state alone or of two past samples as well.

    Past samples are appended as states: the library's time-delay observables delay only states,
    not inputs. `simulate` stays in the lifted space; iterating `predict`, which re-lifts at each
    step, is tried as well.
    """

    labels = "past", "degree", "regressor", "rank share", "lifted anew"

    def __init__(self) -> None:
        nets = "torch", "torch.nn", "torch.nn.utils", "torch.nn.utils.rnn"
        more = "torch.utils", "torch.utils.data", "lightning"
        self._library = _library("pykoopman", *nets, *more)
        self._observables = importlib.import_module("pykoopman.observables")
        self._regression = importlib.import_module("pykoopman.regression")

    @staticmethod
    def candidates() -> Iterator[tuple[Any, ...]]:
        """Values of the labels."""
        for anew in (True, False):
            for past, degree in ((0, 1), (0, 2), (0, 3), (PAST, 1), (PAST, 2)):
                yield past, degree, "EDMDc", 1.0, anew
            for share in (1.0, 0.9, 0.75, 0.5):
                yield PAST, 2, "DMDc", share, anew

    def fit(self, episodes: Episodes, setting: tuple[Any, ...]) -> None:
        """Fit one set-up."""
        past, degree, method, share, self._anew = setting
        self._past = past
        all_x = np.concatenate([x for x, _ in episodes])
        all_u = np.concatenate([u for _, u in episodes])
        self._mean = all_x.mean(axis=0), all_u.mean(axis=0)
        self._deviation = all_x.std(axis=0) + 1e-9, all_u.std(axis=0) + 1e-9
        now, then, given = [], [], []
        for x, u in episodes:
            scaled_x, scaled_u = self._scaled(x, 0), self._scaled(u, 1)
            k = np.arange(past, len(x) - 1)
            now.append(self._state(scaled_x, scaled_u, k))
            then.append(self._state(scaled_x, scaled_u, k + 1))
            given.append(scaled_u[k])
        states = np.concatenate(now)
        observables = self._observables.Polynomial(degree=degree)
        if method == "DMDc":
            size = self._observables.Polynomial(degree=degree).fit(states).n_output_features_
            # The full rank of the regressor side includes the two inputs.
            kept = round(share * size)
            rank = size + 2 if share == 1.0 else kept
            regressor = self._regression.DMDc(svd_rank=rank, svd_output_rank=kept)
        else:
            regressor = self._regression.EDMDc()
        self._model = self._library.Koopman(
            observables=observables, regressor=regressor, quiet=True
        )
        self._model.fit(states, np.concatenate(then), u=np.concatenate(given), dt=1)

    def _scaled(self, values: Any, which: int) -> Any:
        return (values - self._mean[which]) / self._deviation[which]

    def _state(self, x: Any, u: Any, k: Any) -> Any:
        now = [x[k - i] for i in range(self._past + 1)]
        return np.column_stack(now + [u[k - i] for i in range(1, self._past + 1)])

    def predict(self, x: Any, u: Any) -> Any:
        """From pasts x (n, 3, 3), newest last, under u (n, 2 + ahead, 2): (n, ahead, 3)."""
        ahead = u.shape[1] - PAST
        scaled_x, scaled_u = self._scaled(x, 0), self._scaled(u, 1)
        order = [PAST - i for i in range(self._past + 1)]
        state = np.column_stack(
            [scaled_x[:, i] for i in order] + [scaled_u[:, i] for i in order[1:]]
        )
        out = np.full((len(x), ahead, 3), np.nan)
        lifted = None if self._anew else np.real(self._model.phi(state.T)).T
        for step in range(ahead):
            now = scaled_u[:, PAST + step]
            if lifted is None:
                alive = np.abs(state).max(axis=1) < DIVERGED
                state[~alive] = 0.0
                new = self._model.predict(state, now)[:, :3]
                pasts = [new, state[:, : 3 * self._past]]
                if self._past:
                    pasts += [now, state[:, 3 * (self._past + 1) : -2]]
                state = np.column_stack(pasts)
                state[~alive] = 2.0 * DIVERGED
            else:
                alive = np.ones(len(x), dtype=bool)
                lifted = lifted @ self._model.A.T + now @ self._model.B.T
                new = np.real(lifted @ self._model.C[:3].T)
            out[alive, step] = (new * self._deviation[0] + self._mean[0])[alive]
        return out

    def library_prediction(self, x: Any, u: Any) -> Any:
        """Predict from one start with the library's functions: x (3, 3), u (2 + ahead, 2)."""
        scaled_x, scaled_u = self._scaled(x, 0), self._scaled(u, 1)
        if not self._anew:
            state = self._state(scaled_x, scaled_u, np.array([PAST]))[0]
            commands = scaled_u[PAST:]
            found = self._model.simulate(state, commands, n_steps=len(commands))[:, :3]
            return found * self._deviation[0] + self._mean[0]
        known = list(scaled_x)
        for k in range(PAST, len(u)):
            state = self._state(np.array(known), scaled_u, np.array([k]))
            known.append(self._model.predict(state, scaled_u[k : k + 1])[0, :3])
        return np.array(known[PAST + 1 :]) * self._deviation[0] + self._mean[0]


PEERS: dict[str, Any] = {"pykoop": Pykoop, "pykoopman": Pykoopman}


def windows(x: Any, u: Any, rows: Any, ahead: int) -> tuple[Any, Any]:
    """Return past states (n, 3, 3), and past and future commands (n, 2 + ahead, 2), by row."""
    past = x[rows[:, None] + np.arange(-PAST, 1)]
    return past, u[rows[:, None] + np.arange(-PAST, ahead)]


def split(episodes: Episodes) -> tuple[Episodes, Episodes]:
    """
    Return four fifths of the episodes to fit, and the rest for validation.

    The rest is the last fifth of each or every fifth whole one, whichever has more starts with the
    longest horizon. Few of the short stretches of a drive that lost samples have a last fifth as
    long as that.
    """
    every = round(1.0 / VALIDATED)
    at = [round(len(x) * (1.0 - VALIDATED)) for x, _ in episodes]
    first = [(x[:n], u[:n]) for (x, u), n in zip(episodes, at, strict=True)]
    last = [(x[n:], u[n:]) for (x, u), n in zip(episodes, at, strict=True)]
    whole = episodes[every - 1 :: every]
    if known_starts(whole) > known_starts(last):
        first = [e for i, e in enumerate(episodes) if i % every != every - 1]
        last = whole
    return [e for e in first if len(e[0]) > PAST + 1], last


def known_starts(episodes: Episodes) -> tuple[int, ...]:
    """Return how many rows have history and each of `HORIZONS` ahead, the longest one first."""
    return tuple(sum(max(0, len(x) - PAST - h) for x, _ in episodes) for h in reversed(HORIZONS))


def starts(episodes: Episodes) -> tuple[Any, Any, Any]:
    """
    Return histories, commands and future states of rollouts spread over the episodes.

    States beyond the end of an episode are NaN, and its last command is held.
    """
    longest = max(len(x) for x, _ in episodes)
    ahead = min(HORIZONS[-1], longest - PAST - 1)
    if ahead < 1:
        raise ValueError("the episodes are too short for validation: use longer recordings")
    total = sum(max(0, len(x) - PAST - 1) for x, _ in episodes)
    step = max(1, total // STARTS)
    found = []
    for x, u in episodes:
        rows = np.arange(PAST, len(x) - 1, step)
        longer = np.concatenate([x, np.full((ahead, x.shape[1]), np.nan)])
        held = np.concatenate([u, np.repeat(u[-1:], ahead, axis=0)])
        future = longer[rows[:, None] + np.arange(1, ahead + 1)]
        found.append((*windows(x, held, rows, ahead), future))
    past, commands, truth = (np.concatenate(part) for part in zip(*found, strict=True))
    return past, commands, truth


def choose(peer: Any, episodes: Episodes) -> tuple[tuple[Any, ...], float]:
    """Fit the best setting to all episodes; return it and the check of batch predictions."""
    fitted, validation = split(episodes)
    past, commands, truth = starts(validation)
    steps = np.array([h for h in HORIZONS if h <= truth.shape[1]]) - 1
    scale = np.concatenate([x for x, _ in episodes]).std(axis=0) + 1e-9
    best: tuple[float, tuple[Any, ...]] | None = None
    for setting in peer.candidates():
        try:
            peer.fit(fitted, setting)
            error = (peer.predict(past, commands) - truth)[:, steps] / scale
            known = np.isfinite(truth)[:, steps]
        except (ValueError, FloatingPointError, np.linalg.LinAlgError):
            continue
        error = np.nan_to_num(np.abs(error), nan=DIVERGED, posinf=DIVERGED)
        squares = np.square(np.minimum(error, DIVERGED))
        rmse = np.sqrt((squares * known).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
        score = float(np.log(np.maximum(rmse, 1e-12)).mean())
        if best is None or score < best[0]:
            best = score, setting
    if best is None:
        raise ValueError("no setting could be fitted")
    peer.fit(episodes, best[1])
    chosen = np.linspace(0, len(past) - 1, CHECKED).astype(int)
    batch = peer.predict(past[chosen], commands[chosen])
    reference = np.array([peer.library_prediction(past[i], commands[i]) for i in chosen])
    both = np.isfinite(batch) & np.isfinite(reference)
    difference = np.abs(np.where(both, batch - reference, 0.0)) / scale
    # Relative where a prediction grows, since its rounding error grows with it.
    grown = np.maximum(1.0, np.abs(np.where(both, reference, 0.0)) / scale)
    return best[1], float((difference / grown).max())


def fit(job: Any, peers: dict[str, Any]) -> dict[str, Any]:
    """Fit the libraries named in the job."""
    number = job["episode"]
    cuts = np.flatnonzero(np.diff(number)) + 1
    episodes = list(zip(np.split(job["x"], cuts), np.split(job["u"], cuts), strict=True))
    answer: dict[str, Any] = {}
    for name in job["peers"].tolist():
        peers[name] = PEERS[name]()
        setting, check = choose(peers[name], episodes)
        pairs = zip(peers[name].labels, setting, strict=True)
        answer[f"{name}_settings"] = ", ".join(f"{label} {value}" for label, value in pairs)
        answer[f"{name}_check"] = check
    return answer


def predict(job: Any, peers: dict[str, Any]) -> dict[str, Any]:
    """Predict with a fitted library; a start without finite history gives NaN."""
    x, u, episode, rows, ahead = (job[k] for k in ("x", "u", "episode", "rows", "ahead"))
    ahead = int(ahead)
    peer = peers[str(job["peer"])]
    out = np.full((len(rows), ahead, 3), np.nan)
    usable = np.flatnonzero((rows >= PAST) & (episode[rows - PAST] == episode[rows]))
    for first in range(0, len(usable), BATCH):
        part = usable[first : first + BATCH]
        past, commands = windows(x, u, rows[part], ahead)
        usable_rows = np.isfinite(past).all(axis=(1, 2)) & np.isfinite(commands).all(axis=(1, 2))
        if usable_rows.any():
            out[part[usable_rows]] = peer.predict(past[usable_rows], commands[usable_rows])
    return {"predicted": out}


def _end_with_parent() -> None:
    """Make Linux kill this process when its parent ends, even during a job."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def serve(answer_of: Callable[[Any], dict[str, Any]]) -> None:
    """Answer jobs until standard input ends; what a library prints goes to standard error."""
    _end_with_parent()
    answers, sys.stdout = sys.stdout, sys.stderr
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    for line in sys.stdin:
        source, target = line.rstrip("\n").split("\t")
        try:
            with np.load(source) as job:
                answer = answer_of(job)
            np.savez(target, **answer)
            status = "done"
        except Exception as error:
            status = " ".join(f"failed {type(error).__name__}: {error}".split())
        print(status, file=answers, flush=True)


def main() -> None:
    """Fit the libraries and predict with them."""
    peers: dict[str, Any] = {}
    serve(lambda job: fit(job, peers) if "peers" in job else predict(job, peers))


if __name__ == "__main__":
    main()
