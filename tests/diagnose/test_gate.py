"""Data before physics: damaged recordings are mended or left out, and the report says so."""

import numpy as np
import pandas as pd
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from ges.diagnose.prepare.align import CommandHold, Prepared
from ges.diagnose.prepare.delays import _combined_delay, estimate_command_hold
from ges.diagnose.prepare.gate import clipped_samples, pass_gate, prepare
from ges.diagnose.prepare.steady import with_steady_voltage
from ges.diagnose.types.model import from_vehicle
from ges.errors import GesError
from ges.simulator import manoeuvres

COMMAND = ("u_1", "u_2", "u_3", "u_4")
RATES = tuple(f"omega_{a}_rad_s" for a in "xyz")


@pytest.fixture(scope="module")
def whole(flown, sheet, with_rates):
    return flown(sheet(), {}, manoeuvres.make("multisine", 30.0), 1, with_rates)


@pytest.fixture(scope="module")
def model(sheet):
    return from_vehicle(sheet())


def _changed(frame: pd.DataFrame, **columns) -> pd.DataFrame:
    return frame.assign(**columns)


def test_nothing_is_wrong_with_a_whole_flight(whole, model):
    gate = pass_gate([whole, whole], model)
    assert not gate.warnings and gate.pose is None and gate.gyro is None
    assert not {"clipping", "gaps"} & set(gate.flights[0].left_out)


def test_a_flight_from_air_to_air_is_on_the_ground_where_others_rest(whole, sheet, tmp_path):
    """Over a ledge that the vehicle file knows of: low enough to stand on it for two seconds, on
    which no blow tells.
    """
    t, drive = whole["t_s"].to_numpy(), [c for c in whole if c.startswith(("u_", "rotor_speed_"))]
    np.savez(tmp_path / "ledge.npz", x_m=[-50.0, 50.0], y_m=[-50.0, 50.0], z_m=np.full((2, 2), 0.4))
    over = from_vehicle(sheet(terrain={"kind": "grid", "file": "ledge.npz"}), tmp_path)
    low, first, wander = (t > 10.0) & (t < 12.0), t < 4.0, 1e-3 * np.sin(40.0 * t)
    touching = whole.assign(p_z_m=np.where(low, 0.43, 1.5) + wander)
    resting = whole.assign(
        p_z_m=np.where(first, 0.43, 1.5) + wander,
        **{c: np.where(first, 0.0, whole[c]) for c in drive},
    )
    with_others, alone = (
        pass_gate([touching, resting], over).flights[0],
        pass_gate([touching, touching], over).flights[0],
    )
    assert not with_others.flying[(with_others.t_s > 10.0) & (with_others.t_s < 12.0)].any()
    assert with_others.left_out["on_ground"] == pytest.approx(3.0, abs=0.1)
    assert "on_ground" not in alone.left_out


def test_a_recording_that_ends_in_a_brisk_descent_is_flown_all_the_same(whole, model):
    """The drive idles at four metres, and nothing rests there."""
    t, drive = whole["t_s"].to_numpy(), [c for c in whole if c.startswith(("u_", "rotor_speed_"))]
    falling, wander = t > t[-1] - 1.0, 1e-3 * np.sin(40.0 * t)
    frame = whole.assign(
        p_z_m=np.where(t < 20.0, 1.5, 4.0) + wander,
        **{c: np.where(falling, 0.5 * whole[c], whole[c]) for c in drive},
    )
    assert pass_gate([frame, whole], model).flights[0].flying.mean() > 0.9


def test_a_drive_tells_of_itself_on_the_ground_where_it_lifts(whole, held_down, model):
    """Resting, spinning up, at full thrust without leaving the ground, in the air."""
    t, speeds = whole["t_s"].to_numpy(), [c for c in whole if c.startswith("rotor_speed_")]
    frame = held_down(whole, np.interp(t, [1.0, 2.0], [0.0, 1.0]))
    alone = pass_gate([frame, frame], model).flights[0]
    np.testing.assert_array_equal(
        alone.driven, alone.flying
    )  # without commands there is no drive to tell of
    frame = frame.assign(
        **{u: 1e-3 * frame[speed] for u, speed in zip(COMMAND, speeds, strict=True)}
    )
    flight = pass_gate([frame, frame], model).flights[0]
    assert not flight.flying[flight.t_s < 4.4].any() and flight.flying[flight.t_s > 4.7].all()
    assert not flight.driven[flight.t_s < 1.8].any()
    assert flight.driven[flight.t_s > 2.2].mean() > 0.98


