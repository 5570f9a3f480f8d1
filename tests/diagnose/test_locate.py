"""Where residuals have structure: found where it is, not found where there is none, and what of it
stays unexplained.
"""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from ges.diagnose.locate import regimes
from ges.diagnose.locate.regimes import (
    located_by_findings,
    located_by_open_names,
    located_by_residuals,
    regime_cells,
    strongest_entries,
    unexplained_structures,
)
from ges.diagnose.locate.structure import Structure, structures, varied_regimes
from ges.diagnose.select.evidence import Posterior
from ges.diagnose.settings import using
from ges.diagnose.types.model import from_vehicle

NAMES = ("force_x", "force_z", "moment_y")
STEP_S, WINDOWS, FLIGHTS, BLOCK = 0.1, 250, 4, 25


@pytest.fixture
def model(sheet):
    return from_vehicle(sheet())


def _noise(rng, correlation=0.8, size=0.05):
    """Coloured noise of every flight and channel, (m, C) N."""
    white = rng.standard_normal((FLIGHTS, WINDOWS, len(NAMES))) * size * np.sqrt(1 - correlation**2)
    return list(lfilter([1.0], [1.0, -correlation], white, axis=1))


def _flights(seed=0):
    """Regimes of every flight: speeds that go to and fro, a height that goes up, and time."""
    rng, t = np.random.default_rng(seed), np.arange(WINDOWS) * STEP_S
    return [
        {
            "time_s": t,
            "forward_m_s": 2.0 * np.sin(2 * np.pi * t / 8.0 + rng.uniform(0, 6)),
            "height_over_radius": np.linspace(2.0, 12.0, WINDOWS)[:: rng.choice([-1, 1])],
        }
        for _ in range(FLIGHTS)
    ]


