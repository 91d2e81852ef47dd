"""Advised drives on plants: a few here, a hundred by ``piezo-opt bench advice``."""

from __future__ import annotations

from piezo_opt.benchmark.advised import resolved


def test_an_advised_drive_resolves_its_group() -> None:
    told = resolved(8)
    assert [one.advice for one in told] == ["diagnosis", "signals.best_between"]
    assert all(one.right == 8 for one in told)
    assert all(one.sigmas > 5.0 for one in told)
