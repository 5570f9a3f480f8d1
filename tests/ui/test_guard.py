"""Only the server's own page is answered, within the limits and the folder that were named."""

import http.client

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ges.ui.folder import clean_name


@pytest.mark.parametrize("host", ["example.org", "127.0.0.1.example.org", "192.168.0.7:8765", ""])
def test_a_name_that_only_points_here_is_refused(client, host):
    assert client.get("/", headers={"host": host}).status_code == 400


def test_both_names_of_this_computer_are_answered(client):
    for host in ("127.0.0.1:8765", "localhost:9000"):
        assert client.get("/", headers={"host": host}).status_code == 200


@pytest.mark.parametrize("origin", ["http://example.org", "null", "http://localhost:8765"])
def test_a_form_of_another_page_is_refused(client, folder, origin):
    answer = client.post("/example", headers={"origin": origin})
    assert answer.status_code == 403 and "another page" in answer.text
    assert not list((folder / "logs").iterdir())


def test_a_page_may_load_its_own_files_and_nothing_else(client):
    answer = client.get("/")
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy and "script-src 'self'" in policy
    assert "http" not in policy and "unsafe" not in policy
    assert answer.headers["x-content-type-options"] == "nosniff"
    for own in ("/static/ui.js", "/static/ui.css"):
        assert own in answer.text and client.get(own).status_code == 200
    assert "//" not in answer.text.replace("://", "")


def test_a_report_is_of_no_origin(client, diagnosed):
    answer = client.get(f"/diagnoses/{diagnosed('quad')}/report")
    assert answer.text == "<h1>The page</h1>"
    sandbox = answer.headers["content-security-policy"].split(";")[0].split()
    assert sandbox == ["sandbox", "allow-scripts"]


@pytest.mark.parametrize(
    "name",
    ["..%2Fabout.json", "%2e%2e%2fabout.json", "%2Fetc%2Fpasswd", "%2e%2e", "%00", "missing.png"],
)
def test_only_files_of_the_results_are_handed_out(client, diagnosed, name):
    answer = client.get(f"/diagnoses/{diagnosed('quad')}/results/{name}")
    assert answer.status_code == 404 and "made" not in answer.text


@pytest.mark.parametrize("key", ["%2e%2e", "0" * 16, "x", "..%2f..%2flogs", "A" * 16, "%00"])
@pytest.mark.parametrize("kind", ["logs", "diagnoses"])
def test_an_id_that_was_never_given_is_no_path(client, kind, key):
    assert client.get(f"/{kind}/{key}").status_code == 404


@pytest.mark.parametrize("name", ["app.py", "%2e%2e%2Fapp.py", "..%2Fapp.py", "templates"])
def test_the_program_is_not_handed_out(client, name):
    assert client.get(f"/static/{name}").status_code == 404


def files(*sizes):
    return [("files", (f"{i}.csv", b"x" * size)) for i, size in enumerate(sizes)]


def test_an_upload_beyond_the_limit_is_refused_before_it_is_read(client, folder):
    answer = client.post("/logs", files=files(700_000, 700_000))
    assert answer.status_code == 413
    assert "larger than 1 MB together" in answer.text and "--limit" in answer.text
    assert not list((folder / "logs").iterdir())


def test_an_upload_that_hides_its_length_is_cut_off_at_the_limit(client, folder, answer):
    head = (
        b'--b\r\ncontent-disposition: form-data; name="files"; filename="a.csv"\r\n\r\n',
        *[b"x" * 100_000] * 11,
        b"\r\n--b--\r\n",
    )
    kind = {"content-type": "multipart/form-data; boundary=b"}
    assert client.post("/logs", content=iter(head[:2] + head[-1:]), headers=kind).status_code == 200
    before = list((folder / "logs").iterdir())
    assert client.post("/logs", content=iter(head), headers=kind).status_code == 413
    assert list((folder / "logs").iterdir()) == before


@pytest.mark.parametrize("length", ["-1", "many", "1e3"])
def test_a_length_that_is_no_number_is_refused(client, length):
    answer = client.post("/logs", headers={"content-length": length}, content=b"")
    assert answer.status_code in (400, 413)


def test_too_many_files_are_refused(client, folder):
    answer = client.post("/logs", files=files(*[1] * 101))
    assert answer.status_code == 400 and "100" in answer.text
    assert not list((folder / "logs").iterdir())


@pytest.mark.parametrize(
    ("sent", "sentence"),
    [
        ({"files": files(0)}, "0.csv is empty; take a fresh copy"),
        ({"data": {"files": "no file"}}, "no file came with this"),
        ({}, "no file came with this"),
        (
            {"content": b"--", "headers": {"content-type": "multipart/form-data"}},
            "Missing boundary",
        ),
    ],
)
def test_an_upload_without_a_file_is_answered_in_a_sentence(client, folder, sent, sentence):
    answer = client.post("/logs", **sent)
    assert answer.status_code == 400 and sentence in answer.text
    assert not list((folder / "logs").iterdir())


def test_files_keep_their_names_but_not_their_folders(client, folder, answer):
    names = ["../../etc/a.csv", "C:\\logs\\a.csv", ".hidden.csv", "-rf.csv", "Flug 7 ü.csv"]
    client.post("/logs", files=[("files", (name, b"t_s\n1\n")) for name in names])
    (logs,) = (folder / "logs").iterdir()
    kept = sorted(p.name for p in (logs / "files").iterdir())
    assert kept == ["Flug_7_ü.csv", "a.csv", "a_2.csv", "hidden.csv", "rf.csv"]
    assert not [p for p in folder.parent.rglob("*.csv") if p.parent.parent != logs]


@given(st.text(max_size=300))
def test_any_name_becomes_one_that_is_safe(given):
    name = clean_name(given)
    assert name and name[0] not in ".-_" and not set(name) & set("/\\\0 ;'\"$-")
    assert 0 < len(name.encode()) <= 255
    assert clean_name(name) == name


def test_nobody_else_reaches_the_port(client):
    """What is bound is 127.0.0.1, whatever the options: there is none to change it."""
    from ges.commands.ui import _listening, command

    assert {o for p in command.params for o in p.opts} == {
        "--folder",
        "--port",
        "--limit",
        "--open",
    }
    with _listening(0) as listener:
        host, port = listener.getsockname()
        assert host == "127.0.0.1"
        http.client.HTTPConnection("127.0.0.1", port, timeout=2).connect()
