# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Python interface: what the `adk` commands do, with results as data frames and figures.

`adk_ros` itself exports these functions and classes. They print nothing and show no progress bars:
a `progress` callback reports how far the work is. Errors are `adk_ros.UsageError` (the request is
wrong) and `adk_ros.DataError` (the data are unusable), each with a one-line message.
"""
