#!/usr/bin/env bash
# The tests of the report in headless Chromium, in a virtual environment of their own. The browser is CHROMIUM, or one
# of the system; else it is installed: Debian's by apt-get where root may, or the one that Playwright brings.
# Exit code 77: there is none. Example: scripts/test_browser.sh -k phone
set -euo pipefail
cd "$(dirname "$0")/.."

# Debian's is a program; Ubuntu's of that name asks for a snap. So each is tried.
find_chromium() {
    for name in "${CHROMIUM:-}" chromium google-chrome chrome; do
        if [ -n "$name" ] && "$name" --version >/dev/null 2>&1; then
            command -v "$name"
            return
        fi
    done
    return 1
}

venv=${COACT_BROWSER_VENV:-.venv-browser}
scripts/venv.sh "$venv" tests/browser/requirements.txt
if ! CHROMIUM=$(find_chromium); then
    if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
        { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core; } >/dev/null || true
    fi
    # Where this finds none either, conftest.py takes what Playwright has.
    CHROMIUM=$(find_chromium) || "$venv/bin/python" -m playwright install chromium || exit 77
fi
export CHROMIUM
cargo build --locked --release
target=$(realpath "${CARGO_TARGET_DIR:-target}")
COACT="$target/release/coact" "$venv/bin/python" -m pytest -q tests/browser "$@"
