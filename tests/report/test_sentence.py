"""The sentence: at most 40 words whatever was found, no key of a file, numbers of the diagnosis."""

import itertools
import re

import pytest

from ges.diagnose.library.requirements import REQUIREMENTS
from ges.diagnose.report.sentence import MOST_WORDS, sentence_of, size_words
from ges.simulator import effects as effect_table

FORMS = ("physics", "parameter", "sensor", "ambiguous", "unknown", "nothing_proven")


def _finding(content: dict, name: str, **changes) -> dict:
    return {**content["findings"][0], "name": name, "alternatives": [], **changes}


def test_what_how_much_how_sure_and_what_it_is_worth(content):
    assert sentence_of(content) == (
        "Missing in the simulator: rotor drag (0.26 N per m/s), 97 % sure; on flights that took no"
        " part, position x 1 s ahead is 0.040 m off, not 0.15 m."
    )


@pytest.mark.parametrize("count", [1, 2, 5, 9])
@pytest.mark.parametrize("verdict", FORMS)
def test_never_more_than_forty_words_nor_a_key(content, verdict, count):
    names = sorted(effect_table.table(), key=len, reverse=True)
    kinds, places = ("physics", "sensor", "parameter"), ("", "rotor 1")
    for shift, manoeuvre in itertools.product((0, 7, 20), (None, "straight_runs")):
        found = [
            _finding(
                content,
                name,
                open=verdict == "ambiguous" and (k > 0 or count == 1),
                kind=kinds[k % 3],
                place=places[k % 2],
            )
            for k, name in enumerate(names[shift : shift + count])
        ]
        named = verdict not in ("unknown", "nothing_proven")
        changes = {"verdict": verdict, "next_flight": {"manoeuvre": manoeuvre}}
        words = sentence_of({**content, **changes, "findings": found if named else []})
        assert len(words.split()) <= MOST_WORDS, words
        assert not re.search(r"[a-z]_[a-z]|\bP 0\.|nan|None", words), words
        assert words[0].isupper() and words.endswith(".")


@pytest.mark.parametrize(
    ("channel", "size", "words"),
    [
        ("force_z", {"value": 0.42, "unit": "N", "share_of_weight": 0.03}, "3.0 % of weight"),
        ("moment_x", {"value": 0.028, "unit": "N m", "share_of_weight": 0.01}, "lever of 0.0020 m"),
        (
            "drive_1",
            {"value": 4.6, "unit": "rad/s", "share_of_weight": 0.005},
            "0.5 % of full speed",
        ),
        ("range", {"value": 0.03, "unit": "m", "share_of_weight": 0.2}, "0.030 m"),
    ],
)
def test_sizes_are_said_as_engineers_do(content, channel, size, words):
    assert size_words(_finding(content, "x", size={**size, "channel": channel}), content) == words


def test_a_declared_number_is_said_by_its_correction(content):
    wrong = _finding(
        content,
        "thrust_scale",
        kind="parameter",
        parameters={"scale": {"value": -0.157, "ci95": [-0.17, -0.14], "unit": "1"}},
    )
    content |= {"findings": [wrong], "verdict": "parameter"}
    assert sentence_of(content).startswith(
        "Wrong in the vehicle file: thrust scale (−16 %), 97 % sure; on flights"
    )


def test_a_correction_has_the_unit_of_its_number(content):
    """Thirty milliseconds of a motor's lag are no 3 %."""
    slow = {"up_s": {"value": 0.03, "ci95": [0.02, 0.04], "unit": "s"}}
    wrong = _finding(content, "motor_lag", kind="parameter", parameters=slow)
    assert size_words(wrong, content) == "+0.030 s"


def test_a_contradicted_number_without_a_finding_is_named(content):
    far = {"value": 304.0, "ci95": [299.0, 309.0], "declared_sd": 60.0, "prior_sd": 60.0}
    content |= {
        "findings": [],
        "verdict": "parameter",
        "calibration": {"vehicle.max_rotor_speed_rad_s": far},
    }
    assert sentence_of(content) == (
        "The vehicle file is wrong about max rotor speed: the flights ask for +304 rad/s, 5.1"
        " prior sds."
    )


