# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in an object store: moto's server on the loopback interface."""

from __future__ import annotations

import threading
import time
from functools import partial

import boto3
import pytest
import s3fs
from fleet_faults import empty_store
from helpers.fleet import text_stage
from moto.server import ThreadedMotoServer

from adk_ros.api.fleet.fleet_run import FleetOptions, listed_recordings
from adk_ros.errors import UsageError
from adk_ros.fleet.cluster import open_cluster
from adk_ros.fleet.dataset import FleetDataset
from adk_ros.fleet.recordings import find_recordings
from adk_ros.fleet.run import Limits, run_stage
from adk_ros.fleet.store import StoreUnreachable, with_retries
from adk_ros.fleet.tags import Tags


@pytest.fixture
def store(monkeypatch):
    """Yield a server with a bucket of three recordings."""
    server, access = empty_store()
    for name, value in access.items():
        monkeypatch.setenv(name, value)
    # Connections are kept by their arguments, and the address is none of them.
    s3fs.S3FileSystem.clear_instance_cache()
    client = boto3.client("s3")
    client.create_bucket(Bucket="fleet")
    for key, text in (("a.mcap", "ok 1"), ("car/b.mcap", "ok 2"), ("car/c.mcap", "damaged")):
        client.put_object(Bucket="fleet", Key=f"drives/{key}", Body=text.encode())
    yield server
    server.stop()


@pytest.mark.slow(seconds=20)
def test_recordings_of_a_bucket(store, tmp_path) -> None:
    recordings = find_recordings(["s3://fleet/drives"])
    assert [each.uri for each in recordings] == [
        f"s3://fleet/drives/{name}" for name in ("a.mcap", "car/b.mcap", "car/c.mcap")
    ]
    assert [each.name for each in find_recordings(["s3://fleet/drives/car/*"])] == [
        "b.mcap", "c.mcap"
    ]  # fmt: skip
    stage = text_stage(tmp_path / "log")
    summary = run_stage(
        stage, recordings, tmp_path / "out", partial(open_cluster, 1), Limits(60.0)
    )
    assert (summary.computed, summary.failures) == (3, {"unusable": 1})
    rows = FleetDataset(tmp_path / "out").rows("text")
    assert {row["recording"]: row["value"] for row in rows if row["finding"] == "number"} == {
        "a.mcap": 1.0, "car/b.mcap": 2.0
    }  # fmt: skip
    again = run_stage(
        stage, find_recordings(["s3://fleet/drives"]), tmp_path / "out", partial(open_cluster, 1)
    )
    assert (again.reused, again.computed) == (3, 0)


@pytest.mark.slow(seconds=10)
def test_tags_of_a_bucket(store) -> None:
    options = FleetOptions()
    assert listed_recordings(["s3://fleet/drives"], options)[1].tags == {}
    table = b"recording,vehicle,time,rain\ncar/b,car 1,,yes\na.mcap,car 2,,no\n"
    boto3.client("s3").put_object(Bucket="fleet", Key="drives/fleet.csv", Body=table)
    _, found = listed_recordings(["s3://fleet/drives"], options)
    assert found.tags["car/b.mcap"] == Tags("car 1", None, {"rain": "yes"})
    _, found = listed_recordings(["s3://fleet/drives/*/*.mcap"], options)
    assert {name: each.vehicle for name, each in found.tags.items()} == {"b.mcap": "car 1"}


@pytest.mark.slow(seconds=15)
def test_an_outage_of_seconds_is_survived(store, monkeypatch) -> None:
    host, port = store.get_host_and_port()
    assert host == "127.0.0.1"
    store.stop()
    # Its socket would accept connections otherwise.
    store._server.server_close()
    back = ThreadedMotoServer(ip_address="127.0.0.1", port=port, verbose=False)

    def return_later():
        time.sleep(4.0)
        back.start()

    thread = threading.Thread(target=return_later)
    thread.start()
    try:
        found = find_recordings(["s3://fleet/drives"])
    finally:
        thread.join()
        back.stop()
    assert len(found) == 3


@pytest.mark.slow(seconds=15)
def test_an_unreachable_store_is_a_line(store, monkeypatch) -> None:
    store.stop()
    monkeypatch.setattr(
        "adk_ros.fleet.recordings.with_retries", partial(with_retries, outage_s=1.0)
    )
    with pytest.raises(StoreUnreachable, match=r"s3://fleet/drives: the store does not answer"):
        find_recordings(["s3://fleet/drives"])


def stopped(server):
    """Stop a server, and return one that can be started at its address; moto keeps its content."""
    _, port = server.get_host_and_port()
    server.stop()
    # Its socket would accept connections otherwise.
    server._server.server_close()
    return ThreadedMotoServer(ip_address="127.0.0.1", port=port, verbose=False)


@pytest.mark.slow(seconds=110)
@pytest.mark.parametrize(("outage_s", "stops"), [(8.0, False), (75.0, True)])
def test_a_store_that_fails_during_a_run(store, tmp_path, outage_s, stops) -> None:
    """Seconds are survived; after a minute the run stops in a line and continues later."""
    client = boto3.client("s3")
    for i in range(10):
        client.put_object(Bucket="fleet", Key=f"more/r{i}.mcap", Body=f"ok {i}".encode())
    recordings = find_recordings(["s3://fleet/more"])
    stage = text_stage(tmp_path / "log", nap_s=0.5)

    def go():
        return run_stage(
            stage, recordings, tmp_path / "out", partial(open_cluster, 1), Limits(200.0)
        )

    def fail():
        while not list((tmp_path / "log").glob("*")):
            time.sleep(0.05)
        back = stopped(store)
        time.sleep(outage_s)
        back.start()
        servers.append(back)

    servers: list[ThreadedMotoServer] = []
    thread = threading.Thread(target=fail)
    thread.start()
    try:
        if stops:
            with pytest.raises(UsageError, match=r"does not answer for 60 s .*run the same"):
                go()
            thread.join()
        summary = go()
    finally:
        thread.join()
        for server in servers:
            server.stop()
    assert (summary.total, summary.failures) == (10, {})
    assert bool(summary.reused) == stops
    rows = FleetDataset(tmp_path / "out").rows("text")
    numbers = {row["recording"]: row["value"] for row in rows if row["finding"] == "number"}
    assert numbers == {f"r{i}.mcap": float(i) for i in range(10)}
