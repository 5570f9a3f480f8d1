"""What the pages say of logs, vehicles and diagnoses."""

import json
import time
import zipfile
from io import BytesIO

import pytest

LINES = """
import sys
for line in ({lines!r}):
    print(line, file=sys.stderr, flush=True)
{then}
"""


def over(client, address):
    """Wait for a diagnosis by its events; what they were."""
    with client.stream("GET", f"{address}/events") as stream:
        return [line for line in stream.iter_lines() if line]


def about(folder, address):
    return json.loads((folder / address.lstrip("/") / "about.json").read_text())


def begun(client, dropped, **form):
    asked = {"log": ["one.csv", "two.csv"], "source": "named", "vehicle": "x500", **form}
    answer = client.post(f"{dropped}/diagnose", data=asked)
    assert answer.status_code == 200, answer.text
    return answer.url.path


def test_the_first_page_says_what_can_be_dropped_and_where_it_goes(client, folder):
    text = client.get("/").text
    assert "PX4 ULog" in text and "Betaflight" in text and str(folder) in text


def test_files_that_are_no_logs_are_answered_in_a_sentence(client, folder):
    """By the real ``ges doctor``, next to a log that can serve."""
    kept = client.post("/example", follow_redirects=False).headers["location"]
    good = next((folder / kept.lstrip("/") / "files").glob("stairs_slow*")).read_bytes()
    files = {
        "cut.ulg": b"ULog\x01\x12\x35" + b"\0" * 50,
        "noise.bin": bytes(range(256)) * 20,
        "<b>.csv": b"a,b\n1,2,3\n",
        "one.parquet": good,
    }
    answer = client.post("/logs", files=[("files", item) for item in files.items()])
    assert answer.status_code == 200
    assert answer.text.count("cannot be diagnosed: ") == 3
    assert "internal error" not in answer.text and "<b>" not in answer.text
    assert "effects can be told" in answer.text and "rotor_drag" in answer.text
    assert 'value="one.parquet" checked' in answer.text
    assert 'value="cut.ulg"' not in answer.text


def test_a_doctor_that_breaks_is_told(client, ges):
    ges("raise RuntimeError('<i>bits</i>')")
    answer = client.post("/logs", files=[("files", ("one.csv", b"1"))])
    assert answer.status_code == 200
    assert "an internal error of GES" in answer.text and "&lt;i&gt;bits" in answer.text


def test_a_vehicle_file_that_was_dropped_is_the_first_choice(client, dropped):
    text = client.get(dropped).text
    assert '<option value="mine.yaml">mine.yaml, yours' in text
    assert 'value="named" checked' in text and 'value="crazyflie-2.1"' in text


def test_a_shipped_vehicle_is_shown(client, dropped, monkeypatch):
    from ges.ui import jobs

    monkeypatch.setattr("ges.ui.app.ask", jobs.ask)
    answer = client.post(f"{dropped}/vehicle", data={"source": "named", "vehicle": "x500"})
    assert "mass_kg" in answer.text and 'download="vehicle.yaml"' in answer.text


@pytest.mark.parametrize(
    ("form", "sentence"),
    [
        ({"log": []}, "no log is ticked"),
        ({"log": ["/etc/passwd"]}, "no log is ticked"),
        ({"vehicle": "/etc/passwd"}, "vehicle &#39;/etc/passwd&#39; is not here"),
        ({"vehicle": "one.csv"}, "is not here"),
        ({"source": "made", "prop": "10in"}, "give both, as in 2.0 kg and 10in"),
        ({"source": "made", "mass": "2.0"}, "give both"),
        ({"source": "made", "mass": "two", "prop": "10in"}, "mass: &#39;two&#39; is no number"),
        ({"source": "made", "mass": "2000", "prop": "10in"}, "mass: a vehicle of 2000 kg"),
        ({"source": "made", "mass": "2", "prop": "banana"}, "propellers: propeller &#39;banana"),
        ({"source": "made", "mass": "2", "prop": "--out=/x"}, "--out=/x&#39; is no size"),
        (
            {"source": "made", "mass": "2", "prop": "10in", "wheelbase": "wide"},
            "wheelbase: &#39;wide&#39; is no length",
        ),
        ({"source": "made", "mass": "2", "prop": "10in", "layout": "y"}, "layout &#39;y&#39;"),
        ({"holdout": "three"}, "holdout &#39;three&#39; is not here"),
    ],
)
def test_a_form_that_makes_no_sense_is_answered_in_a_sentence(
    client, folder, dropped, form, sentence
):
    asked = {"log": ["one.csv"], "source": "named", "vehicle": "x500", **form}
    answer = client.post(f"{dropped}/diagnose", data=asked)
    assert answer.status_code == 400 and sentence in answer.text
    assert not list((folder / "diagnoses").iterdir())


@pytest.mark.parametrize(
    ("form", "sentence"),
    [
        ({"pwm_low": "1000"}, "need both"),
        ({"pwm_low": "low"}, "motor output that means 0: &#39;low&#39; is no number"),
        ({"rotor_order": "1 2 4"}, "names each from 1 on once"),
        ({"rotor_order": "1 2 3 x"}, "is no whole number"),
        ({"part": "-1"}, "is no whole number"),
        ({"map": "../../secret.yaml"}, "is not here"),
    ],
)
def test_a_reading_that_makes_no_sense_is_answered_in_a_sentence(client, dropped, form, sentence):
    answer = client.post(f"{dropped}/reading", data=form)
    assert answer.status_code == 400 and sentence in answer.text