def _blocks():
    return [np.arange(WINDOWS) // BLOCK + 1000 * f for f in range(FLIGHTS)]


def _structures(residuals, told, names, blocks):
    """Structures where rows resolve everything."""
    return structures(residuals, told, names, blocks, [np.zeros_like(r) for r in residuals])


def _clear(found, chance=0.01):
    return {(s.channel, *s.regime): s for s in found if s.q_value <= chance and not s.of_size}


def _system(model):
    return SimpleNamespace(main=NAMES, model=model, blocks=lambda _: _blocks())


def test_a_force_that_follows_a_speed_is_found_there_and_not_elsewhere():
    told, residuals = _flights(), _noise(np.random.default_rng(1))
    for r, t in zip(residuals, told, strict=True):
        r[:, 0] -= 0.04 * t["forward_m_s"]
    found = _clear(_structures(residuals, told, NAMES, _blocks()))
    best = max(found.values(), key=lambda s: s.r2)
    assert (best.channel, best.regime) == ("force_x", ("forward_m_s",)) and best.r2 > 0.3
    assert {key[0] for key in found} == {"force_x"}
    assert best.low[0] <= -1.5 or best.high[0] >= 1.5, "the force is largest at full speed"


def test_coloured_noise_has_structure_no_oftener_than_it_should():
    """Forty sets of flights without anything: at a chance of 5 %, seven or more would happen once
    in a hundred times.
    """
    alarms = sum(
        bool(
            _clear(
                _structures(_noise(np.random.default_rng(k)), _flights(k), NAMES, _blocks()), 0.05
            )
        )
        for k in range(40)
    )
    assert alarms <= 6


def test_a_strong_structure_does_not_hide_itself():
    """Ninety times the noise: signs of the signal itself would make any prediction look like
    chance.
    """
    told, residuals = _flights(), _noise(np.random.default_rng(2))
    for r, t in zip(residuals, told, strict=True):
        r[:, 2] += 4.5 * np.maximum(t["forward_m_s"], 0.0)
    assert ("moment_y", "forward_m_s") in _clear(_structures(residuals, told, NAMES, _blocks()))


def test_a_strong_structure_is_clear_beside_tests_that_few_blocks_decide():
    """One flight is fast for six seconds. R^2 has a ceiling that a strong structure reaches, and
    draws of a few blocks scatter as far below it.
    """
    told, residuals = _flights(), _noise(np.random.default_rng(0))
    for k, (r, t) in enumerate(zip(residuals, told, strict=True)):
        fast = (t["time_s"] > 10.0) & (t["time_s"] < 16.0) & (k == 0)
        t["forward_m_s"] = np.where(fast, 4.0, 0.5) * np.sin(2 * np.pi * t["time_s"] / 3.0)
        r[:, 2] += 0.3 / 16.0 * t["forward_m_s"] ** 3
    found = _clear(_structures(residuals, told, NAMES, _blocks()))
    assert found["moment_y", "forward_m_s"].r2 > 0.7


def test_what_one_flight_alone_visits_is_seen():
    told, residuals = _flights(), _noise(np.random.default_rng(3))
    for t in told:
        t["height_over_radius"] = np.full(WINDOWS, 12.0)
    told[0]["height_over_radius"] = 7.0 + 5.0 * np.cos(2 * np.pi * told[0]["time_s"] / 5.0)
    residuals[0][:, 1] += 0.4 * (told[0]["height_over_radius"] < 6.0)
    assert ("force_z", "height_over_radius") in _clear(
        _structures(residuals, told, NAMES, _blocks())
    )


def test_a_speed_that_only_the_disturbance_moved_is_no_regime():
    """In hover the drift follows from the force that the residual shows; it would look like drag of
    the wrong sign.
    """
    hover = {
        "forward_m_s": np.linspace(-0.1, 0.1, 50),
        "left_m_s": np.linspace(-1.0, 1.0, 50),
        "battery_V": np.full(50, 15.0),
    }
    assert varied_regimes(hover) == ["left_m_s"]


@pytest.mark.parametrize(("middle", "counts"), [(3.0, True), (47.0, False)])
def test_a_radius_of_height_is_a_regime_near_the_ground_alone(middle, counts):
    heights = np.linspace(middle - 1.0, middle + 1.0, 500)
    assert (varied_regimes({"height_over_radius": heights}) == ["height_over_radius"]) == counts


def test_where_the_size_changes_and_the_mean_does_not():
    told, residuals = _flights(), _noise(np.random.default_rng(4))
    for r, t in zip(residuals, told, strict=True):
        r[:, 1] *= 1.0 + 5.0 * (t["height_over_radius"] < 5.0)
    found = [s for s in _structures(residuals, told, NAMES, _blocks()) if s.q_value <= 0.01]
    best = max((s for s in found if s.of_size), key=lambda s: s.r2)
    assert (best.channel, best.regime) == ("force_z", ("height_over_radius",)) and best.low[0] < 5.0
    assert best.rms == pytest.approx(0.3, rel=0.3), (
        "rms of the residual there, not of its logarithm"
    )
    assert all(s.of_size for s in found)


def test_a_size_is_what_rows_resolve_of_it():
    """As much as rows leave open on average is no structure's: a controller acts most where most
    happens. Of the mean nothing is taken.
    """
    told, residuals = _flights(), _noise(np.random.default_rng(4))
    for r, t in zip(residuals, told, strict=True):
        r[:, 1] *= 1.0 + 5.0 * (t["height_over_radius"] < 5.0)
    arguments = residuals, told, NAMES, _blocks()
    whole = _structures(*arguments)
    for share in (0.1, 10.0):
        open_N2 = [np.full_like(r, share * 0.3**2) for r in residuals]
        less = structures(*arguments, open_N2)
        for before, after in zip(whole, less, strict=True):
            rest = max(before.rms**2 - share * 0.3**2, 0.0) ** 0.5
            assert after.rms == pytest.approx(rest if before.of_size else before.rms)


def test_rougher_air_in_one_flight_than_in_another_is_in_no_regime():
    """Flights at heights of their own, in air that differs by four: a size that follows the height
    from flight to flight is the weather's.
    """
    alarms = 0
    for k in range(20):
        told, residuals = _flights(k), _noise(np.random.default_rng(k))
        for i, (r, t) in enumerate(zip(residuals, told, strict=True)):
            r *= (0.5, 1.0, 2.2, 2.0)[i % 4]
            t["height_over_radius"] = t["height_over_radius"] + 8.0 * (i % 4)
        found = _structures(residuals, told, NAMES, _blocks())
        alarms += any(s.of_size and s.q_value <= 0.05 and s.r2 > 0.1 for s in found)
    assert alarms <= 3


def test_what_differs_from_flight_to_flight_only_is_no_structure():
    """A battery that is fuller in one flight than in the next, and a thrust that is a little off in
    each.
    """
    told, residuals = _flights(), _noise(np.random.default_rng(8))
    for k, (r, t) in enumerate(zip(residuals, told, strict=True)):
        t["battery_V"] = 16.0 - 0.4 * k - 0.01 * t["time_s"]
        r[:, 1] += 0.1 * k
    assert not _clear(_structures(residuals, told, NAMES, _blocks()))


@pytest.mark.parametrize("alike", [True, False])
def test_what_drifts_is_no_function_of_voltage_unless_every_flight_says_so(alike):
    """A battery for each flight, or one for all of them: then no voltage is flown twice, and any
    drift is predicted beside it.
    """
    told, residuals = _flights(), _noise(np.random.default_rng(9))
    for k, (r, t) in enumerate(zip(residuals, told, strict=True)):
        t["battery_V"] = 16.0 - 0.02 * (t["time_s"] + (0.0 if alike else 60.0 * k))
        r[:, 1] += (0.3 if alike or k % 2 else -0.3) * t["time_s"] / 25.0
    found = {
        key
        for key in _clear(_structures(residuals, told, NAMES, _blocks()))
        if key[1] in ("time_s", "battery_V")
    }
    assert found == ({("force_z", "time_s"), ("force_z", "battery_V")} if alike else set())


def test_same_bytes_every_time():
    told, residuals = _flights(), _noise(np.random.default_rng(5))
    assert _structures(residuals, told, NAMES, _blocks()) == _structures(
        residuals, told, NAMES, _blocks()
    )


def test_map_and_entries_show_the_cells(model):
    told, residuals = _flights(), _noise(np.random.default_rng(6))
    for r, t in zip(residuals, told, strict=True):
        r[:, 1] += 0.3 * (t["height_over_radius"] < 5.0)
    found = _structures(residuals, told, NAMES, _blocks())
    made = regime_cells(_system(model), residuals, told, found)
    first = located_by_residuals(made, found, _system(model))[0]
    low, high = first["regime"]["height_over_radius"]
    assert first["channel"] == "force_z" and low < 2.5 and 3.0 < high < 7.0
    assert first["mean"] == pytest.approx(0.7 * 0.3, abs=0.07), (
        "the flight's own mean, here of three tenths, is left out"
    )
    assert first["q_value"] <= 0.01 and 0.5 < first["share_of_excess"] <= 1.0
    dark = [c for c in made if c.q_value <= 0.01]
    assert {c.channel for c in dark} == {"force_z"}
    of_map = [c for c in made if (c.channel, c.regime) == ("force_z", "height_over_radius")]
    assert sum(c.share for c in of_map) == pytest.approx(1.0)


def test_what_is_too_small_to_matter_is_not_located(model):
    told, residuals = _flights(), [1e-3 * r for r in _noise(np.random.default_rng(9))]
    for r, t in zip(residuals, told, strict=True):
        r[:, 0] -= 1e-4 * t["forward_m_s"]
    found = _structures(residuals, told, NAMES, _blocks())
    assert "force_x" in {key[0] for key in _clear(found)}
    assert (
        located_by_residuals(
            regime_cells(_system(model), residuals, told, found), found, _system(model)
        )
        == []
    )


def test_a_finding_is_located_where_it_stands_out_of_the_noise(model):
    told, residuals = _flights(), _noise(np.random.default_rng(7))
    acts = [
        np.stack([-0.05 * t["forward_m_s"], np.zeros(WINDOWS), 1e-4 * t["forward_m_s"]], axis=1)
        for t in told
    ]
    entries = located_by_findings(
        {"rotor_drag": acts}, residuals, {"rotor_drag": 0.98}, told, _system(model)
    )
    assert [(e["channel"], *e["regime"], e["finding"]) for e in entries] == [
        ("force_x", "forward_m_s", "rotor_drag")
    ]
    assert entries[0]["q_value"] == pytest.approx(0.02)
    low, high = entries[0]["regime"]["forward_m_s"]
    assert abs(low) > 0.9 or abs(high) > 0.9


def _open(name, value, probability):
    columns = (0 if name == "a" else 1,)
    posterior = Posterior(columns, np.array([value]), np.ones((1, 1)), 0.0)
    return SimpleNamespace(names=(name,), posterior=posterior, probability=probability)


@pytest.mark.parametrize(
    "likely, channels",
    [((0.6, 0.38), ["force_x"]), ((0.6, 0.2), [])],
    ids=["one of them", "perhaps none"],
)
def test_what_is_open_is_located_where_every_explanation_acts(monkeypatch, likely, channels):
    """Two explanations of a side force, one with a moment too: the force is there whichever holds,
    the moment is not sure.
    """
    told, residuals = _flights(), _noise(np.random.default_rng(10))
    shape = [
        np.stack([0.05 * t["forward_m_s"], np.zeros(WINDOWS), np.zeros(WINDOWS)], axis=1)
        for t in told
    ]
    both = [
        s + np.stack([np.zeros(WINDOWS)] * 2 + [0.1 * t["forward_m_s"]], axis=1)
        for s, t in zip(shape, told, strict=True)
    ]
    flights = [
        SimpleNamespace(
            weighted_columns=lambda terms, count, ab=ab: sum(
                size * ab[k][:, :count] for k, size in terms.items()
            )
        )
        for ab in zip(shape, both, strict=True)
    ]
    columns = [SimpleNamespace(variant=SimpleNamespace(effect=n)) for n in "ab"]
    system = SimpleNamespace(main=NAMES, flights=flights)
    monkeypatch.setattr(
        regimes,
        "with_columns",
        lambda system, wanted: SimpleNamespace(**{**vars(system), "columns": wanted}),
    )
    found = SimpleNamespace(
        hypotheses=[_open(n, 1.0, p) for n, p in zip("ab", likely, strict=True)]
    )
    entries = located_by_open_names(found, columns, system, residuals, told, ())
    assert [e["channel"] for e in entries] == channels
    assert all(
        e["q_value"] == pytest.approx(1.0 - sum(likely)) and "forward_m_s" in e["regime"]
        for e in entries
    )
    assert located_by_open_names(found, columns, system, residuals, told, ("a", "b")) == []


def test_every_channel_once_before_any_twice():
    entries = [{"channel": c, "n": k} for c in ("a", "b") for k in range(5)]
    assert [e["channel"] for e in strongest_entries(entries)] == ["a", "b", "a", "b", "a", "b"]
    with using({"report.entries": 3}):
        assert len(strongest_entries(entries)) == 3


def test_the_accelerometer_speaks_where_the_force_does_not():
    entries = [{"channel": c} for c in ("acc_x", "force_x", "acc_z", "moment_y")]
    assert [e["channel"] for e in strongest_entries(entries)] == ["force_x", "acc_z", "moment_y"]


def _structure(model, channel="force_z", share=0.01, r2=0.5, q=0.002, **more):
    return Structure(
        channel,
        ("climb_m_s",),
        (0.0,),
        (1.0,),
        r2,
        q,
        share * model.reference_scale(channel),
        **more,
    )


def test_unexplained_is_what_is_clear_and_large(model):
    large = _structure(model)
    quiet = [
        _structure(model, "force_x", share=0.001),
        _structure(model, "acc_x", q=0.2),
        _structure(model, "acc_y", r2=0.005),
    ]
    assert unexplained_structures([large, *quiet], model) == [large]
    assert unexplained_structures([_structure(model, share=0.003, r2=0.08)], model) == [], (
        "faint: so do healthy flights"
    )
    assert unexplained_structures([_structure(model, share=0.008, r2=0.02)], model), (
        "no noise is that large"
    )
    calibrated = dataclasses.replace(model, left_unexplained={"force_z": 0.01 * model.weight_N})
    assert unexplained_structures([large], calibrated) == [], (
        "the flights of the calibration show it too"
    )


def test_size_speaks_where_no_mean_does(model):
    noisy = _structure(model, "force_x", share=0.03, of_size=True)
    assert unexplained_structures([noisy], model) == [noisy]
    assert unexplained_structures([_structure(model), noisy], model) == [_structure(model)]
    assert unexplained_structures([dataclasses.replace(noisy, channel="range")], model) == []


def test_vibration_grows_with_speed_in_any_flight_but_not_with_a_place(model):
    noisy = _structure(model, "force_x", share=0.03, r2=0.15, of_size=True)
    assert unexplained_structures([noisy], model) == []
    somewhere = dataclasses.replace(
        noisy, regime=("east_m", "north_m"), low=(0.0, 0.0), high=(1.0, 1.0)
    )
    assert unexplained_structures([somewhere], model) == [somewhere]
    assert unexplained_structures([dataclasses.replace(somewhere, r2=0.08)], model) == []
