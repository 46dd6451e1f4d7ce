"""A cache folder of its own for each session: the tests neither trust nor touch the user's."""

import pytest


@pytest.fixture(scope="session")
def session_cache(tmp_path_factory):
    """Filled by the first test that derives; later tests of the session reuse it."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _private_cache(monkeypatch, session_cache):
    monkeypatch.setenv("UQ_HANDEYE_CACHE", str(session_cache))
