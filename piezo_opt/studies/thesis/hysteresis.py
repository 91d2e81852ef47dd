"""Bouc-Wen on the measured loop, in the thesis' own setting."""

from __future__ import annotations

from functools import lru_cache

from piezo_opt.datasets import load
from piezo_opt.effects import BoucWen, Model, PiezoGain, SecondOrder
from piezo_opt.identification import Fit, Identification, Start, solve
from piezo_opt.linear_models import second_order_shape
from piezo_opt.studies.row import Row


def loop_model() -> Model:
    """Gain, Bouc-Wen and the mechanics of Eq. 3.5."""
    return PiezoGain() + BoucWen() + SecondOrder()


@lru_cache(maxsize=1)
def loop_fit() -> Fit:
    """Eqs. 2.32 and 2.35 on Table 3.1: virgin, at rest, no offset, mechanics of Eq. 3.5."""
    shape = second_order_shape(0.528, 2.5)
    question = Identification(
        loop_model(),
        load("thesis/hysteresis"),
        fixed={"second_order.omega": shape.omega, "second_order.zeta": shape.zeta},
        start=Start.REST,
    )
    return solve(question)


def hysteresis_rows() -> tuple[Row, ...]:
    """The fit, its numbers, and what it cost."""
    fit = loop_fit()
    v = fit.values
    return (
        Row(
            "Bouc-Wen on the loop",
            "drawn only",
            f"rms {1e6 * fit.rms:.4f} µm, fit {fit.fit_percent:.1f} %",
            "The mechanics of Eq. 3.5 kept, a virgin actuator at rest.",
            "Fig. 4.1, solve",
        ),
        Row(
            "α, β, γ, d_e",
            "drawn in Fig. 3.19",
            f"{1e6 * v['bouc_wen.alpha']:.4f} µm/V, {v['bouc_wen.beta']:.5f} 1/V, "
            f"{v['bouc_wen.gamma']:.5f} 1/V, {1e6 * v['piezo_gain.d']:.4f} µm/V",
            fit.blind[0].partition(":")[0] + "." if fit.blind else "",
            "Table 3.4, solve",
        ),
        Row(
            "What the fit cost",
            "Nelder-Mead, 262 iterations",
            f"{fit.evaluations.total} simulations",
            "With exact sensitivities.",
            "Fig. 3.19, Fit.evaluations",
        ),
    )
