#!/usr/bin/env bash
# All tests of RCG, on a fresh Debian machine with rustup too: builds the firmware for its real targets, checks
# format, lints and documentation with warnings as errors, runs every test, and the firmware's trials in an emulated
# Pico. Installs what is missing where it can. Says how long each step took, and which tests took longest.
#
# `./test.sh fast`: format, lints of the host, unit tests and mocked links; no emulator, no physics that takes long.
# `./test.sh full`: long tests that are ignored else, more draws, all pairs of options with each other.
set -euo pipefail
cd "$(dirname "$0")"
case "${1:-}" in
    "" | fast) ;;
    full) export RCG_FULL=1 ;;
    *) echo "test.sh: expected nothing, \`fast\` or \`full\`, found $1" >&2; exit 2 ;;
esac
kind=${1:-}

. ./toolchain.sh

began=$SECONDS
times=
step() {
    if [ -n "${present:-}" ]; then
        times+=$(printf '%6d s  %s' $((SECONDS - since)) "$present")$'\n'
    fi
    present=$*
    since=$SECONDS
    printf '\n== %s\n' "$present"
}

# Drivers of cameras need libaravis; without it everything else is built and tested.
need_features() {
    features=--all-features
    if ! pkg-config --exists 'aravis-0.8 >= 0.8.25' 2>/dev/null; then
        install_packages libaravis-dev libusb-1.0-0-dev aravis-tools pkg-config || true
    fi
    if ! pkg-config --exists 'aravis-0.8 >= 0.8.25' 2>/dev/null; then
        echo "no libaravis (Debian: libaravis-dev libusb-1.0-0-dev): the drivers of cameras are skipped"
        features="--features rcg-firmware/clock-200mhz,rcg-cli/collection,rcg-cli/dlpc900,rcg-cli/window,rcg-hil/window"
    fi
}

# In place of a projector's monitor.
need_screen() {
    command -v Xvfb >/dev/null || install_packages xvfb || true
    command -v Xvfb >/dev/null || echo "no Xvfb (Debian: xvfb): the trials of the window are ignored"
}

# Runs `cargo test` with these arguments. Of each test of the standard harness its time is noted.
tests() {
    local host
    host=$(rustc -vV | sed -n 's/^host: //p' | tr 'a-z-' 'A-Z_')
    env "CARGO_TARGET_${host}_RUNNER=$PWD/tests/timed.sh" cargo test --workspace $features --no-fail-fast "$@"
}

finish() {
    step "passed, in $((SECONDS - began)) s"
    printf '%s' "$times"
    echo "the ten slowest tests:"
    sed -nE 's/^test (.*) \.\.\. ok <([0-9.]+)s>$/\2 s  \1/p' target/tests.log | sort -rn | sed -n 1,10p
    if [ -f target/hil-figures.txt ]; then
        echo "what the trials measured:"
        cat target/hil-figures.txt
    fi
}

step "toolchain"
need_compiler
need_rust
need_features
if command -v rustup >/dev/null; then
    have() { rustup "$1" list --installed --toolchain "$channel" | grep "$2" >/dev/null; }
    for component in clippy rustfmt; do
        have component "$component" || rustup component add "$component" --toolchain "$channel"
    done
    for target in thumbv6m-none-eabi thumbv8m.main-none-eabihf; do
        have target "$target" || rustup target add "$target" --toolchain "$channel"
    done
fi
rustc --version
mkdir -p target
rm -f target/tests.log target/hil-figures.txt

if [ "$kind" = fast ]; then
    step "format"
    cargo fmt --all --check
    step "host: lints"
    cargo clippy --workspace --all-targets $features -- -D warnings
    step "unit tests and mocked links"
    tests --lib -- --skip calibrate:: --skip judge::fit:: --skip study:: 2>&1 | tee -a target/tests.log
    tests --test source --test follow --test wire_v1 --test wire_v2 --test properties --test sequencer --test session --test starts --test packets \
        --test at_most_once --test disconnects --test strangers --test streaming --test takeover --test telemetry --test wires 2>&1 | tee -a target/tests.log
    finish
    exit
fi

step "packages of the system"
need_screen
command -v npm >/dev/null || install_packages nodejs npm ca-certificates || true
has_venv() { python3 -c 'import ensurepip, venv' 2>/dev/null; }
has_venv || install_packages python3 python3-venv || true
! command -v npm >/dev/null || command -v chromium >/dev/null || install_packages chromium || true

# What comes over the network comes while the lints keep the cores busy.
python=host/python/.venv
fetch() {
    if command -v npm >/dev/null; then
        (cd hil/emulator && npm ci --no-audit --no-fund)
        (cd tests/page && npm ci --no-audit --no-fund)
    else
        echo "no npm: the emulated Pico and its trials are skipped, and the page of a measurement is not opened"
    fi
    if ! has_venv; then
        echo "no python3-venv: the emulator is not compared with the other one, and the Python package is skipped"
        return
    fi
    # Another emulator of the PIO, to compare with.
    [ -x hil/emulator/.venv/bin/pip ] || python3 -m venv hil/emulator/.venv
    hil/emulator/.venv/bin/pip install --quiet --disable-pip-version-check -r hil/emulator/requirements.txt
    [ -x $python/bin/pip ] || python3 -m venv $python
    $python/bin/pip install --quiet --disable-pip-version-check -r host/python/requirements.txt && touch target/python-is-there ||
        echo "what its tests need cannot be installed: the Python package is skipped"
}
rm -f target/python-is-there
(set -e; fetch) </dev/null >target/fetched.log 2>&1 &
fetching=$!
trap 'kill "$fetching" 2>/dev/null || true' EXIT

