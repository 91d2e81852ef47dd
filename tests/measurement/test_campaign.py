"""Several records have names of their own and common units."""

from __future__ import annotations

import pytest

from piezo_opt.errors import InputError
from piezo_opt.measurement import Campaign
from tests.measurement.records import sine


def test_a_campaign_has_unique_names_and_common_units() -> None:
    one, two = sine(name="one"), sine(name="two")
    campaign = Campaign.of([one, two])
    assert campaign.names == ("one", "two")
    assert campaign["two"] is two
    assert Campaign.of(campaign) is campaign
    assert Campaign.of(one).records == (one,)
    assert list(campaign) == [one, two]
    for records, says in (
        ([], "at least one"),
        ([one, one], "called 'one'"),
        ([one, two.with_(drive_unit="N")], "drive_unit N"),
    ):
        with pytest.raises(InputError, match=says):
            Campaign.of(records)
    with pytest.raises(InputError, match="no record 'three': there are one, two"):
        campaign["three"]
