//! Lays out the memory of the board and passes the linker's arguments. Does nothing for the host.
//!
//! The arguments stand here and not in `.cargo/config.toml`, because flags there can fail to apply without a
//! word, and an image that lacks them links to an empty file.

use std::path::PathBuf;
use std::process::Command;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-check-cfg=cfg(rp2350)");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return Ok(());
    }

    let rp2350 = env::var("TARGET").is_ok_and(|target| target.starts_with("thumbv8m"));
    let memory = if rp2350 {
        "memory-rp2350.x"
    } else {
        "memory-rp2040.x"
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(memory, out.join("memory.x"))?;
    println!("cargo:rerun-if-changed={memory}");
    println!("cargo:rustc-link-search={}", out.display());

    // Keeps the segments of the flash image together instead of padding them to pages.
    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    if rp2350 {
        println!("cargo:rustc-cfg=rp2350");
    } else {
        // The second-stage boot loader, which the RP2040 wants in the first 256 bytes of the flash.
        println!("cargo:rustc-link-arg-bins=-Tlink-rp.x");
    }
    println!("cargo:rustc-link-arg-bins=-Tdefmt.x");

    // What it is built from, and whether that was changed since.
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    let commit = git(&["rev-parse", "--short=8", "HEAD"]).unwrap_or_default();
    let changed = git(&["status", "--porcelain", "--", ".", "../protocol", "../Cargo.lock"]);
    println!("cargo:rustc-env=RCG_COMMIT={}", commit.get(..8).unwrap_or("0"));
    let modified = changed.is_none_or(|changed| !changed.is_empty());
    println!(
        "cargo:rustc-env=RCG_MODIFIED={}",
        if modified { "yes" } else { "" }
    );
    for file in ["src", "../protocol/src", "../Cargo.lock"] {
        println!("cargo:rerun-if-changed={file}");
    }
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo:rerun-if-changed={log}");
    }

    // Without this defmt compiles everything below `error` out.
    println!("cargo:rerun-if-env-changed=DEFMT_LOG");
    let level = env::var("DEFMT_LOG").unwrap_or_else(|_| "info".into());
    println!("cargo:rustc-env=DEFMT_LOG={level}");
    Ok(())
}
