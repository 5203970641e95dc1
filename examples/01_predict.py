# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Train a model on one recording and score its predictions on another.

Takes about a minute. Run it from any folder: `python examples/01_predict.py --out example_out`.
"""

import argparse
from pathlib import Path

import adk_ros

BAGS = Path(__file__).resolve().parents[1] / "bags"


def main() -> None:
    """Train on bags/handling, replay bags/town, print scores and save figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--out", type=Path, default=Path("example_out"), help="output folder")
    parser.add_argument("--steps", type=int, default=1000, help="training steps")
    arguments = parser.parse_args()

    # A recording is a table on a 25 ms grid in SI units.
    recording = adk_ros.read_recording(BAGS / "town")
    print(
        f"{recording.name}: {recording.duration_s:.0f} s, units {recording.frame.attrs['units']}"
    )
    print(recording.frame.describe().loc[["min", "max"]].T.round(3), end="\n\n")

    # Train on another recording; the model folder also contains a report.
    model = adk_ros.train_model(
        BAGS / "handling", out=arguments.out / "model", steps=arguments.steps, force=True
    )

    # What the live node would have predicted on the first recording.
    replayed = adk_ros.replay(recording, model)
    print("RMSE divided by that of the best naive predictor (below 1 is better):")
    print(replayed.scores["ratio"].unstack().round(2))
    for warning in replayed.warnings:
        print(f"warning: {warning}")

    replayed.figure(horizon_s=1.0).savefig(arguments.out / "predicted_1s_ahead.png")
    model.figure().savefig(arguments.out / "held_out_errors.png")
    print(f"figures and model in {arguments.out}")


if __name__ == "__main__":
    main()
