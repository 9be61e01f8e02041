"""Every command of `docs/recordings.md` is run, on recordings of its layouts, and prints what stands there."""

from __future__ import annotations

import re
import shlex
import subprocess
from dataclasses import dataclass
from pathlib import Path

import layouts
import pytest

ROOT = Path(__file__).resolve().parents[2]
GUIDE = ROOT / "docs/recordings.md"
# Of a run that is over, how long it took is all that may differ.
TIMING = re.compile(r" in [\d.]+ s \([^)]*\)")


@dataclass(frozen=True)
class Shown:
    """A command of the guide with the lines it is said to print; a line `…` stands for any number of them."""

    command: str
    lines: tuple[str, ...]


def shown() -> list[Shown]:
    found = []
    for block in re.findall(r"^```console\n(.*?)^```", GUIDE.read_text(), flags=re.MULTILINE | re.DOTALL):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, *lines = part.splitlines()
            found.append(Shown(command, tuple(lines)))
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return layouts.write_all(tmp_path_factory.mktemp("guide") / "recordings", ROOT)


@pytest.mark.parametrize("shown", shown(), ids=lambda s: s.command[:60])
def test_the_guide_shows_what_is_printed(coact: Path, folder: Path, tmp_path: Path, shown: Shown) -> None:
    program, *args = shlex.split(shown.command)
    assert program == "coact"
    if "-o" in args:
        args[args.index("-o") + 1] = str(tmp_path / "out")
    done = subprocess.run([coact, *args], cwd=folder, capture_output=True, text=True, timeout=60, check=False)
    # In a terminal diagnostics come first, then the summary, and last why nothing came out.
    last = "coact: no episode came out\n"
    found = done.stderr.removesuffix(last) + done.stdout + (last if done.stderr.endswith(last) else "")
    pattern = "".join(
        r"(?:.*\n)*" if line == "…" else re.escape(TIMING.sub(" in …", line)) + r"\n" for line in shown.lines
    )
    found = TIMING.sub(" in …", found)
    assert re.fullmatch(pattern, found), found
    is_failure = any(" failed: " in line for line in shown.lines)
    has_losses = any(re.search(r"refused$| recovered: ", line) for line in shown.lines)
    assert done.returncode == (1 if is_failure else 3 if has_losses else 0)


def test_links_lead_somewhere() -> None:
    text = GUIDE.read_text()
    headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", heading).strip().lower().replace(" ", "-") for heading in headings}
    for target in re.findall(r"\]\(([^)]+)\)", text):
        if target.startswith("#"):
            assert target[1:] in anchors
        else:
            assert (GUIDE.parent / target).exists()
