"""Recording in a browser, with a real Chromium whose microphone plays a file."""

import io
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile
from playwright.sync_api import Browser, Page, expect

from benchmarks.harness.site import Site
from tests.web.conftest import ARGUMENTS, NAMES, sign_in, watched

pytestmark = pytest.mark.browser

RATE_HZ = 48_000
QUIET, LOUD = 10 ** (-80 / 20), 10 ** (-20 / 20)
"""Effective values of what the microphone hears, in turn."""
SECONDS = 3
TONE_HZ = 440.0  # far below half of any rate at which the sound system may hand it on


@pytest.fixture
def page(browser: Browser, site: Site, tmp_path: Path) -> Iterator[Page]:
    """The page of a new diagnosis in a browser whose microphone hears a tone that is quiet and loud in turn."""
    time = np.arange(2 * SECONDS * RATE_HZ) / RATE_HZ
    tone = np.sqrt(2) * np.sin(2 * np.pi * TONE_HZ * time) * np.repeat([QUIET, LOUD], SECONDS * RATE_HZ)
    soundfile.write(tmp_path / "heard.wav", tone, RATE_HZ, subtype="PCM_16")
    capture = f"--use-file-for-fake-audio-capture={tmp_path / 'heard.wav'}"
    fake = ("--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream", capture)
    path = next(found for name in NAMES if (found := shutil.which(name)))
    running = browser.browser_type.launch(executable_path=path, args=[*ARGUMENTS, *fake])
    context = running.new_context()
    sign_in(context, site, "operator")
    with watched(context.new_page(), site, "/diagnoses/new") as opened:
        yield opened
    running.close()


def test_what_the_microphone_hears_is_diagnosed(page: Page, site: Site) -> None:
    """It says where to hold the microphone, and what it sends has neither gain control nor loss."""
    form = page.locator("main form[data-upload]")
    form.get_by_role("button", name="Record now").click()
    expect(form.locator("[data-said]")).to_contain_text("hold it nearer")
    expect(form.locator("[data-said]")).to_contain_text("The level is good")
    expect(form.locator("[data-said]")).to_contain_text("hold it nearer")
    form.get_by_role("button", name="Stop").click()
    expect(form.locator("[data-said]")).to_contain_text(re.compile(r"It is \d+ s long; 20 s or more say more"))
    expect(form.locator("[data-detected]")).to_contain_text(re.compile(r"recording .*\.wav: .* s$"))
    expect(form.locator("audio")).to_be_visible()
    form.get_by_label("Axis", exact=True).fill("bench")
    form.get_by_role("button", name="Diagnose").click()
    page.wait_for_url(re.compile(r"/diagnoses/[0-9a-f]{32}$"))
    with site.server.client("viewer") as client:
        stored = client.get(f"/api/v1/diagnoses/{page.url.rpartition('/')[2]}").json()["recording"]
        content = client.get(f"/api/v1/recordings/{stored['id']}/audio").content
    assert stored["recorded_at"] is not None
    samples, rate_hz = soundfile.read(io.BytesIO(content))
    tenth = rate_hz // 10
    levels = np.sqrt((samples[: samples.size // tenth * tenth].reshape(-1, tenth) ** 2).mean(axis=1))
    quiet, loud = levels[levels < 10 * QUIET], levels[levels > LOUD / 2]
    assert quiet.size > 10
    assert loud.size > 10
    assert 20 * np.log10(np.median(loud) / LOUD) == pytest.approx(0, abs=0.2), "no gain follows the level"
    assert 20 * np.log10(np.median(quiet) / QUIET) == pytest.approx(0, abs=1.0)  # of three steps of 16 bit
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(samples.size)))
    assert spectrum.argmax() * rate_hz / samples.size == pytest.approx(TONE_HZ, abs=1.0)


def test_a_browser_that_may_not_listen_says_what_to_do(page: Page) -> None:
    refusing = "navigator.mediaDevices.getUserMedia = async () => { throw new DOMException('', 'NotAllowedError'); }"
    page.evaluate(f"() => {{ {refusing} }}")
    form = page.locator("main form[data-upload]")
    form.get_by_role("button", name="Record now").click()
    expect(form.locator("[data-said]")).to_contain_text("allow it in the settings of this page")
