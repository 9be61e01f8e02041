#!/usr/bin/env bash
# All tests: the Rust tests, then the Python tests against the binary, in a virtual environment of their own, then those
# of the wheel.
# Needs Rust and Python 3.11 or newer, nothing else. Example: scripts/test.sh
set -euo pipefail
cd "$(dirname "$0")/.."

cargo test --locked --release

python=${PYTHON:-python3}
venv=${COACT_VENV:-.venv}
if ! "$python" -m venv "$venv" 2>/dev/null; then
    # Debian splits venv from Python.
    if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
        apt-get update -qq && apt-get install -y -qq python3-venv
    fi
    "$python" -m venv "$venv"
fi
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r scripts/requirements.txt
cargo build --locked --release
target=$(realpath "${CARGO_TARGET_DIR:-target}")
COACT="$target/release/coact" "$venv/bin/python" -m pytest -q tests/python
scripts/test_wheel.sh
