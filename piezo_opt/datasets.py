"""The measured records that come with the project, each with a datasheet beside it.

The thesis' tables are part of the installed package; the two larger sets live in the ``data``
folder of the repository only.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, Campaign, FloatArray, Measurement
from piezo_opt.readers import read

_RECORDS = {
    "thesis/hysteresis": "thesis/hysteresis.csv",
    "thesis/vibration": "thesis/vibration.csv",
    "thesis/fe": "thesis/fe.csv",
    "flexure-stage": "flexure-stage/record.h5",
}
_CAMPAIGNS = {"cubespec-fsm": "cubespec-fsm/train.h5"}
_PACKAGE = Path(__file__).resolve().parent


def names() -> tuple[str, ...]:
    """The records that `load` knows."""
    return tuple(_RECORDS)


def path(name: str) -> Path:
    """Where a shipped file is: ``path("thesis/hysteresis.csv")``.

    In the installed package first, then in the repository this package is run from. Raises
    `InputError` with the names there are.
    """
    folders = _folders()
    wanted = Path(name)
    if name and not wanted.is_absolute() and ".." not in wanted.parts:
        for folder in folders:
            if (folder / wanted).is_file():
                return folder / wanted
    here = sorted(
        {
            file.relative_to(folder).as_posix()
            for folder in folders
            for file in folder.glob("*/*")
            if file.suffix in (".csv", ".h5", ".md")
        }
    )
    if name in (*_RECORDS.values(), *_CAMPAIGNS.values()):
        raise InputError(
            f"{name!r} is not part of the installed package, which has the thesis' records only: "
            f"clone the repository and run from it (here are {', '.join(here) or 'no files'})"
        )
    raise InputError(f"there is no data file {name!r}: there are {', '.join(here) or 'none'}")


def load(name: str) -> Measurement:
    """A shipped record: ``load("thesis/hysteresis")``, one of `names`.

    Raises `InputError` for an unknown name, or one that is not installed.
    """
    if name in _CAMPAIGNS:
        raise InputError(f"{name!r} is several records: use load_campaign({name!r}, level=...)")
    if name not in _RECORDS:
        raise InputError(f"there is no record {name!r}: there are {', '.join(_RECORDS)}")
    return read(path(_RECORDS[name]))


def load_campaign(
    name: str,
    *,
    level: str,
    drive: int = 1,
    displacement: int = 1,
    single_input: bool = True,
) -> Campaign:
    """The six realisations of one excitation level of ``"cubespec-fsm"``, two periods each.

    Args:
        name: ``"cubespec-fsm"``.
        level: "100mV", "200mV" or "300mV".
        drive, displacement: which of the three voltages [V] and sensors [m].
        single_input: three voltages move the mirror at once, and most of what a sensor reads
            comes from the other two. True takes their linear part away: with G(f) the 3-column
            least-squares frequency response of the sensor over the six realisations,
            y(f) - sum_{j != drive} G_j(f) U_j(f), so that noise and nonlinearity of the reading
            stay in it. False gives the reading as it is; the other voltages are channels
            ``voltage_2``, ... either way.

    Raises:
        InputError: unknown name, level, drive or displacement, or data that is not installed.
    """
    if name not in _CAMPAIGNS:
        raise InputError(f"there is no campaign {name!r}: there are {', '.join(_CAMPAIGNS)}")
    import h5py

    file = path(_CAMPAIGNS[name])
    try:
        with h5py.File(file, "r") as content:
            levels = tuple(content)
            if level not in levels:
                raise InputError(f"{name} has no level {level!r}: there are {', '.join(levels)}")
            # axes: sample, channel, realisation, period
            voltage = np.asarray(content[level]["voltage"][()], dtype=np.float64)
            position = np.asarray(content[level]["displacement"][()], dtype=np.float64)
            rate = float(content.attrs["rate"])
            source = np.asarray(content.attrs["source"]).item().decode("utf-8")
    except (OSError, KeyError) as error:
        raise InputError(
            f"{file}: is damaged ({error}): compare it with SHA256SUMS and fetch it again"
        ) from error
    samples, channels, realisations, periods = voltage.shape
    for word, number in (("drive", drive), ("displacement", displacement)):
        if number not in range(1, channels + 1):
            raise InputError(f"{name} has no {word} {number!r}: there are 1 to {channels}")
    reading = position[:, displacement - 1]
    if single_input:
        reading = reading - _answer_to_others(voltage, reading, drive - 1)
        source += "; the linear answer to the other two voltages taken away"
    time = np.arange(samples * periods) / rate

    def in_a_row(values: FloatArray) -> FloatArray:
        return np.asarray(values.T.reshape(-1), dtype=np.float64)

    return Campaign(
        tuple(
            Measurement(
                time=time,
                drive=in_a_row(voltage[:, drive - 1, one]),
                position=in_a_row(reading[:, one]),
                channels={
                    f"voltage_{other + 1}": in_a_row(voltage[:, other, one])
                    for other in range(channels)
                    if other != drive - 1
                },
                channel_units={
                    f"voltage_{other + 1}": "V" for other in range(channels) if other != drive - 1
                },
                name=f"{level}-{one + 1}",
                between=Between.BANDLIMITED,
                period=samples / rate,
                source=source,
            )
            for one in range(realisations)
        )
    )


def _answer_to_others(voltage: FloatArray, reading: FloatArray, drive: int) -> FloatArray:
    """(sample, realisation, period): the linear answer of a sensor to all drives but one.

    At every excited line k the frequency response solves, over the realisations r,
    Y_r(k) = sum_j G_j(k) U_jr(k) in least squares.
    """
    inputs: NDArray[np.complex128] = np.fft.rfft(voltage.mean(axis=-1), axis=0)
    outputs: NDArray[np.complex128] = np.fft.rfft(reading.mean(axis=-1), axis=0)
    strength = np.abs(inputs).max(axis=(1, 2))
    excited = strength > 0.1 * np.median(strength[strength > 0.01 * strength.max()])
    equations = np.swapaxes(inputs[excited], 1, 2)  # (line, realisation, channel)
    response = (np.linalg.pinv(equations) @ outputs[excited][:, :, np.newaxis])[:, :, 0]
    response[:, drive] = 0.0
    spectrum = np.zeros(outputs.shape, dtype=np.complex128)
    spectrum[excited] = np.einsum("kc,kcr->kr", response, inputs[excited])
    answer = np.fft.irfft(spectrum, n=voltage.shape[0], axis=0)
    return np.asarray(answer[:, :, np.newaxis], dtype=np.float64)


def _folders() -> tuple[Path, ...]:
    folders = [_PACKAGE / "_data"]
    # Beside an installed package there may be some other project's "data".
    if (_PACKAGE.parent / "pyproject.toml").is_file():
        folders.append(_PACKAGE.parent / "data")
    return tuple(folder for folder in folders if folder.is_dir())
