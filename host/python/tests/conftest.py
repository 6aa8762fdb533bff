"""Where the project's machines and the command are."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def root() -> Path:
    """The project's root."""
    return ROOT


@pytest.fixture(scope="session")
def command() -> Path:
    """The command `meshband`, for comparisons with it."""
    path = Path(os.environ.get("MESHBAND_COMMAND", ROOT / "target" / "release" / "meshband"))
    if not path.is_file():
        pytest.skip("skipped: the command is not built")
    return path


@pytest.fixture(scope="session")
def machine(root):
    """The 17/38 pair."""
    import meshband

    return meshband.Machine.read(root / "machines" / "17-38.toml")