def test_what_is_chosen_reaches_the_command_line(client, folder, dropped, ges):
    reading = {"map": "mine.yaml", "pwm_low": "1000", "pwm_high": "2000"}
    client.post(f"{dropped}/reading", data=reading | {"rotor_order": "2 4 1 3", "part": "2"})
    ges("import sys; print('ges: ' + ' '.join(sys.argv[1:]), file=sys.stderr); sys.exit(1)")
    made = {"source": "made", "mass": "2,5", "prop": "10x4.5", "wheelbase": "500mm"}
    made |= {"layout": "x", "holdout": "two"}
    address = begun(client, dropped, **made)
    over(client, address)
    words = about(folder, address)["problem"]
    assert words == (
        "diagnose --no-open --mass=2.5 --prop=10x4.5 --wheelbase=0.5 --frame=x --holdout two"
        " --map mine.yaml --pwm 1000.0 2000.0 --part 2 --rotor-order 2,4,1,3"
        f" --out ../../..{address}/results -- one.csv two.csv"
    )


def test_steps_come_as_they_end(client, folder, dropped, ges):
    lines = ["reading one.csv: 0.1 s", "warning: it was windy", "writing the page: 2.5 s"]
    ges(LINES.format(lines=lines, then="sys.exit(1)"))
    address = begun(client, dropped)
    events = over(client, address)
    steps = [{"what": "reading one.csv", "seconds": 0.1}]
    steps += [{"what": "writing the page", "seconds": 2.5}]
    assert events == [
        *("id: 0", "event: step", f"data: {json.dumps(steps[0])}"),
        *("id: 1", "event: step", f"data: {json.dumps(steps[1])}"),
        *("event: over", "data: {}"),
    ]
    assert about(folder, address)["steps"] == steps
    again = client.get(f"{address}/events", headers={"last-event-id": "0"}).text
    assert "reading one.csv" not in again and "writing the page" in again


def test_a_diagnosis_that_fails_says_why(client, dropped, ges):
    lines = ["reading one.csv: 0.1 s", "ges: one.csv holds a <VTOL>; it has four rotors"]
    ges(LINES.format(lines=lines, then="sys.exit(1)"))
    address = begun(client, dropped)
    over(client, address)
    text = client.get(address).text
    assert "one.csv holds a &lt;VTOL&gt;; it has four rotors" in text and "failed" in text
    assert client.get(f"{address}/report").status_code == 404
    assert client.get(f"{address}/results.zip").status_code == 404


def test_a_diagnosis_is_stopped_with_what_it_started(client, folder, dropped, ges, tmp_path):
    mark = tmp_path / "alive"
    child = (
        f"import time, pathlib\nwhile True: pathlib.Path({str(mark)!r}).touch(); time.sleep(.02)"
    )
    then = f"import subprocess; subprocess.run([sys.executable, '-c', {child!r}])"
    ges(LINES.format(lines=["begun: 0.0 s"], then=then))
    address = begun(client, dropped)
    while not mark.exists():
        time.sleep(0.02)
    assert "under way" in client.get(address).text
    assert "stopped" in client.post(f"{address}/stop").text
    mark.unlink()
    time.sleep(0.2)
    assert not mark.exists()
    assert about(folder, address)["state"] == "stopped"


def test_one_diagnosis_waits_for_another(client, dropped, ges):
    ges(LINES.format(lines=["begun: 0.0 s"], then="import time; time.sleep(60)"))
    first, second = begun(client, dropped), begun(client, dropped)
    assert "waiting for another diagnosis to end" in client.get(second).text
    client.post(f"{first}/stop")
    client.post(f"{second}/stop")
    assert "stopped" in client.get(second).text


def test_a_diagnosis_that_the_server_left_behind_is_not_under_way(client, folder, diagnosed):
    key = diagnosed("quad")
    path = folder / "diagnoses" / key / "about.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"state": "running"}))
    assert "the server ended before it did" in client.get(f"/diagnoses/{key}").text


def test_a_diagnosis_is_read_and_taken_away(client, diagnosed):
    key = diagnosed("quad", "Less <than> told.")
    text = client.get(f"/diagnoses/{key}").text
    assert "missing physics" in text and "Less &lt;than&gt; told." in text
    answer = client.get(f"/diagnoses/{key}/results/diagnosis.json")
    assert answer.json()["sentence"] == "Less <than> told."
    assert answer.headers["content-disposition"].startswith("attachment")
    archive = zipfile.ZipFile(BytesIO(client.get(f"/diagnoses/{key}/results.zip").content))
    assert sorted(archive.namelist()) == ["diagnosis.json", "report.html"]


def test_two_diagnoses_stand_side_by_side(client, diagnosed):
    keys = [diagnosed("x500", "Nothing of Monday."), diagnosed("x500", "Drag on Tuesday.")]
    assert "Compare the two" in client.get("/").text
    text = client.get("/compare", params={"with": keys}).text
    assert "Nothing of Monday." in text and "Drag on Tuesday." in text
    assert "one.csv, x500 (1)" in text and "one.csv, x500 (2)" in text


@pytest.mark.parametrize("count", [0, 1, 3])
def test_other_than_two_are_not_compared(client, diagnosed, count):
    keys = [diagnosed("x500") for _ in range(count)]
    answer = client.get("/compare", params={"with": keys})
    assert answer.status_code == 400 and "choose two" in answer.text


def test_a_diagnosis_that_cannot_be_read_back_does_not_break_the_list(client, folder, diagnosed):
    key = diagnosed("quad")
    (folder / "diagnoses" / key / "results" / "diagnosis.json").write_text("{")
    assert "is not JSON" in client.get("/").text


def test_more_files_are_added_and_read_anew(client, folder, dropped, answer):
    answer["notes"] = ["read again"]
    more = client.post(f"{dropped}/files", files=[("files", ("three.csv", b"t_s\n1\n"))])
    assert "three.csv" in more.text and "read again" in more.text