def test_a_gap_is_left_out_with_its_seconds(whole, model):
    t = whole["t_s"]
    gate = pass_gate([whole[(t < 10.0) | (t > 13.0)].reset_index(drop=True)] * 2, model)
    flight = gate.flights[0]
    assert flight.left_out["gaps"] == pytest.approx(3.0, abs=0.1)
    assert not flight.flying[(flight.t_s > 10.1) & (flight.t_s < 12.9)].any()


def test_a_gyro_at_its_limit_is_left_out_and_said(whole, model):
    """The controller of a tumbling vehicle sees full scale, the flight does not."""
    rate = whole[RATES[0]].to_numpy().copy()
    limit = 1.5 * np.abs(rate).max()
    hit = (whole["t_s"] > 12.0) & (whole["t_s"] < 12.4)
    rate[hit] = limit
    gate = pass_gate([_changed(whole, **{RATES[0]: rate})] * 2, model, ["tumble", "again"])
    assert gate.flights[0].left_out["clipping"] == pytest.approx(0.6, abs=0.06)
    assert [w.partition(" the limit")[0] for w in gate.warnings] == [
        "again reaches",
        "tumble reaches",
    ], "in the order of names"


def test_a_slow_or_constant_sensor_is_not_taken_for_clipped(whole):
    t = whole["t_s"].to_numpy()
    held = whole[RATES[0]].to_numpy()[(np.arange(len(t)) // 10) * 10]
    still = np.full(len(t), 9.81)
    frame = _changed(whole, **{RATES[0]: held}, acc_z_m_s2=still)
    assert not clipped_samples(frame, t).any()


def test_two_clocks_that_drift_are_said(whole, model):
    """The pose's clock runs 0.3 % slow: 90 ms over the flight."""
    t = whole["t_s"].to_numpy()
    pose = [n for n in whole if n.startswith(("p_x", "p_y", "p_z", "v_x", "v_y", "v_z", "q_"))]
    late = {n: np.interp(t * (1.0 - 0.003), t, whole[n]) for n in pose}
    gate = pass_gate([_changed(whole, **late)] * 2, model, ["drifting", "too"])
    assert any("drifting has two clocks" in w for w in gate.warnings), gate.warnings
    assert not any("two clocks" in w for w in pass_gate([whole, whole], model).warnings)


def test_noise_is_no_second_clock(whole, model):
    """The attitude of a calm flight, as noisy as its motion: delays of single stretches scatter by
    tens of milliseconds.
    """
    rng, attitude = np.random.default_rng(0), ["q_w", "q_x", "q_y", "q_z"]
    flights = [
        _changed(whole, **{n: whole[n] + rng.normal(0.0, sd, len(whole)) for n in attitude})
        for sd in (0.003, 0.01, 0.03)
    ]
    assert not any("two clocks" in w for w in pass_gate(flights * 2, model).warnings)


def test_a_constant_delay_of_the_pose_is_taken_out(whole, model):
    t = whole["t_s"].to_numpy()
    pose = [n for n in whole if n.startswith(("p_x", "p_y", "p_z", "v_x", "v_y", "v_z", "q_"))]
    late = _changed(whole, **{n: np.interp(t - 0.03, t, whole[n]) for n in pose})
    gate = pass_gate([late, late], model)
    assert gate.pose.delay_s == pytest.approx(0.03, abs=0.003) and not gate.warnings
    assert gate.delays[0] == gate.pose


def test_rotors_that_never_turn_are_no_flight(whole, model):
    still = _changed(whole, **{f"rotor_speed_{i}_rad_s": 0.0 for i in range(1, 5)})
    told = "bench never leaves the ground: its rotor speeds are zero throughout"
    with pytest.raises(GesError, match=rf"{told} .*esc_status or actuator_motors"):
        pass_gate([still, still], model, ["bench", "bench 2"])
    gate = pass_gate([whole, still, whole], model, ["air", "bench", "air again"])
    assert (
        list(gate.flights) == [0, 2]
        and len(gate.warnings) == 1
        and gate.warnings[0].startswith(told)
    )


def _in_flight(flown, sheet, with_rates, motion_late_s: float, speeds_late_s: float):
    """A flight whose motion, or whose rotor speeds, were logged late; commands are on time."""
    frame = flown(
        sheet(motor_time_constant_s=0.03),
        {},
        manoeuvres.make("multisine", 30.0),
        1,
        (*with_rates, *COMMAND),
    )
    late = {c: motion_late_s for c in frame if c[:2] in ("p_", "v_", "q_") or c.startswith("omega")}
    late |= {c: speeds_late_s for c in frame if c.startswith("rotor_speed")}
    return frame.assign(
        **{c: np.interp(frame["t_s"] - s, frame["t_s"], frame[c]) for c, s in late.items()}
    )


def test_late_rotor_speeds_are_found_beside_their_commands(flown, sheet, with_rates, model):
    gate = pass_gate([_in_flight(flown, sheet, with_rates, 0.0, 0.15)] * 2, model)
    (told,) = gate.delays
    assert told.stream == "rotor_speed" and told.delay_s == pytest.approx(0.15, abs=0.03)


def test_a_flight_without_which_the_others_agree_better_makes_no_delay_alone():
    """Sums of products, squares, squares and of independent samples: of one flight they agree at no
    delay, of another nowhere, least there.
    """
    lags_s, ones = np.arange(-0.04, 0.6, 0.02), np.ones(32)
    clear = np.exp(-((lags_s / 0.5) ** 2))
    clear = np.stack([100.0 * clear, 100.0 * ones, 100.0 * ones, 1e3 * ones])
    against = np.stack([100.0 * lags_s - 60.0, 10.0 * ones, 10.0 * ones, 1e3 * ones])
    told = _combined_delay("rotor_speed", [clear, against], lags_s)
    assert told.delay_s > 0.08 and told.delay_s < 4.0 * told.sd_s
    alone = _combined_delay("rotor_speed", [clear] * 2, lags_s)
    assert alone.delay_s == pytest.approx(0.0, abs=0.005)
    assert alone.sd_s == pytest.approx(0.02 / np.sqrt(12.0)), "as the grid of lags rounds it"


def test_rotor_speeds_on_time_beside_their_commands_are_left_alone(flown, sheet, with_rates, model):
    """Late against the motion alone is what a controller's responses to disturbances look like."""
    gate = pass_gate([_in_flight(flown, sheet, with_rates, -0.15, 0.0)] * 2, model)
    assert not gate.delays


def _commanded(held: bool, late_s: float = 0.0):
    """A flight of 20 s at 100 Hz: commands that are held from row to row, or move on within it, and
    the speeds of motors of 40 ms that follow them, read with noise.
    """
    rng, every, fine_s = np.random.default_rng(0), 20, 5e-4
    t = np.arange(0.0, 20.0, fine_s)
    asked = 0.5 + lfilter([0.01], [1.0, fine_s / 0.02 - 1.0], rng.normal(size=(len(t), 4)), axis=0)
    asked = asked[np.arange(len(t)) // every * every] if held else asked
    late = np.roll(asked, round(late_s / fine_s), axis=0)
    speeds = 1000.0 * lfilter([fine_s / 0.04], [1.0, fine_s / 0.04 - 1.0], late, axis=0)[::every]
    speeds = speeds + rng.normal(0.0, 1.0, speeds.shape)
    columns = dict(zip(COMMAND, asked[::every].T, strict=True))
    columns |= {f"rotor_speed_{i}_rad_s": s for i, s in enumerate(speeds.T, 1)}
    rows = t[::every]
    return Prepared(rows, columns, rows > 1.0, {}, {"command": 0.01, "rotor_speed": 0.01})


def test_how_long_commands_are_held_shows_in_the_speeds_beside_them():
    assert estimate_command_hold([_commanded(held=False)] * 2) == CommandHold(0.0, 0.0)
    assert estimate_command_hold([_commanded(held=True)] * 2) == CommandHold(0.5, 0.0)


def test_what_is_late_or_not_logged_leaves_open_how_long_commands_are_held():
    late, moved = _commanded(held=False, late_s=0.015), _commanded(held=False)
    unseen = moved.replace(columns={c: v for c, v in moved.columns.items() if c in COMMAND})
    assert estimate_command_hold([late] * 2) == estimate_command_hold([unseen] * 2) == CommandHold()


def test_a_voltage_falls_as_read_and_dips_as_the_drive_pulls_it_down(whole, model):
    """A battery that runs down, sags by the current of 50 ms before, and is read with noise as
    large as its sags.
    """
    flight = prepare(whole, model)
    speeds, n = flight.stack("rotor_speed").mean(axis=1), len(flight.t_s)
    sag = gaussian_filter1d(speeds - speeds.mean(), 0.05 / flight.dt_s)
    true = 16.0 - 0.05 * flight.t_s - 0.3 * sag / sag.std()
    read = true + np.random.default_rng(0).normal(0.0, 0.3, n)
    told = with_steady_voltage(
        flight.replace(columns={**flight.columns, "battery_V": read})
    ).columns["battery_V"]
    assert np.std(told - true) < 0.25 * np.std(read - true)


def test_a_blow_from_the_ground_is_left_out_and_counted(whole, model):
    """30 ms of eight times gravity close to the ground; the same high above is what a recording
    says of its motion.
    """
    at = (whole["t_s"] > 12.0) & (whole["t_s"] < 12.03)
    quiet = 9.81 + np.random.default_rng(0).normal(0.0, 0.2, len(whole))
    blown = _changed(whole, acc_z_m_s2=np.where(at, 80.0, quiet))
    low = _changed(
        blown, ground_z_m=np.where(np.abs(whole["t_s"] - 12.0) < 1.0, whole["p_z_m"] - 0.08, 0.0)
    )
    struck, free = pass_gate([low, blown], model).flights.values()
    assert (
        struck.left_out["contact"] == pytest.approx(1.0, abs=0.1) and "contact" not in free.left_out
    )
    assert not struck.flying[np.abs(struck.t_s - 12.0) < 0.3].any()


def test_a_wandering_position_moves_fast_as_the_velocity_says(whole, model):
    """A reading that wanders by 2 cm within a second, as a camera's may, hardly moves a load that
    swings at 1 Hz on the path.
    """
    t = whole["t_s"].to_numpy()
    wander = 0.02 * np.sin(2.0 * np.pi * 0.9 * t)
    moved = whole.assign(p_x_m=whole["p_x_m"] + wander)
    true, steadied = (pass_gate([f, f], model).flights[0] for f in (whole, moved))
    error = (steadied.columns["p_x_m"] - true.columns["p_x_m"])[true.flying]
    assert np.abs(error).max() < 0.005 < 0.019 < np.abs(wander).max()


def test_a_velocity_that_is_off_leads_no_position_away(whole, model):
    off = whole.assign(v_x_m_s=whole["v_x_m_s"] + 0.3)
    true, led = (pass_gate([f, f], model).flights[0] for f in (whole, off))
    error = (led.columns["p_x_m"] - true.columns["p_x_m"])[true.flying]
    assert np.abs(error).max() < 0.01


@pytest.mark.parametrize(("late_s", "settled"), [(0.002, False), (0.014, True)])
def test_noise_that_draws_a_delay_to_half_a_sample_settles_nothing(
    late_s, settled, flown, sheet, with_rates, model
):
    """At 80 Hz, where half a sample is 6 ms: the noisy correlation of what is 2 ms late peaks
    there.
    """
    flight = flown(sheet(), {}, manoeuvres.make("straight_runs", 30.0), 1, with_rates)
    t = np.arange(0.0, 30.0, 0.0125)
    slow = pd.DataFrame({name: np.interp(t, flight["t_s"], flight[name]) for name in flight})

    def noisy(seed: int) -> pd.DataFrame:
        rng = np.random.default_rng(seed)
        turned = {
            n: np.interp(t - late_s, t, slow[n]) + rng.normal(0.0, 0.02, len(t))
            for n in ("q_x", "q_y", "q_z")
        }
        return slow.assign(**turned, **{n: slow[n] + rng.normal(0.0, 0.2, len(t)) for n in RATES})

    pose = pass_gate([noisy(seed) for seed in range(4)], model).pose
    assert bool(pose) == settled
    assert not settled or pose.delay_s == pytest.approx(late_s, abs=0.006)
