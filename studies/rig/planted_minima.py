"""Local minima of random rigs planted before the certificate: every one must be rejected and left for the best.

Run ``python -m studies.rig.planted_minima [RIGS]``. Rigs have one to five cameras and targets on the hand and around
it, all axes, two that are near each other or two at right angles, all views or half of them, noise of 0.5 to 8 mrad and
0.3 to 5 mm; each is started from random rotations.
"""

import sys
import time

import numpy as np

from uq_handeye.core.geometry.nearest_rotation import nearest_rotation
from uq_handeye.errors import DegenerateMotionError, InputError
from uq_handeye.fit.diagnostics.optimality import PROVEN, Isotropic
from uq_handeye.fit.graph.fit import fit
from uq_handeye.fit.graph.graph import Graph
from uq_handeye.fit.graph.noise import given_noise
from uq_handeye.fit.graph.start import start_of
from uq_handeye.model.rig.tied import require_tied
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

AXES = {"all": None, "near": [[1.0, 0.0, 0.0], [1.0, 0.2, 0.0]], "right angles": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]}
STARTS = 10


def drawn(rng: np.random.Generator) -> Isotropic | None:
    """Return the isotropic problem of a random rig at its fit; None where nothing ties it."""
    cameras = {f"c{k}": str(rng.choice(["arm", "world"])) for k in range(rng.integers(1, 6))}
    targets = {f"t{k}": str(rng.choice(["arm", "world"])) for k in range(rng.integers(1, 6))}
    axes = AXES[str(rng.choice(list(AXES)))]
    size = float(2 ** rng.uniform(0, 4))
    seen = float(rng.choice([1.0, 0.5]))
    exact, _ = simulate_rig(
        cameras,
        targets,
        n_poses=int(rng.integers(6, 20)),
        axes=None if axes is None else np.array(axes),
        seen=seen,
        seed=rng,
    )
    noise = dict.fromkeys(("arm", *cameras), (f"{0.5 * size}mrad", f"{0.3 * size}mm"))
    rig = with_noise(exact, noise, rng)
    try:
        require_tied(rig)
        graph = Graph.of(rig)
        found = fit(graph, given_noise(rig, graph, noise), start_of(graph)[0])
    except (DegenerateMotionError, InputError):
        return None
    return None if len(found.open) else Isotropic.of_fit(found)


def run(count: int) -> None:
    """Print how many minima were planted, rejected, left for the best; gaps and times at the best."""
    gaps, times, planted, rejected, left, wrong, done, seed = [], [], 0, 0, 0, 0, 0, 0
    while done < count:
        rng = np.random.default_rng([5, seed])
        seed += 1
        if (problem := drawn(rng)) is None:
            continue
        done += 1
        m = len(problem.others)
        start = np.tile(np.eye(4), (problem.graph.m, 1, 1))
        ends = []
        for _ in range(STARTS):
            start[:, :3, :3] = nearest_rotation(rng.normal(size=(len(start), 3, 3)))[0]
            at = problem.minimum(start)
            ends.append((problem.value(at), at))
        begun = time.process_time()
        own = min(ends, key=lambda one: one[0])
        at, gap, better = problem.globally(own[1])
        times.append((m, time.process_time() - begun))
        if better is not None:  # the best of random starts was none
            own = (problem.value(better), better)
            at, gap, better = problem.globally(better)
        gaps.append(gap)
        for _, end in ends:
            at, gap, better = problem.globally(end)
            if problem.value(at) < own[0] * (1 + 1e-6):
                continue
            planted += 1
            rejected += gap > PROVEN
            wrong += gap <= PROVEN
            left += better is not None and problem.value(better) < own[0] * (1 + 1e-6)
    slowest = max(times, key=lambda one: one[1])
    print(
        f"{count} rigs of 2 to 10 unknown poses; {planted} local minima planted, {rejected} rejected, {left} left for "
        f"the best at once, {wrong} wrongly proven; gap at the best: median {np.median(gaps):.1e}, largest "
        f"{max(gaps):.1e}, {np.mean(np.array(gaps) <= PROVEN):.1%} proven; longest {slowest[1]:.2f} s with "
        f"{slowest[0]} unknown poses"
    )


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
