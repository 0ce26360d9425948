# Sourced by ./rcg and ./test.sh: what both need to build, installed where it may be, else told in one sentence.
# shellcheck shell=sh

# Installs Debian packages: as root, or where sudo asks for no password.
install_packages() {
    command -v apt-get >/dev/null || return 1
    if [ "$(id -u)" = 0 ]; then
        sudo=
    elif sudo -n true 2>/dev/null; then
        sudo="sudo -n"
    else
        return 1
    fi
    # What is printed belongs to the log, not to the data on stdout.
    $sudo apt-get update -qq >&2 &&
        $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >&2
}

# A C compiler, which links every Rust program, and certificates, without which cargo fetches nothing.
need_compiler() {
    if ! command -v cc >/dev/null; then
        install_packages gcc libc6-dev ca-certificates || true
    fi
    if ! command -v cc >/dev/null; then
        echo "rcg: expected a C compiler (cc), found none; install one (Debian, Ubuntu: sudo apt install gcc libc6-dev; Fedora: sudo dnf install gcc; macOS: xcode-select --install) and start again" >&2
        return 1
    fi
}

# Rust by rustup; rust-toolchain.toml names the toolchain.
need_rust() {
    if ! command -v cargo >/dev/null && [ -x "$HOME/.cargo/bin/cargo" ]; then
        PATH=$HOME/.cargo/bin:$PATH
        export PATH
    fi
    if ! command -v cargo >/dev/null; then
        echo "rcg: expected cargo, found none; install Rust by https://rustup.rs and start again" >&2
        return 1
    fi
    # Where rustup does not install by itself this does.
    if command -v rustup >/dev/null; then
        channel=$(sed -n 's/^channel = "\(.*\)"/\1/p' rust-toolchain.toml)
        rustup run "$channel" rustc --version >/dev/null 2>&1 ||
            rustup toolchain install "$channel" --profile minimal --no-self-update >&2
    fi
}
