#!/usr/bin/env bash
# The long form of every sweep of faults: recordings cut at each byte and with each byte changed, and runs whose calls
# to the file system fail, whose disk is full, or that are killed. Prints the figures that `tests/README.md` records.
# COACT_SWEEP is the number of kills (60 if not set). Example: scripts/fault_sweep.sh
set -euo pipefail
cd "$(dirname "$0")/.."
export COACT_SWEEP=${COACT_SWEEP:-60}
export RUST_BACKTRACE=0
cargo test --locked --release --test integration --no-run
started=$SECONDS
# One test after the other, so that each one's figures stand below its name.
cargo test --locked --release --test integration -- --nocapture --test-threads 1 hostile durability 2>&1 |
    grep -v '^coact: '
echo "sweeps took $((SECONDS - started)) s"
