#!/usr/bin/env bash
# Runs every fuzz target for so many minutes, one after the other, and stops at the first find. Needs cargo-fuzz
# (`cargo install cargo-fuzz`) and a C++ compiler; stable Rust will do. A find is kept in fuzz/artifacts: mend it, and
# move its input to fuzz/corpus, where `cargo test` runs it ever after.
# Example: scripts/fuzz.sh 10          all targets, ten minutes each
#          scripts/fuzz.sh 60 cdr      one target, an hour
set -euo pipefail
cd "$(dirname "$0")/.."
minutes=${1:?minutes for each target}
shift
targets=("$@")
if [ ${#targets[@]} = 0 ]; then
    mapfile -t targets < <(cargo fuzz list)
fi
# cargo-fuzz asks rustc for coverage that only a nightly offers by itself. No unsafe code of ours is run, so there is
# nothing for a sanitizer to see, and without one four times as many inputs go through.
export RUSTC_BOOTSTRAP=1
cargo fuzz build --sanitizer none
for target in "${targets[@]}"; do
    echo "== $target: $minutes minutes"
    # What is found on the way grows in a folder of its own; the corpus under version control stays small.
    grown=fuzz/target/corpus/$target
    mkdir -p "$grown" "fuzz/artifacts/$target"
    "fuzz/target/$(rustc -vV | sed -n 's/^host: //p')/release/$target" \
        "$grown" "fuzz/corpus/$target" -artifact_prefix="fuzz/artifacts/$target/" \
        -max_total_time=$((60 * minutes)) -timeout=20 -rss_limit_mb=2048 -max_len=16384 -print_final_stats=1 2>&1 |
        grep -E '^(==|stat::|Done|SUMMARY|thread|artifact|.*(panicked|ERROR|Test unit))' || true
    if [ -n "$(ls -A "fuzz/artifacts/$target")" ]; then
        echo "$target: a find, see fuzz/artifacts/$target"
        exit 1
    fi
done
rm -rf /dev/shm/coact-fuzz-*
