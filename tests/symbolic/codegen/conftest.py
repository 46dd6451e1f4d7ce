"""Helpers made importable, and a folder per language with everything that it has."""

import os
import sys
from pathlib import Path
from unittest import mock

import pytest

import uq_handeye as uq
from uq_handeye.symbolic import codegen
from uq_handeye.symbolic.matrices import FORMS

sys.path.insert(0, str(Path(__file__).parent))  # drivers, whole_functions


@pytest.fixture(scope="session")
def generated(session_cache, tmp_path_factory):
    """Language -> folder with all its files."""
    made = {}

    def folder(language):
        if language not in made:
            made[language] = tmp_path_factory.mktemp(language)
            names = codegen.NAMES if language in codegen.WRITTEN_IN else FORMS
            with mock.patch.dict(os.environ, UQ_HANDEYE_CACHE=str(session_cache)):
                texts = codegen.files(language, names, uq.__version__)
            for name, text in texts.items():
                (made[language] / name).write_bytes(text.encode())
        return made[language]

    return folder
