"""What all tests share."""

from pathlib import Path

import pytest

from omnivert.threads import one_thread

PROJECT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session", autouse=True)
def _one_thread_each() -> None:
    """As in the services; two test processes whose libraries each take all cores would wait for each other."""
    one_thread()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Recordings and photographs that stand beside the project; a test that needs them is skipped without them."""
    folder = PROJECT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("needs ../shared/data, which is not here")
    return folder


@pytest.fixture(scope="session")
def strong_edges_deg() -> tuple[float, ...]:
    """Bearings of windows and shelf in the first photograph of real/vmr, measured by eye."""
    return 35.6, 43.7, 60.4, 92.2, 101.3
