"""Command ``posterior``: X without linearisation, by Markov chain Monte Carlo."""

from pathlib import Path
from typing import Annotated, Any, NamedTuple

from ...errors import InputError
from ..delivery import deliver, wrote
from ..exit_status import ExitStatus
from ..messages import progress_wanted, timed
from ..new_poses import Session
from ..pose_prior import pose_prior_of
from ..printing import emit
from ..stored import run_each

CHAIN = "chain.h5"


class Sampling(NamedTuple):
    """Options of the chain.

    Options (Sampling):
      * --samples N: Effective samples of every coordinate.
      --scales/--no-scales: Sampling of unknown factors of the robot and camera noise. Default: on if the noise is
        estimated.
      * --student-t NU: Heavy-tailed likelihood with NU degrees of freedom, e.g. 5. Default: Gaussian.
      --walkers N: Number of walkers.
      * --max-steps N: Largest number of steps of a walker.
      --seed N: Seed of the random numbers.
    """

    samples: int = 10_000
    scales: bool | None = None
    student_t: float | None = None
    walkers: int = 128
    max_steps: int = 10_000
    seed: int = 0


def posterior_command(
    session: Session,
    beforehand: Annotated["dict[str, Any]", pose_prior_of],
    sampling: Sampling,
    pairs: str = "disjoint",
    as_json: bool = False,
    output: Path | None = None,
    resume: bool = False,
) -> int:
    r"""Sample the posterior of X by Markov chain Monte Carlo.

    Examples:
      uq-handeye posterior robot.csv camera.csv -o posterior/
      # Continue a run that was interrupted or did not converge
      uq-handeye posterior robot.csv camera.csv -o posterior/ --resume
      # With known noise and a heavy-tailed likelihood
      uq-handeye posterior robot.csv camera.csv --student-t 5 \
          --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm
      # A stored result, one camera of a rig, or without --camera each
      uq-handeye posterior result/result.json --camera left -o posterior/

    The prior is flat, except for --prior-x, --prior-w and --known.

    Nothing is reported before the chain has converged (autocorrelation time,
    split R-hat, effective samples). With -o, an interrupted run continues with
    --resume and ends in the same numbers.

    Options (Estimation):
      --pairs NAME <disjoint|consecutive>: Pairs of poses that form a motion, for noise of motions (A and B): disjoint
        or consecutive.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for {CHAIN}, posterior.json and corner.png, .svg.
      * --resume: Continue the chain in -o DIR.
    """
    if resume and output is None:
        raise InputError("--resume needs the folder of the run. Add -o DIR.")
    if cameras := session.each():
        return run_each(
            cameras,
            as_json,
            output,
            lambda name, folder: posterior_command(
                session.of_camera(name), beforehand, sampling, pairs, as_json, folder, resume
            ),
        )
    from ...read import write_files
    from ...trials.validation.posterior.sample import sample_posterior

    _, problem = session.calibrated("all", pairs, shows_checks=False, **beforehand)
    if output is not None:
        write_files(output, {})  # makes the folder, or raises
        output.mkdir(parents=True, exist_ok=True)
    with timed("sampling"):
        result = sample_posterior(
            **problem,
            **sampling._asdict(),
            file=None if output is None else output / CHAIN,
            resume=resume,
            progress=progress_wanted(),
        )
    emit(result.to_json() if as_json else result.summary())
    if output is not None:
        from ...trials.validation.corner_plot import corner

        deliver(output, {"posterior.json": result.to_json(), "corner": corner(result)})
        if not as_json:
            emit(wrote(output, ["posterior.json", "corner.png", "corner.svg", CHAIN]))
    return ExitStatus.DONE
