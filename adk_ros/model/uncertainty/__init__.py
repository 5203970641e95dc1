# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Roll the model out, monitor past rollouts, and calibrate the error covariance by horizon."""
