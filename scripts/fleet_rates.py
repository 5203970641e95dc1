# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how long each stage of `adk fleet` took for a minute of recording.

    adk fleet index drives --out fleet
    adk fleet replay drives --model model --out fleet
    python scripts/fleet_rates.py fleet

Values: seconds of a core, mean over the recordings whose stage succeeded. Those of a stage before
its first result are in `adk_ros/api/fleet/default_rates.py`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from adk_ros.api.fleet.default_rates import DEFAULT_CORE_S
from adk_ros.fleet.dataset import FleetDataset


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    dataset = FleetDataset(parser.parse_args().out)
    indexed = dataset.rows("index", {"kind": ["content"], "finding": ["duration"]})
    size = sum(row["bytes"] for row in indexed)
    if not size:
        parser.error("index the recordings first: the durations come from there")
    minutes_of_byte = sum(row["value"] for row in indexed) / size / 60.0
    for stage, default in DEFAULT_CORE_S.items():
        seconds, read, count = dataset.rates(stage)
        if count:
            measured = seconds / (read * minutes_of_byte)
            print(f"{stage}: {measured:.3f} s for a minute, {count} results (default {default})")


if __name__ == "__main__":
    main()
