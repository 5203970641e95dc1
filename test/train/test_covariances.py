# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Covariances by horizon that training leaves in the model: commands known, and held."""

import numpy as np
from helpers.train import record, small

from adk_ros.model import artefact
from adk_ros.model.evaluation import sample_at
from adk_ros.model.predictor import Predictor
from adk_ros.train.dataset import TRAIN, VALIDATION, Split
from adk_ros.train.hyperparameters import horizon_covariance, horizon_covariances


def test_held_is_of_the_horizon_that_is_published() -> None:
    """On a drive that is all validation, against errors computed here."""
    model = artefact.load(small().path).model
    of = record().rows(slice(0, 800))
    everything = Split([of], [np.full(800, VALIDATION)], "blocks")
    known, held = horizon_covariances(model, everything, ahead=4)
    np.testing.assert_array_equal(known, horizon_covariance(model, everything, ahead=4))
    predictor = Predictor(model, horizon_steps=4)
    errors = []
    for row in range(len(of) - 4):
        made = predictor.step(sample_at(of, row))
        if made is not None and row >= 8 and (row - 8) % 8 == 0:
            errors.append(made.horizon - of.x_ref[row + 1 : row + 5])
    table = np.array(errors)
    wanted = np.einsum("nhi,nhj->hij", table, table) / len(table)
    np.testing.assert_allclose(held, wanted, rtol=1e-6, atol=1e-12)


def test_a_trained_model_has_both_and_they_are_stored() -> None:
    made, stored = small().run.model, artefact.load(small().path).model
    np.testing.assert_array_equal(stored.held_input_covariance, made.held_input_covariance)
    held = made.held_input_covariance
    assert held.shape == made.horizon_covariance.shape == (80, 3, 3)
    assert (np.linalg.eigvalsh(held) > 0.0).all()
    # A step ahead the command is known either way; two seconds ahead the driver is not.
    np.testing.assert_allclose(held[0], made.horizon_covariance[0], rtol=1e-9)
    spread, known = (np.diagonal(c[79]) for c in (held, made.horizon_covariance))
    assert (spread > known).all()


def test_too_short_a_validation_yields_usual_steps() -> None:
    model = artefact.load(small().path).model
    of = record().rows(slice(0, 400))
    none = Split([of], [np.full(400, TRAIN)], "blocks")
    known, held = horizon_covariances(model, none)
    usual = np.square(model.scaling.x_scale * model.scaling.step_scale)
    np.testing.assert_allclose(known[[0, 79]], [np.diag(usual), 80.0 * np.diag(usual)])
    np.testing.assert_array_equal(known, held)
    assert known is not held
