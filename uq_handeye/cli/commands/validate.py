"""Command ``validate``: the covariance tested by Monte Carlo simulation."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from ...core.files.csv_text import frame_text
from ...core.threads import cores
from ...errors import InputError
from ..delivery import deliver, refused_as_not_usable, wrote
from ..exit_status import ExitStatus
from ..messages import LOG, progress_wanted, verbose
from ..names import EVERY_METHOD
from ..new_poses import Session
from ..pose_prior import pose_prior_of
from ..printing import emit, emit_document
from ..stored import run_each
from ..values import methods_of, require_writable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from concurrent.futures import Executor

    from ...trials.validation.monte_carlo.run import MonteCarlo


class Simulation(NamedTuple):
    """Options of the simulation.

    Options (Simulation):
      * --method NAMES <EVERY_METHOD>: Methods to check. Some of {EVERY_METHOD}. Default: efficient.
      * --trials N: Number of trials. With --digits the largest number, 1,000,000 by default. Default: 10,000.
      * --digits N: Number of stable digits to stop at, 1 to 4 (JCGM 102).
      --seed N: Seed of the simulated noise.
      --covariance NAME <model|each>: Covariance to check: model (of the method at the true poses) or each (reported by
        each trial).
      --scale D: Scaling factor d of 4dpa. Default: its limit, in closed form.
      --scheduler ADDRESS: Dask scheduler whose workers run the trials, e.g. tcp://HOST:8786.
    """

    method: list[str] | None = None
    trials: int | None = None
    digits: int | None = None
    seed: int = 0
    covariance: str = "model"
    pairs: str = "all"
    scale: float | None = None
    workers: int | None = None
    scheduler: str | None = None


def validate_command(
    session: Session,
    beforehand: Annotated["dict[str, Any]", pose_prior_of],
    simulation: Simulation,
    figure: Path | None = None,
    as_json: bool = False,
    output: Path | None = None,
    resume: bool = False,
) -> int:
    r"""Check the covariance of X by Monte Carlo simulation.

    Examples:
      uq-handeye validate robot.csv camera.csv --trials 10000
      # With known noise, two methods, results kept
      uq-handeye validate robot.csv camera.csv --method efficient,park \
          --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm -o runs/
      # A stored result, one camera of a rig, or without --camera each
      uq-handeye validate result/result.json --camera left

    Noise is simulated around the fitted poses, X is estimated in each trial, and
    the scatter of X is compared with the reported covariance. Noise that is not
    given is estimated from the data.

    A rejected covariance is a result: the exit status is 0. A run that ends
    early prints the result so far: Ctrl-C (exit status 130), or lost workers
    (exit status 1). With -o DIR, --resume continues it.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for results and trials, for --resume. It holds result.json,
        validation.csv, validation.png, validation.svg and the trials (chunks/); several methods: a folder each.
      * --figure FILE: Figure, .png or .svg, one per method.
      * --resume: Continue the run in -o DIR, or add trials to it.
    """
    pairs = simulation.pairs
    names = methods_of(",".join(simulation.method or ["efficient"]), "--method", EVERY_METHOD)
    if simulation.covariance not in ("model", "each"):
        raise InputError(f"Expected --covariance to be model or each, got {simulation.covariance!r}.")
    if resume and output is None:
        raise InputError("--resume needs the folder of the run. Add -o DIR.")
    require_writable(figure, "--figure", (".png", ".svg"))
    if output is not None and len(names) > 1 and (output / "manifest.json").exists():
        raise InputError(f"{output} holds the run of one method. Give its --method alone, or name a new folder.")
    if (whole := session.whole()) is not None and refused_as_not_usable(whole, session.files.robot, "simulated"):
        return ExitStatus.NOT_USABLE
    if cameras := session.each():
        return run_each(
            cameras,
            as_json,
            output,
            lambda name, folder: validate_command(
                session.of_camera(name),
                beforehand,
                simulation,
                None if figure is None else _of_method(figure, name, cameras),
                as_json,
                folder,
                resume,
            ),
        )
    calibrated, problem = session.calibrated(pairs, **beforehand)
    if calibrated is not None and refused_as_not_usable(calibrated, "the calibration of these poses", "simulated"):
        return ExitStatus.NOT_USABLE
    workers = cores() if simulation.workers is None else simulation.workers

    from ...read import json_text
    from ...trials.validation.sentences import INTERRUPTED

    results: list[MonteCarlo] = []
    for result in _simulated(problem, names, simulation, workers, resume, output):
        results.append(result)
        folder = _folder(output, result.method, names)
        if not as_json:
            emit("\n" if len(results) > 1 else "")
            emit_document(result.document(verbose()))
        if folder is not None and (said := _deliver(result, folder)) and not as_json:
            emit(said)
        if figure is not None:
            result.figure(_of_method(figure, result.method, names))
    if as_json:
        parts = [result.to_dict() for result in results]
        emit(json_text(parts[0] if len(names) == 1 else {"methods": parts}))
    if result.ended.code == INTERRUPTED:
        return ExitStatus.INTERRUPTED
    if result.ended_early:
        how = "--resume goes on" if output is not None else "with -o DIR, --resume would go on"
        reason = " ".join(result.reason.split())
        LOG.error("the run by %s is not complete: %s; %s.", result.method, reason, how)
        return ExitStatus.INTERNAL_ERROR
    return 0


def _simulated(
    problem: dict[str, Any], names: list[str], simulation: Simulation, workers: int, resume: bool, output: Path | None
) -> "Iterator[MonteCarlo]":
    """Yield the result of each method, up to the first that ends early."""
    from ...core.executors import connect_to_dask
    from ...trials.validation.monte_carlo.run import monte_carlo

    with ExitStack() as stack:
        executor: Executor | None = None
        if simulation.scheduler is not None:
            executor, workers = stack.enter_context(connect_to_dask(simulation.scheduler))
        for name in names:
            result = monte_carlo(
                **problem,
                method=name,
                trials=simulation.trials,
                seed=simulation.seed,
                workers=workers,
                pairs=simulation.pairs,
                scale=simulation.scale,
                covariance="each" if simulation.covariance == "each" else None,
                digits=simulation.digits,
                directory=_folder(output, name, names),
                resume=resume,
                executor=executor,
                progress=progress_wanted(),
            )
            yield result
            if result.ended_early:
                return


def _folder(output: Path | None, name: str, names: list[str]) -> Path | None:
    """Return the folder of a method, which has its own if there are several."""
    return output if output is None or len(names) == 1 else output / name


def _files_of(result: Any, stem: str) -> dict[str, Any]:
    """Return a result as data, table and figure, by the names of their files."""
    table = frame_text(result.to_dataframe())
    return {f"{stem}.json": result.to_json(), f"{stem}.csv": table, stem: result.drawn()}


def _deliver(result: "MonteCarlo", folder: Path) -> str:
    """Write table and figure into the folder that holds ``result.json`` and the trials already."""
    import numpy as np

    table = frame_text(result.to_dataframe())
    with np.errstate(over="ignore"):  # the ratio to a direction without any error is infinite
        deliver(folder, {"validation.csv": table, "validation": result.drawn()})
    return wrote(folder, ["result.json", "validation.csv", "validation.png", "validation.svg", "chunks/"])


def _of_method(figure: Path, name: str, names: list[str]) -> Path:
    """Return the file of a method, with its name if there are several."""
    return figure if len(names) == 1 else figure.with_name(f"{figure.stem}-{name}{figure.suffix}")
