#!/usr/bin/env bash
# Tests recordings and tables in object stores: builds with the feature `cloud`, starts an S3 server on this machine, and
# reads and writes through connections that are cut. Example: scripts/test_cloud.sh
set -euo pipefail
cd "$(dirname "$0")/.."

cargo build --locked --release --features cloud
python=${PYTHON:-python3}
venv=${COACT_CLOUD_VENV:-.venv-cloud}
"$python" -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    mcap==1.6.0 'moto[server]==5.2.5' numpy==2.4.6 pyarrow==26.0.1 pytest==9.2.0
target=$(realpath "${CARGO_TARGET_DIR:-target}")
COACT_CLOUD=1 COACT="$target/release/coact" "$venv/bin/python" -m pytest -q --show-capture=no \
    tests/python/test_object_store.py tests/python/test_object_store_output.py
