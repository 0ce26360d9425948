#!/usr/bin/env bash
# All tests of RCG, on a fresh Debian machine with rustup too: builds the firmware for its real targets, checks
# format, lints and documentation with warnings as errors, runs every test, and the firmware's trials in an emulated
# Pico. Installs what is missing where it can. `./test.sh full` tries all pairs of options with each other, not only some.
set -euo pipefail
cd "$(dirname "$0")"
case "${1:-}" in
    "") ;;
    full) export RCG_FULL=1 ;;
    *) echo "test.sh: expected nothing or \`full\`, found $1" >&2; exit 2 ;;
esac

. ./toolchain.sh

began=$SECONDS
step() {
    if [ -n "${present:-}" ]; then
        printf -- '-- %s: %d s\n' "$present" $((SECONDS - since))
    fi
    present=$*
    since=$SECONDS
    printf '\n== %s\n' "$present"
}

step "toolchain"
need_compiler
need_rust
if command -v rustup >/dev/null; then
    have() { rustup "$1" list --installed --toolchain "$channel" | grep -q "$2"; }
    for component in clippy rustfmt; do
        have component "$component" || rustup component add "$component" --toolchain "$channel"
    done
    for target in thumbv6m-none-eabi thumbv8m.main-none-eabihf; do
        have target "$target" || rustup target add "$target" --toolchain "$channel"
    done
fi
rustc --version

step "emulated Pico"
command -v npm >/dev/null || install_packages nodejs npm ca-certificates || true
if command -v npm >/dev/null; then
    (cd hil/emulator && npm ci --no-audit --no-fund)
else
    echo "no npm: the emulated Pico and its trials are skipped"
fi
# Another emulator of the PIO, to compare with.
python3 -c 'import ensurepip, venv' 2>/dev/null || install_packages python3 python3-venv || true
if python3 -c 'import ensurepip, venv' 2>/dev/null; then
    [ -x hil/emulator/.venv/bin/pip ] || python3 -m venv hil/emulator/.venv
    hil/emulator/.venv/bin/pip install --quiet --disable-pip-version-check -r hil/emulator/requirements.txt
else
    echo "no python3-venv: the emulator is not compared with the other one"
fi

step "format"
cargo fmt --all --check

step "firmware: build for RP2040 at 200 and 125 MHz, and for RP2350"
firmware=$PWD/target/thumbv6m-none-eabi/firmware/rcg-firmware
cargo fw-200mhz
cp "$firmware" "$firmware-200mhz"
cargo fw
cargo fw-rp2350
export RCG_FIRMWARE_ELF=$firmware

step "firmware: lints"
cargo clippy --profile firmware --package rcg-firmware --bin rcg-firmware --target thumbv6m-none-eabi -- -D warnings

step "host: lints"
cargo clippy --workspace --all-targets --all-features -- -D warnings

step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --all-features --quiet

if [ -d hil/emulator/node_modules ]; then
    step "emulator: tests"
    (cd hil/emulator && npm test)
fi

step "tests and trials"
rm -f target/hil-figures.txt
cargo test --workspace --all-features --no-fail-fast

step "passed, in $((SECONDS - began)) s"
if [ -f target/hil-figures.txt ]; then
    echo "what the trials measured:"
    cat target/hil-figures.txt
fi