step "format"
cargo fmt --all --check

step "licences and advisories"
if command -v cargo-deny >/dev/null; then
    cargo deny check licenses bans sources
    # The list of advisories comes over the network; without one there is nothing to compare with.
    if cargo deny fetch db >/dev/null 2>&1; then
        cargo deny check advisories
    else
        echo "no list of advisories can be fetched: they are skipped"
    fi
else
    echo "no cargo-deny (cargo install cargo-deny --locked): licences and advisories are skipped"
fi

# Linking the firmware keeps one core busy: the host's lints and documentation go on beside it.
firmware=$PWD/target/thumbv6m-none-eabi/firmware/rcg-firmware
firmware() {
    cargo fw-200mhz
    cp "$firmware" "$firmware-200mhz"
    cargo fw
    cargo fw-rp2350
    cargo clippy --profile firmware --package rcg-firmware --bin rcg-firmware --target thumbv6m-none-eabi -- -D warnings
}
(set -e; firmware) >target/firmware.log 2>&1 &
building=$!
trap 'kill "$building" "$fetching" 2>/dev/null || true' EXIT

step "host: lints"
cargo clippy --workspace --all-targets $features -- -D warnings

step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps $features --quiet

step "firmware: build for RP2040 at 200 and 125 MHz and for RP2350, and lints: the rest of it"
wait "$building" || { cat target/firmware.log; exit 1; }
wait "$fetching" || { cat target/fetched.log; exit 1; }
trap - EXIT
grep -hE "^no |skipped" target/fetched.log || true
grep -E "Finished|warning" target/firmware.log
export RCG_FIRMWARE_ELF=$firmware

if [ -d hil/emulator/node_modules ]; then
    step "emulator: tests"
    # Behind a pipe of its own: node makes one that it inherits non-blocking for all who write into it.
    (cd hil/emulator && npm test) 2>&1 | cat
fi

# Trials wait for an emulated Pico half of their time: the other tests go on beside them.
step "tests: build"
tests --no-run
step "tests"
(set -e; tests --test trials) >target/trials.log 2>&1 &
trials=$!
trap 'kill "$trials" 2>/dev/null || true' EXIT
RCG_TRIALS_APART=1 tests 2>&1 | tee -a target/tests.log
step "trials: the rest of them"
wait "$trials" || { cat target/trials.log; exit 1; }
trap - EXIT
tail -n 12 target/trials.log

# The browser keeps one core busy: the Python package is tested beside it.
browser=
if [ -d tests/page/node_modules ] && command -v chromium >/dev/null; then
    (cd tests/page && npm test) >target/page.log 2>&1 &
    browser=$!
    trap 'kill "$browser" 2>/dev/null || true' EXIT
else
    echo "no npm or no chromium: the page of a measurement is not opened"
fi

step "Python package"
if [ -e target/python-is-there ]; then
    # With the features of the tests: maturin would build the library a second time.
    cargo build --workspace $features --lib
    cp target/debug/lib_rcg.so host/python/rcg/_rcg.abi3.so
    (cd host/python && .venv/bin/python -m pytest --quiet --durations=5)
    if [ "$kind" = full ]; then
        # The wheel that users build.
        $python/bin/pip install --quiet --no-deps --no-build-isolation --upgrade --target target/wheel ./host/python
        PYTHONPATH=target/wheel $python/bin/python -P -c 'import rcg; print(rcg.__file__, rcg.info("satin")["format"])'
    fi
fi

step "page of a measurement, in a browser: the rest of it"
if [ -n "$browser" ]; then
    wait "$browser" || { cat target/page.log; exit 1; }
    trap - EXIT
    tail -n 12 target/page.log
fi

if [ "$kind" = full ]; then
    step "micromirrors behind a real hidraw, in an emulated PC"
    machine() { command -v qemu-system-x86_64 >/dev/null && command -v cpio >/dev/null && [ -x /bin/busybox ]; }
    machine || install_packages qemu-system-x86 cpio busybox-static || true
    if machine; then
        hil/guest/run.sh
    else
        echo "no qemu-system-x86, cpio or busybox-static: the emulated PC is skipped"
    fi
fi

# Of each rig as many measurements, by the commands: none may be wrong in silence.
rigs=4
requests=2
if [ "$kind" = full ]; then
    rigs=10
    requests=3
fi
step "random worlds: $rigs rigs × $requests"
target/debug/rcg worlds --count "$rigs" --requests "$requests" --seed 11 --jobs "$(nproc)"
finish
