"""Advised drives on plants: a few here, a hundred by ``piezo-opt bench advice``."""

from __future__ import annotations

import pytest

from piezo_opt.benchmark.advised import resolved
from piezo_opt.errors import InputError


def test_an_advised_drive_resolves_its_group() -> None:
    (told,) = resolved(8, cases=("bent gain",))
    assert told.group[0] == "nonlinear_gain"
    assert len(told.group) > 1
    assert told.right == 8
    assert told.sigmas > 5.0
    assert "8 of 8 plants resolved" in str(told)
    with pytest.raises(InputError, match="no case 'bend'"):
        resolved(8, cases=("bend",))
