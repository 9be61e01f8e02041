"""Every command of the guides in `docs/` is run, on recordings of theirs, and prints what stands there."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import layouts
import pytest

ROOT = Path(__file__).resolve().parents[2]
GUIDE = ROOT / "docs/recordings.md"
IN_CI = ROOT / "docs/in-ci.md"
SCALING = ROOT / "docs/scaling.md"
IN_SHARDS = ("acrobot", "boxing_ram", "cartpole", "halfcheetah", "mountaincar", "pendulum")
# Of a run that is over, how long it took is all that may differ.
TIMING = re.compile(r" in [\d.]+ s \([^)]*\)")


@dataclass(frozen=True)
class Shown:
    """A command of the guide with the lines it is said to print; a line `…` stands for any number of them."""

    command: str
    lines: tuple[str, ...]


def shown(guide: Path = GUIDE) -> list[Shown]:
    found = []
    for block in re.findall(r"^```console\n(.*?)^```", guide.read_text(), flags=re.MULTILINE | re.DOTALL):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, *lines = part.splitlines()
            found.append(Shown(command, tuple(lines)))
    return found


def assert_prints(shown: Shown, found: str) -> None:
    pattern = "".join(
        r"(?:.*\n)*" if line == "…" else re.escape(TIMING.sub(" in …", line)) + r"\n" for line in shown.lines
    )
    found = TIMING.sub(" in …", found)
    assert re.fullmatch(pattern, found), found


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
    assert_prints(shown, found)
    is_failure = any(" failed: " in line for line in shown.lines)
    has_losses = any(re.search(r"refused$| recovered: ", line) for line in shown.lines)
    assert done.returncode == (1 if is_failure else 3 if has_losses else 0)


@pytest.mark.parametrize(
    ("guide", "recordings"), [(IN_CI, ("cartpole", "pendulum")), (SCALING, IN_SHARDS)], ids=["in-ci", "scaling"]
)
def test_the_commands_of_a_guide_go_on_from_one_another(
    coact: Path, tmp_path: Path, guide: Path, recordings: tuple[str, ...]
) -> None:
    """They are run in order and in one folder."""
    (tmp_path / "recordings").mkdir()
    for name in recordings:
        shutil.copy(ROOT / "fixtures/recordings" / f"{name}.mcap", tmp_path / "recordings")
    code = 0
    for command in shown(guide):
        if command.command == "echo $?":
            assert_prints(command, f"{code}\n")
            continue
        program, *args = shlex.split(command.command)
        assert program == "coact"
        done = subprocess.run([coact, *args], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
        code = done.returncode
        assert_prints(command, done.stderr + done.stdout)


@pytest.mark.parametrize("guide", [GUIDE, IN_CI, SCALING], ids=lambda guide: guide.name)
def test_links_lead_somewhere(guide: Path) -> None:
    text = guide.read_text()
    headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", heading).strip().lower().replace(" ", "-") for heading in headings}
    for target in re.findall(r"\]\(([^)]+)\)", text):
        if target.startswith("#"):
            assert target[1:] in anchors
        else:
            assert (guide.parent / target).exists()
