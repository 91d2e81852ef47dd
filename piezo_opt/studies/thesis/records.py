"""What the thesis measured, and what its readings resolve."""

from __future__ import annotations

from piezo_opt.comparison import uncontrolled_iae
from piezo_opt.datasets import load
from piezo_opt.studies.row import Row


def record_rows() -> tuple[Row, ...]:
    """The three tables that survive."""
    loop, vibration = load("thesis/hysteresis"), load("thesis/vibration")
    return (
        Row(
            "Step of the displacement, loop",
            "0.1725 µm, a camera pixel",
            f"{1e6 * (loop.resolution or 0.0):.4f} µm",
            f"{len(loop)} instants; the table prints the reading at 125 V twice.",
            "Table 3.1, Measurement.resolution",
        ),
        Row(
            "Uncontrolled hysteresis, IAE",
            "67.73 µm s",
            f"{1e6 * uncontrolled_iae(loop):.1f} µm s",
            "Area between the loop and the straight line to its tip.",
            "chapter 4, uncontrolled_iae",
        ),
        Row(
            "Step of the displacement, vibration",
            "0.1233 µm",
            f"{1e6 * (vibration.resolution or 0.0):.4f} µm",
            "The median of the differences.",
            "Appendix E, Measurement.resolution",
        ),
        Row(
            "Vibration record",
            "400 samples at 4 Hz",
            f"{len(vibration)} samples, {len(vibration.gaps)} gaps, {vibration.rate:.3g} Hz",
            "What survives; the gaps are kept.",
            "Appendix E, load",
        ),
    )
