"""Command ``posterior``: samples of the posterior of X."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ...errors import InputError
from ..delivery import deliver, wrote
from ..groups import ESTIMATION, OUTPUT
from ..messages import progress_wanted, timed
from ..options.arm import Arm, arm_of
from ..options.common import JsonOption, emit, flag, folder_option, made_of, option
from ..options.noise import Given, given_of, pose_prior_of
from ..pose_files import PoseFiles
from ..starting_point import calibrated, problem_for
from ..views import views_of

if TYPE_CHECKING:
    from ..views import Views

CHAIN = "chain.h5"
CHAINS = "Sampling"  # group of options


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
            panel=ESTIMATION,
            help="Pairs of poses that form a motion, for noise of motions (A and B): disjoint or consecutive.",
        ),
    ] = "disjoint",
    samples: Annotated[
        int, option("--samples", metavar="N", panel=CHAINS, common=True, help="Effective samples of every coordinate.")
    ] = 10_000,
    scales: Annotated[
        bool | None,
        flag(
            "--scales/--no-scales",
            panel=CHAINS,
            help="Sampling of unknown factors of the robot and camera noise. Default: on if the noise is estimated.",
        ),
    ] = None,
    student_t: Annotated[
        float | None,
        option(
            "--student-t",
            metavar="NU",
            panel=CHAINS,
            common=True,
            help="Heavy-tailed likelihood with NU degrees of freedom, e.g. 5. Default: Gaussian.",
        ),
    ] = None,
    walkers: Annotated[int, option("--walkers", metavar="N", panel=CHAINS, help="Number of walkers.")] = 128,
    max_steps: Annotated[
        int, option("--max-steps", metavar="N", panel=CHAINS, common=True, help="Largest number of steps of a walker.")
    ] = 10_000,
    seed: Annotated[int, option("--seed", metavar="N", panel=CHAINS, help="Seed of the random numbers.")] = 0,
    as_json: JsonOption = False,
    output: Annotated[
        Path | None,
        folder_option(f"Folder for {CHAIN}, posterior.json and corner.png, .svg."),
    ] = None,
    resume: Annotated[bool, flag("--resume", panel=OUTPUT, common=True, help="Continue the chain in -o DIR.")] = False,
) -> None:
    r"""Sample the posterior of X by Markov chain Monte Carlo.

    Examples:
      uq-handeye posterior robot.csv camera.csv -o posterior/
      # Continue a run that was interrupted or did not converge
      uq-handeye posterior robot.csv camera.csv -o posterior/ --resume
      # With known noise and a heavy-tailed likelihood
      uq-handeye posterior robot.csv camera.csv --student-t 5 \
          --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm

    The prior is flat, except for --prior-x, --prior-w and --known.

    Nothing is reported before the chain has converged (autocorrelation time,
    split R-hat, effective samples). With -o, an interrupted run continues with
    --resume and ends in the same numbers.
    """
    if resume and output is None:
        raise InputError("--resume needs the folder of the run. Add -o DIR.")
    poses, noise, shared = files.read(given, views, arm)
    from ...io import write_files
    from ...noise.models import PairNoise
    from ...validation.posterior.sample import sample_posterior

    pairs = pairs if isinstance(noise, PairNoise) else "all"
    problem = problem_for(
        calibrated(poses, noise, shared, pairs, shows_checks=False, **beforehand), poses, noise, shared, pairs
    )
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
