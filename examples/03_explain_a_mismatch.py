# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Find what a simulation lacks compared with a recording, and check the corrected model.

The "real" car of this example is a simulated one with 0.9 m² more drag area. Takes about a minute.
"""

import argparse
from pathlib import Path

import adk_ros

BAGS = Path(__file__).resolve().parents[1] / "bags"

REAL_CAR = """\
name: draggy
base: handling
seed: 5
vehicle_changes: {cda: 1.6}   # m², 0.7 m² in the simulation
"""


def main() -> None:
    """Simulate the real car, explain its difference to bags/handling, write the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--out", type=Path, default=Path("example_out"), help="output folder")
    parser.add_argument("--duration", type=float, default=220.0, help="length of the drive in s")
    arguments = parser.parse_args()
    out = arguments.out
    out.mkdir(parents=True, exist_ok=True)

    scenario = out / "draggy.yaml"
    scenario.write_text(REAL_CAR, encoding="utf-8")
    adk_ros.simulate(scenario, out / "real", duration_s=arguments.duration, force=True)

    result = adk_ros.explain(
        simulation=BAGS / "handling",
        recording=out / "real",
        vehicle="imdv",
        out=out / "report",
        force=True,
    )
    print(result.summary, end="\n\n")
    print(result.effects[["value", "low", "high", "unit", "confidence"]], end="\n\n")
    print("Error of predictions over 1 s, on data that was not used for fitting:")
    print(result.errors)
    result.figures["residuals"].savefig(out / "residuals.png")

    # The corrected model predicts the recording better than the simulation does.
    for name in ("simulation.yaml", "corrected.yaml"):
        rollouts = adk_ros.rollout(out / "real", out / "report" / name, stride_s=2.0)
        print(f"{name}: RMSE of v_x at 1 s {rollouts.errors['v_x'].iloc[-1]:.3f} m/s")
    print(f"report: {out / 'report' / 'report.html'}")


if __name__ == "__main__":
    main()
