"""A refit begins at the numbers of whichever model was fitted before."""

from __future__ import annotations

import pytest

from piezo_opt.diagnosis.refit import refit
from piezo_opt.effects import Dahl
from piezo_opt.errors import ModelError
from piezo_opt.identification import Identification, solve
from problems import hidden_effect


def test_numbers_of_a_law_that_is_no_more_are_left_alone() -> None:
    question: Identification = hidden_effect.question()
    fit = solve(question, statistics=False)
    law = next(name for name in fit.model.names if name == "bouc_wen")
    other = question.with_model(fit.model.replaced(law, Dahl()))
    values = {**fit.values, "bouc_wen.alpha": 1.0}
    assert refit(other, values, 5).rms < 0.6 * refit(other, values, 0).rms
    with pytest.raises(Exception, match="no parameter 'bouc_wen"):
        solve(other, start=dict(values))


def test_what_takes_too_many_sub_steps_is_not_fitted() -> None:
    """One such fit would hold up all others, and the limit of time with them."""
    question: Identification = hidden_effect.question()
    fit = solve(question, statistics=False)
    (accuracy,) = fit.accuracy
    taken = accuracy.per_sample
    assert refit(question, fit.values, 2, most=taken).rms == pytest.approx(fit.rms, rel=1e-3)
    with pytest.raises(ModelError, match="sub-steps a sample at these values, more than"):
        refit(question, fit.values, 2, most=0.4 * taken)
