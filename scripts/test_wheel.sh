#!/usr/bin/env bash
# The wheel as a user gets it: built from the release build that is there, installed into a fresh virtual environment,
# its types checked, its tests (tests/wheel) run. Output: the wheel in target/wheels. Example: scripts/test_wheel.sh
set -euo pipefail
cd "$(dirname "$0")/.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python=${PYTHON:-python3}
pip() { "$1/bin/python" -m pip install --quiet --disable-pip-version-check "${@:2}"; }

"$python" -m venv "$work/build"
pip "$work/build" -r scripts/requirements-wheel.txt
"$work/build/bin/maturin" build --quiet --release --out "$work/wheels"

"$python" -m venv "$work/venv"
# The wheel with what it asks for itself: that it is enough is what the first test is for.
pip "$work/venv" -c scripts/requirements.txt "$work"/wheels/*.whl pytest
"$work/venv/bin/python" -m pytest -q tests/wheel/test_alone.py
pip "$work/venv" -c scripts/requirements.txt mcap pandas polars
"$work/venv/bin/python" -m pytest -q tests/wheel --ignore tests/wheel/test_alone.py

# From a folder without pyproject.toml, as a user's own: the installed package is seen, not the sources.
"$work/build/bin/mypy" --config-file pyproject.toml --python-executable "$work/venv/bin/python" \
    --cache-dir "$work/mypy" python/coact tests/wheel/typed_use.py

mkdir -p target/wheels
mv "$work"/wheels/*.whl target/wheels/
