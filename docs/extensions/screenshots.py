"""Pictures of pages and programs, taken in Chromium.

`python docs/extensions/screenshots.py [NAME ...]` runs the programs on sample campaigns
and writes docs/pictures/NAME.png: report, lab, next_throw, rehearsal,
funnel_in_meshcat and launch_map.
"""

import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from glider.campaign.samples import campaign_folder

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "pictures"
sys.path.insert(0, str(ROOT))

from tests.helpers.browser import opened  # noqa: E402  (Playwright's settings.)

THROWS = 12
"""Throws of the session that the page of a lab shows."""


def run(*arguments: object) -> None:
    """Runs a command of glider."""
    command = [sys.executable, "-m", "glider", *map(str, arguments)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def take_report(folder: Path, picture: Path) -> None:
    """The beginning of a report."""
    run("close-the-loop", "attached_lift", "--out", folder)
    with opened((folder / "report.html").as_uri(), 1000, 1150) as window:
        assert window.wait_for(lambda: window.page.locator(".main-svg").count() > 0)
        window.page.screenshot(path=picture)


def take_lab(folder: Path, picture: Path) -> None:
    """The page of a session, once its throws are traced."""
    sample = campaign_folder("head_wind")
    shutil.copy(sample / "campaign.yaml", folder)
    for flight in sorted(sample.glob("flight_*.csv"))[:THROWS]:
        shutil.copy(flight, folder)
    command = [sys.executable, "-m", "glider", "lab", str(folder)]
    with subprocess.Popen(command, text=True, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address is not None
        with opened(address[0], 1000, 1500) as window:
            found = window.page.locator("#headline")
            assert window.wait_for(lambda: "wind" in found.inner_text().lower())
            window.page.wait_for_timeout(3000)  # Figures follow.
            window.page.screenshot(path=picture)
        process.send_signal(signal.SIGINT)
        process.communicate()


def take_next_throw(folder: Path, picture: Path) -> None:
    """The figure of proposed throws."""
    run("close-the-loop", "four_at_once", "--out", folder / "report")
    proposal = folder / "next"
    report = folder / "report"
    run("next-throw", "four_at_once", "--report", report, "--out", proposal)
    shutil.copy(proposal / "next_throw.png", picture)


def take_rehearsal(folder: Path, picture: Path) -> None:
    """The power of a campaign over the size of effects."""
    run("rehearse", "attached_lift", "--no-flights", "--out", folder / "rehearsal")
    shutil.copy(folder / "rehearsal" / "rehearsal.png", picture)


def take_funnel_in_meshcat(folder: Path, picture: Path) -> None:
    """The tube of a shipped funnel and its nominal flight."""
    from diagrams.playback import play, track_of
    from diagrams.programs.page import open_meshcat, page_of
    from diagrams.tube import draw_tube
    from glider.paths import models_path
    from glider.verification.funnel.funnel import funnel_policy, load_funnel

    funnel = load_funnel(models_path("funnels", "drawn_hook.npz"))
    meshcat = open_meshcat()
    draw_tube(meshcat, funnel)
    track = track_of("nominal flight", funnel_policy(funnel).plan)
    play([track], meshcat, rate=0.25)
    page = folder / "funnel.html"
    page.write_text(page_of(meshcat, [track], "Funnel", 0.25), encoding="utf-8")
    with opened(page.as_uri(), 1000, 520) as window:
        window.page.wait_for_timeout(8000)  # The animation begins.
        window.page.screenshot(path=picture)


def take_launch_map(folder: Path, picture: Path) -> None:
    """The launches from which there is a plan."""
    script = ROOT / "examples" / "launch_map.py"
    subprocess.run([sys.executable, script, "--figure", picture], check=True)


JOBS: dict[str, Callable[[Path, Path], None]] = {
    "report": take_report,
    "lab": take_lab,
    "next_throw": take_next_throw,
    "rehearsal": take_rehearsal,
    "funnel_in_meshcat": take_funnel_in_meshcat,
    "launch_map": take_launch_map,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or JOBS:
        with tempfile.TemporaryDirectory() as folder:
            JOBS[name](Path(folder), PICTURES / f"{name}.png")
        print(PICTURES / f"{name}.png")
