# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Types of numpy arrays in annotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
