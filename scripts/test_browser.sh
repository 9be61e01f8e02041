#!/usr/bin/env bash
# The tests of the report in headless Chromium, in a virtual environment of their own. Chromium is CHROMIUM, or that of
# the system, or is installed: Debian's where apt-get may, else the one that Playwright brings.
# Example: scripts/test_browser.sh -k phone
set -euo pipefail
cd "$(dirname "$0")/.."

python=${PYTHON:-python3}
venv=${COACT_BROWSER_VENV:-.venv-browser}
"$python" -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r tests/browser/requirements.txt
if [ -z "${CHROMIUM:-}" ] && ! command -v chromium >/dev/null; then
    if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ] &&
        apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core >/dev/null; then
        :
    else
        "$venv/bin/python" -m playwright install --with-deps chromium
    fi
fi
cargo build --locked --release
target=$(realpath "${CARGO_TARGET_DIR:-target}")
COACT="$target/release/coact" exec "$venv/bin/python" -m pytest -q tests/browser "$@"
