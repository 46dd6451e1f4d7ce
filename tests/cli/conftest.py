"""Commands in this process draw their figures and do not render them; those in a process of their own do."""

import pytest


@pytest.fixture(autouse=True)
def no_pictures(without_rendering):
    pass
