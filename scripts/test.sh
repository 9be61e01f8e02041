#!/usr/bin/env bash
# All tests: the Rust tests, then the Python tests against the binary, in a virtual environment of their own, then those
# of the wheel, then the report in a browser.
# Needs Rust and Python 3.11 or newer, nothing else. Example: scripts/test.sh
set -euo pipefail
cd "$(dirname "$0")/.."

cargo test --locked --release

venv=${COACT_VENV:-.venv}
scripts/venv.sh "$venv" scripts/requirements.txt
cargo build --locked --release
target=$(realpath "${CARGO_TARGET_DIR:-target}")
COACT="$target/release/coact" "$venv/bin/python" -m pytest -q tests/python
scripts/test_wheel.sh

if scripts/test_browser.sh; then :; else
    status=$?
    [ "$status" = 77 ] || exit "$status"
    echo "NOT TESTED: the report in a browser. There is no Chromium here and none could be installed." >&2
fi
