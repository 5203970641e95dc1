# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""adk bench concealed: accuracy of `adk mismatch` on recordings with a known mismatch."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adk_ros.cli import console
from adk_ros.cli.options import ForceOption, JsonOption
from adk_ros.errors import UsageError

if TYPE_CHECKING:
    from adk_ros.bench.mismatch.case_score import CaseResult

_CALIBRATION_CASES = 60


def concealed(
    cases: Annotated[
        Path | None, typer.Option(help="folder of cases, each with a label.json")
    ] = None,
    own: Annotated[
        bool, typer.Option("--own", help="generate the cases: simulated drives of four plants")
    ] = False,
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate", help="calibrate the held-out criteria on other generated cases"
        ),
    ] = False,
    vary: Annotated[
        str,
        typer.Option(
            help="with --calibrate: halve and double criteria of these names or patterns, such as "
            "'FEATURE_*', and analyse the cases again in which that changes a decision; all cases "
            "for a criterion that is named and takes part in no recorded decision"
        ),
    ] = "",
    real: Annotated[
        Path | None,
        typer.Option(help="folder of real recordings: remove a known term and recover it"),
    ] = None,
    vehicle: Annotated[
        Path | None, typer.Option(help="with --real: vehicle file, masses and lengths (YAML)")
    ] = None,
    only: Annotated[
        str,
        typer.Option(
            help="with --own: cases of these names or patterns, such as 'unlisted_*', separated "
            "by commas"
        ),
    ] = "",
    factorial: Annotated[
        str,
        typer.Option(
            help="with --own: instead of the list, effects of these names or patterns at every "
            "strength, in every simulator, with every noise (27 cases per effect)"
        ),
    ] = "",
    seed: Annotated[
        int, typer.Option(help="with --own: other vehicles, drives and roads for each number")
    ] = 0,
    recordings: Annotated[
        int,
        typer.Option(
            help="with --own: recordings of each car, which are analysed together; cases in which "
            "an effect has a place or an onset are left out"
        ),
    ] = 1,
    limit: Annotated[
        int,
        typer.Option(help="number of cases with --own (0: all) or --calibrate (0: 60)"),
    ] = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="folder for one report per case, the acceptance criteria and tables"),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="skip cases that are already in --out")
    ] = False,
    jobs: Annotated[int, typer.Option(help="cases run in parallel, one thread each")] = 1,
    peers: Annotated[
        bool,
        typer.Option(
            "--peers",
            help="also run the baseline libraries pysindy, gplearn and scikit-learn on the same "
            "residuals (needs `make peers`)",
        ),
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """
    Benchmark `adk mismatch` on recordings with an injected, known effect.

    Prints PASS, FAIL or NONE (no case, or too few cases) for each acceptance criterion. The
    exit code is 0 even if a criterion fails.

    Example: adk bench concealed --cases cases
    """
    from adk_ros.bench.mismatch.acceptance import evaluate_criteria
    from adk_ros.bench.mismatch.baselines import Baselines
    from adk_ros.bench.mismatch.calibration import answers_of
    from adk_ros.bench.mismatch.calibration import calibrate as calibrated
    from adk_ros.bench.mismatch.calibration_cases import calibration_plans
    from adk_ros.bench.mismatch.case_jobs import jobs_of, plan_jobs
    from adk_ros.bench.mismatch.case_matrix import LISTS, select_plans, with_recordings
    from adk_ros.bench.mismatch.criteria_sensitivity import (
        VARIED,
        changes,
        check_pattern,
        varied_job,
    )
    from adk_ros.bench.mismatch.factorial import factorial_plans
    from adk_ros.bench.mismatch.mismatch_bench import SCORED, MismatchBench
    from adk_ros.bench.mismatch.reliability import reliability_markdown
    from adk_ros.bench.mismatch.result_tables import as_json as content
    from adk_ros.bench.mismatch.result_tables import baseline_results, markdown, write_tables
    from adk_ros.bench.paper.criterion import CRITERIA_FILE, EARLIER_CRITERIA_FILE
    from adk_ros.bench.vehicles.multibody import MULTI_BODY, base_parameters
    from adk_ros.files.output_folder import check_output_folder, refuse_existing
    from adk_ros.shutdown import TERMINATED, Terminated, graceful_shutdown

    if (cases is not None) + own + calibrate + (real is not None) != 1:
        raise UsageError("give --cases FOLDER, --own, --calibrate or --real FOLDER, one of them")
    if not 1 <= jobs <= 64:
        raise UsageError(f"--jobs is {jobs}: choose 1 to 64")
    if only and not own:
        raise UsageError("--only selects from the list of generated cases: use it with --own")
    if factorial and not own:
        raise UsageError("--factorial generates cases: use it with --own")
    if factorial and (only or limit):
        raise UsageError("--factorial runs every combination: leave --only and --limit out")
    if seed and not own:
        raise UsageError("--seed selects generated cases: use it with --own")
    if not 0 <= seed < LISTS:
        raise UsageError(f"--seed is {seed}: choose 0 to {LISTS - 1}")
    if recordings != 1 and not own:
        raise UsageError("--recordings generates cases: use it with --own")
    if not 1 <= recordings <= 10:
        raise UsageError(f"--recordings is {recordings}: choose 1 to 10")
    if vary and not calibrate:
        raise UsageError("--vary changes the criteria of a calibration: use it with --calibrate")
    if vary:
        check_pattern(vary)
    if limit < 0:
        raise UsageError(f"--limit is {limit}: choose 0 (all cases) or more")
    if real is not None:
        _ablate(real, vehicle, as_json)
        return
    if vehicle is not None:
        raise UsageError("--vehicle is used with --real only: each case has its own vehicle file")
    if resume and out is None:
        raise UsageError("--resume continues the run in --out FOLDER: name it")
    if out is not None:
        earlier = (CRITERIA_FILE, EARLIER_CRITERIA_FILE, f"*/{SCORED}")
        refuse_existing(out, force or resume, result_files=earlier)
        check_output_folder(out)
    if cases is not None:
        todo = jobs_of(cases)
    elif calibrate:
        todo = plan_jobs(calibration_plans(limit or _CALIBRATION_CASES))
    else:
        plans = factorial_plans(factorial, seed) if factorial else select_plans(limit, only, seed)
        if recordings > 1:
            plans = with_recordings(plans, recordings)
        if any(plan.plant == MULTI_BODY for plan in plans):
            base_parameters()  # Refuses here, not after an hour.
        todo = plan_jobs(plans)
    try:
        with (
            graceful_shutdown(),
            tempfile.TemporaryDirectory() as folder,
            console.progress("cases") as bar,
        ):
            baselines = Baselines() if peers else None
            bench = MismatchBench(out or Path(folder), jobs, resume, baselines)
            results = bench.run(todo, bar)
            for line in bench.left_out:
                console.note(f"left out: {line}")
            if calibrate:
                reports = out or Path(folder)
                varied = None
                if vary:
                    found = changes(answers_of(results, reports), vary)
                    by_name = {job.name: job for job in todo}
                    again = MismatchBench(reports / VARIED, jobs, resume).run(
                        [varied_job(change, by_name[change.case]) for change in found], bar
                    )
                    varied = {x: y.right for x, y in zip(found, again, strict=True)}
                for line in calibrated(results, reports, varied):
                    console.output.print(str(line), markup=False)
                return
            criteria = evaluate_criteria(results)
            if out is not None:
                write_tables(results, criteria, out)
    except Terminated:
        console.note("adk: terminated")
        raise typer.Exit(TERMINATED) from None
    if as_json:
        console.print_json(content(results, criteria))
        return
    for result in results:
        console.output.print(_line(result), markup=False)
    if peers:
        console.output.print(markdown(*baseline_results(results)), markup=False, end="")
    claims = [claim for result in results for claim in result.claims]
    console.output.print(reliability_markdown(claims), markup=False)
    for criterion in criteria:
        console.output.print(str(criterion), markup=False)


def _ablate(folder: Path, vehicle: Path | None, as_json: bool) -> None:
    """Run the ablation on every recording below `folder` and print its results."""
    from dataclasses import asdict

    from adk_ros.bench.mismatch.ablation import ablation_criteria, run_ablation
    from adk_ros.bench.mismatch.result_tables import case_json
    from adk_ros.bench.paper.av21 import find_recordings
    from adk_ros.mismatch.recording.from_bag import read_sensor_log
    from adk_ros.mismatch.recording.nominal_vehicle import load_nominal_vehicle

    if vehicle is None:
        raise UsageError("--real needs --vehicle FILE: masses and lengths of the car")
    nominal = load_nominal_vehicle(vehicle)
    results = []
    for bag in find_recordings(folder):
        with console.progress(f"reading {bag.name}") as bar:
            recording = read_sensor_log(bag, needs_imu=False, progress=bar)
        with console.progress("removing and recovering terms") as bar:
            results += run_ablation(recording, nominal, bar)
    criteria = ablation_criteria(results)
    if as_json:
        console.print_json({
            "asked": [asdict(item) | {"score": case_json(item.score)} for item in results],
            "criteria": [asdict(criterion) for criterion in criteria],
        })  # fmt: skip
        return
    for item in results:
        best = (
            f"; best single effect: {item.best}, -{100.0 * item.gain:.1f} %" if item.best else ""
        )
        console.output.print(_line(item.score) + best, markup=False)
    for criterion in criteria:
        console.output.print(str(criterion), markup=False)


def _line(s: CaseResult) -> str:
    """Return a one-line summary of a case."""
    parts = [f"{s.case}  {s.right:.2f}  {s.label}  ->  {s.reported}"]
    parts += [f"{name} error {100.0 * x:.1f} %" for name, x in s.errors.items()]
    parts += [f"IoU {x:.2f}" for x in s.iou.values()]
    if s.removed:
        reductions = ", ".join(f"{name} {100.0 * x:.0f} %" for name, x in s.removed.items())
        parts.append(f"residual reduced by {reductions}")
    if math.isfinite(s.seconds):
        parts.append(f"{s.seconds:.0f} s, {s.cpu_s:.0f} s CPU, {s.memory_mib:.0f} MiB")
    if s.failure:
        parts.append(s.failure)
    return "; ".join(parts)
