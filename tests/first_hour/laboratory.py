"""One record in the forms in which instruments and people leave it, and with what goes wrong.

3000 samples at 1 kHz of the plain actuator, with noise of 3 nm.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from scipy.io import savemat

from piezo_opt.measurement import FloatArray
from tests.first_hour.plant import reading

NOISE: Final = 3e-3
"""[um]"""
T: Final = np.arange(3000) / 1000.0
U: Final = 50 + 30 * np.sin(2 * np.pi * 2.1 * T) + 15 * np.sin(2 * np.pi * 5.3 * T)
Y: Final = 1e6 * reading(U, 1e-3) + NOISE * np.random.default_rng(7).standard_normal(T.size)
HEAD: Final = "time [s],voltage [V],displacement [um]\n"


def rows(*columns: FloatArray, sep: str = ",", dec: str = ".", tail: str = "") -> str:
    return "".join(
        sep.join(f"{v:.9g}".replace(".", dec) for v in row) + tail + "\n"
        for row in zip(*columns, strict=True)
    )


def changed(where: slice | int, value: Any) -> FloatArray:
    y = Y.copy()
    y[where] = value
    return y


def _twice() -> str:
    u, y = U.copy(), Y.copy()
    u[1500:1756], y[1500:1756] = u[1244:1500], y[1244:1500]
    return HEAD + rows(T, u, y)


def _overload() -> FloatArray:
    y = changed(slice(700, 703), 9.9e37)
    y[1500] = 9.9e37
    return y


_JITTER = 5e-5 * np.random.default_rng(2).uniform(-1, 1, T.size)
_LABVIEW = (
    "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n"
    "***End_of_Header***\t\n\t\nChannels\t2\nY_Unit_Label\tV\tum\nDelta_X\t1.0E-3\t1.0E-3\n"
    "***End_of_Header***\t\t\t\nX_Value\tvoltage\tdisplacement\tComment\n"
)
TEXTS: Final[dict[str, Callable[[], str | bytes]]] = {
    "plain.csv": lambda: HEAD + rows(T, U, Y),
    "parentheses.csv": lambda: "Time (s),Voltage (V),Displacement (um)\n" + rows(T, U, Y),
    "unit_row.csv": lambda: "time,voltage,displacement\ns,V,um\n" + rows(T, U, Y),
    "preamble.csv": lambda: (
        "Model,S1\nSample interval,1.0E-03,s\n\nSource,CH1,CH2\nSecond,Volt,um\n" + rows(T, U, Y)
    ),
    "trailing_comma.csv": lambda: HEAD.replace("\n", ",\n") + rows(T, U, Y, tail=","),
    "start_increment.csv": lambda: (
        "X,CH1,CH2,Start,Increment\nSequence,Volt,um,0.000000E+00,1.000000E-03\n"
        + rows(np.arange(3000.0), U, Y, tail=",,")
    ),
    "decimal_comma.csv": lambda: HEAD.replace(",", ";") + rows(T, U, Y, sep=";", dec=","),
    "utf16.csv": lambda: (HEAD + rows(T, U, Y)).encode("utf-16"),
    "latin1.csv": lambda: (HEAD.replace("um", "\u00b5m") + rows(T, U, Y)).encode("latin-1"),
    "crlf.csv": lambda: (HEAD + rows(T, U, Y)).replace("\n", "\r\n"),
    "no_time.csv": lambda: "voltage [V],displacement [um]\n" + rows(U, Y),
    "iso_time.csv": lambda: (
        "time,voltage [V],displacement [um]\n"
        + "".join(
            f"2020-01-01T00:00:{t:06.3f},{u:.9g},{y:.9g}\n" for t, u, y in zip(T, U, Y, strict=True)
        )
    ),
    "labview.lvm": lambda: _LABVIEW + rows(T, U, Y, sep="\t"),
    "set_point.csv": lambda: (
        "time [s],voltage [V],position [um],measured [um]\n" + rows(T, U, 0.2 * U, Y)
    ),
    "overload.csv": lambda: HEAD + rows(T, U, _overload()),
    "dropout.csv": lambda: HEAD + rows(T, U, changed(slice(1000, 1012), 0.0)),
    "restart.csv": lambda: (
        HEAD + rows(T[:1500], U[:1500], Y[:1500]) + rows(T[:1500], U[1500:], Y[1500:])
    ),
    "glued.csv": lambda: HEAD + rows(T, U, changed(slice(1500, None), Y[1500:] + 4.0)),
    "wrapped.csv": lambda: HEAD + rows(T, U, (Y - Y.min()) % 5.0),
    "slow_drive.csv": lambda: HEAD + rows(T, U[(np.arange(3000) // 10) * 10], Y),
    "block_twice.csv": _twice,
    "metres.csv": lambda: HEAD.replace("[um]", "[m]") + rows(T, U, Y),
    "rounded_time.csv": lambda: HEAD + rows(np.round(T, 2), U, Y),
    "jitter.csv": lambda: HEAD + rows(T + _JITTER, U, Y),
    "range_a.csv": lambda: HEAD + rows(T, U, Y),
    "range_b.csv": lambda: HEAD + rows(T, U, 10 * Y),
}


def _packed(file: Path) -> None:
    with h5py.File(file, "w") as content:
        for name, unit, v in (("time", "s", T), ("voltage", "V", U), ("displacement", "um", Y)):
            low, scale = v.min(), np.ptp(v) / 60000
            own = content.create_dataset(name, data=np.round((v - low) / scale - 3e4).astype("i2"))
            own.attrs.update(units=unit, scale_factor=scale, add_offset=low + 3e4 * scale)


def _simulink(file: Path) -> None:
    signals = [
        {"values": U[:, None], "label": "voltage"},
        {"values": Y[:, None], "label": "displacement"},
    ]
    savemat(file, {"ScopeData": {"time": T[:, None], "signals": signals}})


BINARIES: Final[dict[str, Callable[[Path], None]]] = {
    "packed.h5": _packed,
    "simulink.mat": _simulink,
    "tofile.mat": lambda file: savemat(file, {"log": np.vstack([T, U, Y])}),
}


def make(folder: Path) -> None:
    """All of them, in a folder."""
    for name, text in TEXTS.items():
        content = text()
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    for name, put in BINARIES.items():
        put(folder / name)
