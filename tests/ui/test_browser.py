"""The way of a stranger, in a browser: drop flights, see what is in them, diagnose, read."""

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlparse
from urllib.request import urlopen

import pytest

GES = Path(sys.executable).parent / "ges"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
MINUTES_MS = 300_000


@pytest.fixture
def server(tmp_path):
    """``ges ui`` as it is started by hand; its address."""
    words = [GES, "ui", "--folder", tmp_path / "flights", "--port", "0", "--no-open"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield re.match(r"http://127\.0\.0\.1:\d+/", process.stderr.readline())[0]
            process.send_signal(signal.SIGINT)
            assert process.wait(MINUTES_MS / 1000) in (0, -signal.SIGINT)
            assert "Traceback" not in process.stderr.read()
        finally:
            process.kill()


@pytest.fixture
def browser():
    """The system's Chromium without a window."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if not found:
        pytest.skip(f"there is no browser here: none of {', '.join(BROWSERS)} is on the path")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        # As root, as containers have it, Chromium's own sandbox does not start.
        browser = play.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield browser
        browser.close()


def test_the_server_starts_and_ends_by_hand(server):
    with urlopen(server, timeout=20) as answer:
        assert b"Drop flight logs here" in answer.read()


@pytest.mark.slow
def test_from_a_drop_to_the_page(browser, server, tmp_path):
    subprocess.run([GES, "recordings", "fetch", "example", "--out", tmp_path], check=True)
    flights = sorted((tmp_path / "example").glob("*.parquet"))
    hosts, complaints = set(), []
    page = browser.new_page()
    page.on("request", lambda request: hosts.add(urlparse(request.url).netloc))
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))

    page.goto(server)
    page.set_input_files("input[type=file]", [*flights, tmp_path / "example" / "vehicle.yaml"])
    page.wait_for_url("**/logs/*", timeout=MINUTES_MS)
    assert page.locator(".log").count() == 4 and page.locator(".log.bad").count() == 0
    page.click("text=Show the vehicle file first")
    assert "mass_kg: {value: 1.2, sd: 0.03}" in page.inner_text("pre")
    with page.expect_download() as download:
        page.click("text=Save it")
    assert "mass_kg" in Path(download.value.path()).read_text()
    page.go_back()

    page.click("button:text-is('Diagnose')")
    page.wait_for_selector("#steps tr:nth-child(5)", timeout=MINUTES_MS)
    page.wait_for_selector("text=Read the page", timeout=MINUTES_MS)
    assert "rotor drag" in page.inner_text(".sentence")
    with page.expect_download() as download:
        page.click("text=Download everything")
    assert download.value.suggested_filename.endswith(".zip")
    page.click("text=Read the page")
    page.wait_for_selector("#plots .uplot canvas")
    assert "Missing in the simulator" in page.inner_text(".sentence")

    assert not complaints
    assert {host for host in hosts if host} == {urlparse(server).netloc}