def test_what_is_farthest_off_need_not_be_in_the_file(content):
    """A centre of gravity that no file states is at the origin, as usual."""
    off = {"value": 0.0087, "ci95": [0.0073, 0.01], "declared_sd": None, "prior_sd": 0.0024}
    wide = {"value": 0.3, "ci95": [0.2, 0.4], "declared_sd": None, "prior_sd": None}
    content |= {
        "findings": [],
        "verdict": "nothing_proven",
        "calibration": {"cg_offset.x_m": off, "wind.x_m_s": wide},
    }
    assert "farthest off is cg offset x: the flights ask for +0.0087 m, 3.6 prior sds" in (
        sentence_of(content)
    )
    content["verdict"] = "parameter"
    assert sentence_of(content).startswith("The vehicle file is wrong about a nominal parameter")


def test_what_is_open_says_how_to_find_out(content):
    content |= {
        "verdict": "ambiguous",
        "findings": [
            _finding(content, n, open=True, size={}) for n in ("weak_rotor", "attitude_bias")
        ],
        "next_flight": {"manoeuvre": "yaw_turn"},
    }
    assert sentence_of(content) == (
        "One of weak rotor or attitude bias is missing and these flights cannot tell which; flying"
        " yaw turn would tell."
    )


@pytest.mark.parametrize("message", [r.message for r in REQUIREMENTS.values()])
def test_what_has_to_be_logged_is_said_without_why(content, message):
    """A sentence read *a logged voltage; without it a battery cannot be told apart would tell*."""
    content |= {
        "verdict": "ambiguous",
        "findings": [
            _finding(content, n, open=True, size={}) for n in ("weak_rotor", "attitude_bias")
        ],
        "next_flight": {},
        "not_tested": {"attitude_bias": message},
    }
    need = message.removeprefix("needs ").split(";")[0]
    assert sentence_of(content) == (
        "One of weak rotor or attitude bias is missing and these flights cannot tell which;"
        f" {need} would tell."
    )
    assert ":" not in need


def test_no_gain_is_said_too(content):
    content["fit"]["rollout"] = {}
    content["fit"]["channels"] = {
        "force_x_N": {
            "before": 0.5,
            "recalibrated": 0.4,
            "after": 0.41,
            "reduction_ci95": [-0.1, 0.05],
        }
    }
    assert sentence_of(content).endswith("on flights that took no part, no error falls.")


def test_an_error_that_falls_elsewhere_is_no_gain(content):
    law = {
        "channel": "moment_z",
        "form": "0.12 m g L (V_y/v_h)",
        "size": {"channel": "moment_z", "value": 0.03, "unit": "N m", "share_of_weight": 0.03},
    }
    moment = {"before": 1e-4, "recalibrated": 1.2e-4, "after": 1.3e-4, "reduction_ci95": [-0.2, 0]}
    content["fit"]["channels"]["moment_z_Nm"] = moment
    content["data"]["reference_scale"]["moment"] = 1.0
    told = sentence_of({**content, "findings": [], "laws": [law], "verdict": "law"})
    assert told.endswith("on flights that took no part, nothing of it shows.")
    moment["before"] = 0.1
    told = sentence_of({**content, "findings": [], "laws": [law], "verdict": "law"})
    assert "position x 1 s ahead" in told


def _unseen(before, recalibrated, after, interval):
    stages = {"before": before, "recalibrated": recalibrated, "after": after}
    return {**stages, "reduction_ci95": interval}


def test_a_certain_loss_is_said_beside_the_gain(content):
    content["fit"]["rollout"] = {}
    content["fit"]["channels"] = {
        "force_x_N": _unseen(0.5, 0.4, 0.2, [0.4, 0.6]),
        "force_z_N": _unseen(0.8, 1.2, 1.7, [-0.7, -0.3]),
    }
    told = sentence_of(content)
    assert told.endswith("falls by 50 %, but the force along thrust is 42 % worse.")
    content["fit"]["channels"]["force_z_N"]["reduction_ci95"] = [-0.7, 0.1]
    assert "worse" not in sentence_of(content)


