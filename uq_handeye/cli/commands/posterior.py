"""The command ``uq-handeye posterior``: samples of the posterior of X."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ...errors import InputError
from ..arm_options import Arm, arm_of
from ..delivery import deliver, wrote
from ..messages import progress_wanted, timed
from ..noise_options import Given, given_of, pose_prior_of
from ..options import JsonOption, emit, flag, folder_option, made_of, option
from ..pose_files import PoseFiles, calibrated, problem_for
from ..views import views_of

if TYPE_CHECKING:
    from ..views import Views

CHAIN = "chain.h5"


@made_of(given=given_of, beforehand=pose_prior_of, files=PoseFiles, views=views_of, arm=arm_of)
def posterior_command(
    files: "PoseFiles",
    given: "Given",
    beforehand: "dict[str, Any]",
    views: "Views | None",
    arm: "Arm | None",
    pairs: Annotated[
        str,
        option(
            "--pairs",
            of=("disjoint", "consecutive"),
            metavar="NAME",
            help="For noise on motions (A and B): disjoint, or consecutive.",
        ),
    ] = "disjoint",
    samples: Annotated[int, option("--samples", help="Effective samples of every coordinate.")] = 10_000,
    scales: Annotated[
        bool | None,
        flag(
            "--scales/--no-scales",
            help="Sample unknown factors on the noise of robot and camera, too. Left out: if it is estimated.",
        ),
    ] = None,
    student_t: Annotated[
        float | None,
        option("--student-t", metavar="NU", help="Heavy-tailed likelihood of NU degrees of freedom, e.g. 5."),
    ] = None,
    walkers: Annotated[int, option("--walkers", help="Number of walkers.")] = 128,
    max_steps: Annotated[int, option("--max-steps", help="Steps of every walker at most.")] = 10_000,
    seed: Annotated[int, option("--seed", help="Seed of the random numbers.")] = 0,
    as_json: JsonOption = False,
    output: Annotated[
        Path | None,
        folder_option(f"Keep the chain ({CHAIN}) here, and write posterior.json, corner.png and corner.svg."),
    ] = None,
    resume: Annotated[bool, flag("--resume", help="Go on with the chain in -o DIR.")] = False,
) -> None:
    """The posterior of X by Markov chain Monte Carlo, with a flat prior, until enough samples are effective.

    Example: uq-handeye posterior robot.csv camera.csv -o out/

    With known noise append --robot-noise 0.02deg,0.05mm and --camera-noise
    0.1deg,0.5mm. Without, it is estimated from the data.

    Nothing is reported before the chain has converged (autocorrelation time,
    split R-hat, effective samples). With -o a run that was interrupted, or has
    not converged, goes on with --resume and ends in the same numbers.
    """
    if resume and output is None:
        raise InputError("--resume needs -o DIR, the folder of the run to go on with.")
    poses, noise, shared = files.read(given, views, arm)
    from ...io import write_files
    from ...noise.models import PairNoise
    from ...validation.posterior.sample import sample_posterior

    pairs = pairs if isinstance(noise, PairNoise) else "all"
    problem = problem_for(calibrated(poses, noise, shared, pairs, **beforehand), poses, noise, shared, pairs)
    if output is not None:
        write_files(output, {})  # makes the folder, or says why not
        output.mkdir(parents=True, exist_ok=True)
    with timed("sampling"):
        result = sample_posterior(
            **problem,
            seed=seed,
            samples=samples,
            scales=scales,
            student_t=student_t,
            walkers=walkers,
            file=None if output is None else output / CHAIN,
            resume=resume,
            max_steps=max_steps,
            progress=progress_wanted(),
        )
    emit(result.to_json() if as_json else result.summary())
    if output is not None:
        from ...validation.posterior.figure import corner  # Matplotlib is slow to import

        deliver(output, {"posterior.json": result.to_json()}, {"corner": corner(result)})
        if not as_json:
            emit(wrote(output, ["posterior.json", "corner.png", "corner.svg", CHAIN]))
