"""The contract, for causes of every hook that are made for the tests."""

import made_causes
import pytest
import test_contract as contract

from icpshap.causes import CAUSES, Cause

MADE = [
    member
    for member in vars(made_causes).values()
    if isinstance(member, type) and issubclass(member, Cause) and member is not Cause
]
OF_ONE = [
    contract.test_its_words_are_complete,
    contract.test_it_acts_through_one_hook,
]
OF_A_PAIR = [
    contract.test_off_changes_nothing_to_the_bit,
    contract.test_the_hook_itself_does_nothing_at_off,
    contract.test_it_changes_something_when_on,
    contract.test_the_same_level_does_the_same_each_time,
    contract.test_a_larger_level_removes_more_of_the_same,
    contract.test_its_random_numbers_are_its_own,
    contract.test_masks_are_those_of_the_raw_scans,
]


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    for cause in MADE:
        monkeypatch.setitem(CAUSES, cause.name, cause)


@pytest.mark.parametrize("cause", MADE)
def test_the_contract_holds(cause, room_pair):
    for check in OF_ONE:
        check(cause)
    for check in OF_A_PAIR:
        check(cause, room_pair)


def test_seven_causes_act_together_in_any_order(room_pair):
    assert len(CAUSES) >= 7
    contract.test_the_order_in_which_causes_are_named_does_not_matter(room_pair)
    contract.test_the_initial_poses_depend_on_the_causes_that_move_them_alone(room_pair)
