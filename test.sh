#!/usr/bin/env bash
# All tests of RCG, on a fresh Debian machine with rustup too: builds the firmware for its real targets, checks
# format and lints with warnings as errors, runs every test. Installs what is missing where it can.
set -euo pipefail
cd "$(dirname "$0")"

step() { printf '\n== %s\n' "$*"; }

step "toolchain"
# rust-toolchain.toml names the toolchain; where rustup does not install by itself this does.
if ! command -v cc >/dev/null && command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    apt-get update -qq && apt-get install -y -qq gcc libc6-dev
fi
if command -v rustup >/dev/null; then
    channel=$(sed -n 's/^channel = "\(.*\)"/\1/p' rust-toolchain.toml)
    rustup run "$channel" rustc --version >/dev/null 2>&1 ||
        rustup toolchain install "$channel" --profile minimal --no-self-update
    have() { rustup "$1" list --installed --toolchain "$channel" | grep -q "$2"; }
    for component in clippy rustfmt; do
        have component "$component" || rustup component add "$component" --toolchain "$channel"
    done
    for target in thumbv6m-none-eabi thumbv8m.main-none-eabihf; do
        have target "$target" || rustup target add "$target" --toolchain "$channel"
    done
fi
rustc --version

step "format"
cargo fmt --all --check

step "firmware: build for RP2040 and RP2350"
cargo fw
cargo fw-rp2350

step "firmware: lints"
cargo clippy --profile firmware --package rcg-firmware --bin rcg-firmware --target thumbv6m-none-eabi -- -D warnings

step "host: lints"
cargo clippy --workspace --all-targets --all-features -- -D warnings

step "tests"
# The release build of the command is the README's other half; a test that needs it finds it built.
RCG_FIRMWARE_ELF="$PWD/target/thumbv6m-none-eabi/firmware/rcg-firmware" \
    cargo test --workspace --all-features

step "passed"
