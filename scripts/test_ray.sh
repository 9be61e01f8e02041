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
pip -c scripts/requirements.txt "$work"/wheels/*.whl polars -r scripts/requirements-ray.txt

cargo build --quiet --locked --release --example generate_recording
generate=$(realpath "${CARGO_TARGET_DIR:-target}")/release/examples/generate_recording
mkdir "$work/generated"
"$generate" many 20 "$work/generated/many"
"$generate" json 40 "$work/generated/large.mcap"

RAY_USAGE_STATS_ENABLED=0 "$work/venv/bin/python" scripts/ray_check.py fixtures "$work/generated" --shards 8
