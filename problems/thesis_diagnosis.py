"""The thesis' measured loop diagnosed: what does plain Bouc-Wen miss?

Statement. Plain Bouc-Wen behind the mechanics of Eq. 3.5 leaves 0.169 um rms of the thesis' loop,
one triangle of 125 V in 50 s read once a second in steps of a camera pixel (0.1725 um). Ask which
effect is missing. As in the thesis' own search, alpha and beta may take either sign.

Known answer. Creep comes first, and with it, refitted, the error falls to 0.107 um (0.11 or lower
was to be shown). It is the likeliest answer and no proof. By the information criterion a hysteretic
force in the mechanics is as good, and a drift of the sensor is not far behind. Asymmetry of the
usual form is clearly poorer (0.129 um), but cannot be excluded: a loop that gives way sooner on one
side leaves 0.114 um with as many numbers as creep. 51 readings in steps of a pixel, nothing held
out, and one slow way up and one down cannot do better: 2 % of the trace of creep is visible beside
the fitted parameters, and its share (0.76) moves the gain d with it. The answer is therefore a
group that creep leads.

Source: data/thesis (Table 3.1 of the thesis, Universiti Teknologi Malaysia, 2015). Creep of a
Kelvin-Voigt chain: Croft, Shed and Devasia (2001), J. Dyn. Sys. Meas. Control 123(1), 35-43.
"""

from __future__ import annotations

from collections.abc import Mapping

import piezo_opt as po
from piezo_opt.diagnosis.rung import adding, bic_gain, solved
from piezo_opt.effects import BoucWen, PiezoGain, SecondOrder

RIVALS = ("creep", "hysteretic_force", "drift", "sensor_nonlinearity", "friction", "asymmetry")


def question() -> po.Identification:
    """Mechanics of Eq. 3.5, virgin start, no offset; alpha and beta of either sign."""
    return po.Identification(
        PiezoGain() + BoucWen() + SecondOrder(),
        po.load("thesis/hysteresis"),
        fixed={"second_order.omega": 8.0321, "second_order.zeta": 0.1992},
        bounds={"bouc_wen.alpha": (-1e-3, 1e-3), "bouc_wen.beta": (-1.0, 1.0)},
        start=po.Start.REST,
    )


def known() -> Mapping[str, float]:
    """Errors [m] without and with creep, and what asymmetry alone would leave."""
    return {"rms": 0.1690e-6, "rms with creep": 0.107e-6, "rms with asymmetry": 0.129e-6}


def tolerance() -> Mapping[str, float]:
    """How far the found numbers may be from the known ones."""
    return {"rms": 0.0001e-6, "rms with creep": 0.001e-6, "rms with asymmetry": 0.001e-6}


def rivals(diagnosis: po.Diagnosis) -> Mapping[str, tuple[float, float]]:
    """Error [m] after refitting with each rival alone, and by how much BIC falls."""
    suspects = {s.name: s for s in diagnosis.suspects}
    trials = {name: adding(diagnosis.fit, suspects[name]) for name in RIVALS}
    fits = {name: solved(trial.question, trial.start, 100) for name, trial in trials.items()}
    return {name: (fit.rms, bic_gain(diagnosis.fit, fit)) for name, fit in fits.items()}


def found(diagnosis: po.Diagnosis) -> Mapping[str, float]:
    """The numbers of `known`."""
    return {
        "rms": diagnosis.fit.rms,
        "rms with creep": diagnosis.steps[0].rms_after,
        "rms with asymmetry": rivals(diagnosis)["asymmetry"][0],
    }


def confirm(diagnosis: po.Diagnosis) -> None:
    """Creep first and alone, the known errors, and the doubt said unprompted."""
    assert [s.name for s in diagnosis.steps] == ["creep"], diagnosis.steps
    assert diagnosis.suspects[0].name == "creep", diagnosis.suspects[0].name
    have = found(diagnosis)
    for name, value in known().items():
        assert abs(have[name] - value) <= tolerance()[name], (
            f"{name}: {have[name]:.6g}, known {value:.6g}"
        )
    # What cannot be excluded is in the answer, not only in this file.
    meant = {"drift", "hysteretic_force", "asymmetry"}
    assert meant <= set(diagnosis.steps[0].group), diagnosis.steps[0].group
    assert any("cannot be told from" in s for s in diagnosis.advice), diagnosis.advice
    assert not diagnosis.noise.measured


def check(fit: po.Fit) -> None:
    """Diagnose the fit and confirm the known answer."""
    confirm(po.diagnose(fit, advise=False))


def main() -> None:
    """Fit, diagnose, and set the rivals side by side."""
    fit = po.solve(question())
    print(fit.outcome.sentence)
    diagnosis = po.diagnose(fit, advise=False)
    print(f"\n{diagnosis}")
    print(f"\n  {'refitted with':<20} {'rms [um]':>9} {'BIC falls':>10}")
    for name, (rms, falls) in rivals(diagnosis).items():
        print(f"  {name:<20} {1e6 * rms:>9.4f} {falls:>10.1f}")
    confirm(diagnosis)


if __name__ == "__main__":
    main()
