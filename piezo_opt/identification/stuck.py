"""Whether a fit can be the answer: at no bound, and not far above the noise of its residual."""

from __future__ import annotations

import numpy as np

from piezo_opt.identification.result import Fit
from piezo_opt.measurement.spectra import hann

_FEWEST = 64
"""Samples from which a spectrum has an upper half to speak of."""
_FAR = 10.0
"""Error over the noise beyond which noise is less than a hundredth of the power that is left."""


def noise_of(fit: Fit) -> float:
    """White noise [m] that would be as strong as the highest frequencies of what a fit leaves.

    Of the first record: with r the residual under a Hann window w, R its spectrum, and the median
    over the upper half of the frequencies (ln 2 of the mean, for noise; lines do not lift it),

        sigma^2 = median |R|^2 / (ln 2 sum w^2)

    NaN for less than 64 samples. Source: Welch (1967), IEEE Trans. Audio and Electroacoustics
    15(2), 70-73 (windowed periodograms).
    """
    record = fit.question.campaign.records[0]
    left = (record.position - fit.readings[0])[record.counted]
    if left.size < _FEWEST:
        return float("nan")
    window = hann(left.size)
    spectrum = np.fft.rfft(window * left)
    upper = np.abs(spectrum[spectrum.size // 2 :]) ** 2
    return float(np.sqrt(np.median(upper) / (np.log(2.0) * float(window @ window))))


def far_above(fit: Fit) -> float:
    """Error over the noise where that is more than ten, 0 elsewhere."""
    noise = noise_of(fit)
    return fit.rms / noise if fit.rms > _FAR * noise > 0.0 else 0.0


def doubtful(fit: Fit) -> bool:
    """Whether other starts are worth a trial: far above the noise, or at a bound."""
    return bool(fit.at_bound) or fit.outcome.far > 0.0


def explains_nothing(fit: Fit) -> bool:
    """Whether a fit leaves as much of the reading as a constant does.

    Of N counted samples of noise k unknowns explain R^2 = 1 - |r|^2 / |y - mean y|^2 of k / N on
    average, with a standard deviation of sqrt(2 k) / N (chi-square). A fit that is not three of
    those above has found nothing.
    """
    k, samples = len(fit.names), max(1, fit.residuals.size)
    explained = 1.0 - (1.0 - fit.fit_percent / 100.0) ** 2
    return bool(explained <= (k + 3.0 * np.sqrt(2.0 * k)) / samples)
