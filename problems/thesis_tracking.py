"""The thesis' controllers of hysteresis on its own loop, with and without a sensor.

Statement. On the loop of problems/thesis_loop.py, identified, follow a triangle to the height of
the measured loop and back in 50 s, within -30 to 150 V, read every 5 ms: with the thesis' PID
(Table 3.11), with the inverse compensation of its Eq. 3.14, which has no sensor, and with a PID
that is tuned from the thesis' start.

Known answer. Fig. 4.4: both errors stay within about 0.15 um; without a controller the integral of
the absolute error is 67.73 um s.

Source: Modelling and Control of Hysteresis and Vibration in Piezoelectric Actuator, Universiti
Teknologi Malaysia (2015), Table 3.11, Eq. 3.14 and Fig. 4.4.
"""

from __future__ import annotations

from collections.abc import Mapping

import piezo_opt as po
from piezo_opt.studies.thesis.control import LIMITS, hysteresis_loops
from problems import thesis_loop


def question() -> po.Identification:
    """The loop itself."""
    return thesis_loop.question()


def known() -> Mapping[str, float]:
    """What the thesis prints, SI units."""
    return {"largest error": 0.15e-6, "uncontrolled": 67.73e-6}


def check(fit: po.Fit) -> None:
    """Every controller within the thesis' bound; what is tuned here is no worse than its PID."""
    loops = hysteresis_loops(fit)
    for name, loop in loops.items():
        assert loop.largest <= known()["largest error"], f"{name}: {1e6 * loop.largest:.3f} um"
        assert loop.iae < 0.1 * known()["uncontrolled"], f"{name}: IAE {1e6 * loop.iae:.2f} um s"
        assert loop.drive.min() >= LIMITS.low, f"{name}: {loop.drive.min():.1f} V"
        assert loop.drive.max() <= LIMITS.high, f"{name}: {loop.drive.max():.1f} V"
    assert loops["PID tuned here"].iae <= loops["PID"].iae


def main() -> None:
    """Solve it, follow the triangle, and check."""
    fit = po.solve(question())
    print(fit)
    print(f"\n  {'':<16} {'largest [um]':>12} {'IAE [um s]':>12}")
    for name, loop in hysteresis_loops(fit).items():
        print(f"  {name:<16} {1e6 * loop.largest:>12.3f} {1e6 * loop.iae:>12.3f}")
    check(fit)


if __name__ == "__main__":
    main()
