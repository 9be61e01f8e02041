#!/usr/bin/env bash
# scripts/coact_ray.py on a Ray cluster of two nodes on this machine, one of whose workers is killed. Not part of
# scripts/test.sh: Ray is 800 MB. Linux. Example: scripts/test_ray.sh
set -euo pipefail
cd "$(dirname "$0")/.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python=${PYTHON:-python3}
pip() { "$work/venv/bin/python" -m pip install --quiet --disable-pip-version-check "$@"; }

"$python" -m venv "$work/venv"
pip "$(grep '^maturin==' scripts/requirements-wheel.txt)"
"$work/venv/bin/maturin" build --quiet --release --out "$work/wheels"
pip -c scripts/requirements.txt "$work"/wheels/*.whl mcap polars -r scripts/requirements-ray.txt

RAY_USAGE_STATS_ENABLED=0 "$work/venv/bin/python" scripts/ray_check.py fixtures --shards 8
