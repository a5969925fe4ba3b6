"""Where real observations lie: `$LCBAYES_DATA`, else `../shared/data` beside the project."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_dir() -> Path:
    given = os.environ.get("LCBAYES_DATA")
    folder = Path(given) if given else Path(__file__).parents[3] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real observations at {folder}; set LCBAYES_DATA")
    return folder
