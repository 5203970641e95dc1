# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Process many recordings: engine, storage and bookkeeping of `adk fleet`.

A *stage* (`stage.Stage`) is the work on one recording. `run.run_stage` runs it on all recordings
with Dask (`cluster`, `engine`), each in a separate process with limits (`stage_process`), and
writes the rows to a Parquet dataset (`dataset`). What the dataset holds already is not computed
again. Dask, pyarrow and fsspec are optional: `make fleet`, or `pip install 'adk_ros[fleet]'`.
"""
