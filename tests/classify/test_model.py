"""Flags that prevent a decision."""

import pytest

from doppelgait.classify.model import BLOCKING, find_blocking_flag


@pytest.mark.parametrize("flag", ["folded_echo_of:2", "not_a_moving_body:moves_like_a_thing", "unknown_target:x"])
def test_what_is_no_body_gets_no_decision_and_a_caution_about_one_feature_prevents_nothing(flag):
    assert find_blocking_flag(("harmonic_ratio_3:no_peak", flag), BLOCKING) == flag
    assert find_blocking_flag(("harmonic_ratio_3:no_peak",), BLOCKING) is None
