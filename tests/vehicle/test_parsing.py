"""What is said of a vehicle is read in one way, and what cannot be meant says so."""

import pytest

from ges.errors import UsageError
from ges.vehicle import parsing


@pytest.mark.parametrize(
    ("text", "value"), [("1.5", 1.5), (" 1,5 ", 1.5), ("1e3", 1e3), ("0,034", 0.034)]
)
def test_numbers_have_a_decimal_point_or_comma(text, value):
    assert parsing.parse_number(text) == value


@pytest.mark.parametrize("text", ["", "two", "nan", "inf", "1.2.3", "1,2,3"])
def test_what_is_no_number_says_how_to_write_one(text):
    with pytest.raises(UsageError, match=r"is no number; write it as in 1\.5"):
        parsing.parse_number(text)


def test_a_separator_of_thousands_is_no_decimal_comma():
    with pytest.raises(UsageError, match=r"'1,500' may be 1\.500 or 1500"):
        parsing.parse_number("1,500")


@pytest.mark.parametrize("text", ["2000", "0", "-1", "0.001"])
def test_a_mass_that_no_vehicle_has(text):
    with pytest.raises(UsageError, match=r"allowed is 0\.005 to 200 kg"):
        parsing.parse_mass_kg(text)


def test_lengths():
    assert (
        parsing.parse_length_m("500mm")
        == parsing.parse_length_m("0.5")
        == parsing.parse_length_m("50cm")
        == 0.5
    )
    with pytest.raises(UsageError, match="500mm"):
        parsing.parse_length_m("half a metre")


def test_a_propeller_stays_as_it_was_written():
    assert parsing.require_propeller("10x4.5") == "10x4.5"
    with pytest.raises(UsageError, match="propeller 'banana' is no size"):
        parsing.require_propeller("banana")
