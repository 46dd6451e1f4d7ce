"""Tables of the quick sizes, which all processes of a run share."""

import os

import pytest
from fixtures import study_tables


@pytest.fixture(scope="session", autouse=True)
def tables_of_the_run(tmp_path_factory):
    """Name the folder of the run, which is above that of each process of xdist."""
    own = tmp_path_factory.getbasetemp()
    study_tables.FOLDER[:] = [own.parent if "PYTEST_XDIST_WORKER" in os.environ else own]
