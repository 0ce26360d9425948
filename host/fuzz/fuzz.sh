#!/bin/sh
# Draws inputs for one of the targets with libFuzzer, by the project's own compiler (cargo-fuzz asks for a nightly one):
#     host/fuzz/fuzz.sh readers -max_total_time=600
# What it learns stays in corpus/TARGET, which may hold files to begin from; what it breaks is kept in artifacts/.
set -eu
cd "$(dirname "$0")"
[ $# -gt 0 ] || { echo "fuzz.sh: expected one of $(cd fuzz_targets && ls | sed 's/\.rs//' | tr '\n' ' ')and libFuzzer's options, found nothing" >&2; exit 2; }
target=$1
shift
host=$(rustc -vV | sed -n 's/^host: //p')
coverage="-Cpasses=sancov-module"
for wanted in level=4 inline-8bit-counters pc-table trace-compares; do
    coverage="$coverage -Cllvm-args=-sanitizer-coverage-$wanted"
done
RUSTFLAGS="$coverage --cfg fuzzing" \
    CARGO_PROFILE_RELEASE_DEBUG_ASSERTIONS=true CARGO_PROFILE_RELEASE_OVERFLOW_CHECKS=true \
    cargo build --release --target "$host" --bin "$target"
mkdir -p "corpus/$target" artifacts
exec "target/$host/release/$target" "corpus/$target" -rss_limit_mb=1024 -timeout=20 -artifact_prefix=artifacts/ "$@"
