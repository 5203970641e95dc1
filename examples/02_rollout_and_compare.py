# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compare open-loop predictions of a trained model and of a vehicle simulation.

Takes about a minute; less with the model of the first example: `--model example_out/model`.
"""

import argparse
from pathlib import Path

import pandas as pd

import adk_ros

BAGS = Path(__file__).resolve().parents[1] / "bags"


def main() -> None:
    """Predict along bags/town from many starts and print the errors by horizon."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--out", type=Path, default=Path("example_out"), help="output folder")
    parser.add_argument("--model", type=Path, help="model folder [default: train one]")
    parser.add_argument("--steps", type=int, default=1000, help="training steps")
    parser.add_argument("--horizon", type=float, default=2.0, help="length of a prediction in s")
    arguments = parser.parse_args()

    recording = adk_ros.read_recording(BAGS / "town")
    if arguments.model is not None:
        model = adk_ros.load_model(arguments.model)
    else:
        model = adk_ros.train_model(
            BAGS / "handling", out=arguments.out / "model", steps=arguments.steps, force=True
        )

    # From a start every second, with the recording's own commands and no later measurement.
    # "imdv" is the vehicle that drove the sample bags: the best that a simulation can do.
    predictors: dict[str, adk_ros.TrainedModel | str] = {
        "trained model": model,
        "simulation (imdv)": "imdv",
    }
    results = {
        name: adk_ros.rollout(recording, of, horizon_s=arguments.horizon, stride_s=1.0)
        for name, of in predictors.items()
    }

    channels = ["v_x", "v_y", "yaw_rate"]
    errors = pd.concat({name: item.errors[channels] for name, item in results.items()}, axis=1)
    print("RMSE by horizon (m/s, m/s, rad/s):")
    print(errors.iloc[9::10].round(4))

    arguments.out.mkdir(parents=True, exist_ok=True)
    results["trained model"].figure().savefig(arguments.out / "rollouts.png")
    results["trained model"].write_csv(arguments.out / "rollouts.csv", force=True)
    print(f"figure and table in {arguments.out}")


if __name__ == "__main__":
    main()
