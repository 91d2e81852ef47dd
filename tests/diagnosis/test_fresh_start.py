"""A base fit that is stuck does not keep the sets near it stuck as well."""

from __future__ import annotations

from piezo_opt.benchmark import plants
from piezo_opt.benchmark.hidden import measurement
from piezo_opt.diagnosis import diagnose


def test_a_resonance_that_joins_a_stuck_base_is_found_from_a_fresh_start() -> None:
    # Gain and loop have run to a valley thirty times too large: from there no resonance fits.
    record = plants.make((), 9012, samples=4000)[0]
    found = diagnose(measurement(record, "chirp"), threads=1, advise=False, max_time=600.0)
    assert found.verdict == "complete"
    assert found.steps == ()
    assert "second_order" in found.refined
    assert found.final.rms < 1.02 * record.noise_rms
    assert min(suspect.p_value for suspect in found.suspects) > 1e-3