def test_a_loss_is_said_before_names_and_sizes(content):
    """Where all of it is too long, the gain goes first, then names and sizes."""
    content["fit"]["channels"] = {"force_z_N": _unseen(0.8, 1.2, 1.7, [-0.7, -0.3])}
    content["findings"] = [
        _finding(content, name) for name in ("ground_effect_forward_flight", *["wind"] * 4)
    ]
    told = sentence_of(content)
    assert told.endswith("is 42 % worse.") and len(told.split()) <= MOST_WORDS


def test_where_gain_and_loss_are_too_long_there_is_a_loss_all_the_same(content):
    content["fit"]["channels"] = {"moment_y_Nm": _unseen(0.8, 1.2, 1.7, [-0.7, -0.3])}
    content["findings"] = [
        _finding(content, "slung_load"),
        _finding(content, "wind"),
        _finding(content, "time_offset", kind="sensor"),
    ]
    assert sentence_of(content).endswith("m off, not 0.15 m, but another error grows.")


def test_what_stays_unknown_has_its_place(content):
    content |= {
        "verdict": "unknown",
        "findings": [],
        "located": [],
        "unexplained": [{"channel": "acc_z", "regime": {"battery_V": [7.92, 8.09]}}],
    }
    assert sentence_of(content) == (
        "The simulator is wrong in the accelerometer along thrust at battery voltage 7.92 to 8.09"
        " V, and no effect of the library explains it."
    )


def test_nothing_proven_tells_the_number_that_moved(content):
    content |= {"verdict": "nothing_proven", "findings": []}
    assert "thrust scale" not in sentence_of(content)
    content["calibration"]["thrust_scale.scale"]["value"] = 0.09
    assert "farthest off is thrust scale: the flights ask for +9.0 %, 3.0 prior" in sentence_of(
        content
    )


def test_nothing_proven_tells_the_error_that_stays_on_flights_that_took_no_part(content):
    content |= {"verdict": "nothing_proven", "findings": [], "calibration": {}}
    content["data"]["reference_scale"] = {"force": 19.0, "moment": 2.6}
    content["fit"]["channels"] = {
        "force_z_N": {"before": 20.2, "recalibrated": 14.7, "after": 14.7},
        "moment_y_Nm": {"before": 0.3, "recalibrated": 0.2, "after": 0.2},
    }
    assert "the force along thrust stays 15 N off" in sentence_of(content)


@pytest.mark.parametrize(
    ("probability", "words"), [(0.9905, "99.1 % sure"), (0.997, "99.7 %"), (0.9999, "99.9 % sure")]
)
def test_nothing_is_rounded_to_certainty(content, probability, words):
    finding = {**content["findings"][0], "probability": probability}
    assert words in sentence_of({**content, "findings": [finding]})


def test_two_errors_are_said_with_as_many_digits_as_tell_them_apart(content):
    rolled = content["fit"]["rollout"]
    rows = {"p_x_m": {**rolled["channels"]["p_x_m"], "recalibrated": 0.1249, "after": 0.1175}}
    fit = {**content["fit"], "rollout": {**rolled, "channels": rows}}
    assert "is 0.117 m off, not 0.125 m" in sentence_of({**content, "fit": fit})


@pytest.mark.parametrize(
    ("count", "more"), [(1, ""), (2, " and by 1 more law"), (3, " and by 2 more laws")]
)
def test_a_law_is_what_the_simulator_is_off_by(content, count, more):
    law = {
        "channel": "force_y",
        "form": "0.0971 m g V_x/v_h",
        "size": {"channel": "force_y", "share_of_weight": 0.03},
    }
    told = sentence_of({**content, "findings": [], "laws": [law] * count, "verdict": "law"})
    assert told.startswith(
        f"The force to the left is off by 0.0971 m g V_x/v_h{more},"
        " which no effect is proven to make;"
    )


@pytest.mark.parametrize("verdict", ["physics", "ambiguous"])
def test_three_names_outrank_their_sizes(content, verdict):
    names = ("ground_effect_forward_flight", "ground_effect_moment", "rotor_inertia_reaction")
    size = {"channel": "force_z", "value": 0.4, "unit": "N", "share_of_weight": 0.03}
    found = [_finding(content, n, size=size, open=verdict == "ambiguous") for n in names]
    told = sentence_of({**content, "findings": found, "verdict": verdict})
    assert all(n.replace("_", " ") in told for n in names)
    if verdict == "physics":
        assert "of weight" not in told and "position x 1 s ahead" in told
