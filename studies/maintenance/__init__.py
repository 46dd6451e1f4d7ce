"""A calibration in use: false alarms, power and causes of checks, updates, real recordings.

    python -m studies.maintenance [--full] [-o results]

Simulated rigs, eye-in-hand and eye-to-hand, with noise given and estimated (robot 0.02 deg and 0.05 mm, camera 0.1 deg
and 0.5 mm; nothing shared): 15 poses calibrate, 5 new ones check. With ``--full`` 500 calibrations for each
cell with noise given, 1,000 with noise estimated:

- 2,000 checks without a change: false alarms at the 5 % level, with the standard error of means by calibration;
- X moved in a random direction by what should be found in 30, 60 and 90 %;
- X, target, focal length or image centre changed by three times what is found in 95 %: the cause that is named;
- with noise given, 5 points touched (0.2 mm) and seen (0.3 mm): two sets without a bias, and biases of once and three
  times what is found in 95 %.

5 calibrations for each cell that are updated twice, in both orders, against the fit of all poses.

Real recordings, where `UQ_HANDEYE_DATA` names their folder: one part is calibrated, another held against it.

Seeds 2121 and 2123.
"""

from __future__ import annotations

from studies.common.study import Study, Tables
from studies.maintenance.figures import figures
from studies.maintenance.findings import findings
from studies.maintenance.real_sets import real_table
from studies.maintenance.single_checks import single_checks
from studies.maintenance.updates import update_table


def measure(full: bool) -> Tables:
    """All tables; that of real recordings only where they are there."""
    real = real_table() if full else None
    return {
        **single_checks(full),
        "updates": update_table(full),
        **({} if real is None else {"real": real}),
    }


STUDY = Study("maintenance", measure, findings, figures)
