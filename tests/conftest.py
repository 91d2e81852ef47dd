"""What holds for every test: no display, one thread per worker, examples that repeat.

Compiled libraries are kept in the user's own cache directory, which all workers share: the effects
are compiled once, before the first test. A test about the cache itself sets ``PIEZO_OPT_CACHE`` to
a directory of its own.
"""

from __future__ import annotations

import os

import pytest
from hypothesis import settings

# Set before the first import of numpy and matplotlib, and inherited by processes that tests start.
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

# The first call of a test may compile, so a time limit for one example says nothing. The same
# examples every time: a red run can be repeated. HYPOTHESIS_PROFILE=search looks for new ones.
settings.register_profile("repeat", deadline=None, derandomize=True)
settings.register_profile("search", deadline=None, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeat"))


@pytest.fixture(scope="session", autouse=True)
def _compiled_effects() -> None:
    """The library of effects: no test that looks at its own cache finds it built there."""
    from piezo_opt.simulation.library import catalogue

    catalogue()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest test first: at the end one worker would wait minutes for the other."""
    items.sort(key=lambda item: "flexure_diagnosis" not in item.name)
